"""Scores of a session on a simulated or emulated rig against its simulated world; no other file may look at that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rig.capture.rig import Rig
from rig.devices.simulated.devices import SimulatedCamera
from rig.devices.simulated.mesh.world import MeshWorld
from rig.devices.simulated.pair import SimulatedPair
from rig.devices.simulated.rigs import simulated_worlds_of
from rig.devices.simulated.room import reflectance_at
from rig.devices.simulated.world import SimulatedWorld
from rig.files.channels import image_of
from rig.session import Session
from rig.stages.model import FittedScene, load_model, load_model_record
from rig.stages.results import TruthErrors
from rig.stages.scene_model import PosedLens
from rig.stages.surface.scene import AnyScene
from rig.truth.transport import ground_truth_mixing
from sim.geometry.mesh import Mesh

FloatArray = NDArray[np.float64]
Worlds = tuple[SimulatedPair, ...]
"""One simulated world in each band of its camera."""


def score(session: Session, rig: Rig | None) -> TruthErrors | None:
    """Return the error of each calibrated quantity, from step `truth`; None of a session whose truth nobody knows.

    Parameters
    ----------
    session
        With step `model` finished.
    rig
        If it is open: its simulated world need not be made again.
    """
    if session.profile.simulation is None:
        return None
    step = session.step("truth", needs=("geometry", "separation", "model"))
    if not step.done:
        worlds = simulated_worlds_of(session.profile) if rig is None else ground_truth_worlds(rig)
        step.save_record("truth", _scores(worlds, session))
        step.finish()
    return step.load_record("truth", TruthErrors)


def ground_truth_worlds(rig: Rig) -> Worlds:
    """Return the simulated world that a rig photographs, in each band of its camera.

    The emulated rig's stands behind real drivers: made again, it is the same.
    Raises ProfileError when the profile has none.
    """
    if rig.profile.camera.driver == "simulated" and isinstance(rig.camera, SimulatedCamera):
        return rig.camera.bands
    return simulated_worlds_of(rig.profile)


def _scores(worlds: Worlds, session: Session) -> TruthErrors:
    model, world = load_model(session), worlds[0]
    pose = _pose_errors(world, model.scene_model.camera, model.scene_model.projector)
    sources = [band.source for band in load_model_record(session).bands]
    reflectance, lit_and_seen = _reflectance_errors(worlds, model, sources)
    direct, global_ = _separation_biases(worlds, session, model)
    surface = _surface_errors(world, model)
    return TruthErrors(
        camera_position_mm=pose.position_mm,
        camera_rotation_deg=pose.rotation_deg,
        focal_percent=pose.focal_percent,
        surface_median_mm=surface.median_mm,
        reflectance_rmse=reflectance,
        reflectance_rmse_lit_and_seen=lit_and_seen,
        direct_bias_percent=direct,
        global_bias_percent=global_,
        mixing_max_error=_mixing_error(worlds, model),
        surface_median_percent=surface.median_percent,
        surface_p95_percent=surface.p95_percent,
    )


def _mixing_error(worlds: Worlds, model: FittedScene) -> float | None:
    """Largest difference of a share of the mixing; None of a grey rig, which has none."""
    if model.channels == 1:
        return None
    return float(np.abs(model.room.mixing - ground_truth_mixing(worlds)).max())


@dataclass(frozen=True)
class _PoseErrors:
    position_mm: float
    rotation_deg: float
    focal_percent: float


def _pose_errors(world: SimulatedPair, camera: PosedLens, projector: PosedLens) -> _PoseErrors:
    """Pose of the camera relative to the projector, independent of how the room's frame was found."""
    found_rotation = projector.pose.rotation @ camera.pose.rotation.T
    true_rotation = world.projector.rotation @ world.camera.rotation.T
    found = projector.pose.rotation @ (camera.pose.position_m - projector.pose.position_m)
    true = world.projector.rotation @ (world.camera.position_m - world.projector.position_m)
    turn = Rotation.from_matrix(found_rotation @ true_rotation.T).magnitude()
    focal = [
        abs(camera.lens.focal_px[0] / world.settings.camera.focal_px - 1),
        abs(projector.lens.focal_px[0] / world.settings.projector.focal_px - 1),
    ]
    return _PoseErrors(
        position_mm=1000 * float(np.linalg.norm(found - true)),
        rotation_deg=float(np.degrees(turn)),
        focal_percent=100 * max(focal),
    )


def _to_world(world: SimulatedPair, projector: PosedLens, points_m: FloatArray) -> FloatArray:
    """Model points into the simulated world's room by way of the projector, which both know."""
    local = points_m @ projector.pose.rotation.T + projector.pose.translation_m
    return np.asarray(local @ world.projector.rotation + world.projector.position_m)


@dataclass(frozen=True)
class _SurfaceErrors:
    """Distances of the model's points from the true surface, of lit pixels; in per cent of the distance they see."""

    median_mm: float
    median_percent: float
    p95_percent: float


def _surface_errors(world: SimulatedPair, model: FittedScene) -> _SurfaceErrors:
    """Of every so many pixels: from a box's nearest wall, else from what the pixel looks at."""
    seen = model.lit.ravel()
    points = model.scene_model.camera_hits.points_m[seen][::37]
    finite = np.isfinite(points).all(axis=1)
    there = _to_world(world, model.scene_model.projector, points[finite])
    if isinstance(world, SimulatedWorld):
        distances = np.stack([np.abs(there[:, wall.axis] - wall.position_m) for wall in world.room.walls])
        off_m = distances.min(axis=0)
    else:
        true, normals = (
            part.reshape(-1, 3)[seen][::37][finite] for part in (world.surface.points_m, world.surface.normals)
        )
        off_m = np.abs(np.einsum("ij,ij->i", there - true, normals))
    percent = 100 * off_m / np.linalg.norm(there - world.camera.position_m, axis=1)
    return _SurfaceErrors(
        median_mm=1000 * float(np.nanmedian(off_m)),
        median_percent=float(np.nanmedian(percent)),
        p95_percent=float(np.nanquantile(percent, 0.95)),
    )


def _reflectance_errors(worlds: Worlds, model: FittedScene, sources: Sequence[Sequence[int]]) -> tuple[float, float]:
    """Area-weighted rms over all patches and bands, and over those that were both lit and seen."""
    scene = model.scene_model.scene
    found = np.stack([scene_model.scene.reflectance for scene_model in model.room.bands])
    projector = model.scene_model.projector
    error = found - np.stack([ground_truth_reflectance(world, scene, projector) for world in worlds])
    areas = np.broadcast_to(scene.areas, error.shape)
    known = np.isfinite(error)
    measured = known & (np.array(sources) == 0)

    def rms(chosen: NDArray[np.bool_]) -> float:
        return float(np.sqrt(np.average(error[chosen] ** 2, weights=areas[chosen])))

    return rms(known), rms(measured)


def ground_truth_reflectance(
    world: SimulatedPair, scene: AnyScene, projector: PosedLens, samples: int = 5
) -> FloatArray:
    """Return (P,) mean true reflectance over each patch of a scene, NaN where the simulated world has nothing there.

    Of which wall a patch is, its place tells, not its name: a room that was measured has its own corner as origin.
    """
    if isinstance(scene, Mesh):
        return _mesh_reflectance(world, scene, projector, samples)
    share = (np.arange(samples) + 0.5) / samples
    values = np.full(scene.n_patches, np.nan)
    for face in scene.faces:
        row, column = np.divmod(np.arange(face.n_patches), face.columns)
        u = (column[:, None, None] + share[None, :, None]) / face.columns
        v = (row[:, None, None] + share[None, None, :]) / face.rows
        points = face.points(*np.broadcast_arrays(u, v))
        there = _to_world(world, projector, points.reshape(-1, 3)).reshape(points.shape)
        if isinstance(world, MeshWorld):
            inwards = _to_world(world, projector, face.normal[None]) - _to_world(world, projector, np.zeros((1, 3)))
            values[face.patches] = _mean_known(world.reflectance_near(there.reshape(-1, 3), inwards[0]), face.n_patches)
        elif isinstance(world, SimulatedWorld):
            values[face.patches] = _box_reflectance(world, there)
    return values


def _mesh_reflectance(world: SimulatedPair, mesh: Mesh, projector: PosedLens, samples: int) -> FloatArray:
    """(P,) means over points of each patch; a world of a box has nothing but its walls."""
    if not isinstance(world, MeshWorld):
        return np.full(mesh.n_patches, np.nan)
    share = (np.arange(samples) + 0.5) / samples
    u, v = (each.ravel()[None, :, None] for each in np.meshgrid(share, share))
    a, b, c, d = (mesh.vertices[:, k, None] for k in range(4))
    points = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
    there = _to_world(world, projector, points.reshape(-1, 3))
    turned = _to_world(world, projector, mesh.normals) - _to_world(world, projector, np.zeros((1, 3)))
    return _mean_known(world.reflectance_near(there, np.repeat(turned, samples**2, axis=0)), mesh.n_patches)


def _mean_known(values: FloatArray, n_patches: int) -> FloatArray:
    """(P,) means of (P · samples) values; NaN where less than half of them are known."""
    each = values.reshape(n_patches, -1)
    known = np.isfinite(each)
    means = np.where(known, each, 0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    return np.where(known.mean(axis=1) >= 0.5, means, np.nan)


def _box_reflectance(world: SimulatedWorld, there: FloatArray) -> FloatArray | float:
    """(P,) means over samples of one face's patches, (P, n, n, 3) points; NaN where the box is open."""
    size = np.array(world.settings.size_m)
    beside = np.abs(np.concatenate([there, there - size], axis=-1)).mean(axis=(0, 1, 2))
    axis, side = int(np.argmin(beside)) % 3, int(np.argmin(beside)) // 3
    wall = _wall_at(world, axis, side * size[axis])
    if wall is None:
        return np.nan
    inside = np.clip(there, 0, size)
    return np.asarray(reflectance_at(world.room, wall, inside).mean(axis=(1, 2)))


def _wall_at(world: SimulatedWorld, axis: int, position_m: float) -> int | None:
    """The number of the wall at a place; None where the simulated world is open."""
    walls = enumerate(world.room.walls)
    return next((k for k, wall in walls if wall.axis == axis and abs(wall.position_m - position_m) < 1e-9), None)


def _separation_biases(worlds: Worlds, session: Session, model: FittedScene) -> tuple[float, float]:
    """Bias of measured direct and global light over the lit pixels, in percent of the truth there; mean of the bands.

    The unit of light is relative, so the measured white is put on the true one first.
    """
    image = session.finished("separation").load_image("separation")
    direct, global_, white = (image_of(image, name)[model.lit] for name in ("direct", "global", "white"))
    biases = []
    for b, world in enumerate(worlds):
        true_direct, true_global = _true_light_of_white(world, model)
        unit = float((true_direct + true_global).mean()) / float(white[:, b].mean())
        biases.append(
            (
                100 * float(unit * direct[:, b].mean() / true_direct.mean() - 1),
                100 * float(unit * global_[:, b].mean() / true_global.mean() - 1),
            )
        )
    direct_bias, global_bias = (float(np.mean(bands)) for bands in zip(*biases, strict=True))
    return direct_bias, global_bias


def _true_light_of_white(world: SimulatedPair, model: FittedScene) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Direct and global light of white above black, at the lit pixels."""
    white, black = (world.light(np.full(world.projector.shape, code, np.uint8)) for code in (255, 0))
    direct = ((white.direct - black.direct) * world.vignetting)[model.lit]
    return direct, ((white.global_ - black.global_) * world.vignetting)[model.lit]
