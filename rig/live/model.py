"""The frame kernel's model of a room: from a session's records, or guessed from a profile for trying out."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from rig.files.colour.srgb import linear_of_srgb
from rig.profile.schema import Profile
from rig.session import Session
from rig.stages.linear_light import RadiometricCalibration
from rig.stages.maps.sampling import sample_bands
from rig.stages.model import FittedScene, load_model
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.scene_model import LEAST_GAIN
from sim.form_factors import form_factors
from sim.frame.compensator import FrameModel, frame_model
from sim.geometry.mesh import Mesh
from sim.geometry.optics import Lens, Pose, project, rays_at
from sim.geometry.scene import intersect
from sim.light.mesh_view import NodeView, node_view
from sim.light.transport import LightTransport
from sim.light.transport_of_scene import coaxial_transport, smooth_view
from sim.scenes.gridded import room

FloatArray = NDArray[np.float64]

_BLACK_BLUR_SHARE = 0.003
"""Spread of the smoothing of the black image, of the picture's width: it is noise otherwise."""
_DITHER_SEED = 1
"""Any number does: two shows dither alike."""
_GUESSED_SIZE_M = (4.8, 4.8, 2.4)
_GUESSED_PLACE = (0.25, 0.25, 0.5)
"""Of a projector nobody has measured: shares of the room's edges; it looks along x and y, level."""
_GUESSED_REFLECTANCE = 0.7
"""Of painted walls; chosen, and said so in the notes."""
_GUESSED_GAMMA = 2.2


_GREY = "the session is monochrome: red, green and blue get the same light transport and are taken not to mix"
_LEARNED = (
    "what photographs of [transport] taught of the light is shown by patches: {:.0f} % of it (rms), which changes "
    "within them, is left out"
)


@dataclass(frozen=True, eq=False)
class LiveModel:
    """What the kernel needs, and where it comes from, in words."""

    frames: FrameModel
    origin: str
    notes: tuple[str, ...]


def session_model(session: Session, *, is_linear: bool) -> LiveModel:
    """Everything that a session has measured, in the projector's view.

    A session of a colour camera has a light transport, a response and a black for each colour, and their mixing. With
    a grey camera each colour gets the same light transport, and colours are taken not to mix.
    Raises SessionError when the session's model is not finished.
    """
    model, radiometric = load_model(session), load_radiometric_calibration(session)
    transport, black = model.room.projector_transport, black_at_pixels(model, radiometric)
    tables = np.stack([np.interp(np.arange(256), each.levels, each.linear) for each in radiometric.projector])
    grey = model.channels == 1
    frames = frame_model(
        transport.bands[0] if grey else transport,
        model.scene_model.projector.lens.shape,
        model.room.active,
        target_scale=model.level,
        black=black,
        eotf=target_curve(is_linear=is_linear),
        response=tables[0] if grey else tables,
        dither_seed=_DITHER_SEED,
        node_view=steered_node_view(model),
    )
    notes = [_GREY] if grey else []
    if model.learned is not None:
        notes.append(_LEARNED.format(100 * frames.learned_left_out))
    return LiveModel(frames, f"session {session.path}", tuple(notes))


def steered_node_view(model: FittedScene) -> NodeView | None:
    """Return what the steered pixels see of a mesh, in the two steps that frames take; None of gridded walls."""
    scene, hits = model.scene_model.scene, model.scene_model.projector_hits.hits
    if not isinstance(scene, Mesh):
        return None
    view = node_view(scene, hits)
    return NodeView(csr_array(view.weights[np.flatnonzero(model.room.active)]), view.nodes)


def black_at_pixels(model: FittedScene, radiometric: RadiometricCalibration) -> FloatArray:
    """(n active, B) what the camera sees at each projector pixel while the projector shows black."""
    scene_model, exposure_s = model.scene_model, max(radiometric.black)
    ratio = np.float32(exposure_s / radiometric.reference_exposure_s)
    black = radiometric.black[exposure_s] / ratio * radiometric.balance.astype(np.float32)
    sigma = max(_BLACK_BLUR_SHARE * black.shape[1], 0.5)
    smooth = cv2.GaussianBlur(black, (0, 0), sigma).reshape(black.shape).astype(np.float64)
    where = project(scene_model.camera.lens, scene_model.camera.pose, scene_model.projector_hits.points_m)
    # `sample` takes 0 for missing
    seen = sample_bands(np.maximum(smooth, 0.0) + 1.0, where)[model.room.active] - 1.0
    return np.where(np.isfinite(seen), seen, np.nanmedian(seen, axis=0))


def target_curve(*, is_linear: bool) -> FloatArray:
    """(256,) linear light of a target's codes: as such, or those of sRGB, as video and photographs."""
    codes = np.arange(256) / 255
    return codes if is_linear else linear_of_srgb(codes)


def guessed_model(profile: Profile, *, is_linear: bool) -> LiveModel:
    """A room of the profile's size with a projector in a usual place: nothing measured, for trying out."""
    size_m = profile.room.size_m or _GUESSED_SIZE_M
    transport, active = guessed_transport(size_m, profile)
    white = transport @ np.ones(transport.shape[1])
    frames = frame_model(
        transport,
        profile.projector.shape,
        active,
        target_scale=profile.brightness.target_white_share * float(np.median(white)),
        eotf=target_curve(is_linear=is_linear),
        response=(np.arange(256) / 255) ** _GUESSED_GAMMA,
        dither_seed=_DITHER_SEED,
    )
    note = (
        f"no session: a closed room of {size_m[0]:g} x {size_m[1]:g} x {size_m[2]:g} m in "
        f"{transport.radiosity.n_patches} patches with reflectance {_GUESSED_REFLECTANCE:g}, gamma "
        f"{_GUESSED_GAMMA:g} and the projector's place are guessed; for a real room give a session"
    )
    return LiveModel(frames, f"guess from profile {profile.name}", (note,))


def guessed_transport(size_m: tuple[float, float, float], profile: Profile) -> tuple[LightTransport, NDArray[np.bool_]]:
    """Transport of the lit projector pixels, seen from the projector, and (H * W,) which these are."""
    projector = profile.projector
    scene = room(size_m, profile.room.patch_size_m, _GUESSED_REFLECTANCE)
    lens = Lens.from_horizontal_field_of_view(projector.width_px, projector.height_px, projector.hfov_deg)
    place = np.array(size_m) * _GUESSED_PLACE
    pose = Pose.look_at(place, place + np.array([1.0, 1.0, 0.0]))
    whole = coaxial_transport(scene, form_factors(scene), lens, pose, convention="physical", emission_rule="area")
    hits = intersect(scene, pose.position_m, rays_at(lens, pose, lens.pixel_grid()))
    direct = whole.direct_matrix.diagonal()
    active = direct > LEAST_GAIN * np.median(direct[direct > 0])
    chosen = np.flatnonzero(active)
    reflectance = np.where(active, scene.reflectance[hits.patch], 0.0)
    view = csr_array(smooth_view(scene, hits, reflectance)[chosen])
    emission = csr_array(whole.emission[:, chosen])
    matrix = csr_array(whole.direct_matrix[chosen][:, chosen])
    transport = LightTransport(
        direct=matrix, emission=emission, radiosity=whole.radiosity, view=view, pixel_patch=hits.patch[chosen]
    )
    return transport, active
