"""Arrays to pictures in the page: the same exposure for all that are to be compared."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass

import cv2
import matplotlib
import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.files.channels import one_or_all
from rig.files.pictures import png_of

BoolArray = NDArray[np.bool_]
Numbers = NDArray[np.integer] | NDArray[np.floating]

ERROR_RANGE = 64.0
"""Grey levels at the ends of the error scale."""
REASONS = (
    "valid",
    "dark",
    "saturated",
    "uncertain bit",
    "out of range",
    "isolated",
    "ambiguous",
    "washed out",
    "mirrored",
)
_REASON_COLOURS = ("#2a9d5c", "#20242e", "#f2c14e", "#d9673a", "#8c4fb0", "#3a7bd5", "#c94f7c", "#8a7a5c", "#5fc9c4")


@dataclass(frozen=True)
class EmbeddedPicture:
    """A picture inside a page."""

    src: str
    """Data URI."""
    alt: str
    """What it shows, in words."""


def picture(rgb: NDArray[np.uint8], alt: str, width_px: int = 640) -> EmbeddedPicture:
    """Return a small PNG of (H, W) or (H, W, 3) codes, at most so wide."""
    if rgb.shape[1] > width_px:
        height = round(rgb.shape[0] * width_px / rgb.shape[1])
        rgb = np.asarray(cv2.resize(rgb, (width_px, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return EmbeddedPicture("data:image/png;base64," + base64.b64encode(png_of(rgb)).decode(), alt)


def photograph(levels: Numbers, mask: BoolArray | None = None) -> NDArray[np.uint8]:
    """Return codes of grey levels (H, W) or (H, W, B) with a display's gamma of 2.2; outside the mask a third."""
    bands = np.atleast_3d(levels)
    shown = 255 * (np.clip(np.nan_to_num(bands), 0, 255) / 255) ** (1 / 2.2)
    if mask is not None:
        shown = np.where(mask[..., None], shown, shown / 3)
    return one_or_all(np.asarray(shown, dtype=np.float64).astype(np.uint8))


def signed_error(error: Numbers, mask: BoolArray) -> NDArray[np.uint8]:
    """Return colours of an error, of several bands their mean: blue too dark, red too bright; grey outside the mask."""
    grey = np.atleast_3d(np.nan_to_num(error)).mean(axis=-1)
    share = np.clip(grey / ERROR_RANGE, -1, 1) / 2 + 0.5
    colours = np.asarray(255 * colormaps["RdBu_r"](share)[..., :3], dtype=np.float64).astype(np.uint8)
    colours[~mask] = (96, 96, 100)
    return colours


def ramp(values: Numbers, mask: BoolArray, name: str = "viridis") -> NDArray[np.uint8]:
    """Return values between their extremes in the mask as colours."""
    low, high = (float(np.min(values[mask])), float(np.max(values[mask]))) if mask.any() else (0.0, 1.0)
    share = np.clip((np.nan_to_num(values) - low) / max(high - low, 1e-12), 0, 1)
    colours = np.asarray(255 * colormaps[name](share)[..., :3], dtype=np.float64).astype(np.uint8)
    colours[~mask] = (32, 36, 46)
    return colours


def reasons(codes: Numbers) -> NDArray[np.uint8]:
    """Return reason codes of a correspondence map as colours."""
    table = np.array([[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in _REASON_COLOURS], dtype=np.uint8)
    return np.asarray(table[np.clip(codes.astype(int), 0, len(table) - 1)])


def reason_legend() -> list[tuple[str, str]]:
    """Return (name, colour) of each reason."""
    return list(zip(REASONS, _REASON_COLOURS, strict=True))


def svg(figure: Figure) -> str:
    """Return a matplotlib figure as a data URI, the same bytes for the same figure."""
    stream = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "procam-rig", "svg.fonttype": "path"}):
        figure.savefig(stream, format="svg", bbox_inches="tight", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(stream.getvalue()).decode()


def png_figure(figure: Figure, *, tight: bool = True) -> str:
    """Return a figure with many shapes as a PNG data URI; ``tight``: its margins cut off, which draws it twice."""
    stream = io.BytesIO()
    margins = "tight" if tight else None
    figure.savefig(stream, format="png", dpi=110, bbox_inches=margins, metadata={"Software": None})
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode()
