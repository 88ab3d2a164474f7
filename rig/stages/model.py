"""The room in patches: vignetting, reflectance, flux, brightness scale. Step `model`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.light.reflectance import ReflectanceFit, estimate_reflectance
from calibration.light.vignetting import Vignetting, fit_vignetting
from rig.files.channels import image_of, layers, merged, of_bands
from rig.profile.schema import Profile
from rig.session import Session
from rig.stages.correspondence import load_correspondence, pinhole_of
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.scene_model import (
    ColouredRoom,
    Look,
    PosedLens,
    SceneModel,
    box_scene,
    camera_view,
    look,
    optic,
    unit_emission,
    white_irradiance,
)
from rig.terminal import OnStep
from sim.form_factors import form_factors
from sim.geometry.optics import project
from sim.geometry.scene import Scene

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Light = dict[str, NDArray[np.float32]]
"""One band's light of white in parts, (H, W) by name."""

_LEAST_DIRECT = 0.05
"""A pixel is lit when its direct light is above this share of the median of the lit ..."""
_LEAST_IN_A_BAND = 0.005
"""... and in each band above this share."""
_LEAST_PIXELS = 40
"""Camera pixels that a patch needs before its light counts."""
_SMOOTHING_SHARE = 0.003
"""Spread of the smoothing of the global share, of the picture's width."""


@dataclass(frozen=True, eq=False)
class FittedScene:
    """The finished model, loaded."""

    room: ColouredRoom
    level: float
    """Camera value of a target's 255, in each band."""
    lit: BoolArray
    """(H, W) lit and valid camera pixels."""
    white: FloatArray
    """(H, W, B) light of projector white."""
    white_variance: FloatArray

    @property
    def scene_model(self) -> SceneModel:
        """The first band's: lenses, poses, patches and looks are those of all."""
        return self.room.bands[0]

    @property
    def channels(self) -> int:
        """B, bands of the camera and channels of the projector."""
        return len(self.room.bands)


@dataclass(frozen=True, eq=False)
class _Geometry:
    scene: Scene
    camera: PosedLens
    projector: PosedLens
    camera_look: Look


def build_model(profile: Profile, session: Session, on_step: OnStep) -> None:
    """Fit what light does in the measured room; decide the brightness scale."""
    settings = {
        "patch_size_m": profile.box.patch_size_m,
        "target_white_share": profile.brightness.target_white_share,
        "smoothing_share": _SMOOTHING_SHARE,
        "least_pixels": _LEAST_PIXELS,
        "global_gain": "of white",
    }
    step = session.step("model", settings=settings, needs=("geometry", "separation", "correspondence"))
    if step.done:
        return
    on_step("build model", 0, 4)
    geometry = _geometry(session, profile.box.patch_size_m)
    bands, valid = _light(session)
    lit = _lit(bands, valid)
    gains = [_direct_gain(light, lit, geometry.camera_look) for light in bands]
    on_step("build model", 1, 4)
    vignetting = _fit_lenses(geometry, np.mean(gains, axis=0), lit)
    camera = PosedLens(geometry.camera.lens, geometry.camera.pose, vignetting.camera)
    projector = PosedLens(geometry.projector.lens, geometry.projector.pose, vignetting.projector)
    on_step("build model", 2, 4)
    fits = [_fit_reflectance(geometry, camera, projector, g, b, lit) for g, b in zip(gains, bands, strict=True)]
    on_step("build model", 3, 4)
    surfaces = [(fit.reflectance, fit.flux) for fit in fits]
    twins = _twins(session, geometry.scene, camera, projector, surfaces, gains)
    global_gain = np.stack([_global_gain(t, b, lit) for t, b in zip(twins, bands, strict=True)], axis=-1)
    maps: dict[str, NDArray[Any]] = layers("gain", np.stack(gains, axis=-1)) | layers("global_gain", global_gain)
    step.save_image("direct-gain", {**maps, "lit": lit.astype(np.float32)}, folder="maps")
    step.save_record("model", _record(profile, fits, vignetting, bands, lit))
    step.finish()
    on_step("build model", 4, 4)


def _light(session: Session) -> tuple[list[Light], BoolArray]:
    """Direct light, global light and white of each band, (H, W) by name, and where they are valid."""
    image = session.finished("separation").load_image("separation")
    stacks = {name: image_of(image, name) for name in ("direct", "global", "white", "white_variance")}
    n_bands = stacks["white"].shape[-1]
    bands = [{name: np.ascontiguousarray(stack[..., b]) for name, stack in stacks.items()} for b in range(n_bands)]
    return bands, load_correspondence(session).valid & (image["valid"] > 0)


def _geometry(session: Session, patch_size_m: float) -> _Geometry:
    record = session.finished("geometry").load_record("geometry")
    camera, projector = optic(pinhole_of(record["camera"])), optic(pinhole_of(record["projector"]))
    room = record["room"]
    scene = box_scene(tuple(room["size_m"]), tuple(room["faces"]), patch_size_m, 0.5)
    return _Geometry(scene, camera, projector, look(scene, camera))


def _lit(bands: list[Light], valid: BoolArray) -> BoolArray:
    direct = np.mean([light["direct"] for light in bands], axis=0)
    if not (direct[valid] > 0).any():
        raise CalibrationError("no valid pixel has direct light; look at the correspondence map and at the checkers")
    enough = [light["direct"] > _LEAST_IN_A_BAND * np.median(light["direct"][valid]) for light in bands]
    return np.asarray(valid & (direct > _LEAST_DIRECT * np.median(direct[valid])) & np.all(enough, axis=0))


def _direct_gain(light: Light, lit: BoolArray, camera_look: Look) -> FloatArray:
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


def _global_gain(scene_model: SceneModel, light: Light, lit: BoolArray) -> FloatArray:
    """(H, W) global light of white as measured over as modelled, smoothed; 1 where not lit."""
    modelled = _simulated_white(scene_model)["global"]
    known = lit & (modelled > 0)
    ratio = np.where(known, (light["white"] - scene_model.direct_gain) / np.where(known, modelled, 1.0), 1.0)
    return np.where(lit, _smoothed_along_faces(ratio, lit, scene_model.camera_look), 1.0)


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
        face=hits.face[sample],
        camera_r=geometry.camera.radius(camera_xy),
        projector_r=geometry.projector.radius(projector_xy),
    )


def _fit_reflectance(
    geometry: _Geometry,
    camera: PosedLens,
    projector: PosedLens,
    gain: FloatArray,
    light: Light,
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
    profile: Profile, fits: list[ReflectanceFit], vignetting: Vignetting, bands: list[Light], lit: BoolArray
) -> dict[str, Any]:
    medians = [float(np.median(light["white"][lit])) for light in bands]
    return {
        "patch_size_m": profile.box.patch_size_m,
        **merged([_fit_record(fit) for fit in fits]),
        "vignetting_camera": vignetting.camera,
        "vignetting_projector": vignetting.projector,
        "vignetting_rms": vignetting.rms,
        "level": profile.brightness.target_white_share * float(np.mean(medians)),
        **merged([_light_record(light, lit) for light in bands]),
        "lit_share_of_image": float(lit.mean()),
    }


def _fit_record(fit: ReflectanceFit) -> dict[str, Any]:
    return {
        "reflectance": fit.reflectance,
        "source": fit.source,
        "flux": fit.flux,
        "flux_sigma": fit.flux_sigma,
        "unseen_reflectance": fit.unseen_reflectance,
        "unseen_sigma": fit.unseen_sigma,
        "global_rms": fit.global_rms,
    }


def _light_record(light: Light, lit: BoolArray) -> dict[str, Any]:
    white = np.maximum(light["white"][lit], 1e-9)
    return {
        "white_median": float(np.median(light["white"][lit])),
        "global_share_mean": float((light["global"][lit] / white).mean()),
    }


def simulated_white(room: ColouredRoom) -> dict[str, FloatArray]:
    """(H, W, B) direct and global light of white as the patches alone predict them, without `global_gain`."""
    parts = [_simulated_white(scene_model) for scene_model in room.bands]
    return {name: np.stack([part[name] for part in parts], axis=-1) for name in ("direct", "global")}


def _simulated_white(scene_model: SceneModel) -> dict[str, FloatArray]:
    transport = camera_view(
        replace(scene_model, global_gain=1.0), np.ones(scene_model.projector.lens.n_pixels, dtype=bool)
    )
    white = np.ones(scene_model.projector.lens.n_pixels)
    shape = scene_model.camera.lens.shape
    return {"direct": (transport.direct @ white).reshape(shape), "global": (transport.global_ @ white).reshape(shape)}


def _twins(
    session: Session,
    scene: Scene,
    camera: PosedLens,
    projector: PosedLens,
    surfaces: Sequence[tuple[FloatArray, float]],
    gains: Sequence[FloatArray],
) -> list[SceneModel]:
    """The room in each band, of which reflectance and flux are known; what depends on geometry alone is made once."""
    reflectance, flux = surfaces[0]
    first = SceneModel(
        scene.with_reflectance(reflectance),
        form_factors(scene),
        camera,
        projector,
        flux,
        unit_emission(scene, projector),
        look(scene, camera),
        look(scene, projector),
        gains[0],
        load_correspondence(session).projector_xy_px.astype(np.float64),
    )
    others = [
        replace(first, scene=scene.with_reflectance(reflectance), flux=flux, direct_gain=gain)
        for (reflectance, flux), gain in zip(surfaces[1:], gains[1:], strict=True)
    ]
    return [first, *others]


def load_model(session: Session) -> FittedScene:
    """The finished step's model, read from the disk once for each of its results."""
    return _read_model(session, session.finished("model").outputs_sha256)


@lru_cache(maxsize=1)
def _read_model(session: Session, outputs_sha256: str) -> FittedScene:
    step = session.finished("model")
    record, maps = step.load_record("model"), step.load_image("direct-gain")
    light = session.finished("separation").load_image("separation")
    gains, global_gains = (_by_band(image_of(maps, name)) for name in ("gain", "global_gain"))
    twins = _read_twins(session, record, gains)
    bands = tuple(replace(scene_model, global_gain=gain) for scene_model, gain in zip(twins, global_gains, strict=True))
    return FittedScene(
        ColouredRoom(bands, load_radiometric_calibration(session).mixing),
        record["level"],
        maps["lit"] > 0,
        image_of(light, "white").astype(np.float64),
        image_of(light, "white_variance").astype(np.float64),
    )


def _by_band(image: NDArray[np.float32]) -> list[FloatArray]:
    return [image[..., b].astype(np.float64, order="C") for b in range(image.shape[-1])]


def _read_twins(session: Session, record: dict[str, Any], gains: list[FloatArray]) -> list[SceneModel]:
    geometry = session.finished("geometry").load_record("geometry")
    camera = optic(pinhole_of(geometry["camera"]), tuple(record["vignetting_camera"]))
    projector = optic(pinhole_of(geometry["projector"]), tuple(record["vignetting_projector"]))
    room = geometry["room"]
    scene = box_scene(tuple(room["size_m"]), tuple(room["faces"]), record["patch_size_m"], 0.5)
    reflectance, flux = (of_bands(record[key], len(gains)) for key in ("reflectance", "flux"))
    surfaces = [(np.array(values), kappa) for values, kappa in zip(reflectance, flux, strict=True)]
    return _twins(session, scene, camera, projector, surfaces, gains)
