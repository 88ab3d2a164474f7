"""Points along camera rays, and how uncertain they are."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.surfaces.point_map import point_map
from tests.calibration.surfaces.made import CAMERA, PROJECTOR, ball, correspondence_of, distances, plane

SHAPES = [ball((0.3, 2.6, 1.1), 0.5), plane((0, 4.0, 0), (0.2, 1.0, 0.1))]


def test_distances_are_those_of_the_shapes():
    points = point_map(correspondence_of(SHAPES, sigma_px=0.0), CAMERA, PROJECTOR)
    error = points.distance_m - distances(SHAPES)
    assert np.nanmax(np.abs(error)) < 1e-4, "what is left is the rounding of the coordinates to 32 bits"
    assert points.known.mean() > 0.6


def test_standard_deviations_are_those_of_repeated_measurements():
    maps = [point_map(correspondence_of(SHAPES, seed=seed), CAMERA, PROJECTOR) for seed in range(12)]
    known = np.all([each.known for each in maps], axis=0)
    found = np.std([each.distance_m[known] for each in maps], axis=0, ddof=1)
    stated = maps[0].sigma_m[known]
    assert np.sqrt(np.mean((found / stated) ** 2)) == pytest.approx(1.0, abs=0.1)


def test_only_chosen_pixels_get_a_point():
    chosen = np.zeros((CAMERA.height_px, CAMERA.width_px), dtype=bool)
    chosen[100:110, 150:160] = True
    assert (point_map(correspondence_of(SHAPES), CAMERA, PROJECTOR, chosen).known <= chosen).all()


def test_devices_in_one_place_are_refused():
    with pytest.raises(CalibrationError, match="apart"):
        point_map(correspondence_of(SHAPES), CAMERA, CAMERA)
