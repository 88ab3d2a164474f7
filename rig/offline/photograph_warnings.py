"""What photographs and their points say is wrong with a scan, in words for its user."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray
from calibration.geometry.known.pair import HeldPair
from calibration.geometry.noise import SIGMAS
from calibration.structured_light.correspondence import Correspondence, PixelReason
from rig.devices.replay.photographs import Manifest, Photograph
from rig.errors import ProfileError
from rig.offline.photograph_order import OrderedPhotographs

_LEAST_BASELINE_M, _MOST_BASELINE_M = 3e-3, 30.0
"""No projector fits beside a camera below the first, nor lights a thing that both see from further apart."""
_FULL_SCALE_OF_8_BITS = 255
_LEAST_OF_FULL_SCALE = 1 / 8
_MOST_SATURATED = 0.1
_MOST_CLIPPED = 0.3
"""Of the bright pixels: what a refusal is put down to."""
_LEAST_READ = 0.5
_MOST_OUTSIDE = 0.1
_MOST_LEFT_OUT = 0.1
"""Of the projector pixels seen; 0.02 on a real object."""
_MOST_DISTANCE_SIGMA = 0.05
_MOST_OFF_MIDDLE = 0.15
"""Of the picture's width or height; lenses of cameras that nobody shifts are 0.08 off at most in the sets at hand."""
_MOST_EPIPOLAR_PX = 1.0
"""A third of a pixel is what whole codes and right numbers give."""


def refuse_implausible_unit(manifest: Manifest) -> None:
    """Raise ProfileError when camera and projector are as far apart as no rig is."""
    if manifest.camera is None or manifest.projector is None:
        return
    apart_m = math.hypot(*(manifest.projector.position_m - manifest.camera.position_m))
    if apart_m == 0 or _LEAST_BASELINE_M <= apart_m <= _MOST_BASELINE_M:
        return
    other = {"m": "mm", "mm": "m"}[manifest.unit]
    raise ProfileError(
        f"{manifest.path}: projector_from_camera.translation: camera and projector are {apart_m:.3g} m apart, the "
        f'limits are {_LEAST_BASELINE_M:g} and {_MOST_BASELINE_M:g} m; is the unit "{other}", not "{manifest.unit}"?'
    )


def refuse_wrong_full_scale(manifest: Manifest, frames: Mapping[str, Photograph]) -> None:
    """Raise ProfileError when photographs of 8 bits are given the full scale of more."""
    coded = [frame for name, frame in frames.items() if name.startswith("gray-")]
    if manifest.full_scale_dn > _FULL_SCALE_OF_8_BITS and all(frame.dtype == np.uint8 for frame in coded):
        raise ProfileError(
            f"{manifest.path}: camera.full_scale_dn: is {manifest.full_scale_dn}, but the photographs have 8 bits; "
            f"set it to {_FULL_SCALE_OF_8_BITS}"
        )


def warnings_of(manifest: Manifest, photographs: OrderedPhotographs, correspondence: Correspondence) -> tuple[str, ...]:
    """Return what the photographs and the codes read in them say is wrong, a sentence each."""
    grid, lit = slice(None, None, photographs.grid_px), photographs.lit
    few = {name: frame[grid, grid] for name, frame in photographs.frames.items() if name.startswith("gray-")}
    losses = _losses(correspondence.reason[grid, grid], lit, correspondence.projector_shape)
    return (*_brightness(manifest.full_scale_dn, few, lit), *losses, *_principal_point(manifest))


def exposure_causes(manifest: Manifest, frames: Mapping[str, Photograph]) -> tuple[str, ...]:
    """Return what the photographs' exposure says of a refusal: pictures that are clipped show no stripes."""
    coded = [frame for name, frame in frames.items() if name.startswith("gray-")]
    brightest, full = np.maximum.reduce(coded), manifest.full_scale_dn
    share = _share(brightest >= full, brightest > full / 2)
    if share <= _MOST_CLIPPED:
        return ()
    return (
        f"{100 * share:.0f} % of the bright pixels are saturated (limit {100 * _MOST_CLIPPED:g} %), which widens "
        "stripes and hides what tells photographs apart: expose shorter; by that or not",
    )


def _brightness(full_scale_dn: int, frames: Mapping[str, Photograph], lit: BoolArray) -> tuple[str, ...]:
    brightest = max(int(frame.max()) for frame in frames.values())
    if brightest < _LEAST_OF_FULL_SCALE * full_scale_dn:
        return (
            f"the brightest value of the photographs is {brightest} dn, {100 * brightest / full_scale_dn:.1f} % of "
            f"camera.full_scale_dn = {full_scale_dn}: correct it (255 for 8 bits, 4095 for 12), or expose longer",
        )
    clipped = np.mean([frame >= full_scale_dn for frame in frames.values()], axis=0) > _CLIPPED_OFTEN
    share = _share(clipped, lit)
    if share > _MOST_SATURATED:
        return (
            f"{100 * share:.0f} % of the lit pixels are saturated even where the pattern is dark (limit "
            f"{100 * _MOST_SATURATED:g} %): expose the photographs shorter",
        )
    return ()


_CLIPPED_OFTEN = 0.6
"""Of the photographs of a pixel: more than those that light it."""


def _losses(reason: NDArray[np.uint8], lit: BoolArray, projector_shape: tuple[int, int]) -> tuple[str, ...]:
    outside, read = _share(reason == PixelReason.OUT_OF_RANGE, lit), _share(reason == PixelReason.VALID, lit)
    height, width = projector_shape
    if outside > _MOST_OUTSIDE:
        return (
            f"{100 * outside:.0f} % of the lit pixels read codes outside the projector's {width} × {height} px (limit "
            f"{100 * _MOST_OUTSIDE:g} %): check [projector] width_px and height_px, and first_code",
        )
    if read < _LEAST_READ:
        return (
            f"only {100 * read:.0f} % of the lit pixels have a code (limit {100 * _LEAST_READ:g} %): check focus, "
            "exposure, and that nothing moved",
        )
    return ()


def _share(of: BoolArray, among: BoolArray) -> float:
    return float((of & among).sum() / max(int(among.sum()), 1))


def _principal_point(manifest: Manifest) -> tuple[str, ...]:
    if manifest.camera is None or manifest.camera_is_cropped:
        return ()
    x, y = manifest.camera.principal_point_px
    height, width = manifest.camera_shape
    if 0 <= x < width and 0 <= y < height:
        return ()
    return (
        f"camera.lens.principal_point_px = ({x:.0f}, {y:.0f}) lies outside the photographs of {width} × {height} px: "
        "if they were cropped or scaled, say so in [camera.crop] or scale the lens",
    )


def loss_warnings(left_out_share: float, epipolar_median_px: float | None) -> tuple[str, ...]:
    """Return what the points say is wrong, a sentence each."""
    found = []
    if left_out_share > _MOST_LEFT_OUT:
        found.append(
            f"{100 * left_out_share:.0f} % of the points were left out (limit {100 * _MOST_LEFT_OUT:g} %), beyond the "
            "epipolar limit, beside the projector's picture or alone: check that all photographs belong together, the "
            "lenses and the crops"
        )
    if epipolar_median_px is not None and epipolar_median_px > _MOST_EPIPOLAR_PX:
        found.append(
            f"projector pixels lie {epipolar_median_px:.2f} px (median) from their epipolar lines, right numbers give "
            f"less than {_MOST_EPIPOLAR_PX:g}: check lenses, pose, crops and first_code"
        )
    return tuple(found)


def parallax_warnings(distance_sigma_share: float) -> tuple[str, ...]:
    """Return whether codes tell distances too roughly to be of use."""
    if distance_sigma_share <= _MOST_DISTANCE_SIGMA:
        return ()
    return (
        f"a point's distance is known to {100 * distance_sigma_share:.0f} % only (median, limit "
        f"{100 * _MOST_DISTANCE_SIGMA:g} %): camera and projector stand too near to each other for pixels as coarse as "
        "these; move them apart, or go nearer",
    )


def lone_axis_warnings(manifest: Manifest) -> tuple[str, ...]:
    """Return whether a camera's principal point is implausible, which columns or rows alone cannot contradict."""
    if manifest.camera is None or manifest.camera_is_cropped:
        return ()
    height, width = manifest.camera_shape
    off = [
        abs(at - (length - 1) / 2) / length
        for at, length in zip(manifest.camera.principal_point_px, (width, height), strict=True)
    ]
    x, y = manifest.camera.principal_point_px
    if max(off) <= _MOST_OFF_MIDDLE:
        return ()
    return (
        f"camera.lens.principal_point_px = ({x:.0f}, {y:.0f}) lies {100 * max(off):.0f} % of the picture from its "
        f"middle (limit {100 * _MOST_OFF_MIDDLE:g} %), and columns or rows alone cannot contradict it: check its "
        "order, and whether the photographs were cropped ([camera.crop])",
    )


def lens_warnings(held: HeldPair, epipolar_median_px: float | None) -> tuple[str, ...]:
    """Return whether the photographs contradict the lens file."""
    if held.contradiction_sigmas <= SIGMAS:
        return ()
    after = (
        "" if epipolar_median_px is None else f", {epipolar_median_px:.2f} px with lenses and pose that they pull to"
    )
    return (
        f"the photographs contradict the lens file by {held.contradiction_sigmas:.0f} sigma (limit {SIGMAS:g}): "
        f"projector pixels lie {held.epipolar_before_px:.2f} px (median) from its epipolar lines{after}; camera or "
        "projector was moved, zoomed or focused since, or the file is of another rig: calibrate with boards again",
    )
