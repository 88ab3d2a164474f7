"""The scene in patches: vignetting, reflectance, flux, brightness scale. Step `model`."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from calibration.light import faces as walls
from calibration.light.open_wall import ANOTHER_PICTURE
from calibration.light.reflectance import ReflectanceFit, ReflectanceSource
from calibration.light.vignetting import Vignetting
from rig.files.channels import bands_of, image_of, layers
from rig.profile.schema import Profile
from rig.records import JsonObject
from rig.session import Session, Step
from rig.stages.correspondence import load_correspondence, only, pair_of
from rig.stages.geometry import load_geometry, tape_sigmas
from rig.stages.light.between_patches import with_even_return
from rig.stages.light.choice import FittedRoom, SplitLight, chosen_room
from rig.stages.light.fit import (
    LEAST_PIXELS,
    BandLight,
    BareRoom,
    bare_room,
    lit_pixels,
)
from rig.stages.light.other_backs import probabilities, sigma_of_backs, with_other_guesses
from rig.stages.light.records import BandModel, CameraModel, ModelRecord, ProjectorModel
from rig.stages.light.unseen_walls import PlacedByLight, SeenInWhite, place_unseen_walls, shift_of, unmeasured_axes
from rig.stages.maps.uncertainty import SMOOTHING_SHARE, LightUncertainty, light_uncertainty
from rig.stages.maps.white import as_measured, light_of_white
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.scene_model import (
    ColouredRoom,
    MeasuredLight,
    PosedCamera,
    PosedProjector,
    SceneModel,
    cast_pixels,
    unit_emission,
)
from rig.stages.separation import projector_blur_px2
from rig.stages.showing.dark import dark_pixels, dark_settings
from rig.stages.surface.known import known_settings
from rig.stages.surface.positions import positions_settings
from rig.stages.surface.standing import StandingRecord, standing_of
from rig.stages.transport.evidence import model_steps, told_of_light
from rig.stages.transport.learned import BandPrior, LearnedBand, band_prior, learned_band
from rig.stages.transport.prior import OpenWalls
from rig.terminal import OnStep

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_LEAST_WHITE_SHARE = 0.3
"""Of a white picture, seen by a pixel beside its border: with less, its direct light is not extrapolated."""


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
    unseen: FloatArray | float = 0.0
    """(H, W, B) the same by another guess of what nobody saw of things, and beside their edges, which have no patch."""
    learned: tuple[LearnedBand, ...] | None = None
    """What photographs of known pictures say of each band; None: the patches alone."""

    @property
    def scene_model(self) -> SceneModel:
        """The first band's: lenses, poses, patches and hits are those of all."""
        return self.room.bands[0]

    @property
    def channels(self) -> int:
        """B, bands of the camera and channels of the projector."""
        return len(self.room.bands)


def model_settings(session: Session) -> JsonObject:
    """Return what step `model` depends on."""
    profile = session.profile
    return {
        "patch_size_m": profile.room.patch_size_m,
        "surface": profile.surface.kind,
        **known_settings(profile),
        **positions_settings(session),
        "patches": "finer where something stands, and beside lit edges",
        **(
            {"backs": "close behind; bodies as deep as wide; fronts that stand; all fronts; best explained; in sigmas"}
            if profile.surface.kind == "free"
            else {}
        ),
        **(
            {}
            if profile.surface.kind == "box"
            else {"alike": "walls; backs and fronts; things", "flat": "all told", "bent": "told by global light, too"}
        ),
        "target_white_share": profile.brightness.target_white_share,
        "smoothing_share": SMOOTHING_SHARE,
        "least_pixels": LEAST_PIXELS,
        "global_gain": "of white",
        "blur": "of both lenses",
        "vignetting": "told apart by what lenses usually do",
        "unseen": ["by wall", walls.EDGE_PX, "flux bears a misfit", "placed by light", "inside", "parts of patches"],
        "edges": "white as measured, in parts beside things",
    }


def build_model(session: Session, step: Step, on_step: OnStep) -> None:
    """Step `model`: fit what light does in the measured room; decide the brightness scale."""
    on_step("build model", 0, 4)
    bands, valid = _light(session)
    lit = lit_pixels(bands, valid)
    blur = session.finished("separation").load_image("blur")
    border = np.maximum(blur["white_share"], np.float32(_LEAST_WHITE_SHARE))
    projector_xy_px = np.stack([blur["column"], blur["row"]], axis=-1)
    seen = SeenInWhite(light=_together(bands), lit=lit, projector_xy_px=projector_xy_px, border=border)
    placed = _placed(session, seen, on_step)
    measured = load_geometry(session)
    found = standing_of(session, measured, shift_of(placed))
    if found is not None and found.misfit_m is not None:
        step.save_image("misfit", {"misfit_m": found.misfit_m.astype(np.float32)}, folder="maps")
    on_step("build model", 1, 4)
    room = partial(bare_room, measured, session.profile.room.patch_size_m, shift_of(placed))
    light = SplitLight(bands=bands, lit=lit, border=border, projector_xy_px=projector_xy_px)
    fitted, others = chosen_room(light, room, found)
    fitted = with_other_guesses(fitted, others)
    if fitted.standing is not None:
        step.save_record("standing", fitted.standing)
    on_step("build model", 3, 4)
    fits = fitted.fits
    band_models, models = _modelled(session, light, fitted)
    of_white = [as_measured(scene_model, one, lit, border) for scene_model, one in zip(models, bands, strict=True)]
    gain, ratio, beside_things = (np.stack(part, axis=-1) for part in zip(*of_white, strict=True))
    maps = layers("gain", gain) | layers("global_gain", ratio)
    apart = [_sigma_of_backs(models, _modelled(session, light, other)[1], (fitted, other)) for other in others]
    if others or beside_things.any():
        maps |= layers("unseen", np.linalg.norm([*apart, beside_things], axis=0))
    step.save_image("direct-gain", {**maps, "lit": lit.astype(np.float32)}, folder="maps")
    record = _record(session.profile, fitted.vignetting, fits, bands=band_models, lit=lit)
    step.save_record("model", replace(record, placed=placed))
    on_step("build model", 4, 4)


def _modelled(
    session: Session, light: SplitLight, fitted: FittedRoom
) -> tuple[tuple[BandModel, ...], list[SceneModel]]:
    """The records and the scenes of all bands."""
    bands = tuple(_band_model(fit, one, light.lit) for fit, one in zip(fitted.fits, light.bands, strict=True))
    surfaces = zip(bands, (fit.flux for fit in fitted.fits), strict=True)
    return bands, _scene_models(session, fitted.geometry, surfaces, fitted.gains)


def _sigma_of_backs(
    models: list[SceneModel], others: list[SceneModel], rooms: tuple[FittedRoom, FittedRoom]
) -> FloatArray:
    """(H, W, B) relative deviation of global light by another guess of the backs of things; rooms: taken, and not."""
    chances = probabilities(*rooms)
    return np.stack([sigma_of_backs(*one) for one in zip(models, others, chances, strict=True)], axis=-1)


def _light(session: Session) -> tuple[list[BandLight], BoolArray]:
    """The light of white in each band, and where it is valid."""
    image = session.finished("separation").load_image("separation")
    direct, global_, white = (bands_of(image_of(image, name)) for name in ("direct", "global", "white"))
    bands = [BandLight(*parts) for parts in zip(direct, global_, white, strict=True)]
    return bands, load_correspondence(session).valid & (image["valid"] > 0)


def _together(bands: list[BandLight]) -> BandLight:
    """The mean of the bands."""
    if len(bands) == 1:
        return bands[0]
    parts = ([getattr(light, part) for light in bands] for part in ("direct", "global_", "white"))
    return BandLight(*(np.mean(part, axis=0) for part in parts))


def _placed(session: Session, seen: SeenInWhite, on_step: OnStep) -> tuple[PlacedByLight, ...]:
    """Walls that nobody measured: none in nearly all rooms."""
    record, box = load_geometry(session), session.profile.room
    axes = unmeasured_axes(record.surface, height_known=box.lens_height_m is not None)
    sizes_m = (tape_sigmas(session.profile)[1:4] * record.surface.size_m).tolist()
    return place_unseen_walls(record, axes, box.patch_size_m, size_sigmas_m=sizes_m, seen=seen, on_step=on_step)


def _band_model(fit: ReflectanceFit, light: BandLight, lit: BoolArray) -> BandModel:
    return BandModel(
        reflectance=tuple(fit.reflectance.tolist()),
        source=tuple(int(source) for source in fit.source),
        unseen_reflectance=fit.unseen_reflectance,
        unseen_sigma=fit.unseen_sigma,
        global_rms=fit.global_rms,
        white_median=float(np.median(light.white[lit])),
        global_share_mean=float((light.global_[lit] / np.maximum(light.white[lit], 1e-9)).mean()),
        returned_share=fit.returned_share,
        lit_part=() if fit.lit_part is None else tuple(fit.lit_part.tolist()),
        reflectance_sigma=float(np.sqrt(np.mean(fit.sigma[fit.source == ReflectanceSource.DIRECT] ** 2))),
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
        patch_size_m=profile.room.patch_size_m,
        bands=bands,
        cameras={pair.camera: CameraModel(vignetting=vignetting.camera)},
        projectors={pair.projector: projector},
        vignetting_rms=vignetting.rms,
        level=profile.brightness.target_white_share * float(np.mean([band.white_median for band in bands])),
        lit_share_of_image=float(lit.mean()),
    )


def simulated_white(room: ColouredRoom) -> tuple[FloatArray, FloatArray]:
    """Return (H, W, B) direct and global light of white as the patches alone predict them, without `global_gain`."""
    direct, global_ = zip(*(light_of_white(scene_model) for scene_model in room.bands), strict=True)
    return np.stack(direct, axis=-1), np.stack(global_, axis=-1)


def _scene_models(
    session: Session, geometry: BareRoom, surfaces: Iterable[tuple[BandModel, float]], gains: list[FloatArray]
) -> list[SceneModel]:
    """The scene in each band, of which reflectance and flux are known; what depends on geometry alone is made once."""
    pair, scene = pair_of(session.profile), geometry.scene
    blur = session.finished("separation").load_image("blur")
    xy_px = np.stack([blur["column"], blur["row"]], axis=-1).astype(np.float64)
    variance = np.stack([blur["variance_x"], blur["variance_y"]], axis=-1).astype(np.float64)
    factors, faces = geometry.form_factors, load_geometry(session).surface.faces
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
            projectors={pair.projector: replace(projector, flux=flux, lit_part=np.array(band.lit_part or 1.0))},
            measured={pair: MeasuredLight(gain, xy_px, variance_px2=variance)},
            walls=faces,
        )
        for (band, flux), gain in zip(surfaces, gains, strict=True)
    ]


def load_model(session: Session) -> FittedScene:
    """Return the finished step's model, with what photographs of known pictures have taught it where there are any.

    It is read from the disk once for each of its results.
    """
    prior, steps = load_prior_model(session), model_steps(session)[1:]
    hashes = tuple((name, session.finished(name).outputs_sha256) for name in steps)
    return _learned(session, prior, hashes) if steps else prior


def load_prior_model(session: Session) -> FittedScene:
    """Return the finished step's model as it was before any photograph of step `transport`."""
    mask = json.dumps(dark_settings(session.profile))
    return _darkened(session, session.finished("model").outputs_sha256, mask)


@lru_cache(maxsize=1)
def _darkened(session: Session, outputs_sha256: str, _mask: str) -> FittedScene:
    """The finished step's model, of which the pixels stay black that the profile's mask says."""
    model = _read_model(session, outputs_sha256)
    dark = dark_pixels(session.profile, model.scene_model)
    return model if dark is None else replace(model, room=replace(model.room, dark=dark))


@lru_cache(maxsize=1)
def transport_priors(session: Session) -> tuple[BandPrior, ...]:
    """Return what that model says of each band's light, in places of the camera's picture."""
    model, record = load_prior_model(session), load_model_record(session)
    return tuple(
        band_prior(
            scene_model,
            model.lit,
            relative_error=model.global_error,
            open_walls=OpenWalls(source=band.source, sigma=band.unseen_sigma),
        )
        for scene_model, band in zip(model.room.bands, record.bands, strict=True)
    )


@lru_cache(maxsize=1)
def _learned(session: Session, prior: FittedScene, steps: tuple[tuple[str, str], ...]) -> FittedScene:
    told = told_of_light(session, prior.channels, tuple(name for name, _ in steps))
    if told is None:
        return prior
    priors = transport_priors(session)
    bands = tuple(
        learned_band(band, photographs, prior.lit, uneven)
        for band, photographs, uneven in zip(priors, told[0], np.moveaxis(told[1], -1, 0), strict=True)
    )
    room = replace(prior.room, bands=tuple(band.scene_model for band in bands))
    return replace(prior, room=room, learned=bands)


def load_standing(session: Session) -> StandingRecord | None:
    """Return what the finished step found before the walls; None where the surface is a box."""
    if session.profile.surface.kind == "box":
        return None
    return session.finished("model").load_record("standing", StandingRecord)


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
        global_error=max(_global_error(band, record.placed) for band in record.bands),
        unseen=image_of(maps, "unseen").astype(np.float64) if any(one.startswith("unseen") for one in maps) else 0.0,
    )


def _global_error(band: BandModel, placed: tuple[PlacedByLight, ...]) -> float:
    """Relative standard deviation of what the patches make of global light."""
    of_return = ANOTHER_PICTURE * (band.returned_share > 0)
    return float(np.linalg.norm([band.global_rms, of_return, *(one.light_error for one in placed)]))


def _read_scene_models(session: Session, record: ModelRecord, gains: list[FloatArray]) -> list[SceneModel]:
    camera, projector = only(record.cameras), only(record.projectors)
    vignetting = Vignetting(camera.vignetting, projector.vignetting, record.vignetting_rms)
    standing = load_standing(session)
    bare = bare_room(load_geometry(session), record.patch_size_m, shift_of(record.placed), standing)
    geometry = bare.with_vignetting(vignetting)
    return _scene_models(session, geometry, zip(record.bands, projector.flux, strict=True), gains)
