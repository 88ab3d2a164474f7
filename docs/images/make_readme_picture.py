"""Compose the README's picture from a compared session.

Run: python docs/images/make_readme_picture.py SESSION OUTPUT.png

Upper row: what the camera should see, and what it saw without and with compensation (strategy bounded).
Lower row: how much light the room adds, and the two errors. All on the session's one brightness scale.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from rig import Session, SessionResult
from rig.stages.model import load_model_record

Image = NDArray[np.floating]
_ERROR_RANGE = 64
_EVERY = 3
"""Every third pixel is enough for a page."""


def main(session_folder: str, output: str) -> None:
    """Write the picture."""
    with Session.open(session_folder) as session:
        compared = session.finished("compare")
        scale = 255 / load_model_record(session).level
        judged = compared.load_image("judged")
        measured = {name: compared.load_image(f"measured-{name}")["light"] * scale for name in ("none", "bounded")}
        light = session.finished("separation").load_image("separation")
        errors = session.read_metrics(SessionResult).strategies
    mask = judged["mask"] > 0
    share = light["global"] / np.maximum(light["white"], 1e-9)
    figure, axes = plt.subplots(2, 3, figsize=(11, 6.1), dpi=82, layout="constrained")
    _grey(axes[0, 0], judged["target"], mask, "target")
    _grey(axes[0, 1], measured["none"], mask, "camera, uncompensated (best single gain)")
    _grey(axes[0, 2], measured["bounded"], mask, "camera, compensated (bounded)")
    bar = axes[1, 0].imshow(_cut(100 * share, mask), cmap="magma", vmin=0, vmax=100)
    axes[1, 0].set_title("share of light reflected more than once", fontsize=10)
    figure.colorbar(bar, ax=axes[1, 0], location="bottom", shrink=0.7, label="%")
    for axis, name in zip(axes[1, 1:], ("none", "bounded"), strict=True):
        error = _cut(measured[name] - judged["target"], mask)
        bar = axis.imshow(error, cmap="RdBu_r", vmin=-_ERROR_RANGE, vmax=_ERROR_RANGE)
        axis.set_title(f"error: mean {errors[name].measured.mean:.1f} grey levels of 255", fontsize=10)
    figure.colorbar(bar, ax=axes[1, 1:], location="bottom", shrink=0.4, label="measured − target, grey levels")
    for axis in axes.flat:
        axis.set_axis_off()
    figure.savefig(output, metadata={"Software": None})


def _cut(image: Image, mask: NDArray[np.bool_]) -> Image:
    """Cut out the judged part of the picture, thinned; NaN outside."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    inside = np.where(mask, image, np.nan)
    return inside[rows[0] : rows[-1] : _EVERY, columns[0] : columns[-1] : _EVERY]


def _grey(axis: Axes, image: Image, mask: NDArray[np.bool_], title: str) -> None:
    axis.imshow(_cut(image, mask), cmap="gray", vmin=0, vmax=255)
    axis.set_title(title, fontsize=10)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*(str(Path(argument)) for argument in sys.argv[1:]))
