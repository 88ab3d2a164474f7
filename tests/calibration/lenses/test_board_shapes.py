"""Boards that are not what was printed on a plane: bowed along any direction, twisted, longer than wide."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calibration.arrays import FloatArray
from calibration.lenses.bundle import STRETCH
from calibration.lenses.calibrate import LensFit, LensRequest, calibrate_lenses
from calibration.lenses.lens import project_points
from calibration.lenses.records import BoardSightings
from tests.calibration.lenses.board_world import (
    BOARD,
    CAMERA,
    CAMERA_SIZE,
    PROJECTOR,
    PROJECTOR_SIZE,
    TURN,
    truth,
)

OPEN = LensRequest(camera_size_px=CAMERA_SIZE, projector_size_px=PROJECTOR_SIZE)
SIGHTED_PX = 0.02
HALF = np.array(BOARD.half_size_m)
LENSES = [0, 1, 2, 3, 12, 13, 14, 15]
"""Focal lengths and principal points."""

Surface = Callable[[FloatArray], FloatArray]
"""(N, 3) points of a board, of (N, 2) places on its print."""


def flat(places: FloatArray) -> FloatArray:
    return np.column_stack([places, np.zeros(len(places))])


def rolled(radius_m: float, way_rad: float) -> Surface:
    """A sheet on a cylinder that lies askew: its print keeps its lengths along the sheet."""
    along = np.array([np.cos(way_rad), np.sin(way_rad)])

    def surface(places: FloatArray) -> FloatArray:
        arc = (places - HALF) @ along
        moved = places + (radius_m * np.sin(arc / radius_m) - arc)[:, None] * along
        return np.column_stack([moved, radius_m * (np.cos(arc / radius_m) - 1)])

    return surface


def twisted(corner_m: float) -> Surface:
    """A propeller: each row is turned a little more than the one before."""

    def surface(places: FloatArray) -> FloatArray:
        x, y = (places - HALF).T
        turn = corner_m / HALF[0] * y / HALF[1]
        return np.column_stack([x * np.cos(turn) + HALF[0], y + HALF[1], x * np.sin(turn)])

    return surface


def fed(share: float) -> Surface:
    """Paper that the printer fed too far."""
    return lambda places: flat(places * [1.0, 1 + share])


def seen_of(surface: Surface, views: int = 8, seed: int = 5) -> BoardSightings:
    """Corners of such a board by both devices, with noise."""
    random, state = np.random.default_rng(seed), truth(views, seed=seed)
    points = surface(BOARD.points_m)
    before = np.concatenate(
        [points @ turn.T + place for turn, place in zip(state.rotations, state.translations_m, strict=True)]
    )
    camera = project_points(CAMERA, before)
    projector = project_points(PROJECTOR, before @ TURN.T + state.projector_translation_m)
    n = len(points)
    blank = BoardSightings.of_camera(np.repeat(np.arange(views), n), np.tile(BOARD.points_m, (views, 1)), camera)
    return replace(
        blank,
        camera_xy_px=camera + SIGHTED_PX * random.normal(size=camera.shape),
        projector_xy_px=projector + SIGHTED_PX * random.normal(size=camera.shape),
        projector_weight=np.ones(len(camera)),
    )


def errors_of(fit: LensFit) -> FloatArray:
    """Errors of focal lengths and principal points over their sigmas."""
    state = fit.calibration.state
    off = np.concatenate([state.camera - CAMERA, state.projector - PROJECTOR])
    return np.asarray((off / np.maximum(fit.calibration.sigmas()[:24], 1e-12))[LENSES])


@pytest.mark.parametrize("way_rad", [0.0, 0.5, np.pi / 4, 2.0])
@pytest.mark.parametrize("radius_m", [1.5, -4.0])
def test_a_sheet_that_rolls_up_along_any_direction_moves_no_lens(way_rad: float, radius_m: float) -> None:
    fit = calibrate_lenses(seen_of(rolled(radius_m, way_rad)), OPEN)
    # by bends along the sides alone, errors come to 10 sigma and more
    assert np.abs(errors_of(fit)).max() < 4
    assert max(fit.calibration.noise_px) < 1.3 * SIGHTED_PX


@pytest.mark.parametrize("corner_m", [0.002, -0.004])
def test_a_twisted_board_says_by_how_much(corner_m: float) -> None:
    fit = calibrate_lenses(seen_of(twisted(corner_m)), OPEN)
    assert fit.calibration.state.flex_m[2] == pytest.approx(corner_m, rel=0.03)
    assert np.abs(errors_of(fit)).max() < 4


@pytest.mark.parametrize("share", [0.002, -0.006])
@pytest.mark.parametrize("views", [4, 8])
def test_a_print_that_is_longer_than_wide_says_so_and_moves_no_lens(share: float, views: int) -> None:
    fit = calibrate_lenses(seen_of(fed(share), views), OPEN)
    sigma = float(fit.calibration.sigmas()[STRETCH][0])
    assert abs(fit.calibration.state.stretch - share) < 4 * sigma
    assert sigma < abs(share) / 5
    assert np.abs(errors_of(fit)).max() < 4


@pytest.mark.parametrize("seed", [5, 6, 7, 8])
def test_a_board_as_it_should_be_is_taken_as_square(seed: int) -> None:
    fit = calibrate_lenses(seen_of(flat, seed=seed), OPEN)
    assert fit.calibration.state.stretch == 0
    assert fit.calibration.sigmas()[STRETCH] == 0
