"""From calibration records to the simulator: the only place where the two meet.

The scene_model's unit of radiosity is the camera's linear value without its vignetting: patch i emits
E_i = ρ_i κ e_i p for projector light p, e the geometric irradiance of unit flux, κ the fitted flux.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from calibration.geometry.pinhole import PinholeModel
from sim.form_factors import FormFactors
from sim.geometry.interpolation import bilinear
from sim.geometry.optics import Lens, Pose, project, rays_at
from sim.geometry.scene import Hits, Scene, intersect
from sim.light.colour import ColourTransport
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport
from sim.light.transport_of_scene import area_emission, irradiance_at, smooth_view
from sim.scenes.library import room

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

Vignetting = tuple[float, float]
"""v2, v4: relative illumination 1 + v2 r² + v4 r⁴, r = distance from the principal point / half diagonal."""


LEAST_GAIN = 0.02
"""Projector pixels with less direct light than this share of the median are left black."""


@dataclass(frozen=True, eq=False)
class PosedLens:
    """One device in the room: lens, pose, vignetting."""

    lens: Lens
    pose: Pose
    vignetting: Vignetting = (0.0, 0.0)

    def illumination(self, xy_px: FloatArray) -> FloatArray:
        """(N,) relative illumination of image points (N, 2)."""
        v2, v4 = self.vignetting
        r2 = self.radius(xy_px) ** 2
        return np.asarray(1 + r2 * (v2 + r2 * v4))

    def radius(self, xy_px: FloatArray) -> FloatArray:
        """(N,) distance from the principal point over half the image's diagonal."""
        half_diagonal = np.hypot(*self.lens.shape) / 2
        return np.asarray(np.linalg.norm(xy_px - np.array(self.lens.principal_point_px), axis=1) / half_diagonal)


def optic(model: PinholeModel, vignetting: Vignetting = (0.0, 0.0)) -> PosedLens:
    """The simulator's lens and pose for a calibrated device."""
    lens = Lens(
        width_px=model.width_px,
        height_px=model.height_px,
        focal_px=model.focal_px,
        principal_point_px=model.principal_point_px,
        distortion=model.distortion,
    )
    return PosedLens(lens, Pose(model.rotation, model.translation_m), vignetting)


@dataclass(frozen=True, eq=False)
class Look:
    """What every pixel of a device meets in the scene."""

    hits: Hits
    points_m: FloatArray
    """(N, 3); NaN where a ray meets nothing."""


def look(scene: Scene, device: PosedLens) -> Look:
    """Follow every pixel of a device to the scene."""
    origin = device.pose.position_m
    rays = rays_at(device.lens, device.pose, device.lens.pixel_grid())
    hits = intersect(scene, origin, rays)
    distance = np.where(hits.patch >= 0, hits.distance, np.nan)
    return Look(hits, origin + distance[:, None] * rays)


def box_scene(
    size_m: tuple[float, float, float], faces: tuple[str, ...], patch_size_m: float, reflectance: FloatArray | float
) -> Scene:
    """The measured room in patches."""
    scene = room(size_m, patch_size_m, 0.5, faces, name="measured room")
    return scene.with_reflectance(reflectance)


def white_irradiance(scene: Scene, projector: PosedLens, points_m: FloatArray, patch: NDArray[np.intp]) -> FloatArray:
    """(N,) irradiance e by unit white at surface points, projector vignetting included; 0 outside its picture."""
    xy = project(projector.lens, projector.pose, points_m)
    height, width = projector.lens.shape
    with np.errstate(invalid="ignore"):
        inside = (xy > -0.5).all(axis=1) & (xy < (width - 0.5, height - 0.5)).all(axis=1) & (patch >= 0)
    e = np.zeros(len(points_m))
    e[inside] = irradiance_at(scene, projector.lens, projector.pose, points_m=points_m[inside], patch=patch[inside])
    e[inside] *= projector.illumination(xy[inside])
    return e


def unit_emission(scene: Scene, projector: PosedLens) -> csr_array:
    """(P, n pixels) irradiance of each patch by each projector pixel at unit flux, vignetting included."""
    bare = area_emission(
        scene.with_reflectance(1.0), projector.lens, projector.pose, subsamples=2, convention="physical"
    )
    return csr_array(bare @ diags_array(projector.illumination(projector.lens.pixel_grid())))


@dataclass(frozen=True, eq=False)
class SceneModel:
    """Everything that predicts what the camera sees of the room."""

    scene: Scene
    form_factors: FormFactors
    camera: PosedLens
    projector: PosedLens
    flux: float
    """κ."""
    unit_emission: csr_array
    camera_look: Look
    projector_look: Look
    direct_gain: FloatArray
    """(H, W) camera value of direct light by white, measured; 0 where not lit or not valid."""
    projector_xy_px: FloatArray
    """(H, W, 2) measured correspondence; NaN where there is none."""
    global_gain: FloatArray | float = 1.0
    """(H, W) measured over modelled global light of white: what the patches are too coarse for; 1 where not lit."""

    @cached_property
    def seen_reflectance(self) -> FloatArray:
        """(H·W,) what a camera pixel sees of the light that arrives: reflectance, vignetting, `global_gain`.

        From the direct light; NaN where unlit.
        """
        e = white_irradiance(self.scene, self.projector, self.camera_look.points_m, self.camera_look.hits.patch)
        gain = self.direct_gain.ravel()
        usable = (gain > 0) & (e > 0)
        seen = np.where(usable, gain / np.where(usable, self.flux * e, 1.0), np.nan)
        return np.asarray(seen * np.ravel(np.broadcast_to(self.global_gain, self.direct_gain.shape)))

    @cached_property
    def projector_pixel_gains(self) -> tuple[FloatArray, FloatArray]:
        """(n projector pixels,) direct gain and `seen_reflectance` as the camera measures them; NaN unseen."""
        where = project(self.camera.lens, self.camera.pose, self.projector_look.points_m)
        gain = sample(self.direct_gain, where)
        seen = sample(self.seen_reflectance.reshape(self.camera.lens.shape), where)
        return gain, seen

    @cached_property
    def active(self) -> BoolArray:
        """(n projector pixels,) pixels that the camera sees well enough to steer; the others stay black."""
        gain, seen = self.projector_pixel_gains
        known = np.isfinite(gain) & np.isfinite(seen)
        return np.asarray(known & (np.where(known, gain, 0) > LEAST_GAIN * np.median(gain[known])))


def camera_view(scene_model: SceneModel, active: BoolArray) -> LightTransport:
    """T from the active projector pixels to all camera pixels (flat).

    Pixels without measured direct light see the patch's own reflectance, dimmed by the camera's vignetting.
    """
    shape = (scene_model.camera.lens.n_pixels, scene_model.projector.lens.n_pixels)
    pixels = np.flatnonzero(
        (scene_model.direct_gain.ravel() > 0) & np.isfinite(scene_model.projector_xy_px.reshape(-1, 2)[:, 0])
    )
    rows, columns, weights = bilinear(
        scene_model.projector_xy_px.reshape(-1, 2)[pixels],
        scene_model.projector.lens.width_px,
        scene_model.projector.lens.height_px,
    )
    value = weights * scene_model.direct_gain.ravel()[pixels, None]
    index = (rows * scene_model.projector.lens.width_px + columns).ravel()
    direct = csr_array((value.ravel(), (np.repeat(pixels, 4), index)), shape=shape)
    hits = scene_model.camera_look.hits
    own = scene_model.scene.reflectance[hits.patch] * scene_model.camera.illumination(
        scene_model.camera.lens.pixel_grid()
    )
    measured = scene_model.seen_reflectance
    seen = np.where(hits.patch < 0, 0.0, np.where(np.isfinite(measured), measured, own))
    return _transport(
        scene_model, active, csr_array(direct[:, np.flatnonzero(active)]), smooth_view(scene_model.scene, hits, seen)
    )


def projector_view(scene_model: SceneModel, active: BoolArray) -> LightTransport:
    """T from the active projector pixels to what the camera sees at each of them: square, direct part diagonal."""
    gain, seen = scene_model.projector_pixel_gains
    view = smooth_view(scene_model.scene, scene_model.projector_look.hits, np.where(active, seen, 0.0))
    chosen = np.flatnonzero(active)
    return _transport(scene_model, active, csr_array(diags_array(gain[chosen])), csr_array(view[chosen]))


@dataclass(frozen=True, eq=False)
class ColouredRoom:
    """The room in each band of the camera: one geometry, and reflectance, flux and gains a band."""

    bands: tuple[SceneModel, ...]
    mixing: FloatArray
    """(B, B) K[b, q]: share of white in band b that channel q of the projector makes."""

    @cached_property
    def active(self) -> BoolArray:
        """(n projector pixels,) pixels that the camera sees well enough to steer, in every band."""
        return np.asarray(np.all([scene_model.active for scene_model in self.bands], axis=0))

    @cached_property
    def camera_transport(self) -> ColourTransport:
        """T from the active projector pixels to the camera's pixels."""
        return ColourTransport([camera_view(scene_model, self.active) for scene_model in self.bands], self.mixing)

    @cached_property
    def projector_transport(self) -> ColourTransport:
        """T from the active projector pixels to what the camera sees at each of them."""
        return ColourTransport([projector_view(scene_model, self.active) for scene_model in self.bands], self.mixing)


def sample_bands(image: FloatArray, xy_px: FloatArray) -> FloatArray:
    """(N, B) samples of an image (H, W, B), as :func:`sample` takes them."""
    return np.stack([sample(image[..., b], xy_px) for b in range(image.shape[-1])], axis=-1)


def sample(image: FloatArray, xy_px: FloatArray) -> FloatArray:
    """(N,) bilinear samples; NaN where a point is outside or touches a pixel that is 0 or NaN."""
    usable = np.isfinite(image) & (image != 0)
    xy = np.where(np.isfinite(xy_px), xy_px, -10.0).astype(np.float32)
    x, y = (np.ascontiguousarray(xy[None, :, k]) for k in (0, 1))
    values = _remap(np.where(usable, image, 0.0), x, y)
    whole = _remap(usable.astype(np.float64), x, y) > 1 - 1e-6
    return np.where(whole, values, np.nan)


def _remap(image: FloatArray, x: NDArray[np.float32], y: NDArray[np.float32]) -> FloatArray:
    # OpenCV's remap takes at most 32,767 columns.
    step = 30_000
    parts = [
        cv2.remap(image.astype(np.float32), x[:, k : k + step], y[:, k : k + step], cv2.INTER_LINEAR)[0]
        for k in range(0, x.shape[1], step)
    ]
    return np.concatenate(parts).astype(np.float64)


def _transport(scene_model: SceneModel, active: BoolArray, direct: csr_array, view: csr_array) -> LightTransport:
    chosen = np.flatnonzero(active)
    emission = diags_array(scene_model.scene.reflectance * scene_model.flux) @ scene_model.unit_emission[:, chosen]
    radiosity = Radiosity(scene_model.form_factors, scene_model.scene.reflectance, solver="repeated")
    patch, xy_px = scene_model.projector_look.hits.patch[chosen], scene_model.projector.lens.pixel_grid()[chosen]
    return LightTransport(direct, csr_array(emission), radiosity, view, pixel_patch=patch, pixel_xy_px=xy_px)
