"""Scores of a session on a simulated or emulated rig against its simulated world; no other file may look at that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.capture.devices import simulated_worlds_of
from rig.capture.rig import Rig
from rig.devices.simulated.devices import SimulatedCamera
from rig.devices.simulated.room import reflectance_at
from rig.devices.simulated.world import SimulatedWorld
from rig.files.channels import image_of, of_bands
from rig.session import Session
from rig.stages.model import FittedScene, load_model
from rig.stages.scene_model import PosedLens
from rig.truth.transport import ground_truth_mixing

FloatArray = NDArray[np.float64]


def score(rig: Rig, session: Session) -> dict[str, float] | None:
    """The error of each calibrated quantity, from step `truth`; None on a rig that has no truth."""
    if rig.profile.simulation is None:
        return None
    step = session.step("truth", needs=("geometry", "separation", "model"))
    if not step.done:
        step.save_record("truth", _scores(ground_truth_worlds(rig), session))
        step.finish()
    scores: dict[str, float] = step.load_record("truth")
    return scores


def ground_truth_worlds(rig: Rig) -> tuple[SimulatedWorld, ...]:
    """The simulated world that a rig photographs, in each band of its camera.

    The emulated rig's stands behind real drivers: made again, it is the same.
    Raises ProfileError when the profile has none.
    """
    if rig.profile.camera.driver == "simulated" and isinstance(rig.camera, SimulatedCamera):
        return rig.camera.bands
    return simulated_worlds_of(rig.profile)


def _scores(worlds: tuple[SimulatedWorld, ...], session: Session) -> dict[str, float]:
    model, world = load_model(session), worlds[0]
    scores = _pose_errors(world, model.scene_model.camera, model.scene_model.projector)
    scores["surface_median_mm"] = _surface_error_mm(world, model)
    scores |= _reflectance_errors(worlds, model, of_bands(_record(session)["source"], model.channels))
    scores |= _separation_biases(worlds, session, model)
    return scores | _mixing_error(worlds, model)


def _mixing_error(worlds: tuple[SimulatedWorld, ...], model: FittedScene) -> dict[str, float]:
    """Largest difference of a share of the mixing; nothing on a grey rig, which has none."""
    if model.channels == 1:
        return {}
    return {"mixing_max_error": float(np.abs(model.room.mixing - ground_truth_mixing(worlds)).max())}


def _record(session: Session) -> dict[str, Any]:
    return session.finished("model").load_record("model")


def _pose_errors(world: SimulatedWorld, camera: PosedLens, projector: PosedLens) -> dict[str, float]:
    """Pose of the camera relative to the projector, independent of how the room's frame was found."""
    found_rotation = projector.pose.rotation @ camera.pose.rotation.T
    true_rotation = world.projector.rotation @ world.camera.rotation.T
    found = projector.pose.rotation @ (camera.pose.position_m - projector.pose.position_m)
    true = world.projector.rotation @ (world.camera.position_m - world.projector.position_m)
    turn = cv2.Rodrigues(found_rotation @ true_rotation.T)[0]
    focal = [
        abs(camera.lens.focal_px[0] / world.settings.camera.focal_px - 1),
        abs(projector.lens.focal_px[0] / world.settings.projector.focal_px - 1),
    ]
    return {
        "camera_position_mm": 1000 * float(np.linalg.norm(found - true)),
        "camera_rotation_deg": float(np.degrees(np.linalg.norm(turn))),
        "focal_percent": 100 * max(focal),
    }


def _to_world(world: SimulatedWorld, projector: PosedLens, points_m: FloatArray) -> FloatArray:
    """Model points into the simulated world's room by way of the projector, which both know."""
    local = points_m @ projector.pose.rotation.T + projector.pose.translation_m
    return np.asarray(local @ world.projector.rotation + world.projector.position_m)


def _surface_error_mm(world: SimulatedWorld, model: FittedScene) -> float:
    points = model.scene_model.camera_look.points_m[model.lit.ravel()][::37]
    there = _to_world(world, model.scene_model.projector, points[np.isfinite(points).all(axis=1)])
    distances = np.stack([np.abs(there[:, wall.axis] - wall.position_m) for wall in world.room.walls])
    return 1000 * float(np.median(distances.min(axis=0)))


def _reflectance_errors(
    worlds: tuple[SimulatedWorld, ...], model: FittedScene, sources: Sequence[Sequence[int]]
) -> dict[str, float]:
    """Area-weighted rms over all patches and bands, and over those that were both lit and seen."""
    scene = model.scene_model.scene
    found = np.stack([scene_model.scene.reflectance for scene_model in model.room.bands])
    error = found - np.stack([_ground_truth_reflectance(world, model) for world in worlds])
    areas = np.broadcast_to(scene.areas, error.shape)
    known = np.isfinite(error)
    measured = known & (np.array(sources) == 0)

    def rms(chosen: NDArray[np.bool_]) -> float:
        return float(np.sqrt(np.average(error[chosen] ** 2, weights=areas[chosen])))

    return {"reflectance_rmse": rms(known), "reflectance_rmse_lit_and_seen": rms(measured)}


def _ground_truth_reflectance(world: SimulatedWorld, model: FittedScene, samples: int = 5) -> FloatArray:
    """(P,) mean true reflectance over each patch of the model, NaN where the simulated world is open."""
    scene = model.scene_model.scene
    by_name = {wall.name: k for k, wall in enumerate(world.room.walls)}
    share = (np.arange(samples) + 0.5) / samples
    values = np.full(scene.n_patches, np.nan)
    for face in scene.faces:
        if face.name not in by_name:
            continue
        row, column = np.divmod(np.arange(face.n_patches), face.columns)
        u = (column[:, None, None] + share[None, :, None]) / face.columns
        v = (row[:, None, None] + share[None, None, :]) / face.rows
        points = face.points(*np.broadcast_arrays(u, v))
        size = np.array(world.settings.size_m)
        there = np.clip(points / np.maximum(scene.vertices.max(axis=(0, 1)), 1e-9), 0, 1) * size
        values[face.patches] = reflectance_at(world.room, by_name[face.name], there).mean(axis=(1, 2))
    return values


def _separation_biases(worlds: tuple[SimulatedWorld, ...], session: Session, model: FittedScene) -> dict[str, float]:
    """Bias of measured direct and global light over the lit pixels, in percent of the truth there; mean of the bands.

    The unit of light is relative, so the measured white is put on the true one first.
    """
    image = session.finished("separation").load_image("separation")
    measured = {name: image_of(image, name) for name in ("direct", "global", "white")}
    parts = [{name: part[..., b] for name, part in measured.items()} for b in range(len(worlds))]
    biases = [_band_biases(world, part, model) for world, part in zip(worlds, parts, strict=True)]
    return {key: float(np.mean([bias[key] for bias in biases])) for key in biases[0]}


def _band_biases(
    world: SimulatedWorld, measured: Mapping[str, NDArray[np.float32]], model: FittedScene
) -> dict[str, float]:
    white, black = (world.light(np.full(world.projector.shape, code, np.uint8)) for code in (255, 0))
    lit = model.lit
    direct = ((white.direct - black.direct) * world.vignetting)[lit]
    global_ = ((white.global_ - black.global_) * world.vignetting)[lit]
    unit = float((direct + global_).mean()) / float(measured["white"][lit].mean())
    return {
        "direct_bias_percent": 100 * float(unit * measured["direct"][lit].mean() / direct.mean() - 1),
        "global_bias_percent": 100 * float(unit * measured["global"][lit].mean() / global_.mean() - 1),
    }
