"""Photographs from the files inside scikit-image's wheel, with the statistics that the paper publishes of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import skimage.data
from numpy.typing import NDArray
from skimage.color import rgb2gray
from skimage.transform import resize

from rig.files.pictures import centre_crop

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Photograph:
    """Where a photograph comes from, and the statistics that the paper gives for its own."""

    source: str
    mean: float
    sd: float


PHOTOGRAPHS = {
    "outdoor": Photograph("skimage.data.camera (CC0)", 123.0, 46.0),
    "indoor": Photograph("skimage.data.coffee (CC0)", 102.0, 52.0),
}
_LOADERS = {"outdoor": skimage.data.camera, "indoor": skimage.data.coffee}


def photograph(name: str, shape: tuple[int, int]) -> FloatArray:
    """(H, W) grey levels in 0 ... 255, cut to the aspect, resized, with the published mean and sd."""
    image = np.asarray(_LOADERS[name]())  # type: ignore[no-untyped-call]
    grey = 255 * rgb2gray(image) if image.ndim == 3 else image.astype(np.float64)
    cut = _cut_to_aspect(grey, shape[1] / shape[0])
    resized = resize(cut, shape, order=1, anti_aliasing=True)  # type: ignore[no-untyped-call]
    return rescaled(resized, PHOTOGRAPHS[name].mean, PHOTOGRAPHS[name].sd)


def rescaled(image: FloatArray, mean: float, sd: float) -> FloatArray:
    """Give an image this mean and standard deviation within 0 ... 255; iterates, since the range clips."""
    values = np.asarray(image, dtype=np.float64)
    for _ in range(200):
        values = np.clip((values - values.mean()) / values.std() * sd + mean, 0, 255)
    return values


def _cut_to_aspect(image: FloatArray, aspect: float) -> FloatArray:
    height, width = image.shape
    wide, tall = min(width, round(height * aspect)), min(height, round(width / aspect))
    return centre_crop(image, (tall, wide))
