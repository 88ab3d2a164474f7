"""Pictures that strategies are compared on beside the user's own: two walls black and white, one dark, one bright."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.files.photographs import photograph, rescaled
from rig.stages.model import FittedScene
from rig.stages.scene_model import SceneModel
from rig.stages.surface.scene import upright_regions
from rig.stages.target import Target

FloatArray = NDArray[np.float64]

DARK = ("indoor", 40.0, 30.0)
"""Photograph, mean and standard deviation in grey levels."""
BRIGHT = ("outdoor", 180.0, 45.0)


@dataclass(frozen=True, eq=False)
class ComparisonPicture:
    """A target with the name that its files and its rows have."""

    name: str
    target: Target


def pictures_for(model: FittedScene, target: Target) -> list[ComparisonPicture]:
    """The user's picture first; the others are grey."""
    shape = model.scene_model.projector.lens.shape
    return [
        ComparisonPicture("target", target),
        ComparisonPicture(
            "two-walls", _grey("one wall white, the other black", two_walls(model.scene_model), model.channels)
        ),
        ComparisonPicture("dark", _photograph(*DARK, shape, model.channels)),
        ComparisonPicture("bright", _photograph(*BRIGHT, shape, model.channels)),
    ]


def two_walls(scene_model: SceneModel) -> NDArray[np.float32]:
    """(H, W) white on the wall that fills most of the picture, black on the second; floor and ceiling by their side.

    With one wall only, the left half is white.
    """
    height, width = scene_model.projector.lens.shape
    face = scene_model.projector_hits.hits.face
    column = np.tile(np.arange(width), height)
    upright = upright_regions(scene_model.scene).tolist()
    counts = {k: int((face == k).sum()) for k in upright}
    first, second = sorted(upright, key=lambda k: -counts[k])[:2] if len(upright) > 1 else (0, 0)
    if not counts.get(second) or first == second:
        return _levels(column < width / 2, (height, width))
    places = column[face == first].mean(), column[face == second].mean()
    nearer = np.abs(column - places[0]) < np.abs(column - places[1])
    return _levels((face == first) | (nearer & (face != second)), (height, width))


def _levels(white: NDArray[np.bool_], shape: tuple[int, int]) -> NDArray[np.float32]:
    return np.where(white, 255.0, 0.0).reshape(shape).astype(np.float32)


def _photograph(name: str, mean: float, sd: float, shape: tuple[int, int], channels: int) -> Target:
    grey = rescaled(photograph(name, shape), mean, sd).astype(np.float32)
    return _grey(f"photograph '{name}', mean {mean:g}, sd {sd:g}", grey, channels)


def _grey(title: str, levels: NDArray[np.float32], channels: int) -> Target:
    return Target(name=title, levels=np.repeat(levels[..., None], channels, axis=2))
