"""Correspondence and geometry: steps `gray`, `correspondence`, `geometry`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import cv2
import numpy as np

from calibration.errors import CalibrationError
from calibration.geometry.epipolar import NominalIntrinsics
from calibration.geometry.pinhole import PinholeModel
from calibration.geometry.room import RoomBox, room_from_stereo
from calibration.geometry.stereo import StereoCalibration, calibrate_stereo, scale_from_baseline, scale_from_spots
from calibration.structured_light.code import CODES
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.patterns import flat
from calibration.structured_light.subpixel import refine_subpixel
from rig.capture.rig import Rig
from rig.profile.schema import Profile
from rig.session import Session, Step
from rig.stages.linear_light import RadiometricCalibration
from rig.stages.photograph import ExposureBracket, frame_name, photograph
from rig.stages.radiometry import load_radiometric_calibration, reference_exposure_s
from rig.terminal import OnStep

CODE = "long-run"
_SIGMAS = 2.0
"""A bit counts when pattern and inverse differ by more than so many standard deviations of their noise.

An unlit pixel passes by chance in all of some twenty bits with a probability below 1e-20."""
_LEAST_VALID_SHARE = 0.01
_EDGE_SHARE = 0.005
"""Pixels nearer than this to an edge do not enter the geometry, as a share of the picture's width."""


def photograph_gray_code(rig: Rig, session: Session, on_step: OnStep) -> None:
    """Step `gray`: white, black, and the planes of the Gray code with their inverses."""
    shot = ExposureBracket((reference_exposure_s(session),))
    step = session.step("gray", settings={"code": CODE, "exposures_s": shot.exposures_s}, needs=("exposure",))
    if step.done:
        return
    shape = rig.projector.shape
    code = CODES[CODE]
    count = 2 + len(code.pattern_names(shape))
    flats = [flat(shape, 255, "white"), flat(shape, 0, "black")]
    photograph(rig, session, step, flats, shot, 2, lambda label, done, total: on_step(label, done, count))
    photograph(
        rig,
        session,
        step,
        code.patterns(shape),
        shot,
        count - 2,
        lambda label, done, total: on_step(label, done + 2, count),
    )
    step.finish()


def decode_gray_code(rig: Rig, session: Session, on_step: OnStep) -> None:
    """Step `correspondence`: which projector pixel each camera pixel sees, and why some see none."""
    step = session.step("correspondence", settings={"sigmas": _SIGMAS}, needs=("gray", "response"))
    if step.done:
        return
    on_step("decode", 0, 2)
    correspondence = _decode(session.finished("gray"), session, rig.projector.shape)
    valid_share = float(correspondence.valid.mean())
    if valid_share < _LEAST_VALID_SHARE:
        raise CalibrationError(
            f"only {100 * valid_share:.2f} % of the camera's pixels have a projector pixel, the limit is "
            f"{100 * _LEAST_VALID_SHARE:g} %: aim the camera at the projected picture, darken the room, check the focus"
        )
    on_step("decode", 1, 2)
    refined = refine_subpixel(correspondence)
    xy = refined.projector_xy_px
    step.save_image(
        "correspondence",
        {"column": xy[..., 0], "row": xy[..., 1], "reason": refined.reason.astype(np.float32)},
        folder="maps",
    )
    reasons = {code.name.lower(): float((refined.reason == code).mean()) for code in PixelReason}
    step.save_record("correspondence", {"valid_share_of_image": valid_share, "reasons": reasons})
    step.finish()
    on_step("decode", 2, 2)


def _decode(gray: Step, session: Session, projector_shape: tuple[int, int]) -> Correspondence:
    radiometric = load_radiometric_calibration(session)
    code = CODES[CODE]
    names = code.pattern_names(projector_shape)
    frames = {name: _grey(gray.load_frame(frame_name(name)).pixels, radiometric) for name in names}
    white, black = (gray.load_frame(frame_name(name)).pixels for name in ("white", "black"))
    limit = _SIGMAS * np.sqrt(2) * _noise_dn(white, black, radiometric)
    return code.decode(
        frames,
        projector_shape,
        white=_grey(white, radiometric),
        black=_grey(black, radiometric),
        noise_limit=limit,
        saturation=radiometric.saturation_dn * white.shape[2],
    )


def _grey(pixels: np.ndarray, radiometric: RadiometricCalibration) -> np.ndarray:
    """(H, W) sum of the bands (H, W, B): the code is in each."""
    most = np.min_scalar_type(radiometric.full_scale_dn * pixels.shape[2])
    return np.asarray(pixels.sum(axis=2, dtype=np.promote_types(np.uint16, most)))


def _noise_dn(white: np.ndarray, black: np.ndarray, radiometric: RadiometricCalibration) -> np.ndarray:
    """(H, W) standard deviation of the bands' sum of a half-lit frame."""
    level = np.maximum((white.astype(np.float32) + black) / 2 - radiometric.offset_dn, 0)
    variance = level / radiometric.gain_e_per_dn + radiometric.read_noise_dn**2 + 1 / 12
    return np.asarray(np.sqrt(variance.sum(axis=2)))


def load_correspondence(session: Session) -> Correspondence:
    """The finished step's map."""
    image = session.finished("correspondence").load_image("correspondence")
    xy = np.stack([image["column"], image["row"]], axis=-1)
    return Correspondence(xy, image["reason"].astype(np.uint8), session.profile.projector.shape)


def fit_geometry(rig: Rig, session: Session, on_step: OnStep) -> None:
    """Step `geometry`: lenses, poses, planes, metres, room."""
    profile = rig.profile
    settings = {
        "hfov_deg": [profile.camera.hfov_deg, profile.projector.hfov_deg],
        "scale": profile.scale.model_dump(),
        "room": profile.box.model_dump(exclude={"patch_size_m"}),
    }
    step = session.step("geometry", settings=settings, needs=("correspondence",))
    if step.done:
        return
    correspondence = load_correspondence(session)
    rows, columns = np.nonzero(_well_inside(correspondence))
    camera_xy = np.stack([columns, rows], axis=1).astype(np.float64)
    projector_xy = correspondence.projector_xy_px[rows, columns].astype(np.float64)
    nominal = NominalIntrinsics.of(
        camera_shape=rig.camera.shape[:2],
        projector_shape=rig.projector.shape,
        camera_hfov_deg=profile.camera.hfov_deg,
        projector_hfov_deg=profile.projector.hfov_deg,
    )
    pair = calibrate_stereo(
        camera_xy,
        projector_xy,
        nominal,
        right_angles=profile.box.right_angles,
        on_step=lambda done, total: on_step("fit geometry", done, total),
    )
    pair = _in_metres(pair, profile)
    box = room_from_stereo(pair, profile.box.size_m, profile.box.closed)
    step.save_record("geometry", _record(pair, box))
    step.finish()


def _well_inside(correspondence: Correspondence) -> np.ndarray:
    """Pixels away from edges of the picture and of surfaces, where sub-pixel coordinates are biased.

    At such edges the refinement keeps integer codes, so these tell where the edges are.
    """
    xy = correspondence.projector_xy_px
    with np.errstate(invalid="ignore"):
        whole = (np.abs(xy * 2 - np.round(xy * 2)) < 1e-6).all(axis=-1)
    refined = (correspondence.valid & ~whole).astype(np.uint8)
    size = 2 * round(_EDGE_SHARE * refined.shape[1]) + 1
    inside = cv2.erode(refined, np.ones((size, size), np.uint8), borderValue=0) > 0
    return inside if inside.sum() > 0.2 * refined.sum() else refined > 0


def _in_metres(pair: StereoCalibration, profile: Profile) -> StereoCalibration:
    scale = profile.scale
    if scale.baseline_m is not None:
        return scale_from_baseline(pair, scale.baseline_m)
    return scale_from_spots(pair, np.array(scale.spots_px), float(scale.distance_m or 0))


def _record(pair: StereoCalibration, box: RoomBox) -> dict[str, Any]:
    return {
        "camera": asdict(box.camera),
        "projector": asdict(box.projector),
        "room": {
            "size_m": list(box.size_m),
            "seen": list(box.seen),
            "faces": list(box.faces),
            "angle_error_deg": box.angle_error_deg,
            "notes": box.notes,
        },
        "baseline_m": pair.baseline,
        "rms_px": pair.rms_px,
        "camera_rms_px": pair.camera_rms_px,
        "projector_rms_px": pair.projector_rms_px,
        "inlier_share": pair.inlier_share,
        "sigmas": pair.sigmas,
    }


def pinhole_of(record: Mapping[str, Any]) -> PinholeModel:
    """A PinholeModel from its JSON record."""
    k1, k2, p1, p2, k3 = record["distortion"]
    return PinholeModel(
        width_px=record["width_px"],
        height_px=record["height_px"],
        focal_px=(record["focal_px"][0], record["focal_px"][1]),
        principal_point_px=(record["principal_point_px"][0], record["principal_point_px"][1]),
        distortion=(k1, k2, p1, p2, k3),
        rotation=np.array(record["rotation"]),
        translation_m=np.array(record["translation_m"]),
    )
