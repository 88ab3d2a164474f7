"""Which photograph shows what: the pictures themselves are asked first, then the lenses."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.arrays import BoolArray
from calibration.geometry.pinhole import PinholeModel
from calibration.geometry.plausibility import rivals, view_of
from calibration.structured_light.consistency.check import PhotographOrder, check_gray_frames
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.decode import decode_gray
from calibration.structured_light.gray import BOTH_AXES, Axis
from rig.devices.replay.photographs import Manifest, Photograph
from rig.errors import CalibrationFailed
from rig.terminal.line import first_of

_GRID = 8_000
"""Camera pixels at which readings are compared."""
_LEAST_EXPLAINED = 0.3
"""Share of the lit pixels: lenses that explain fewer are other ones; a right scan of a real object has 0.8."""
_BRIGHT = 0.3
"""Of the contrast of bright pixels."""
_LISTED = 6
_ISOLATION_PX = 8.0


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderedPhotographs:
    """Photographs by what they show, and what had to be said about it."""

    frames: Mapping[str, Photograph]
    """By the name of the pattern that each shows."""
    mended: tuple[str, ...]
    """What was put right, a sentence each."""
    warnings: tuple[str, ...]
    """What the photographs leave open."""
    lit: BoolArray
    """(h, w) whether the projector lights a pixel, at every so many-th pixel."""
    grid_px: int
    """How many-th."""


def in_order(
    manifest: Manifest,
    frames: Mapping[str, Photograph],
    devices: tuple[PinholeModel, PinholeModel],
    *,
    limit_dn: float,
    epipolar_limit_px: float,
) -> OrderedPhotographs:
    """Find out what each photograph shows.

    Parameters
    ----------
    manifest : Manifest
    frames : mapping of pattern name to (H, W)
        As the manifest names them. [dn]
    devices : (camera, projector)
    limit_dn : float
        By which a pattern and its inverse have to differ.
    epipolar_limit_px : float

    Returns
    -------
    OrderedPhotographs

    Raises
    ------
    CalibrationError
        The photographs are not of one still scene and one code.
    CalibrationFailed
        They are in another order than the manifest's, and which one cannot be told.
    """
    checked = check_gray_frames(frames, 2 * limit_dn)
    frames = _evenly_exposed(frames, checked.gains)
    few, step_px = _on_grid(manifest, frames)
    lit = _lit(few, limit_dn)
    views = [
        view_of(_read(manifest, few, reading, limit_dn), lit, step_px, devices=devices, limit_px=epipolar_limit_px)
        for reading in checked.readings
    ]
    best, *others = rivals(views)
    if views[best].share < _LEAST_EXPLAINED and checked.as_named:
        best, others = 0, []  # the lenses are wrong, and cannot tell anything of the order; what follows will say so
    reading = checked.readings[best]
    changed = {pattern: name for pattern, name in reading.items() if name != pattern}
    if others and not (checked.as_named and 0 in (best, *others)):
        raise CalibrationFailed(
            f"{manifest.path}: the photographs are not in the order of the manifest, and {1 + len(others)} orders "
            f"explain them: {_told(manifest, changed)}, for one; correct the manifest, or photograph again"
        )
    if others:
        reading, changed = checked.readings[0], {}
    return OrderedPhotographs(
        frames=_taken_for(frames, reading),
        mended=(*_mended_order(manifest, changed), *_mended_exposures(manifest, checked.gains)),
        warnings=(*_left_open(len(others), checked), *_unresolved(manifest, checked)),
        lit=lit,
        grid_px=step_px,
    )


def _on_grid(manifest: Manifest, frames: Mapping[str, Photograph]) -> tuple[dict[str, Photograph], int]:
    """Every so many-th pixel, and how many."""
    height, width = manifest.camera_shape
    step_px = max(1, int(np.sqrt(height * width / _GRID)))
    return {name: np.ascontiguousarray(frame[::step_px, ::step_px]) for name, frame in frames.items()}, step_px


def _read(
    manifest: Manifest, frames: Mapping[str, Photograph], reading: Mapping[str, str], limit_dn: float
) -> Correspondence:
    return decode(manifest, _taken_for(frames, reading), limit_dn, isolation_px=np.inf)


def _taken_for(frames: Mapping[str, Photograph], reading: Mapping[str, str]) -> dict[str, Photograph]:
    """Photographs by what a reading says that they show."""
    return {**frames, **{pattern: frames[name] for pattern, name in reading.items()}}


def decode(
    manifest: Manifest, frames: Mapping[str, Photograph], limit_dn: float, *, isolation_px: float = _ISOLATION_PX
) -> Correspondence:
    """Read the manifest's Gray code.

    Parameters
    ----------
    manifest : Manifest
    frames : mapping of pattern name to (H, W)
        By what each photograph shows. [dn]
    limit_dn : float
        By which a pattern and its inverse have to differ.
    isolation_px : float
        See :func:`~calibration.structured_light.decode.decode_gray`.

    Returns
    -------
    Correspondence

    Raises
    ------
    CalibrationError
        Photographs are missing, or their shapes differ.
    """
    return decode_gray(
        {name: frame for name, frame in frames.items() if name.startswith("gray-")},
        manifest.projector_shape,
        white=frames.get("white"),
        black=frames.get("black"),
        contrast_limit=limit_dn,
        bit_limit=limit_dn,
        first_code=manifest.first_code,
        isolation_px=isolation_px,
        axes=axes_of(frames),
        finest_bit=manifest.finest_bit,
    )


def axes_of(frames: Mapping[str, Photograph]) -> tuple[Axis, ...]:
    """Return what the photographs code."""
    return tuple(axis for axis in BOTH_AXES if any(name.startswith(f"gray-{axis}-") for name in frames))


def _evenly_exposed(frames: Mapping[str, Photograph], gains: Mapping[str, float]) -> dict[str, Photograph]:
    return {name: _scaled(frame, gains[name]) if name in gains else frame for name, frame in frames.items()}


def _scaled(frame: Photograph, gain: float) -> Photograph:
    most = np.iinfo(frame.dtype).max
    return np.asarray(np.clip(np.rint(frame / gain), 0, most).astype(frame.dtype))


def _lit(frames: Mapping[str, Photograph], limit_dn: float) -> BoolArray:
    """(H, W) pixels that get light from the projector, not only noise or light from other surfaces."""
    stack = [frame for name, frame in frames.items() if name.startswith("gray-")]
    contrast = np.maximum.reduce(stack).astype(np.float32) - np.minimum.reduce(stack)
    seen = contrast[contrast >= limit_dn]
    bright = float(np.quantile(seen, 0.95)) if len(seen) else 0.0
    return np.asarray(contrast >= max(limit_dn, _BRIGHT * bright))


def _mended_order(manifest: Manifest, changed: Mapping[str, str]) -> tuple[str, ...]:
    if not changed:
        return ()
    return (f"the photographs were taken in another order than the manifest's: {_told(manifest, changed)}",)


def _told(manifest: Manifest, changed: Mapping[str, str]) -> str:
    lines = [f"{manifest.frames[name].name} shows {pattern}" for pattern, name in changed.items()]
    return ", ".join(first_of(lines, _LISTED))


def _mended_exposures(manifest: Manifest, gains: Mapping[str, float]) -> tuple[str, ...]:
    return tuple(
        f"{manifest.frames[name].name} is {gain:.2f} times as bright as it should be and was scaled: "
        "was the exposure automatic?"
        for name, gain in gains.items()
    )


def _left_open(others: int, checked: PhotographOrder) -> tuple[str, ...]:
    if not others:
        return ()
    lacking, remedy = "no edge of the widest stripes", "photograph a larger part of the projected picture"
    if checked.undersampled or checked.unresolved:
        lacking, remedy = "finest stripes that it does not resolve", "focus, or move the camera nearer"
    return (
        f"{others} other {'order' if others == 1 else 'orders'} of the photographs would explain them as well, since "
        f"the view has {lacking}: the cloud rests on the names alone; {remedy}",
    )


def _unresolved(manifest: Manifest, checked: PhotographOrder) -> tuple[str, ...]:
    said = []
    if checked.unresolved:
        said.append(
            f"the stripes in {_files(manifest, checked.unresolved)} are too blurred to be read: focus camera and "
            "projector, go nearer, or leave them out (finest_bit)"
        )
    if checked.undersampled:
        said.append(
            f"the stripes in {_files(manifest, checked.undersampled)} are narrower than one and a half pixels of the "
            "camera: only their names tell what they are; move the camera nearer, use one with more pixels, or leave "
            "them out (finest_bit)"
        )
    return tuple(said)


def _files(manifest: Manifest, patterns: Sequence[str]) -> str:
    return ", ".join(manifest.frames[name].name for name in patterns)


def with_files(manifest: Manifest, message: str) -> str:
    """Put the photographs' file names beside the names of the patterns in a message."""
    names = sorted(manifest.frames, key=len, reverse=True)
    if not names:
        return message
    known = re.compile("|".join(rf"{re.escape(name)}(?![\w-])" for name in names))
    return known.sub(lambda found: f"{manifest.frames[found[0]].name} ({found[0]})", message)
