"""The scene model: what calibration found, as the simulator's scene and light transport; here alone the two meet.

Its unit of radiosity is the camera's linear value without its vignetting: patch i emits E_i = ρ_i κ e_i p for
projector light p, e the geometric irradiance of unit flux, κ the fitted flux.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from calibration.geometry.pinhole import PinholeModel
from rig.stages.correspondence import DevicePair, only
from rig.stages.maps.sampling import sample, sample_bands, sample_smooth
from rig.stages.surface.scene import AnyScene
from sim.form_factors import FormFactors
from sim.geometry.interpolation import bilinear
from sim.geometry.optics import Lens, Pose, project, rays_at
from sim.geometry.rays import trace
from sim.geometry.scene import Hits
from sim.light.colour import ColourTransport
from sim.light.learned_transport import with_learned
from sim.light.picture_blur import PictureBlur
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport
from sim.light.transport_of_scene import area_emission, irradiance_at, smooth_view

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

Vignetting = tuple[float, float]
"""v2, v4: relative illumination 1 + v2 r² + v4 r⁴, r = distance from the principal point / half diagonal."""


SQUARE_PIXEL_PX2, FOUR_PIXELS_PX2 = 1 / 12, 1 / 6
"""Mean variance of a square pixel, and of sharing a place out to the four nearest pixels by distance."""
MOST_OFF_PX = 4.0
"""Projector pixels between where a camera pixel is in the model and where its code says: surfaces are right to less."""
LEAST_GAIN = 0.02
"""Projector pixels with less direct light than this share of the median are left black."""
_MOST_SEEN = 4.0
"""Times all light: beyond, it comes from beside. Four pixels of odd room 600 took the model to 1e13 of white."""


@dataclass(frozen=True, eq=False)
class PosedLens:
    """One device in the room: lens, pose, vignetting."""

    lens: Lens
    pose: Pose
    vignetting: Vignetting = (0.0, 0.0)

    def illumination(self, xy_px: FloatArray) -> FloatArray:
        """Return (N,) relative illumination of image points (N, 2)."""
        v2, v4 = self.vignetting
        r2 = self.radius(xy_px) ** 2
        return np.asarray(1 + r2 * (v2 + r2 * v4))

    def radius(self, xy_px: FloatArray) -> FloatArray:
        """Return (N,) distance from the principal point over half the image's diagonal."""
        half_diagonal = np.hypot(*self.lens.shape) / 2
        return np.asarray(np.linalg.norm(xy_px - np.array(self.lens.principal_point_px), axis=1) / half_diagonal)


def posed_lens(model: PinholeModel, vignetting: Vignetting = (0.0, 0.0)) -> PosedLens:
    """Return the simulator's lens and pose for a calibrated device."""
    lens = Lens(
        width_px=model.width_px,
        height_px=model.height_px,
        focal_px=model.focal_px,
        principal_point_px=model.principal_point_px,
        distortion=model.distortion,
    )
    return PosedLens(lens, Pose(model.rotation, model.translation_m), vignetting)


@dataclass(frozen=True, eq=False)
class PixelHits:
    """What every pixel of a device meets in the scene."""

    hits: Hits
    points_m: FloatArray
    """(N, 3); NaN where a ray meets nothing."""


def cast_pixels(scene: AnyScene, device: PosedLens) -> PixelHits:
    """Follow every pixel of a device to the scene."""
    origin = device.pose.position_m
    rays = rays_at(device.lens, device.pose, device.lens.pixel_grid())
    hits = trace(scene, origin, rays)
    distance = np.where(hits.patch >= 0, hits.distance, np.nan)
    return PixelHits(hits, origin + distance[:, None] * rays)


def white_irradiance(
    scene: AnyScene, projector: PosedLens, points_m: FloatArray, patch: NDArray[np.intp]
) -> FloatArray:
    """Return (N,) irradiance e by unit white at points, projector vignetting included; 0 outside its picture."""
    xy = project(projector.lens, projector.pose, points_m)
    height, width = projector.lens.shape
    with np.errstate(invalid="ignore"):
        inside = (xy > -0.5).all(axis=1) & (xy < (width - 0.5, height - 0.5)).all(axis=1) & (patch >= 0)
    e = np.zeros(len(points_m))
    e[inside] = irradiance_at(scene, projector.lens, projector.pose, points_m=points_m[inside], patch=patch[inside])
    e[inside] *= projector.illumination(xy[inside])
    return e


def unit_emission(scene: AnyScene, projector: PosedLens) -> csr_array:
    """Return (P, n pixels) irradiance of each patch by each projector pixel at unit flux, vignetting included."""
    white = scene.with_reflectance(1.0)
    bare = area_emission(white, projector.lens, projector.pose, subsamples=2, convention="physical")
    return csr_array(bare @ diags_array(projector.illumination(projector.lens.pixel_grid())))


def face_of_pixels(camera_hits: PixelHits, shape: tuple[int, ...]) -> NDArray[np.intp]:
    """Return (H, W) number of the face that each camera pixel sees."""
    return np.asarray(camera_hits.hits.face.reshape(shape))


@dataclass(frozen=True, eq=False)
class PosedCamera:
    """A camera in the scene."""

    device: PosedLens
    hits: PixelHits


@dataclass(frozen=True, eq=False, kw_only=True)
class PosedProjector:
    """A projector in the scene."""

    device: PosedLens
    hits: PixelHits
    flux: float
    """κ."""
    unit_emission: csr_array
    """(P, n pixels) of :func:`unit_emission`."""
    blur_variance_px2: FloatArray | None = None
    """(height, width) of its own lens, at its pixels; None: no blur."""
    lit_part: FloatArray | float = 1.0
    """(P,) reflectance of each patch's lit part over the whole patch's."""


@dataclass(frozen=True, eq=False)
class MeasuredLight:
    """What one camera has measured of one projector's light; H, W are the camera's."""

    direct_gain: FloatArray
    """(H, W) camera value of direct light by white; 0 where not lit or not valid."""
    projector_xy_px: FloatArray
    """(H, W, 2) correspondence; NaN where there is none."""
    global_gain: FloatArray | float = 1.0
    """(H, W) measured over modelled global light of white: what the patches are too coarse for; 1 where not lit."""
    variance_px2: FloatArray | None = None
    """(H, W, 2) of what each camera pixel sees of the projector picture, along its columns and rows, beside its square
    pixels; NaN where unknown. None: no blur."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LearnedLight:
    """What photographs have taught of global light, beside the patches."""

    by_pixel: FloatArray
    """(H, W, r) light that a camera pixel sees ..."""
    by_patch: FloatArray
    """(r, P) ... of what each patch's emission makes."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneModel:
    """Everything that predicts what cameras see of the scene, in one band of light."""

    scene: AnyScene
    form_factors: FormFactors
    cameras: Mapping[str, PosedCamera]
    projectors: Mapping[str, PosedProjector]
    measured: Mapping[DevicePair, MeasuredLight]
    """What ties a camera's pixels to a projector's."""
    walls: tuple[str, ...]
    """Names of the scene's first regions, the room's faces; what comes after them stands before these."""
    learned: LearnedLight | None = None
    """None: the patches alone."""

    @property
    def camera(self) -> PosedLens:
        """The only camera."""
        return only(self.cameras).device

    @property
    def camera_hits(self) -> PixelHits:
        """What the only camera's pixels see."""
        return only(self.cameras).hits

    @property
    def projector(self) -> PosedLens:
        """The only projector."""
        return only(self.projectors).device

    @property
    def projector_hits(self) -> PixelHits:
        """What the only projector's pixels light."""
        return only(self.projectors).hits

    @property
    def light(self) -> MeasuredLight:
        """What the only camera has measured of the only projector."""
        return only(self.measured)

    def with_global_gain(self, global_gain: FloatArray | float) -> SceneModel:
        """Return the model with another ratio of measured to modelled global light."""
        measured = {pair: replace(light, global_gain=global_gain) for pair, light in self.measured.items()}
        return replace(self, measured=measured)

    @cached_property
    def seen_reflectance(self) -> FloatArray:
        """(H·W,) what a camera pixel sees of the light that arrives: reflectance, vignetting, `global_gain`.

        From the direct light; NaN where unlit, or where light hardly grazes what the pixel is taken to see.
        """
        light, hits = self.light, self.camera_hits
        sent = only(self.projectors).flux * white_irradiance(self.scene, self.projector, hits.points_m, hits.hits.patch)
        gain = light.direct_gain.ravel()
        usable = (gain > 0) & (gain < _MOST_SEEN * sent)
        seen = np.where(usable, gain / np.where(usable, sent, 1.0), np.nan)
        return np.asarray(seen * np.ravel(np.broadcast_to(light.global_gain, light.direct_gain.shape)))

    @cached_property
    def camera_xy_px(self) -> FloatArray:
        """(n projector pixels, 2) where the camera sees what each of them lights; NaN where that is nothing."""
        return np.asarray(project(self.camera.lens, self.camera.pose, self.projector_hits.points_m))

    @cached_property
    def projector_pixel_gains(self) -> tuple[FloatArray, FloatArray]:
        """(n projector pixels,) direct gain and `seen_reflectance` as the camera measures them; NaN unseen."""
        gain = sample(self.light.direct_gain, self.camera_xy_px)
        seen = sample(self.seen_reflectance.reshape(self.camera.lens.shape), self.camera_xy_px)
        return gain, seen

    @property
    def seen_blur(self) -> FloatArray | None:
        """(height, width, 2) variance of the projector picture as the camera sees it, as :class:`PictureBlur` has it.

        What is unseen is as blurred as the median.
        """
        return None if self._footprint_px2 is None else _beyond_four_pixels(self._footprint_px2)

    @property
    def camera_blur(self) -> FloatArray | None:
        """The same of the camera alone: what it makes of a picture that is sharp on the wall."""
        own = only(self.projectors).blur_variance_px2
        if self._footprint_px2 is None or own is None:
            return None
        return _beyond_four_pixels(self._footprint_px2 - own[..., None])

    @cached_property
    def _footprint_px2(self) -> FloatArray | None:
        """(height, width, 2) variance of what camera pixels see of the picture, beside its square pixels."""
        if self.light.variance_px2 is None:
            return None
        known = sample_bands(np.nan_to_num(self.light.variance_px2), self.camera_xy_px)
        known = np.where(np.isfinite(known), known, np.nanmedian(known, axis=0))
        return np.asarray(known.reshape(*self.projector.lens.shape, 2))

    @cached_property
    def hidden(self) -> BoolArray:
        """(n projector pixels,) pixels whose light lands where something else stands before the camera.

        The camera pixel there has the code of another projector pixel, which is the one to steer.
        """
        code_px = np.nan_to_num(self.light.projector_xy_px, nan=-1.0) + 1.0
        there = sample_bands(code_px, self.camera_xy_px) - 1.0
        off_px = np.abs(there - self.projector.lens.pixel_grid()).max(axis=1)
        return np.asarray(np.isfinite(off_px) & (off_px > MOST_OFF_PX))

    @cached_property
    def active(self) -> BoolArray:
        """(n projector pixels,) pixels that the camera sees well enough to steer; the others stay black."""
        gain, seen = self.projector_pixel_gains
        known = np.isfinite(gain) & np.isfinite(seen) & ~self.hidden
        return np.asarray(known & (np.where(known, gain, 0) > LEAST_GAIN * np.median(gain[known])))


def _beyond_four_pixels(variance_px2: FloatArray) -> FloatArray:
    """A camera pixel takes its light from four projector pixels, which is a blur already."""
    return np.maximum(variance_px2 + SQUARE_PIXEL_PX2 - FOUR_PIXELS_PX2, 0.0)


def camera_view(scene_model: SceneModel, active: BoolArray) -> LightTransport:
    """Return T from the active projector pixels to all camera pixels (flat).

    Pixels without measured direct light see the patch's own reflectance, dimmed by the camera's vignetting.
    """
    hits, camera = scene_model.camera_hits.hits, scene_model.camera
    own = scene_model.scene.reflectance[hits.patch] * camera.illumination(camera.lens.pixel_grid())
    measured = scene_model.seen_reflectance
    seen = np.where(hits.patch < 0, 0.0, np.where(np.isfinite(measured), measured, own))
    direct = _direct_light(scene_model)
    view = smooth_view(scene_model.scene, hits, seen)
    chosen = csr_array(direct[:, np.flatnonzero(active)])
    transport = _transport(scene_model, active, chosen, view, variance_px2=scene_model.seen_blur)
    learned = scene_model.learned
    if learned is None:
        return transport
    return with_learned(transport, learned.by_pixel.reshape(len(seen), -1), learned.by_patch)


def _direct_light(scene_model: SceneModel) -> csr_array:
    """(n camera pixels, n projector pixels) measured direct light, shared out to the four nearest pixels."""
    camera, projector, light = scene_model.camera.lens, scene_model.projector.lens, scene_model.light
    xy_px = light.projector_xy_px.reshape(-1, 2)
    pixels = np.flatnonzero((light.direct_gain.ravel() > 0) & np.isfinite(xy_px[:, 0]))
    rows, columns, weights = bilinear(xy_px[pixels], projector.width_px, projector.height_px)
    value = weights * light.direct_gain.ravel()[pixels, None]
    index = (rows * projector.width_px + columns).ravel()
    shape = (camera.n_pixels, projector.n_pixels)
    return csr_array((value.ravel(), (np.repeat(pixels, 4), index)), shape=shape)


def projector_view(scene_model: SceneModel, active: BoolArray) -> LightTransport:
    """Return T from the active projector pixels to the wall at each of them, in camera values: direct part diagonal.

    Its blur is the projector's alone: the picture is wanted on the wall, and what the camera's lens makes of it is no
    fault of it.
    """
    gain, seen = scene_model.projector_pixel_gains
    view = smooth_view(scene_model.scene, scene_model.projector_hits.hits, np.where(active, seen, 0.0))
    chosen = np.flatnonzero(active)
    own = only(scene_model.projectors).blur_variance_px2
    variance = None if own is None else np.repeat(own[..., None], 2, axis=-1)
    direct = csr_array(diags_array(gain[chosen]))
    transport = _transport(scene_model, active, direct, csr_array(view[chosen]), variance_px2=variance)
    learned = scene_model.learned
    if learned is None:
        return transport
    return with_learned(transport, sample_smooth(learned.by_pixel, scene_model.camera_xy_px[chosen]), learned.by_patch)


@dataclass(frozen=True, eq=False)
class ColouredRoom:
    """The room in each band of the camera: one geometry, and reflectance, flux and gains a band."""

    bands: tuple[SceneModel, ...]
    mixing: FloatArray
    """(B, B) K[b, q]: share of white in band b that channel q of the projector makes."""
    dark: BoolArray | None = None
    """(n projector pixels,) pixels that stay black whatever is shown; None: none."""

    @cached_property
    def active(self) -> BoolArray:
        """(n projector pixels,) pixels that the camera sees well enough to steer, in every band, and that may light."""
        seen = np.asarray(np.all([scene_model.active for scene_model in self.bands], axis=0))
        return seen if self.dark is None else seen & ~self.dark

    @cached_property
    def camera_transports(self) -> Mapping[DevicePair, ColourTransport]:
        """T in blocks: a row of blocks a camera (its pixels), a column a projector (all its pixels, seen or not)."""
        every = np.ones(self.active.size, dtype=bool)
        bands = [camera_view(scene_model, every) for scene_model in self.bands]
        return {pair: ColourTransport(bands, self.mixing) for pair in self.bands[0].measured}

    @property
    def camera_transport(self) -> ColourTransport:
        """The only block of T."""
        return only(self.camera_transports)

    @cached_property
    def camera_blur(self) -> PictureBlur | None:
        """What the camera's own lens and pixels make of a picture of the steered pixels that is sharp on the wall."""
        variance = self.bands[0].camera_blur
        return None if variance is None else PictureBlur(variance_px2=variance, chosen=self.active)

    def through_camera(self, picture: FloatArray) -> FloatArray:
        """Return (n, B) a picture on the wall, at the steered pixels, as the camera's own blur lets it see it."""
        return picture if self.camera_blur is None else self.camera_blur.apply(picture)

    @cached_property
    def projector_transport(self) -> ColourTransport:
        """T from the active projector pixels to the wall at each of them."""
        return ColourTransport([projector_view(scene_model, self.active) for scene_model in self.bands], self.mixing)


def _transport(
    scene_model: SceneModel, active: BoolArray, direct: csr_array, view: csr_array, *, variance_px2: FloatArray | None
) -> LightTransport:
    chosen = np.flatnonzero(active)
    projector, scene = only(scene_model.projectors), scene_model.scene
    lit = scene.reflectance * projector.lit_part * projector.flux
    emission = diags_array(lit) @ projector.unit_emission[:, chosen]
    radiosity = Radiosity(scene_model.form_factors, scene.reflectance, solver="repeated")
    patch, xy_px = projector.hits.hits.patch[chosen], projector.device.lens.pixel_grid()[chosen]
    blur = None if variance_px2 is None else PictureBlur(variance_px2=variance_px2, chosen=active)
    return LightTransport(direct, csr_array(emission), radiosity, view, pixel_patch=patch, pixel_xy_px=xy_px, blur=blur)
