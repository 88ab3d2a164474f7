"""From fits and maps to the numbers that are printed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.lenses.bundle import CAMERA, PROJECTOR
from calibration.lenses.calibrate import LensFit
from calibration.lenses.fit import view_rms
from calibration.lenses.records import LensCalibration
from calibration.lenses.refusals.undetermined import tilts_deg
from rig.lenses.maps import DeviceMaps
from rig.lenses.records import DeviceLens, HalvesSummary, LeftOutSummary, ViewSummary
from rig.lenses.views import SeenView

FloatArray = NDArray[np.float64]
_FIELDS = 10
"""A side, in which a picture's coverage is counted."""


def device_summary(name: str, role: str, fit: LensFit, maps: DeviceMaps) -> DeviceLens:
    """Return the numbers of one device."""
    calibration, lens = fit.calibration, maps.lens
    second = role == "projector"
    sigma = np.sqrt(np.diag(calibration.covariance)[PROJECTOR if second else CAMERA])
    scores = fit.projector_scores if second else fit.camera_scores
    return DeviceLens(
        name=name,
        role=role,
        width_px=lens.width_px,
        height_px=lens.height_px,
        model=lens.model,
        focal_px=lens.focal_px,
        focal_sigma_px=(float(sigma[0]), float(sigma[1])),
        principal_point_px=lens.principal_point_px,
        principal_point_sigma_px=(float(sigma[2]), float(sigma[3])),
        distortion=lens.distortion,
        rms_px=_rms(maps.residual_px),
        rms_all_px=_rms(np.concatenate([maps.residual_px, maps.left_out_residual_px])),
        noise_px=calibration.noise_px[int(second)],
        corners=len(maps.seen_px),
        left_out=len(maps.left_out_px),
        projection_sigma_px=_middle_median_worst(maps.sigma_far_px, maps),
        projection_sigma_near_px=_middle_median_worst(maps.sigma_near_px, maps),
        covered_share=covered_share(maps),
        left_out_models=tuple(LeftOutSummary(model=one.model, rms_px=one.left_out_px) for one in scores),
        halves=_halves(maps),
    )


def _rms(residual_px: FloatArray) -> float:
    return float(np.sqrt((residual_px**2).sum(axis=1).mean())) if len(residual_px) else 0.0


def _middle_median_worst(sigma_px: FloatArray, maps: DeviceMaps) -> tuple[float, float, float]:
    """In the middle of the picture; median and worst within the outline of the corners."""
    rows, columns = maps.grid_shape
    middle, inside = sigma_px.reshape(rows, columns)[rows // 2, columns // 2], sigma_px[maps.inside]
    return float(middle), float(np.nanmedian(inside)), float(np.nanmax(inside))


def covered_share(maps: DeviceMaps) -> float:
    """Share of a picture's fields in which a corner was seen."""
    size = np.array([maps.lens.width_px, maps.lens.height_px])
    field = np.clip(np.floor(maps.seen_px / size * _FIELDS), 0, _FIELDS - 1).astype(int)
    return len(np.unique(field, axis=0)) / _FIELDS**2 if len(field) else 0.0


def _halves(maps: DeviceMaps) -> HalvesSummary | None:
    if maps.halves is None:
        return None
    inside = maps.halves.rows(maps.inside)
    expected = float(np.sqrt(np.nanmean(inside.expected_px**2)))
    return HalvesSummary(difference_px=inside.rms_px, expected_px=expected, ratio=inside.ratio)


def view_summaries(views: tuple[SeenView, ...], calibration: LensCalibration) -> tuple[ViewSummary, ...]:
    """Return a line for each view, in the manifest's order."""
    sightings = calibration.sightings
    there = np.column_stack([sightings.camera_weight, sightings.projector_weight]) > 0
    length = np.linalg.norm(calibration.residual_px.reshape(-1, 2, 2), axis=2)
    rms = view_rms(length, there, sightings)
    used = np.bincount(sightings.view, weights=calibration.used[:, 0], minlength=sightings.views)
    tilts, places = tilts_deg(calibration.state), calibration.state.translations_m
    found, k = [], 0
    for view in views:
        if view.problem:
            found.append(ViewSummary(name=view.name, used=False, corners=len(view.board_m), note=view.problem))
            continue
        fits = bool(used[k] > 0)
        found.append(
            ViewSummary(
                name=view.name,
                used=fits,
                corners=len(view.board_m),
                camera_rms_px=_number(rms[k, 0]),
                projector_rms_px=_number(rms[k, 1]),
                tilt_deg=float(tilts[k]),
                distance_m=float(np.linalg.norm(places[k])),
                note="" if fits else _fits_none(rms[k], rms),
            )
        )
        k += 1
    return tuple(found)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _fits_none(own: FloatArray, rms: FloatArray) -> str:
    usual = np.nanmedian(rms, axis=0)
    device = int(np.nanargmax(own / usual))
    return (
        f"fits none of the lenses: its {('camera', 'projector')[device]}'s corners lie {own[device]:.2f} px from where "
        f"they should be, the other views' {usual[device]:.2f} px; the camera's zoom or focus was changed, something "
        "moved while it was photographed, its photographs are turned or in another order, or the board is another: "
        "take it again, or leave it out"
    )
