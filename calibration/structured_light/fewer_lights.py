"""Pixels that light from other walls has spoiled, and the same patterns again with less of that light."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import cv2
import numpy as np

from calibration.arrays import BoolArray
from calibration.errors import CalibrationError
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.patterns import Pattern

_REACH_PX = 3
"""Projector pixels around one that is seen which are covered with it: a camera may see every third only."""
_MARGIN_PX = 8
"""By which lights reach beyond what is wanted: stripes have to be whole at its border."""


def lights_for(correspondence: Correspondence, parts: int = 1) -> list[BoolArray]:
    """Choose the projector pixels to leave on when patterns are shown again: those that no valid pixel sees.

    A pixel is spoiled by what comes back from other walls; what has been read already need not be lit any more, and
    the rest can be lit in parts, each with a share of that light.

    Parameters
    ----------
    correspondence : Correspondence
        Read with all lights on.
    parts : int
        Into how many upright bands the rest is divided, each with as many pixels.

    Returns
    -------
    list of (H, W) bool
        Projector pixels that are on; fewer than `parts`, or none, where nothing is left to be read.

    Raises
    ------
    CalibrationError
        If `parts` is not positive, or an axis was not coded.
    """
    if parts < 1:
        raise CalibrationError(f"{parts} parts: at least 1 is needed")
    height, width = correspondence.projector_shape
    xy = correspondence.projector_xy_px[correspondence.valid]
    if not np.isfinite(xy).all():
        raise CalibrationError("only columns or only rows are known: photograph a code of both to choose lights")
    seen = np.zeros((height, width), dtype=np.uint8)
    column, row = np.rint(xy).astype(np.int64).T
    seen[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)] = 1
    covered = cv2.morphologyEx(seen, cv2.MORPH_CLOSE, _square(_REACH_PX), borderType=cv2.BORDER_REPLICATE)
    rest = covered == 0
    if not rest.any():
        return []
    share = np.cumsum(rest.sum(axis=0)) / rest.sum()
    band = np.minimum((share * parts).astype(int), parts - 1)
    wanted = (rest & (band == part) for part in range(parts))
    return [cv2.dilate(part.astype(np.uint8), _square(_MARGIN_PX)) > 0 for part in wanted if part.any()]


def with_lights(patterns: Iterable[Pattern], lights: BoolArray) -> Iterator[Pattern]:
    """Yield patterns under their own names, black where lights are off; so has white to be photographed."""
    for pattern in patterns:
        on = lights if pattern.codes.ndim == lights.ndim else lights[..., None]
        yield Pattern(pattern.name, np.where(on, pattern.codes, np.uint8(0)))


def filled_in(first: Correspondence, again: Correspondence, lights: BoolArray) -> Correspondence:
    """Fill pixels that were not read with what they are with fewer lights on.

    Parameters
    ----------
    first : Correspondence
        With all lights on, or what was filled in before.
    again : Correspondence
        With fewer.
    lights : (H, W) bool
        That were on; a coordinate elsewhere is not believed.

    Returns
    -------
    Correspondence
        With standard deviations where both have them.

    Raises
    ------
    CalibrationError
        If the two are not of one camera and one projector.
    """
    if first.reason.shape != again.reason.shape or first.projector_shape != again.projector_shape:
        raise CalibrationError(
            f"pictures of {first.reason.shape} and {again.reason.shape}, projectors of {first.projector_shape} and "
            f"{again.projector_shape}: only readings of one camera and one projector can be joined"
        )
    take = ~first.valid & again.valid
    column, row = np.rint(again.projector_xy_px[take]).astype(np.int64).T
    height, width = first.projector_shape
    take[take] = lights[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    sigma = None
    if first.sigma_px is not None and again.sigma_px is not None:
        sigma = np.where(take[..., None], again.sigma_px, first.sigma_px)
    xy = np.where(take[..., None], again.projector_xy_px, first.projector_xy_px)
    reason = np.where(take, np.uint8(PixelReason.VALID), first.reason)
    return Correspondence(xy, reason, first.projector_shape, sigma)


def _square(reach_px: int) -> np.ndarray:
    return np.ones((2 * reach_px + 1, 2 * reach_px + 1), np.uint8)
