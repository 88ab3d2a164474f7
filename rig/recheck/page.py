"""What `rig recheck` prints, and its page: the table, and maps of what is left over."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from rig.files.atomic import write_bytes
from rig.recheck.compare import Compared
from rig.recheck.records import PAGE, Recheck
from rig.records import Verdict
from rig.report.pictures import EmbeddedPicture, picture
from rig.report.render import rendered
from rig.terminal import print_table, say

_LEAST_SCALE_PX = 1.0
"""At the ends of the residuals' colours: what noise alone leaves looks pale."""
_NOWHERE = (96, 96, 100)


@dataclass(frozen=True)
class _Map:
    """A picture with what it shows."""

    picture: EmbeddedPicture
    text: str


def print_recheck(result: Recheck) -> None:
    """Print what moved, value and limit of every row, and what to do about those that fail."""
    rows = [(row.what, _number(row.value), _limit(row), row.unit, row.status) for row in result.limits]
    print(result.summary)
    print_table(f"{result.session}: re-check", ("what", "value", "limit", "unit", "status"), rows)
    for row in result.limits:
        if not row.met:
            say(f"{row.what}: {row.advice}")
    if result.realigned is not None:
        print(f"realigned: {result.realigned.folder}; rig live and rig compare-strategies use it from now on")
    print(f"report: {result.report}")


def write_recheck_page(result: Recheck, compared: Compared, folder: Path) -> Path:
    """Write one self-contained HTML file into a look's folder, and return its path. Raises SessionError.

    Parameters
    ----------
    result
        What is told.
    compared
        What the maps are drawn from.
    folder
        Of the look.
    """
    context = {
        "title": f"Re-check of {result.session}",
        "subtitle": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC; {result.frames} photographs, {result.device_s:.0f} s of "
        f"the rig's time; compared with {result.compared_with}.",
        "met": result.within_limits,
        "verdict": result.summary,
        "failed": [row for row in result.limits if not row.met],
        "rows": [{"row": row, "value": _number(row.value), "limit": _limit(row)} for row in result.limits],
        "devices": [("camera", result.camera), ("projector", result.projector)],
        "result": result,
        "maps": _maps(compared),
    }
    path = folder / PAGE
    write_bytes(path, rendered("recheck/recheck.html", context).encode())
    return path


def _maps(compared: Compared) -> list[_Map]:
    found = []
    for residual, what in (
        (compared.before_px, "as it is"),
        (compared.residual_px, "after the motion that was found"),
    ):
        scale_px = max(_LEAST_SCALE_PX, 3 * float(np.nanmedian(np.abs(residual))))
        for k, axis in enumerate(("right", "down")):
            alt = f"Pixels see the projector's picture displaced, {axis}, {what}"
            colours = _signed(residual[..., k], scale_px)
            text = f"{axis}, {what}: blue −{scale_px:.2g} px, white 0, red +{scale_px:.2g} px"
            found.append(_Map(picture(_enlarged(colours), alt), text))
    if compared.elsewhere.any():
        shown = np.array([(32, 36, 46), (242, 193, 78)], dtype=np.uint8)[compared.elsewhere.astype(int)]
        found.append(_Map(picture(_enlarged(shown), "Where something stands elsewhere"), "something stands elsewhere"))
    return found


def _signed(values: NDArray[np.float64], scale: float) -> NDArray[np.uint8]:
    share = np.clip(np.nan_to_num(values) / scale, -1, 1) / 2 + 0.5
    colours = np.asarray(255 * colormaps["RdBu_r"](share)[..., :3], dtype=np.float64).astype(np.uint8)
    colours[~np.isfinite(values)] = _NOWHERE
    return colours


def _enlarged(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Every pixel of a thinned map as a square."""
    factor = max(1, round(640 / rgb.shape[1]))
    return np.asarray(rgb.repeat(factor, axis=0).repeat(factor, axis=1))


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value if abs(value) > 1e-6 else 0:.3g}"


def _limit(row: Verdict) -> str:
    return "" if row.limit is None else f"{'≥' if row.at_least else '≤'} {row.limit:.3g}"
