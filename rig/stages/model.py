"""The scene in patches: vignetting, reflectance, flux, brightness scale. Step `model`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.light import faces as walls
from calibration.light.open_wall import ANOTHER_PICTURE, estimate_open_wall
from calibration.light.reflectance import ReflectanceFit, estimate_reflectance
from calibration.light.vignetting import Vignetting, fit_vignetting
from rig.files.channels import bands_of, image_of, layers
from rig.profile.schema import Profile
from rig.records import JsonObject, Record
from rig.session import Session, Step
from rig.stages.correspondence import load_correspondence, only, pair_of
from rig.stages.geometry import GeometryRecord, load_geometry
from rig.stages.maps.uncertainty import SMOOTHING_SHARE, LightUncertainty, light_uncertainty
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.scene_model import (
    ColouredRoom,
    MeasuredLight,
    PixelHits,
    PosedCamera,
    PosedLens,
    PosedProjector,
    SceneModel,
    box_scene,
    camera_view,
    cast_pixels,
    face_of_pixels,
    on_the_model,
    posed_lens,
    seen_from,
    unit_emission,
    wall_of_patches,
    white_irradiance,
    with_even_return,
)
from rig.stages.separation import projector_blur_px2
from rig.terminal import OnStep
from sim.form_factors import form_factors
from sim.geometry.optics import project
from sim.geometry.scene import Scene

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_LEAST_DIRECT = 0.05
_LEAST_IN_A_BAND = 0.005
"""A pixel is lit when its direct light is above this share of the median of the lit, and in each band above that."""
_LEAST_PIXELS = 40
"""Camera pixels that a patch needs before its light counts."""
_LEAST_WHITE_SHARE = 0.3
"""Of a white picture, seen by a pixel beside its border: with less, its direct light is not extrapolated."""


@dataclass(frozen=True, kw_only=True)
class BandModel(Record):
    """What the scene does in one band of light."""

    reflectance: tuple[float, ...]
    """Of each patch."""
    source: tuple[int, ...]
    """What each patch's reflectance is from (:class:`calibration.light.reflectance.Source`)."""
    unseen_reflectance: float
    """Mean of the patches that nobody saw ..."""
    unseen_sigma: float
    """... and its standard deviation."""
    global_rms: float
    """Residual of the fit to the global light, relative."""
    white_median: float
    """Of projector white over the lit pixels."""
    global_share_mean: float
    """Mean share of global light in it."""
    returned_share: float = 0.0
    """Of one wall's mean radiosity, what an open room sends back, evenly; 0 where walls light each other."""


@dataclass(frozen=True, kw_only=True)
class CameraModel(Record):
    """What the model knows of one camera beside its geometry."""

    vignetting: tuple[float, float]
    """v2, v4: relative illumination 1 + v2 r² + v4 r⁴."""


@dataclass(frozen=True, kw_only=True)
class ProjectorModel(Record):
    """What the model knows of one projector beside its geometry."""

    vignetting: tuple[float, float]
    flux: tuple[float, ...]
    """κ in each band ..."""
    flux_sigma: tuple[float, ...]
    """... and its standard deviation."""


@dataclass(frozen=True, kw_only=True)
class ModelRecord(Record):
    """What step `model` found, beside its images."""

    patch_size_m: float
    bands: tuple[BandModel, ...]
    cameras: Mapping[str, CameraModel]
    projectors: Mapping[str, ProjectorModel]
    vignetting_rms: float
    level: float
    """Camera value of a target's 255, in each band."""
    lit_share_of_image: float


@dataclass(frozen=True, eq=False, kw_only=True)
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
    uncertainty: LightUncertainty
    global_error: float
    """Relative standard deviation of what the patches make of global light."""

    @property
    def scene_model(self) -> SceneModel:
        """The first band's: lenses, poses, patches and hits are those of all."""
        return self.room.bands[0]

    @property
    def channels(self) -> int:
        """B, bands of the camera and channels of the projector."""
        return len(self.room.bands)


@dataclass(frozen=True, eq=False)
class _BandLight:
    """One band's light of white in parts, (H, W) each."""

    direct: NDArray[np.float32]
    global_: NDArray[np.float32]
    white: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class _Geometry:
    """The scene without any reflectance, and the devices in it; vignetting once it is fitted."""

    scene: Scene
    camera: PosedLens
    projector: PosedLens
    camera_hits: PixelHits

    def with_vignetting(self, vignetting: Vignetting) -> _Geometry:
        camera = replace(self.camera, vignetting=vignetting.camera)
        return replace(self, camera=camera, projector=replace(self.projector, vignetting=vignetting.projector))


def model_settings(session: Session) -> JsonObject:
    """Return what step `model` depends on."""
    profile = session.profile
    return {
        "patch_size_m": profile.box.patch_size_m,
        "target_white_share": profile.brightness.target_white_share,
        "smoothing_share": SMOOTHING_SHARE,
        "least_pixels": _LEAST_PIXELS,
        "global_gain": "of white",
        "blur": "of both lenses",
        "unseen": ["by wall", walls.EDGE_PX, "flux bears a misfit"],
    }


def build_model(session: Session, step: Step, on_step: OnStep) -> None:
    """Step `model`: fit what light does in the measured room; decide the brightness scale."""
    on_step("build model", 0, 4)
    bare = _bare_geometry(load_geometry(session), session.profile.box.patch_size_m)
    bands, valid = _light(session)
    lit = _lit(bands, valid)
    blur = session.finished("separation").load_image("blur")
    border = np.maximum(blur["white_share"], np.float32(_LEAST_WHITE_SHARE))
    gains = [_direct_gain(light, lit, bare.camera_hits) / border for light in bands]
    on_step("build model", 1, 4)
    on_model = on_the_model(bare.projector, bare.camera_hits, np.stack([blur["column"], blur["row"]], axis=-1))
    inner = walls.on_model_of(lit, on_model) & walls.away_from_edges(face_of_pixels(bare.camera_hits, lit.shape))
    vignetting = _fit_lenses(bare, np.mean(gains, axis=0), inner)
    geometry = bare.with_vignetting(vignetting)
    on_step("build model", 2, 4)
    fits = [_fit_reflectance(geometry, gain, light, inner) for gain, light in zip(gains, bands, strict=True)]
    on_step("build model", 3, 4)
    band_models = tuple(_band_model(fit, light, lit) for fit, light in zip(fits, bands, strict=True))
    models = _scene_models(session, geometry, zip(band_models, [fit.flux for fit in fits], strict=True), gains)
    ratios = [_global_gain(scene_model, light, lit) for scene_model, light in zip(models, bands, strict=True)]
    maps = layers("gain", np.stack(gains, axis=-1)) | layers("global_gain", np.stack(ratios, axis=-1))
    step.save_image("direct-gain", {**maps, "lit": lit.astype(np.float32)}, folder="maps")
    step.save_record("model", _record(session.profile, vignetting, fits, bands=band_models, lit=lit))
    on_step("build model", 4, 4)


def _light(session: Session) -> tuple[list[_BandLight], BoolArray]:
    """The light of white in each band, and where it is valid."""
    image = session.finished("separation").load_image("separation")
    direct, global_, white = (bands_of(image_of(image, name)) for name in ("direct", "global", "white"))
    bands = [_BandLight(*parts) for parts in zip(direct, global_, white, strict=True)]
    return bands, load_correspondence(session).valid & (image["valid"] > 0)


def _bare_geometry(record: GeometryRecord, patch_size_m: float) -> _Geometry:
    camera, projector = (posed_lens(only(devices).pinhole()) for devices in (record.cameras, record.projectors))
    scene = box_scene(record.surface.size_m, record.surface.faces, patch_size_m, 0.5)
    return _Geometry(scene, camera, projector, cast_pixels(scene, camera))


def _lit(bands: list[_BandLight], valid: BoolArray) -> BoolArray:
    direct = np.mean([light.direct for light in bands], axis=0)
    if not (direct[valid] > 0).any():
        raise CalibrationError("no valid pixel has direct light; look at the correspondence map and at the checkers")
    enough = [light.direct > _LEAST_IN_A_BAND * np.median(light.direct[valid]) for light in bands]
    return np.asarray(valid & (direct > _LEAST_DIRECT * np.median(direct[valid])) & np.all(enough, axis=0))


def _direct_gain(light: _BandLight, lit: BoolArray, camera_hits: PixelHits) -> FloatArray:
    """(H, W) direct light of white, 0 where not lit.

    The checkers tell the share of direct light with noise; that share is smooth along a wall (reflectance and
    vignetting cancel in it), so it is smoothed there and applied to the white frame, which has little noise.
    """
    share = np.where(lit, light.direct / np.maximum(light.white, 1e-9), 0.0).astype(np.float64)
    face = face_of_pixels(camera_hits, lit.shape)
    return walls.smoothed_along_faces(share, lit, face, SMOOTHING_SHARE) * light.white


def _global_gain(scene_model: SceneModel, light: _BandLight, lit: BoolArray) -> FloatArray:
    """(H, W) global light of white as measured over as modelled, smoothed; 1 where not lit."""
    direct_of_white, modelled = _simulated_white(scene_model)
    face = face_of_pixels(scene_model.camera_hits, lit.shape)
    known = lit & (modelled > 0)
    ratio = np.where(known, (light.white - direct_of_white) / np.where(known, modelled, 1.0), 1.0)
    return np.where(lit, walls.smoothed_along_faces(ratio, lit, face, SMOOTHING_SHARE), 1.0)


def _fit_lenses(geometry: _Geometry, gain: FloatArray, lit: BoolArray) -> Vignetting:
    hits, points = geometry.camera_hits.hits, geometry.camera_hits.points_m
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


def _fit_reflectance(geometry: _Geometry, gain: FloatArray, light: _BandLight, lit: BoolArray) -> ReflectanceFit:
    """Patch means of what the camera saw, its vignetting taken out, to the inverse radiosity problem."""
    scene, hits, projector = geometry.scene, geometry.camera_hits.hits, geometry.projector
    e = white_irradiance(scene, projector, geometry.camera_hits.points_m, hits.patch)
    brightness = geometry.camera.illumination(geometry.camera.lens.pixel_grid())
    direct = np.where(e > 0, gain.ravel() / np.where(e > 0, e * brightness, 1.0), 0.0)
    lit_flat = lit.ravel() & (e > 0)
    # Outside the lit area all light is global; close to its border the lens mixes both.
    border = cv2.dilate((light.direct > 0.02 * np.median(light.direct[lit])).astype(np.uint8), np.ones((9, 9)))
    dark = (border == 0).ravel() & (hits.patch >= 0)
    global_light = np.where(lit_flat, light.white.ravel() - gain.ravel(), light.white.ravel()) / brightness
    counts = walls.PatchCounts(scene.n_patches, _LEAST_PIXELS)
    per_lit = walls.patch_means(direct, hits.patch, lit_flat, counts)
    per_global = walls.patch_means(global_light, hits.patch, lit_flat | dark, counts)
    irradiance = np.asarray(unit_emission(scene, projector) @ np.ones(projector.lens.n_pixels))
    if len(scene.faces) == 1:
        return estimate_open_wall(per_lit, per_global, irradiance, scene.areas)
    return estimate_reflectance(
        per_lit,
        per_global,
        irradiance,
        form_factors(scene).matrix,
        wall=wall_of_patches(scene),
        seen_from=seen_from(scene, hits, lit_flat | dark),
    )


def _band_model(fit: ReflectanceFit, light: _BandLight, lit: BoolArray) -> BandModel:
    return BandModel(
        reflectance=tuple(fit.reflectance.tolist()),
        source=tuple(int(source) for source in fit.source),
        unseen_reflectance=fit.unseen_reflectance,
        unseen_sigma=fit.unseen_sigma,
        global_rms=fit.global_rms,
        white_median=float(np.median(light.white[lit])),
        global_share_mean=float((light.global_[lit] / np.maximum(light.white[lit], 1e-9)).mean()),
        returned_share=fit.returned_share,
    )


def _record(
    profile: Profile, vignetting: Vignetting, fits: list[ReflectanceFit], bands: tuple[BandModel, ...], lit: BoolArray
) -> ModelRecord:
    pair = pair_of(profile)
    projector = ProjectorModel(
        vignetting=vignetting.projector,
        flux=tuple(fit.flux for fit in fits),
        flux_sigma=tuple(fit.flux_sigma for fit in fits),
    )
    return ModelRecord(
        patch_size_m=profile.box.patch_size_m,
        bands=bands,
        cameras={pair.camera: CameraModel(vignetting=vignetting.camera)},
        projectors={pair.projector: projector},
        vignetting_rms=vignetting.rms,
        level=profile.brightness.target_white_share * float(np.mean([band.white_median for band in bands])),
        lit_share_of_image=float(lit.mean()),
    )


def simulated_white(room: ColouredRoom) -> tuple[FloatArray, FloatArray]:
    """Return (H, W, B) direct and global light of white as the patches alone predict them, without `global_gain`."""
    direct, global_ = zip(*(_simulated_white(scene_model) for scene_model in room.bands), strict=True)
    return np.stack(direct, axis=-1), np.stack(global_, axis=-1)


def _simulated_white(scene_model: SceneModel) -> tuple[FloatArray, FloatArray]:
    n_pixels, shape = scene_model.projector.lens.n_pixels, scene_model.camera.lens.shape
    transport = camera_view(scene_model.with_global_gain(1.0), np.ones(n_pixels, dtype=bool))
    white = np.ones(n_pixels)
    return (transport.direct @ white).reshape(shape), (transport.global_ @ white).reshape(shape)


def _scene_models(
    session: Session, geometry: _Geometry, surfaces: Iterable[tuple[BandModel, float]], gains: list[FloatArray]
) -> list[SceneModel]:
    """The scene in each band, of which reflectance and flux are known; what depends on geometry alone is made once."""
    pair, scene = pair_of(session.profile), geometry.scene
    blur = session.finished("separation").load_image("blur")
    xy_px = np.stack([blur["column"], blur["row"]], axis=-1).astype(np.float64)
    variance = np.stack([blur["variance_x"], blur["variance_y"]], axis=-1).astype(np.float64)
    factors = form_factors(scene)
    projector = PosedProjector(
        device=geometry.projector,
        hits=cast_pixels(scene, geometry.projector),
        flux=1.0,
        unit_emission=unit_emission(scene, geometry.projector),
        blur_variance_px2=projector_blur_px2(session),
    )
    return [
        SceneModel(
            scene=scene.with_reflectance(np.array(band.reflectance)),
            form_factors=with_even_return(factors, band.returned_share),
            cameras={pair.camera: PosedCamera(geometry.camera, geometry.camera_hits)},
            projectors={pair.projector: replace(projector, flux=flux)},
            measured={pair: MeasuredLight(gain, xy_px, variance_px2=variance)},
        )
        for (band, flux), gain in zip(surfaces, gains, strict=True)
    ]


def load_model(session: Session) -> FittedScene:
    """Return the finished step's model, read from the disk once for each of its results."""
    return _read_model(session, session.finished("model").outputs_sha256)


def load_model_record(session: Session) -> ModelRecord:
    """Return the numbers of the finished step's model."""
    return session.finished("model").load_record("model", ModelRecord)


@lru_cache(maxsize=1)
def _read_model(session: Session, _outputs_sha256: str) -> FittedScene:
    record, maps = load_model_record(session), session.finished("model").load_image("direct-gain")
    light = session.finished("separation").load_image("separation")
    gains, ratios = (bands_of(image_of(maps, name).astype(np.float64)) for name in ("gain", "global_gain"))
    models = _read_scene_models(session, record, gains)
    bands = tuple(model.with_global_gain(ratio) for model, ratio in zip(models, ratios, strict=True))
    return FittedScene(
        room=ColouredRoom(bands, load_radiometric_calibration(session).mixing),
        level=record.level,
        lit=maps["lit"] > 0,
        white=image_of(light, "white").astype(np.float64),
        white_variance=image_of(light, "white_variance").astype(np.float64),
        uncertainty=light_uncertainty(session),
        global_error=max(float(np.hypot(b.global_rms, ANOTHER_PICTURE * (b.returned_share > 0))) for b in record.bands),
    )


def _read_scene_models(session: Session, record: ModelRecord, gains: list[FloatArray]) -> list[SceneModel]:
    camera, projector = only(record.cameras), only(record.projectors)
    vignetting = Vignetting(camera.vignetting, projector.vignetting, record.vignetting_rms)
    geometry = _bare_geometry(load_geometry(session), record.patch_size_m).with_vignetting(vignetting)
    return _scene_models(session, geometry, zip(record.bands, projector.flux, strict=True), gains)
