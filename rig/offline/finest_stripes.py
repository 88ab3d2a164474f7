"""Stripes that are finer than the camera resolves: a code is read without them, in wider cells."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.geometry.triangulation import is_whole
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.orientation import without_mirrored
from rig.devices.replay.photographs import Manifest, Photograph
from rig.offline.photograph_order import decode, with_files
from rig.offline.scan_points import in_cells

_MOST_BETWEEN = 0.65
"""Share of the codes between two cells from which on the finest stripes are not resolved. A published scan, of which
98.9 % are right, has 0.54, ten drawn sets have up to 0.25; two that are not resolved 0.72 and 0.99."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ResolvedCode:
    """A code as far as the camera resolves it."""

    manifest: Manifest
    """Without the stripes that it does not resolve."""
    correspondence: Correspondence
    mended: tuple[str, ...]
    """What was left out, in words; empty where nothing was."""


def read_resolved(manifest: Manifest, frames: Mapping[str, Photograph], limit_dn: float) -> ResolvedCode:
    """Read a manifest's code, without its finest stripes where most pixels see both sides of them at once.

    Such pixels have no code of their own, but one between two: they name no projector pixel, and many of those that do
    are wrong. Without these stripes the same pixels lie inside of wider cells.

    Parameters
    ----------
    manifest : Manifest
    frames : mapping of pattern name to (H, W)
        By what each photograph shows. [dn]
    limit_dn : float
        By which a pattern and its inverse have to differ.

    Returns
    -------
    ResolvedCode

    Raises
    ------
    CalibrationError
        Photographs are missing, or their shapes differ.
    """
    found = without_mirrored(decode(manifest, frames, limit_dn))
    bit = manifest.finest_bit
    if _between_cells(manifest, found) <= _MOST_BETWEEN or not _of_bit(frames, bit + 1):
        return ResolvedCode(manifest=manifest, correspondence=found, mended=())
    finest = _of_bit(frames, bit)
    rest = {name: frame for name, frame in frames.items() if name not in finest}
    read = read_resolved(replace(manifest, finest_bit=bit + 1), rest, limit_dn)
    told = (
        f"most pixels see both sides of the stripes of {', '.join(finest)} at once, which are too fine for this camera "
        f"and its focus: they were left out, and points are of cells of {2 ** (bit + 1)} projector pixels"
    )
    return replace(read, mended=(with_files(manifest, told), *read.mended))


def _of_bit(frames: Mapping[str, Photograph], bit: int) -> list[str]:
    """Photographs of the stripes of a bit, inverses included."""
    return [name for name in frames if name.startswith("gray-") and name.split("-")[2] == f"{bit:02d}"]


def _between_cells(manifest: Manifest, found: Correspondence) -> float:
    """Share of the codes that lie between two cells, of the axis that has more."""
    codes = in_cells(manifest, found)[0].projector_xy_px[found.valid]
    axes = [axis for axis in np.moveaxis(codes, -1, 0) if len(axis) and np.isfinite(axis).all()]
    return max((1 - float(is_whole(axis).mean()) for axis in axes), default=0.0)
