"""Lengths that points and tape both tell: each is believed as far as it is known."""

import numpy as np
import pytest

from calibration.geometry.known.lengths import TapedCalibration
from calibration.geometry.known.scale import scale_from_baseline
from calibration.geometry.pinhole import PinholeModel
from calibration.geometry.stereo import StereoCalibration, calibrate_stereo

TAPE = 0.003
"""Standard deviation of a length by tape, share of it."""
NOISE_PX = 0.3


def distances_of_walls(pair: StereoCalibration) -> np.ndarray:
    """Of the planes that were found, from the camera."""
    return np.sort(1 / np.linalg.norm(pair.planes, axis=1))


def baseline_m(room) -> float:
    return float(np.linalg.norm(np.subtract(room.camera.position_m, room.projector.position_m)))


@pytest.fixture(scope="module")
def pair(room):
    """Of noisy points, so that distances in baselines are known to some tenths of a percent."""
    camera_xy, projector_xy = room.correspondences(8)
    random = np.random.default_rng(3)
    noisy = camera_xy + random.normal(0, NOISE_PX, camera_xy.shape)
    return calibrate_stereo(noisy, projector_xy + random.normal(0, NOISE_PX, projector_xy.shape), room.nominal)


@pytest.fixture(scope="module")
def true_m(room, pair):
    """Distances of the walls that were found from the true camera."""
    x, y, z = room.camera.position_m
    found = distances_of_walls(scale_from_baseline(pair, baseline_m(room)))
    there = np.array([x, room.size_m[0] - x, y, room.size_m[1] - y, z, room.size_m[2] - z])
    return np.array([there[np.argmin(np.abs(there - one))] for one in found])


def held(room, pair, true_m, tape_errors):
    """Walls' distances and their deviations, of a baseline and the last wall's distance by tapes that are off."""
    taped_m = baseline_m(room) * (1 - TAPE * tape_errors[0]), true_m[-1] * (1 - TAPE * tape_errors[1])

    def walls(one, errors):
        return distances_of_walls(scale_from_baseline(one, taped_m[0] * (1 + TAPE * errors[0])))

    apart = TapedCalibration.apart(pair, 2)
    taped = apart.held_to(lambda one, errors: walls(one, errors)[-1:] - taped_m[1] * (1 + TAPE * errors[1]))
    before = walls(apart.pair, apart.tape_errors), apart.sigmas_of(walls)
    return before, (walls(taped.pair, taped.tape_errors), taped.sigmas_of(walls))


def test_a_second_tape_makes_the_other_walls_surer_and_truer(room, pair, true_m):
    random, errors, sigmas = np.random.default_rng(8), [], []
    for _ in range(40):
        both = held(room, pair, true_m, random.normal(size=2))
        errors.append([found - true_m for found, _ in both])
        sigmas.append([sigma for _, sigma in both])
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (rms[1] < 0.9 * rms[0]).all()
    assert (np.median(sigmas, axis=0)[1] < 0.85 * np.median(sigmas, axis=0)[0]).all()
    assert 0.6 < np.sqrt(np.mean(np.square(np.array(errors)[:, 1] / np.array(sigmas)[:, 1]))) < 1.4


def test_two_tapes_that_differ_meet_where_both_are_as_likely(room, pair, true_m):
    (before, _), (after, _) = held(room, pair, true_m, np.array([2.0, -2.0]))
    assert abs(after[-1] - true_m[-1]) < 0.5 * abs(before[-1] - true_m[-1])


def test_lenses_are_known_no_worse_and_not_moved_by_a_tape_that_agrees(room, pair, true_m):
    taped = TapedCalibration.apart(pair, 1)
    before = distances_of_walls(pair)[-1]
    agreed = taped.held_to(lambda one, errors: distances_of_walls(one)[-1:] - before * (1 + TAPE * errors))
    assert agreed.pair.camera.focal_px == pytest.approx(pair.camera.focal_px, rel=1e-9)
    assert all(agreed.pair.sigmas[term] <= sigma * (1 + 1e-9) for term, sigma in pair.sigmas.items())
    assert agreed.pair.sigmas["camera_f"] < pair.sigmas["camera_f"]


def test_tapes_that_differ_by_more_than_both_allow_are_as_uncertain_as_they_show(room, pair, true_m):
    """Of tapes three times worse than is said, a third of all lengths would lie beyond three of their sigmas."""
    random, scores, widest = np.random.default_rng(5), [], 0.0
    for _ in range(40):
        (_, (found, sigma)) = held(room, pair, true_m, 3 * random.normal(size=2))
        scores.append(np.abs(found - true_m) / sigma)
        widest = max(widest, float(sigma[-1]))
    _, (_, agreed) = held(room, pair, true_m, np.zeros(2))
    assert np.mean(np.array(scores) < 3) > 0.8
    assert widest > 2 * agreed[-1]


@pytest.fixture
def known():
    """A calibration that was not fitted, so that nothing of it is uncertain."""

    def lens(at_m: float) -> PinholeModel:
        return PinholeModel(
            width_px=64,
            height_px=48,
            focal_px=(50.0, 50.0),
            principal_point_px=(32.0, 24.0),
            distortion=(0.0,) * 5,
            rotation=np.eye(3),
            translation_m=np.array([at_m, 0.0, 0.0]),
        )

    return StereoCalibration(
        camera=lens(0.0),
        projector=lens(1.0),
        planes=np.array([[0.0, 0.0, 0.5]]),
        axes=(2,),
        room_axes=np.eye(3),
        rms_px=0.1,
        camera_rms_px=0.1,
        projector_rms_px=0.1,
        sigmas={},
        inlier_share=1.0,
        explained=None,
    )


@pytest.mark.parametrize(("apart", "sigma"), [(0.0, 0.5), (1.0, 0.5), (2.0, 1.0), (4.0, 4.0)])
def test_two_tapes_alone_meet_half_way_and_are_no_surer_than_they_agree(known, apart, sigma):
    """By sums by hand: chi-squared is apart² / 2, and widens the variance of their mean, 0.5, where it exceeds 1."""
    taped = TapedCalibration.apart(known, 2).held_to(lambda _, errors: np.array([errors[0] - errors[1] - apart]))
    assert taped.tape_errors == pytest.approx([apart / 2, -apart / 2])
    assert taped.sigmas_of(lambda _, errors: errors[:1]) == pytest.approx([np.sqrt(sigma)])
