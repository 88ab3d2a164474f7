"""Gray-code photographs and known lenses to a point cloud: `rig scan`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.known.pair import HeldPair, hold_pair
from calibration.geometry.pinhole import PinholeModel
from calibration.geometry.triangulation import parallax_px, stands_alone
from calibration.structured_light.consistency.unsteady import with_sign
from calibration.structured_light.correspondence import Correspondence, PixelReason
from rig.devices.replay.photographs import Manifest, Photograph, load_manifest, load_photographs, read_photograph
from rig.errors import CalibrationFailed, ProfileError
from rig.files.atomic import check_output
from rig.files.ply import write_ply
from rig.offline.finest_stripes import read_resolved
from rig.offline.photograph_order import axes_of, in_order, with_files
from rig.offline.photograph_warnings import (
    exposure_causes,
    lens_warnings,
    lone_axis_warnings,
    loss_warnings,
    parallax_warnings,
    refuse_implausible_unit,
    refuse_wrong_full_scale,
    warnings_of,
)
from rig.offline.records import ScanResult
from rig.offline.scan_points import (
    FoundPoints,
    pairs_by_projector_pixel,
    points_by_camera_pixel,
    points_by_projector_pixel,
)
from rig.terminal import OnStep, silent

_BIT_LIMIT = 4.5 / 255
"""Share of full scale by which a pattern and its inverse have to differ: above the noise of a good JPEG."""
_LEAST_TELLING = 100
"""Projector pixels that were seen; fewer say nothing of a lens file."""
_NORMAL_MEDIAN = 1.4826
"""Standard deviation of a normal error over the median of its size."""
_PER_METRE = {"m": 1.0, "mm": 1000.0}
_FRAME_COMMENT = "axes of the camera: x right, y down, z forward"


def run_scan(
    manifest_path: Path,
    output_path: Path,
    *,
    bit_limit_dn: float | None = None,
    epipolar_limit_px: float = 4.0,
    on_step: OnStep = silent,
) -> ScanResult:
    """Write one point for each projector pixel that the camera sees, in the manifest's unit of length.

    Parameters
    ----------
    manifest_path
        TOML file that names the photographs and the lenses.
    output_path
        Point cloud to write (.ply).
    bit_limit_dn : float, optional
        A pixel counts when each pattern differs from its inverse by at least this; default 4.5 of 255.
    epipolar_limit_px : float
        Points whose projector pixel is further from its epipolar line are left out: wrong codes.
    on_step : callable (label, done, total)

    Returns
    -------
    ScanResult

    Raises
    ------
    UsageError
        There is no folder for the point cloud.
    ProfileError
        The manifest is wrong, or lacks what a scan needs.
    DeviceLost
        Photographs cannot be used.
    CalibrationFailed
        No point is left, most pixels are beyond the epipolar limit, or camera and projector coincide.
    """
    started_s = time.perf_counter()
    check_output(output_path)
    manifest = load_manifest(manifest_path)
    devices = _lenses(manifest)
    refuse_implausible_unit(manifest)
    frames = load_photographs(manifest, lambda done, total: on_step("read photographs", done, total))
    refuse_wrong_full_scale(manifest, frames)
    limit_dn = _BIT_LIMIT * manifest.full_scale_dn if bit_limit_dn is None else bit_limit_dn
    on_step("decode and triangulate", 0, 1)
    scan = scan_photographs(manifest, frames, devices, limit_dn=limit_dn, epipolar_limit_px=epipolar_limit_px)
    points = scan.points_m * _PER_METRE[manifest.unit]
    comments = (f"unit {manifest.unit}", _FRAME_COMMENT)
    write_ply(output_path, points, _colours(manifest, scan.camera_xy_px), comments)
    on_step("decode and triangulate", 1, 1)
    return ScanResult(
        points=len(points),
        unit=manifest.unit,
        valid_share=scan.valid_share,
        epipolar_median_px=scan.epipolar_median_px,
        left_out=scan.left_out,
        mended=scan.mended,
        warnings=scan.warnings,
        distance_sigma_percent=100 * scan.distance_sigma_share,
        lens_sigma_percent=None if scan.lens_sigma_share is None else 100 * scan.lens_sigma_share,
        seconds=time.perf_counter() - started_s,
        output=output_path,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Scan:
    """Points of photographs, and how they came about."""

    points_m: FloatArray
    """(N, 3) in the camera's axes. [m]"""
    camera_xy_px: FloatArray
    """(N, 2) where the camera sees them. [px]"""
    valid_share: float
    """Share of the camera's pixels that have a code."""
    epipolar_median_px: float | None
    """None where columns or rows alone were photographed. [px]"""
    left_out: int
    mended: tuple[str, ...]
    warnings: tuple[str, ...]
    distance_sigma_share: float
    """Median standard deviation of a distance that the code leaves open, as a share of it."""
    lens_sigma_share: float | None
    """The same that a lens file leaves open."""


def scan_photographs(
    manifest: Manifest,
    frames: Mapping[str, Photograph],
    devices: tuple[PinholeModel, PinholeModel],
    *,
    limit_dn: float,
    epipolar_limit_px: float,
) -> Scan:
    """Find the points that photographs show, and what is wrong with the photographs.

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
    Scan

    Raises
    ------
    CalibrationFailed
        The photographs are not of one still scene and one code, or allow several orders; no point is left, most pixels
        are beyond the epipolar limit, or camera and projector coincide.
    """
    try:
        ordered = in_order(manifest, frames, devices, limit_dn=limit_dn, epipolar_limit_px=epipolar_limit_px)
        read = read_resolved(manifest, ordered.frames, limit_dn)
        manifest, correspondence = read.manifest, read.correspondence
        both = len(axes_of(frames)) == 2
        held = _held(manifest, correspondence) if both else None
        devices = devices if held is None else held.devices
        found = (
            points_by_projector_pixel(manifest, correspondence, devices)
            if both
            else points_by_camera_pixel(manifest, correspondence, devices)
        )
        epipolar_median_px = _agreement_px(found.epipolar_px, epipolar_limit_px)
    except CalibrationError as error:
        raise CalibrationFailed(_refusal(manifest, frames, str(error))) from error
    kept = _kept(found, epipolar_limit_px)
    _refuse_nothing(manifest.path, correspondence, kept, limit_dn)
    sigma_share = _sigma_share(found, kept, devices, epipolar_median_px)
    return Scan(
        points_m=found.points_m[kept],
        camera_xy_px=found.camera_xy_px[kept],
        valid_share=float(correspondence.valid.mean()),
        epipolar_median_px=epipolar_median_px,
        left_out=int((~kept).sum()),
        mended=(*ordered.mended, *read.mended),
        warnings=(
            *ordered.warnings,
            *warnings_of(manifest, ordered, correspondence),
            *loss_warnings(float((~kept).mean()), epipolar_median_px),
            *parallax_warnings(sigma_share),
            *(() if both else lone_axis_warnings(manifest)),
            *(() if held is None else lens_warnings(held, epipolar_median_px)),
        ),
        distance_sigma_share=sigma_share,
        lens_sigma_share=None if held is None else held.sigma_share,
    )


def _lenses(manifest: Manifest) -> tuple[PinholeModel, PinholeModel]:
    camera, projector = manifest.camera, manifest.projector
    coded = any(name.startswith("gray-") for name in manifest.frames)
    needs = {
        "camera.lens, or lens_file": camera,
        "projector.lens and projector_from_camera": projector,
        "gray_code": coded or None,
    }
    missing = [name for name, value in needs.items() if value is None]
    if camera is None or projector is None or missing:
        lines = [f"{manifest.path}: {name}: missing; a scan needs it" for name in missing]
        raise ProfileError("\n".join(lines))
    return camera, projector


def _held(manifest: Manifest, correspondence: Correspondence) -> HeldPair | None:
    """Lenses and pose of a lens file, pulled by what the photographs show within what the boards left open."""
    if manifest.known is None:
        return None
    pairs, projector_xy_px, _ = pairs_by_projector_pixel(manifest, correspondence)
    if len(projector_xy_px) < _LEAST_TELLING:
        return None
    return hold_pair(manifest.known, pairs.camera_xy_px, projector_xy_px)


def _refusal(manifest: Manifest, frames: Mapping[str, Photograph], fault: str) -> str:
    """A fault, and before it what the photographs show that may be its cause."""
    told = with_files(manifest, ", ".join((*exposure_causes(manifest, frames), with_sign(frames, fault))))
    return f"{manifest.path}: {told}"


def _agreement_px(epipolar_px: FloatArray, limit_px: float) -> float | None:
    """Median epipolar distance; None when nothing was seen, or columns or rows alone were."""
    if not np.isfinite(epipolar_px).any():
        return None
    median_px = float(np.nanmedian(epipolar_px))
    if median_px > limit_px:
        raise CalibrationError(
            f"projector pixels lie {median_px:.1f} px (median) from their epipolar lines, the limit "
            f"is {limit_px:g} px: check lenses, pose, [projector.crop] and first_code"
        )
    return median_px


def _sigma_share(
    found: FoundPoints, kept: BoolArray, devices: tuple[PinholeModel, PinholeModel], epipolar_median_px: float | None
) -> float:
    """Median standard deviation of distances: pixels err along their epipolar lines as they do across them."""
    sigma_px = _NORMAL_MEDIAN * (epipolar_median_px or 0.0) if found.code_sigma_px is None else found.code_sigma_px
    return float(sigma_px / np.median(np.hypot(*parallax_px(found.points_m[kept], *devices).T)))


def _kept(found: FoundPoints, epipolar_limit_px: float) -> NDArray[np.bool_]:
    kept = np.isfinite(found.points_m).all(axis=1) & ~(found.epipolar_px > epipolar_limit_px)
    if found.cell_xy is not None:
        distance_m = np.linalg.norm(found.points_m[kept], axis=1)
        kept[kept] = ~stands_alone(found.cell_xy[kept], distance_m, found.cells)
    return np.asarray(kept)


def _refuse_nothing(path: Path, correspondence: Correspondence, kept: NDArray[np.bool_], limit_dn: float) -> None:
    if kept.any():
        return
    share = {reason.name: 100 * float((correspondence.reason == reason).mean()) for reason in PixelReason}
    shares = ", ".join(f"{value:.1f} % {name.lower().replace('_', ' ')}" for name, value in share.items())
    raise CalibrationFailed(
        f"{path}: no point is left of {len(kept)} projector pixels seen (camera pixels: {shares}; bit limit "
        f"{limit_dn:.3g} dn): check the order of the photographs, first_code, the lenses and the pose"
    )


def _colours(manifest: Manifest, camera_xy_px: FloatArray) -> NDArray[np.uint8]:
    """Colour of the nearest camera pixel: of white, or the larger of a pattern and its inverse."""
    first = next(name for name in manifest.frames if name.startswith("gray-"))
    lit = ("white",) if "white" in manifest.frames else (first, f"{first}-inverse")
    column, row = np.rint(camera_xy_px).astype(np.int64).T
    seen = [read_photograph(manifest.frames[name])[row, column] for name in lit if name in manifest.frames]
    brightest = np.max(seen, axis=0).astype(np.float64) * (255 / manifest.full_scale_dn)
    return np.broadcast_to(brightest, (len(row), 3)).astype(np.uint8)
