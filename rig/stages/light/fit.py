"""What light does in a room whose shape is known: direct light, vignetting of both lenses, reflectance of patches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.light import faces as walls
from calibration.light.alike import Alike
from calibration.light.open_wall import estimate_open_wall
from calibration.light.reflectance import ReflectanceFit, arriving_light, estimate_reflectance
from calibration.light.vignetting import Vignetting, fit_vignetting
from calibration.surfaces.bends import slant_errors
from rig.stages.correspondence import only
from rig.stages.geometry import GeometryRecord, Point
from rig.stages.light.between_patches import seen_from
from rig.stages.light.whole_patches import SeenPatches, whole_patches, with_unseen_parts
from rig.stages.maps.uncertainty import SMOOTHING_SHARE
from rig.stages.scene_model import (
    MOST_OFF_PX,
    PixelHits,
    PosedLens,
    cast_pixels,
    face_of_pixels,
    posed_lens,
    unit_emission,
    white_irradiance,
)
from rig.stages.surface.scene import AnyScene, alike_in, factors_of, scene_of
from rig.stages.surface.standing import StandingRecord
from sim.form_factors import FormFactors
from sim.geometry.optics import Pose, project
from sim.geometry.scene import Scene

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Shift = Point
"""x, y, z. [m]"""
NO_SHIFT: Shift = (0.0, 0.0, 0.0)

_LEAST_DIRECT = 0.05
_LEAST_IN_A_BAND = 0.005
"""A pixel is lit when its direct light is above this share of the median of the lit, and in each band above that."""
WHOLE_WHITE = 0.9995
"""Share of white from which on a pixel tells its patch's reflectance: on random rigs those with 0.97 to 0.995 of it had
3 to 6 % too little direct light, for the blur at the border is known to a few percent of itself."""
_NO_LIGHT = 1e-9
LEAST_PIXELS = 40
"""Camera pixels that a patch needs before its light counts."""
LEAST_OF_TRIANGLES = 6
"""The same of a triangle of what stands in the room: with more, small things would be taken for as bright as others."""


@dataclass(frozen=True, eq=False)
class BandLight:
    """One band's light of white in parts, (H, W) each."""

    direct: NDArray[np.float32]
    global_: NDArray[np.float32]
    white: NDArray[np.float32]


@dataclass(frozen=True, eq=False, kw_only=True)
class BareRoom:
    """The scene without any reflectance, and the devices in it; vignetting once it is fitted."""

    scene: AnyScene
    camera: PosedLens
    projector: PosedLens
    camera_hits: PixelHits
    alike: Alike
    """Of its surfaces, which are expected to reflect alike."""

    @cached_property
    def form_factors(self) -> FormFactors:
        """Of the scene: the same in all bands of light."""
        return factors_of(self.scene)

    @cached_property
    def slant_errors(self) -> FloatArray | None:
        """(P,) relative, of irradiance: the same in all bands of light; None of walls alone, which are flat."""
        scene = self.scene
        if isinstance(scene, Scene):
            return None
        towards_m = self.projector.pose.position_m - scene.centres
        return slant_errors(scene.topology.corner, scene.normals, towards_m, scene.region)

    def with_vignetting(self, vignetting: Vignetting) -> BareRoom:
        """Return the room with both lenses' vignetting."""
        camera = replace(self.camera, vignetting=vignetting.camera)
        return replace(self, camera=camera, projector=replace(self.projector, vignetting=vignetting.projector))

    def moved(self, by_m: Shift) -> BareRoom:
        """Return the room with both devices moved."""
        camera, projector = (_moved(device, by_m) for device in (self.camera, self.projector))
        return replace(self, camera=camera, projector=projector, camera_hits=cast_pixels(self.scene, camera))


def bare_room(
    record: GeometryRecord,
    patch_size_m: float,
    shift_m: Shift = NO_SHIFT,
    standing: StandingRecord | None = None,
) -> BareRoom:
    """Return the measured room in patches, with what stands in it.

    Its devices are moved by so much against walls that nobody measured; what stands before the walls was found so.
    """
    devices = (posed_lens(only(devices).pinhole()) for devices in (record.cameras, record.projectors))
    camera, projector = (_moved(device, shift_m) for device in devices)
    scene = scene_of(record, patch_size_m, standing)
    return BareRoom(
        scene=scene,
        camera=camera,
        projector=projector,
        camera_hits=cast_pixels(scene, camera),
        alike=alike_in(record, standing),
    )


def _moved(device: PosedLens, by_m: Shift) -> PosedLens:
    pose = device.pose
    there = Pose(pose.rotation, pose.translation_m - pose.rotation @ np.array(by_m))
    return replace(device, pose=there)


def lit_pixels(bands: list[BandLight], valid: BoolArray) -> BoolArray:
    """Return (H, W) valid pixels with direct light in every band. Raises CalibrationError where there is none."""
    direct = np.mean([light.direct for light in bands], axis=0)
    if not (direct[valid] > 0).any():
        raise CalibrationError("no valid pixel has direct light; look at the correspondence map and at the checkers")
    enough = [light.direct > _LEAST_IN_A_BAND * np.median(light.direct[valid]) for light in bands]
    return np.asarray(valid & (direct > _LEAST_DIRECT * np.median(direct[valid])) & np.all(enough, axis=0))


def on_the_model(room: BareRoom, projector_xy_px: NDArray[np.float32], most_off_px: float = MOST_OFF_PX) -> BoolArray:
    """Return (H, W) pixels that see in the model what the code says: not a floor that was put where nobody looked."""
    expected = project(room.projector.lens, room.projector.pose, room.camera_hits.points_m)
    with np.errstate(invalid="ignore"):
        off = np.abs(expected.reshape(projector_xy_px.shape) - projector_xy_px).max(axis=-1)
        return np.asarray(off < most_off_px)


def direct_gain(light: BandLight, lit: BoolArray, camera_hits: PixelHits, border: NDArray[np.float32]) -> FloatArray:
    """Return (H, W) direct light of a white without borders, 0 where not lit.

    The checkers tell the share of direct light with noise; that share is smooth along a wall (reflectance and
    vignetting cancel in it), so it is smoothed there and applied to the white frame, which has little noise. Beside the
    picture's border less than white arrives: the share of light is smooth only once what is missing is put back.

    Parameters
    ----------
    light
        Of one band.
    lit : (H, W) bool
    camera_hits
        What each pixel sees.
    border : (H, W)
        Share of white that a pixel sees, above 0.
    """
    direct = np.where(lit, light.direct / border, 0.0).astype(np.float64)
    share = np.where(lit, direct / np.maximum(direct + light.white - light.direct, _NO_LIGHT), 0.0)
    face = face_of_pixels(camera_hits, lit.shape)
    smooth = walls.smoothed_along_faces(share, lit, face, SMOOTHING_SHARE, told=border > WHOLE_WHITE)
    return np.asarray(light.white * smooth / np.maximum(1 - smooth * (1 - border), _NO_LIGHT))


def pixels_that_tell(
    room: BareRoom, lit: BoolArray, projector_xy_px: NDArray[np.float32], border: NDArray[np.float32]
) -> BoolArray:
    """Return (H, W) lit pixels whose light tells what reflects it: on the model, away from edges and borders.

    Parameters
    ----------
    room
        With its camera.
    lit : (H, W) bool
    projector_xy_px : (H, W, 2)
        What each pixel sees of the projector's picture.
    border : (H, W)
        Share of white that a pixel sees.

    Raises
    ------
    CalibrationError
        If few lit pixels see in the model what their code says.
    """
    on_model = walls.on_model_of(lit, on_the_model(room, projector_xy_px))
    face = face_of_pixels(room.camera_hits, lit.shape)
    return np.asarray(on_model & walls.away_from_edges(face) & (border > WHOLE_WHITE))


def fit_lenses(geometry: BareRoom, gain: FloatArray, lit: BoolArray) -> Vignetting:
    """Fit the vignetting of both lenses to direct light (H, W) on the lit pixels."""
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


def fit_reflectance(
    geometry: BareRoom, gain: FloatArray, light: BandLight, lit: BoolArray, *, least_pixels: int = LEAST_PIXELS
) -> ReflectanceFit:
    """Fit the patches' reflectance to means of what the camera saw, its vignetting taken out: inverse radiosity."""
    scene, hits, projector = geometry.scene, geometry.camera_hits.hits, geometry.projector
    e = white_irradiance(scene, projector, geometry.camera_hits.points_m, hits.patch)
    brightness = geometry.camera.illumination(geometry.camera.lens.pixel_grid())
    direct = np.where(e > 0, gain.ravel() / np.where(e > 0, e * brightness, 1.0), 0.0)
    lit_flat = lit.ravel() & (e > 0)
    # Outside the lit area all light is global; close to its border the lens mixes both.
    border = cv2.dilate((light.direct > 0.02 * np.median(light.direct[lit])).astype(np.uint8), np.ones((9, 9)))
    dark = (border == 0).ravel() & (hits.patch >= 0)
    global_light = np.where(lit_flat, light.white.ravel() - gain.ravel(), light.white.ravel()) / brightness
    counts = walls.PatchCounts(scene.n_patches, _needed_pixels(scene, least_pixels))
    per_lit = walls.patch_means(direct, hits.patch, lit_flat, counts)
    per_global = walls.patch_means(global_light, hits.patch, lit_flat | dark, counts)
    irradiance = np.asarray(unit_emission(scene, projector) @ np.ones(projector.lens.n_pixels))
    if not scene.region.any():
        return estimate_open_wall(per_lit, per_global, irradiance, scene.areas)
    solve = partial(
        estimate_reflectance,
        global_light=per_global,
        form_factors=geometry.form_factors.matrix,
        wall=scene.region,
        seen_from=seen_from(scene, hits, lit_flat | dark),
        alike=geometry.alike,
        irradiance_error=geometry.slant_errors,
    )
    fit = solve(per_lit, irradiance=irradiance)
    if not isinstance(scene, Scene):
        return fit
    seen = SeenPatches(
        scene=scene,
        camera=geometry.camera,
        hits=geometry.camera_hits,
        told=lit_flat,
        direct=direct,
        share=np.clip(light.direct.ravel() / np.maximum(light.white.ravel(), _NO_LIGHT), 0.0, 1.0),
        white=light.white.ravel() / brightness,
        irradiance=e,
    )
    found = whole_patches(seen, per_lit, fit, arriving_light(fit, irradiance, geometry.form_factors.matrix))
    # What a patch sends out of the projector's light, its lit part reflects; of all other light, the whole of it.
    whole = solve(found.whole, irradiance=irradiance * found.lit_part)
    return with_unseen_parts(whole, found, scene.region)


def _needed_pixels(scene: AnyScene, least_pixels: int) -> NDArray[np.intp]:
    """(P,) camera pixels that a patch needs: small triangles have few, but next to each other their light is smooth."""
    triangle = (scene.vertices[:, 2] == scene.vertices[:, 3]).all(axis=1)
    return np.where(triangle, min(LEAST_OF_TRIANGLES, least_pixels), least_pixels)
