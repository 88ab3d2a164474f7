"""The room in patches: vignetting, reflectance, flux, brightness scale. Step `model`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.records import CalibrationError
from calibration.reflectance import ReflectanceFit, Vignetting, estimate_reflectance, fit_vignetting
from rig.profile import Profile
from rig.session import Session
from rig.terminal import OnStep
from rig.twin import Look, Optic, RoomTwin, box_scene, camera_view, look, optic, unit_emission, white_irradiance
from rig.workflows.calibrate import load_correspondence, pinhole_of
from sim.form_factors import form_factors
from sim.optics import project
from sim.scene import Scene

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_LEAST_DIRECT = 0.05
"""A pixel is lit when its direct light is above this share of the median of the lit."""
_LEAST_PIXELS = 40
"""Camera pixels that a patch needs before its light counts."""
_SMOOTHING_SHARE = 0.003
"""Spread of the smoothing of the global share, of the picture's width."""


@dataclass(frozen=True, eq=False)
class RoomRecord:
    """The finished model, loaded."""

    twin: RoomTwin
    level: float
    """Camera value of a target's 255."""
    lit: BoolArray
    """(H, W) lit and valid camera pixels."""
    white: FloatArray
    """(H, W) light of projector white."""
    white_variance: FloatArray


@dataclass(frozen=True, eq=False)
class _Geometry:
    scene: Scene
    camera: Optic
    projector: Optic
    camera_look: Look


def build_model(profile: Profile, session: Session, on_step: OnStep) -> None:
    """Fit what light does in the measured room; decide the brightness scale."""
    settings = {
        "patch_size_m": profile.room.patch_size_m,
        "target_white_share": profile.brightness.target_white_share,
        "smoothing_share": _SMOOTHING_SHARE,
        "least_pixels": _LEAST_PIXELS,
        "global_gain": "of white",
    }
    step = session.step("model", settings=settings, needs=("geometry", "separation", "correspondence"))
    if step.done:
        return
    on_step("build model", 0, 4)
    geometry = _geometry(session, profile.room.patch_size_m)
    light = session.finished("separation").load_image("separation")
    valid = load_correspondence(session).valid & (light["valid"] > 0)
    lit = _lit(light["direct"], valid)
    gain = _direct_gain(light, lit, geometry.camera_look)
    on_step("build model", 1, 4)
    vignetting = _fit_lenses(geometry, gain, lit)
    camera = Optic(geometry.camera.lens, geometry.camera.pose, vignetting.camera)
    projector = Optic(geometry.projector.lens, geometry.projector.pose, vignetting.projector)
    on_step("build model", 2, 4)
    fit = _fit_reflectance(geometry, camera, projector, gain, light, lit)
    on_step("build model", 3, 4)
    level = profile.brightness.target_white_share * float(np.median(light["white"][lit]))
    scene = geometry.scene.with_reflectance(fit.reflectance)
    global_gain = _global_gain(_twin(session, scene, camera, projector, fit.flux, gain), light, lit)
    maps: dict[str, NDArray[Any]] = {"gain": gain, "lit": lit.astype(np.float32), "global_gain": global_gain}
    step.save_image("direct-gain", maps, folder="maps")
    step.save_record("model", _record(fit, vignetting, level, profile.room.patch_size_m, light, lit))
    step.finish()
    on_step("build model", 4, 4)


def _geometry(session: Session, patch_size_m: float) -> _Geometry:
    record = session.finished("geometry").load_record("geometry")
    camera, projector = optic(pinhole_of(record["camera"])), optic(pinhole_of(record["projector"]))
    room = record["room"]
    scene = box_scene(tuple(room["size_m"]), tuple(room["faces"]), patch_size_m, 0.5)
    return _Geometry(scene, camera, projector, look(scene, camera))


def _lit(direct: NDArray[np.float32], valid: BoolArray) -> BoolArray:
    if not (direct[valid] > 0).any():
        raise CalibrationError("no valid pixel has direct light; look at the correspondence map and at the checkers")
    return np.asarray(valid & (direct > _LEAST_DIRECT * np.median(direct[valid])))


def _direct_gain(light: dict[str, NDArray[np.float32]], lit: BoolArray, camera_look: Look) -> FloatArray:
    """(H, W) direct light of white, 0 where not lit.

    The checkers tell the share of direct light with noise; that share is smooth along a wall (reflectance and
    vignetting cancel in it), so it is smoothed there and applied to the white frame, which has little noise.
    """
    share = np.where(lit, light["direct"] / np.maximum(light["white"], 1e-9), 0.0).astype(np.float64)
    return _smoothed_along_faces(share, lit, camera_look) * light["white"]


def _smoothed_along_faces(values: FloatArray, lit: BoolArray, camera_look: Look) -> FloatArray:
    """(H, W) means around each lit pixel over the lit pixels of its face; 0 where not lit."""
    face = camera_look.hits.face.reshape(lit.shape)
    sigma = _SMOOTHING_SHARE * lit.shape[1]
    smooth = np.zeros(lit.shape)
    for k in np.unique(face[lit]):
        on = (lit & (face == k)).astype(np.float64)
        weight = cv2.GaussianBlur(on, (0, 0), sigma)
        total = cv2.GaussianBlur(np.where(lit, values, 0.0) * on, (0, 0), sigma)
        smooth = np.where(on > 0, total / np.maximum(weight, 1e-9), smooth)
    return smooth


def _global_gain(twin: RoomTwin, light: dict[str, NDArray[np.float32]], lit: BoolArray) -> FloatArray:
    """(H, W) global light of white as measured over as modelled, smoothed; 1 where not lit."""
    modelled = simulated_white(twin)["global"]
    known = lit & (modelled > 0)
    ratio = np.where(known, (light["white"] - twin.direct_gain) / np.where(known, modelled, 1.0), 1.0)
    return np.where(lit, _smoothed_along_faces(ratio, lit, twin.camera_look), 1.0)


def _fit_lenses(geometry: _Geometry, gain: FloatArray, lit: BoolArray) -> Vignetting:
    hits, points = geometry.camera_look.hits, geometry.camera_look.points_m
    e = white_irradiance(geometry.scene, geometry.projector, points, hits.patch)
    usable = np.flatnonzero(lit.ravel() & (e > 0) & (gain.ravel() > 0))
    sample = usable[:: max(1, len(usable) // 20000)]
    camera_xy = geometry.camera.lens.pixel_grid()[sample]
    projector_xy = project(geometry.projector.lens, geometry.projector.pose, points[sample])
    return fit_vignetting(
        gain.ravel()[sample],
        e[sample],
        hits.face[sample],
        geometry.camera.radius(camera_xy),
        geometry.projector.radius(projector_xy),
    )


def _fit_reflectance(
    geometry: _Geometry,
    camera: Optic,
    projector: Optic,
    gain: FloatArray,
    light: dict[str, NDArray[np.float32]],
    lit: BoolArray,
) -> ReflectanceFit:
    """Patch means of what the camera saw, its vignetting taken out, to the inverse radiosity problem."""
    scene, hits = geometry.scene, geometry.camera_look.hits
    e = white_irradiance(scene, projector, geometry.camera_look.points_m, hits.patch)
    brightness = camera.illumination(camera.lens.pixel_grid())
    direct = np.where(e > 0, gain.ravel() / np.where(e > 0, e * brightness, 1.0), 0.0)
    lit_flat = lit.ravel() & (e > 0)
    # Outside the lit area all light is global; close to its border the lens mixes both.
    border = cv2.dilate((light["direct"] > 0.02 * np.median(light["direct"][lit])).astype(np.uint8), np.ones((9, 9)))
    dark = (border == 0).ravel() & (hits.patch >= 0)
    global_light = np.where(lit_flat, light["white"].ravel() - gain.ravel(), light["white"].ravel()) / brightness
    per_lit = _patch_mean(scene, hits.patch, direct, lit_flat)
    per_global = _patch_mean(scene, hits.patch, global_light, lit_flat | dark)
    irradiance = np.asarray(unit_emission(scene, projector) @ np.ones(projector.lens.n_pixels))
    factors = form_factors(scene).matrix
    return estimate_reflectance(per_lit, per_global, irradiance, factors)


def _patch_mean(scene: Scene, patch: NDArray[np.intp], values: FloatArray, chosen: BoolArray) -> FloatArray:
    """(P,) mean over each patch's chosen pixels, NaN where they are too few."""
    index = patch[chosen]
    count = np.bincount(index, minlength=scene.n_patches)
    total = np.bincount(index, values[chosen], minlength=scene.n_patches)
    return np.where(count >= _LEAST_PIXELS, total / np.maximum(count, 1), np.nan)


def _record(
    fit: ReflectanceFit,
    vignetting: Vignetting,
    level: float,
    patch_size_m: float,
    light: dict[str, NDArray[np.float32]],
    lit: BoolArray,
) -> dict[str, Any]:
    white = np.maximum(light["white"][lit], 1e-9)
    return {
        "patch_size_m": patch_size_m,
        "reflectance": fit.reflectance,
        "source": fit.source,
        "flux": fit.flux,
        "flux_sigma": fit.flux_sigma,
        "unseen_reflectance": fit.unseen_reflectance,
        "unseen_sigma": fit.unseen_sigma,
        "global_rms": fit.global_rms,
        "vignetting_camera": vignetting.camera,
        "vignetting_projector": vignetting.projector,
        "vignetting_rms": vignetting.rms,
        "level": level,
        "white_median": float(np.median(light["white"][lit])),
        "global_share_mean": float((light["global"][lit] / white).mean()),
        "lit_share_of_image": float(lit.mean()),
    }


def simulated_white(twin: RoomTwin) -> dict[str, FloatArray]:
    """(H, W) direct and global light of white as the patches alone predict them, without `global_gain`."""
    transport = camera_view(replace(twin, global_gain=1.0), np.ones(twin.projector.lens.n_pixels, dtype=bool))
    white = np.ones(twin.projector.lens.n_pixels)
    shape = twin.camera.lens.shape
    return {"direct": (transport.direct @ white).reshape(shape), "global": (transport.global_ @ white).reshape(shape)}


def _twin(session: Session, scene: Scene, camera: Optic, projector: Optic, flux: float, gain: FloatArray) -> RoomTwin:
    xy = load_correspondence(session).projector_xy_px.astype(np.float64)
    return RoomTwin(
        scene,
        form_factors(scene),
        camera,
        projector,
        flux,
        unit_emission(scene, projector),
        look(scene, camera),
        look(scene, projector),
        gain,
        xy,
    )


def load_model(session: Session) -> RoomRecord:
    """The finished step's model, read from the disk once for each of its results."""
    return _read_model(session, session.finished("model").outputs_sha256)


@lru_cache(maxsize=1)
def _read_model(session: Session, outputs_sha256: str) -> RoomRecord:
    step = session.finished("model")
    record, maps = step.load_record("model"), step.load_image("direct-gain")
    light = session.finished("separation").load_image("separation")
    geometry = session.finished("geometry").load_record("geometry")
    camera = optic(pinhole_of(geometry["camera"]), tuple(record["vignetting_camera"]))
    projector = optic(pinhole_of(geometry["projector"]), tuple(record["vignetting_projector"]))
    room = geometry["room"]
    scene = box_scene(
        tuple(room["size_m"]), tuple(room["faces"]), record["patch_size_m"], np.array(record["reflectance"])
    )
    twin = _twin(session, scene, camera, projector, record["flux"], maps["gain"].astype(np.float64))
    twin = replace(twin, global_gain=maps["global_gain"].astype(np.float64))
    return RoomRecord(
        twin,
        record["level"],
        maps["lit"] > 0,
        light["white"].astype(np.float64),
        light["white_variance"].astype(np.float64),
    )
