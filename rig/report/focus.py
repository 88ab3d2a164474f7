"""Where to focus: the blur of both lenses over their pictures, and in words where it is sharp and which way to turn."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from calibration.light.blur import LensBlur
from rig.report.pictures import png_figure
from rig.stages.light.records import BlurRecord, SeparationRecord
from rig.stages.model import FittedScene

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_SHARP_PX = 0.7
"""Standard deviation with which lines one pixel wide keep 9 % of their contrast, exp(-π² σ² / 2): hardly seen."""
_WORST_SHOWN_PX = 1.5
"""End of the colour scale."""
_COLOURS = "RdYlGn_r"
_HOLES_OF_WIDTH = 40
_PARTS = (("upper left", "top", "upper right"), ("left", "middle", "right"), ("lower left", "bottom", "lower right"))
_TELLING_RATIO, _TELLING_SIGMAS = 1.25, 3.0
"""Of the blur at far and near places: closer together, distance does not tell which way to turn."""
_LEAST_SPREAD = 1.2
"""Of the distances: in a picture of one distance blur cannot follow it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FocusOf:
    """One device's blur where its picture was measured."""

    role: str
    sigma_px: FloatArray
    """(H, W)."""
    known_px: float
    """Standard deviation of that in the middle."""
    measured: BoolArray
    """(H, W)."""
    distance_m: FloatArray
    """(H, W) from the device to what its pixels meet."""

    @property
    def sentence(self) -> str:
        """How sharp it is, where, and which way to turn."""
        if not self.measured.any():
            return f"Nothing of the {self.role}'s picture was measured."
        values = self.sigma_px[self.measured]
        share = float((values <= _SHARP_PX).mean())
        if share > 0.99:
            judged = "sharp everywhere"
        elif share < 0.01:
            judged = "sharp nowhere"
        else:
            judged = f"sharp over {100 * share:.0f} % of what was measured"
        return f"The {self.role} is {judged}: {self._places(values)}{self._way() if share <= 0.99 else ''}"

    def _places(self, values: FloatArray) -> str:
        low, high = float(values.min()), float(values.max())
        known = f"± {self.known_px:.2f} px"
        if high - low <= 2 * self.known_px:
            return f"{float(np.median(values)):.2f} px {known}, the same all over."
        best, worst = self._part_of(smallest=True), self._part_of(smallest=False)
        return f"{low:.2f} px at the {best}, {high:.2f} px at the {worst} ({known})."

    def _part_of(self, *, smallest: bool) -> str:
        """Part of the picture in which the sharpest, or the least sharp, measured pixel lies."""
        hidden = np.inf if smallest else -np.inf
        values = np.where(self.measured, self.sigma_px, hidden)
        at = np.argmin(values) if smallest else np.argmax(values)
        row, column = np.unravel_index(int(at), values.shape)
        return _PARTS[3 * int(row) // values.shape[0]][3 * int(column) // values.shape[1]]

    def _way(self) -> str:
        """Whether near or far places are sharper: the focus is on that side of the others."""
        distance, variance = self.distance_m[self.measured], self.sigma_px[self.measured] ** 2
        usable = np.isfinite(distance)
        if not usable.any():
            return ""
        ends = np.quantile(distance[usable], [0.1, 0.9])
        near, far = (
            float(np.sqrt(np.median(variance[usable & chosen])))
            for chosen in (distance <= ends[0], distance >= ends[1])
        )
        telling = max(near, far) > _TELLING_RATIO * min(near, far) and abs(near - far) > _TELLING_SIGMAS * self.known_px
        if ends[1] < _LEAST_SPREAD * ends[0] or not telling:
            return " Its blur does not follow distance: turn the focus a little either way and measure again."
        side, way = ("near", "farther") if near < far else ("far", "nearer")
        return (
            f" What is {side} is sharper ({near:.2f} px at {ends[0]:.1f} m, {far:.2f} px at {ends[1]:.1f} m): "
            f"focus {way}."
        )


def focus_of(model: FittedScene, record: SeparationRecord) -> tuple[FocusOf, FocusOf]:
    """Return the blur of projector and camera, each over its own picture."""
    scene_model = model.scene_model
    projector = _focus(
        "projector",
        record.projector_blur,
        model.room.active.reshape(scene_model.projector.lens.shape),
        np.linalg.norm(scene_model.projector_hits.points_m - scene_model.projector.pose.position_m, axis=1),
    )
    camera = _focus(
        "camera",
        record.camera_blur,
        model.lit,
        np.linalg.norm(scene_model.camera_hits.points_m - scene_model.camera.pose.position_m, axis=1),
    )
    return projector, camera


def _focus(role: str, record: BlurRecord, measured: BoolArray, distance_m: FloatArray) -> FocusOf:
    height, width = shape = (measured.shape[0], measured.shape[1])
    xy_px = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
    return FocusOf(
        role=role,
        sigma_px=LensBlur(shape, record.variance_px2).sigma_px(xy_px),
        known_px=record.middle_sigma_px,
        measured=_closed(measured),
        distance_m=distance_m.reshape(shape),
    )


def _closed(measured: BoolArray) -> BoolArray:
    """Without the holes that single pixels leave which were not decoded: blur is known between them."""
    side = measured.shape[1] // _HOLES_OF_WIDTH | 1
    return np.asarray(cv2.morphologyEx(measured.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((side, side))) > 0)


def focus_text(devices: tuple[FocusOf, FocusOf]) -> str:
    """Return what the maps say, in words."""
    return (
        f"Blur of each lens over its own picture, as a standard deviation in its own pixels; up to {_SHARP_PX:g} px "
        "lines one pixel wide can be told apart. " + " ".join(device.sentence for device in devices)
    )


def focus_figure(devices: tuple[FocusOf, FocusOf]) -> str:
    """Return both maps; outside of what was measured they are pale."""
    figure = Figure(figsize=(10, 3.5), layout="constrained")
    for axes, device in zip(figure.subplots(1, 2), devices, strict=True):
        _draw(axes, device)
    scale = ScalarMappable(Normalize(0, _WORST_SHOWN_PX), _COLOURS)
    figure.colorbar(scale, ax=figure.axes, shrink=0.85, pad=0.015, extend="max", label="blur, px")
    return png_figure(figure)


def _draw(axes: Axes, device: FocusOf) -> None:
    height, width = device.sigma_px.shape
    alpha = np.where(device.measured, 1.0, 0.25)
    axes.imshow(device.sigma_px, vmin=0, vmax=_WORST_SHOWN_PX, cmap=_COLOURS, alpha=alpha, aspect="equal")
    inside = device.sigma_px[device.measured]
    if inside.size and inside.min() < _SHARP_PX < inside.max():
        lines = axes.contour(device.sigma_px, levels=[_SHARP_PX], colors="#1d2330", linewidths=1.2)
        axes.clabel(lines, fmt=f"{_SHARP_PX:g} px", fontsize=8)
    for row in (1, 3, 5):
        for column in (1, 3, 5):
            y, x = row * height // 6, column * width // 6
            if device.measured[y, x]:
                axes.text(x, y, f"{device.sigma_px[y, x]:.2f}", ha="center", va="center", fontsize=8, color="#1d2330")
    axes.set_title(f"{device.role}'s picture", fontsize=10, loc="left")
    axes.set_xticks([])
    axes.set_yticks([])
