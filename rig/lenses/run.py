"""`rig lenses`: from a manifest of boards to a lens file, its page and its numbers."""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.lenses.bundle import BEND, CAMERA, PROJECTOR, RELATIVE, STRETCH
from calibration.lenses.calibrate import LEAST_VIEWS, LensFit, LensRequest, calibrate_lenses
from calibration.lenses.lens import PARAMETERS, FittedLens
from calibration.lenses.next_pose import suggest_pose
from calibration.lenses.records import LensCalibration
from rig.errors import CalibrationFailed
from rig.files.atomic import check_output
from rig.files.lens_file import POSE_PARAMETERS, SCHEMA, JointEntry, LensEntry, LensFile, PoseEntry, write_lens_file
from rig.lenses.judged import judged, warnings_of
from rig.lenses.manifest import LensManifest, load_lens_manifest
from rig.lenses.maps import DeviceMaps, device_maps
from rig.lenses.page import write_lens_page
from rig.lenses.records import DeviceLens, LensesResult, PairPose
from rig.lenses.summaries import device_summary, view_summaries
from rig.lenses.views import SeenView, joined, seen_views
from rig.terminal import OnStep, silent
from rig.terminal.line import first_of
from rig.version import __version__

FloatArray = NDArray[np.float64]
_LISTED = 12
"""Views that a message lists."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Measured:
    """All that the page and the numbers are made of."""

    manifest: LensManifest
    views: tuple[SeenView, ...]
    fit: LensFit
    maps: tuple[DeviceMaps, ...]

    @property
    def calibration(self) -> LensCalibration:
        """Lenses, poses and covariances."""
        return self.fit.calibration


def run_lenses(
    manifest_path: Path, output_path: Path, report_path: Path | None = None, *, on_step: OnStep = silent
) -> LensesResult:
    """Calibrate a camera, and a projector that lights the boards, and write a lens file.

    Parameters
    ----------
    manifest_path
        TOML file that names board, devices and photographs, or lists of corners.
    output_path
        Lens file to write (.toml).
    report_path
        Page to write (.html); None: none.
    on_step : callable (label, done, total)

    Returns
    -------
    LensesResult

    Raises
    ------
    UsageError
        There is no folder for what is to be written.
    ProfileError
        The manifest or a list of corners is wrong.
    CalibrationFailed
        The views do not determine the lenses; the message names views and causes.
    """
    started_s = time.perf_counter()
    for path in (output_path, report_path):
        if path is not None:
            check_output(path)
    manifest = load_lens_manifest(manifest_path)
    views, size_px = seen_views(manifest, manifest_path.parent, on_step)
    measured = _measured(manifest_path, manifest, views, size_px=size_px, on_step=on_step)
    write_lens_file(output_path, lens_file_of(measured))
    result = _result(measured, output_path, report_path, started_s=started_s)
    if report_path is not None:
        write_lens_page(result, measured.maps, report_path)
    return result


def _measured(
    path: Path,
    manifest: LensManifest,
    views: tuple[SeenView, ...],
    *,
    size_px: tuple[int, int] | None,
    on_step: OnStep,
) -> Measured:
    usable = [view for view in views if not view.problem]
    if len(usable) < LEAST_VIEWS or size_px is None:
        raise CalibrationFailed(f"{path}: {_too_few(views, len(usable))}")
    sightings = joined(views, manifest.board.board())
    request = LensRequest(
        camera_size_px=size_px,
        projector_size_px=_projector_size(manifest) if sightings.has_projector else None,
        camera_model=manifest.camera.model,
        projector_model=None if manifest.projector is None else manifest.projector.model,
        flex=manifest.board.flex,
    )
    names = tuple(view.name for view in usable)
    try:
        fit = calibrate_lenses(
            sightings, request, names=names, on_step=lambda done, total: on_step("fit lenses", done, total)
        )
    except (CalibrationError, np.linalg.LinAlgError) as error:
        listed = "".join(f"\n  {view.name}: {view.problem}" for view in views if view.problem)
        raise CalibrationFailed(f"{path}: {error}{listed}") from error
    return Measured(manifest=manifest, views=views, fit=fit, maps=device_maps(fit))


def _projector_size(manifest: LensManifest) -> tuple[int, int] | None:
    projector = manifest.projector
    return None if projector is None else (projector.width_px, projector.height_px)


def _too_few(views: tuple[SeenView, ...], usable: int) -> str:
    problems = [f"{view.name}: {view.problem}" for view in views if view.problem]
    head = f"{usable} of {len(views)} views can be used, at least {LEAST_VIEWS} are needed, each with another tilt"
    listed = [f"  {line}" for line in first_of(problems, _LISTED)]
    return "\n".join([head + (":" if problems else ": photograph more"), *listed])


def _lenses(calibration: LensCalibration) -> list[tuple[str, FittedLens, slice]]:
    found = [("camera", calibration.camera, CAMERA)]
    if calibration.projector is not None:
        found.append(("projector", calibration.projector, PROJECTOR))
    return found


def _result(measured: Measured, output: Path, report: Path | None, *, started_s: float) -> LensesResult:
    calibration, fit = measured.calibration, measured.fit
    names = {"camera": measured.manifest.camera.name}
    if measured.manifest.projector is not None:
        names["projector"] = measured.manifest.projector.name
    devices = tuple(
        device_summary(names[role], role, fit, maps)
        for (role, _, _), maps in zip(_lenses(calibration), measured.maps, strict=True)
    )
    views = view_summaries(measured.views, calibration)
    sigma_x, sigma_y, sigma_twist = (1e3 * calibration.sigmas()[BEND]).tolist()
    flex_x, flex_y, twist = (1e3 * calibration.state.flex_m).tolist()
    pose = suggest_pose(fit.settled, calibration.camera, calibration.projector)
    return LensesResult(
        rms_px=_joint_rms(devices),
        devices=devices,
        views=views,
        pose=_pose(calibration),
        flex_mm=(flex_x, flex_y, twist),
        flex_sigma_mm=(sigma_x, sigma_y, sigma_twist),
        stretch=calibration.state.stretch,
        stretch_sigma=float(calibration.sigmas()[STRETCH][0]),
        scatter_of_views=float(np.sqrt(max(calibration.excess, 0.0))),
        starts=fit.starts,
        starts_agree_px=fit.starts_agree_px,
        worse_starts=fit.worse_starts,
        next_pose="" if pose is None else pose.words,
        limits=judged(devices, fit),
        warnings=warnings_of(measured.views, views, calibration),
        seconds=time.perf_counter() - started_s,
        output=output,
        report=report,
    )


def _joint_rms(devices: tuple[DeviceLens, ...]) -> float:
    corners = sum(device.corners for device in devices)
    return float(np.sqrt(sum(device.corners * device.rms_px**2 for device in devices) / max(corners, 1)))


def _pose(calibration: LensCalibration) -> PairPose | None:
    if calibration.projector is None:
        return None
    state, part = calibration.state, calibration.covariance[RELATIVE, RELATIVE]
    place = state.projector_translation_m
    length = float(np.linalg.norm(place))
    along = place / max(length, 1e-12)
    x, y, z = place.tolist()
    sx, sy, sz = np.sqrt(np.diag(part)[3:]).tolist()
    return PairPose(
        rotation=tuple(state.projector_rotation.ravel().tolist()),
        translation_m=(x, y, z),
        translation_sigma_m=(sx, sy, sz),
        baseline_m=length,
        baseline_sigma_m=float(np.sqrt(along @ part[3:, 3:] @ along)),
    )


def lens_file_of(measured: Measured) -> LensFile:
    """Return what is written of a calibration."""
    calibration = measured.calibration
    summaries = {maps.role: maps for maps in measured.maps}
    names = {"camera": measured.manifest.camera.name}
    if measured.manifest.projector is not None:
        names["projector"] = measured.manifest.projector.name
    entries = []
    for role, lens, part in _lenses(calibration):
        device = device_summary(names[role], role, measured.fit, summaries[role])
        entries.append(_entry(device, lens, np.sqrt(np.diag(calibration.covariance)[part])))
    return LensFile(
        schema=SCHEMA,  # type: ignore[call-arg]
        made_by=f"procam-rig {__version__}",
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        views=calibration.sightings.views,
        lens=tuple(entries),
        projector_from_camera=_pose_entry(calibration),
        joint=_joint(calibration),
    )


def _entry(device: DeviceLens, lens: FittedLens, sigma: FloatArray) -> LensEntry:
    return LensEntry(
        name=device.name,
        role="projector" if device.role == "projector" else "camera",
        width_px=device.width_px,
        height_px=device.height_px,
        model=device.model,
        focal_px=device.focal_px,
        principal_point_px=device.principal_point_px,
        distortion=device.distortion,
        sigma=tuple(sigma[: 4 + len(lens.distortion)].tolist()),
        rms_px=device.rms_px,
        noise_px=device.noise_px,
        projection_sigma_px=device.projection_sigma_px[1],
    )


def _pose_entry(calibration: LensCalibration) -> PoseEntry | None:
    pose = _pose(calibration)
    if pose is None:
        return None
    sigma = np.sqrt(np.diag(calibration.covariance)[RELATIVE])
    return PoseEntry(rotation=pose.rotation, translation_m=pose.translation_m, sigma=tuple(sigma.tolist()))


def _joint(calibration: LensCalibration) -> JointEntry:
    names = [
        *(f"camera.{name}" for name in PARAMETERS),
        *(f"projector.{name}" for name in PARAMETERS),
        *POSE_PARAMETERS,
        "board.flex_x",
        "board.flex_y",
        "board.twist",
        "board.stretch",
    ]
    free = np.flatnonzero(calibration.free)
    part = calibration.covariance[np.ix_(free, free)]
    return JointEntry(parameters=tuple(names[k] for k in free), covariance=tuple(tuple(row) for row in part.tolist()))
