"""Whether the sigmas of `rig lenses` are true: many synthetic sets of boards, errors over their stated sigmas.

    python benchmarks/calibration/lens_coverage.py --sets 40 --seed 1
    python benchmarks/calibration/lens_coverage.py --sets 40 --views 3 5     # hardly enough boards

Each set draws lenses, noise, poses, bend and the number of views; the truth has terms that the fit may leave out.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from calibration.errors import CalibrationError
from calibration.geometry.pinhole import rotation_of
from calibration.lenses.bundle import camera_points, projector_points
from calibration.lenses.calibrate import LensFit, LensRequest, calibrate_lenses
from calibration.lenses.halves import compare_halves, halves_of
from calibration.lenses.lens import project_points
from calibration.lenses.records import BoardSightings, RigState
from calibration.lenses.uncertainty import FAR_M, Anchor, pixel_grid, pixels_of, points_at, projection_covariance

CAMERA_SIZE, PROJECTOR_SIZE = (1280, 1024), (1024, 768)
COLUMNS, ROWS, SQUARE_M = 10, 7, 0.03


def drawn_rig(rng: np.random.Generator, third: float = 0.0) -> RigState:
    """Lenses, pose and bend, without views; `third` is how much of k3 they have, beside k1 and k2."""

    def lens(size: tuple[int, int], focal: float, middle: tuple[float, float], strength: float) -> np.ndarray:
        terms = strength * np.array([rng.normal(), rng.normal(), 0.005 * rng.normal(), 0.005 * rng.normal(), 0.0])
        if third:
            terms[4] = third * strength * rng.normal()
        place = np.array(middle) * size + 8 * rng.normal(size=2)
        return np.array([focal, focal * (1 + 0.002 * rng.normal()), *place, *terms, 0, 0, 0])

    focal = rng.uniform(1000, 2200)
    turn = rotation_of(rng.uniform(-0.25, 0.25, 3))
    shift = rng.uniform(0.0, 0.65)
    projector = lens(PROJECTOR_SIZE, rng.uniform(900, 1800), (0.5, 0.5 + shift), 0.05)
    depth = rng.uniform(0.8, 1.2) * focal / 1500
    middle = np.array([(511.5 - projector[2]) / projector[0], (383.5 - projector[3]) / projector[1], 1.0])
    return RigState(
        camera=lens(CAMERA_SIZE, focal, (0.5, 0.5), 0.12),
        projector=projector,
        projector_rotation=turn,
        projector_translation_m=1.05 * depth * middle - turn @ np.array([0.0, 0.0, depth]),
        flex_m=rng.normal(size=3) * rng.choice([0.0, 4e-4]),
        rotations=np.zeros((0, 3, 3)),
        translations_m=np.zeros((0, 3)),
    )


def with_views(rig: RigState, rng: np.random.Generator, count: int) -> tuple[BoardSightings, RigState]:
    places = np.stack(np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), axis=-1).reshape(-1, 2) * SQUARE_M
    half, depth = places.max(axis=0) / 2, rig.camera[0] / 1500
    turns, shifts = [], []
    while len(turns) < count:
        turn = rotation_of(np.array([*rng.uniform(-0.65, 0.65, 2), rng.uniform(-0.3, 0.3)]))
        middle = np.array([*(rng.uniform(-0.3, 0.3, 2) * depth * 1500 / rig.camera[0]), rng.uniform(0.6, 1.1) * depth])
        shift = middle - turn @ np.array([*half, 0.0])
        xy = project_points(rig.camera, places @ turn[:, :2].T + shift)
        if ((xy > 5) & (xy < np.array(CAMERA_SIZE) - 6)).all():
            turns.append(turn)
            shifts.append(shift)
    state = replace(rig, rotations=np.stack(turns), translations_m=np.stack(shifts))
    n = len(places)
    view, board = np.repeat(np.arange(count), n), np.tile(places, (count, 1))
    return BoardSightings.of_camera(view, board, np.zeros((count * n, 2))), state


def seen(blank: BoardSightings, state: RigState, rng: np.random.Generator) -> BoardSightings:
    """Corners with noise; what the camera's is off by moves the projector's reading."""
    points = camera_points(blank, state)

    def pixels(where: np.ndarray) -> np.ndarray:
        lit = project_points(state.projector, projector_points(where, state))
        return np.hstack([project_points(state.camera, where), lit])

    here = pixels(points)
    steps = [pixels(points + 1e-5 * state.rotations[blank.view][:, :, k]) - here for k in (0, 1)]
    along = np.stack(steps, axis=2)
    slope = along[:, 2:] @ np.linalg.inv(along[:, :2])
    off = rng.uniform(0.03, 0.3) * rng.normal(size=(len(here), 2))
    read = here[:, 2:] + np.einsum("nij,nj->ni", slope, off) + rng.uniform(0.03, 0.3) * rng.normal(size=off.shape)
    lit = ((here[:, 2:] > 0) & (here[:, 2:] < np.array(PROJECTOR_SIZE) - 1)).all(axis=1)
    return replace(
        blank,
        camera_xy_px=here[:, :2] + off,
        projector_xy_px=read,
        projector_by_camera=slope,
        projector_weight=lit.astype(np.float64),
    )


def errors(fit: LensFit, truth: RigState) -> dict[str, np.ndarray]:
    """Errors over sigmas: parameters that people read, and pixels of fixed points far away."""
    found, sigma = fit.calibration.state, fit.calibration.sigmas()
    off = np.concatenate(
        [
            (found.camera - truth.camera)[:4],
            (found.projector - truth.projector)[:4],
            found.projector_translation_m - truth.projector_translation_m,
        ]
    )
    z = {"parameters": off / sigma[[0, 1, 2, 3, 12, 13, 14, 15, 27, 28, 29]]}
    anchor = Anchor.of(fit.settled.sightings, found)
    turn, shift = anchor.aligned(truth)
    for name, in_projector, size in (("camera", False, CAMERA_SIZE), ("projector", True, PROJECTOR_SIZE)):
        grid, _ = pixel_grid(*size, columns=8)
        points = points_at(found, grid, FAR_M, in_projector=in_projector)
        apart = pixels_of(truth, points @ turn.T + shift, in_projector=in_projector) - grid
        covariance = projection_covariance(anchor, fit.calibration.covariance, grid, FAR_M, in_projector=in_projector)
        z[f"projection, {name}"] = (apart / np.sqrt(np.einsum("nii->ni", covariance))).ravel()
    halves = halves_of(fit.settled)
    if halves is not None:
        grid = pixel_grid(*CAMERA_SIZE, columns=8)[0]
        z["halves, camera"] = np.array([compare_halves(halves, grid, in_projector=False).ratio])
    return z


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--views", type=int, nargs=2, default=(5, 15), metavar=("LEAST", "MOST"), help="of a set")
    parser.add_argument("--third", type=float, default=0.0, help="share of k3 in the true lenses, beside k1 and k2")
    arguments = parser.parse_args()
    least, most = arguments.views
    collected: dict[str, list[np.ndarray]] = {}
    for index in range(arguments.sets):
        rng = np.random.default_rng([arguments.seed, index])
        blank, state = with_views(drawn_rig(rng, arguments.third), rng, int(rng.integers(least, most + 1)))
        started_s = time.perf_counter()
        try:
            fit = calibrate_lenses(
                seen(blank, state, rng), LensRequest(camera_size_px=CAMERA_SIZE, projector_size_px=PROJECTOR_SIZE)
            )
        except CalibrationError as error:
            print(f"{index}: refused: {error}", flush=True)
            continue
        z = errors(fit, state)
        for name, values in z.items():
            collected.setdefault(name, []).append(values)
        projector = fit.calibration.projector
        models = f"{fit.calibration.camera.model} {projector.model if projector else '-'}"
        text = ", ".join(f"{name} {np.sqrt(np.nanmean(values**2)):.2f}" for name, values in z.items())
        print(f"{index}: {blank.views} views, {models}, {time.perf_counter() - started_s:.1f} s: {text}", flush=True)
    for name, parts in collected.items():
        values = np.concatenate(parts)
        values = values[np.isfinite(values)]
        within = 100 * float((np.abs(values) < 3).mean())
        print(f"{name}: {within:.1f} % within 3 sigma, rms {np.sqrt((values**2).mean()):.2f}, {len(values)} values")


if __name__ == "__main__":
    main()
