"""Walls of plaster: each bulges by millimetres, which a camera sees, and which must bend neither lenses nor sigmas."""

from dataclasses import dataclass

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.geometry.flat.bows import bows_of, taken_by_bows
from calibration.geometry.plane_bundle import Rounds, adjust
from calibration.geometry.plane_search import candidates
from calibration.geometry.stereo import calibrate_stereo
from tests.calibration.conftest import FACES, SyntheticRoom, errors_by_sigma

DRAWS = 4


@dataclass(frozen=True, kw_only=True)
class BowedRoom(SyntheticRoom):
    """A box whose walls bulge in or out, each in a shape of its own, and stand right along their edges."""

    bow_m: float
    draw: int
    askew_deg: float = 0.0
    """By which each wall leans, too, about the foot of the camera's perpendicular: one standard deviation."""

    def bow(self, axis, side, points):
        """(N,) by how much a wall stands further towards +axis than it ought to."""
        leans = np.random.default_rng([self.draw, axis, side, 7]).normal(0, np.radians(self.askew_deg), 2)
        off = np.delete(points - self.camera.position_m, axis, axis=1)
        return off @ leans + self._waves(axis, side, points)

    def _waves(self, axis, side, points):
        waves = np.random.default_rng([self.draw, axis, side]).normal(size=3) * (1.0, 0.5, 0.5)
        others = np.delete(np.arange(3), axis)
        u, v = np.pi * points[:, others].T / np.array(self.size_m)[others, None]
        shapes = np.stack([np.sin(u) * np.sin(v), np.sin(2 * u) * np.sin(v), np.sin(u) * np.sin(2 * v)])
        return self.bow_m * waves @ shapes / np.abs(waves).sum()

    def hits(self, device, xy_px):
        origin, rays = np.array(device.position_m), device.rays(xy_px)
        along = np.full((3, 2, len(rays)), np.inf)
        for axis, pair in enumerate(FACES):
            for side, name in enumerate(pair):
                towards = rays[:, axis] * (2 * side - 1) > 0
                if name in self.faces and towards.any():
                    along[axis, side, towards] = self._along(axis, side, origin, rays[towards])
        along = along.reshape(6, -1)
        points = origin + along.min(axis=0)[:, None] * rays
        points[~np.isfinite(along.min(axis=0))] = np.nan
        return points, self._from_edges_m(points)

    def _along(self, axis, side, origin, rays):
        flat = (side * self.size_m[axis] - origin[axis]) / rays[:, axis]
        along = flat
        for _ in range(30):
            along = flat + self.bow(axis, side, origin + along[:, None] * rays) / rays[:, axis]
        return along

    def _from_edges_m(self, points):
        standing = np.array([[name in self.faces for name in pair] for pair in FACES]).T
        off = np.where(standing[:, None], np.abs(np.stack([points, np.array(self.size_m) - points])), np.inf)
        return np.sort(off.min(axis=0), axis=1)[:, 1]


def fitted(bow_m, draw, true_deg=0.0, **options):
    room = BowedRoom(bow_m=bow_m, draw=draw, askew_deg=true_deg)
    return room, calibrate_stereo(*room.correspondences(8), room.nominal, **options)


@pytest.fixture(scope="module")
def draws():
    """Rooms whose walls bulge by up to 6 mm; held for flat, they are told to be at no right angles."""
    return [fitted(0.006, draw) for draw in range(DRAWS)]


@pytest.fixture(scope="module")
def flat():
    return fitted(0.0, 0)


def test_errors_are_as_large_as_their_sigmas_say(draws):
    errors = np.array([errors_by_sigma(*draw) for draw in draws])
    assert np.abs(errors).max() < 4
    assert 0.5 < np.sqrt(np.mean(errors**2)) < 1.6


def test_it_is_told_by_how_much_they_bow(draws):
    """Waves of 6 mm leave a plane by 1 to 2 mm rms where they are seen; the baseline is 0.61 m."""
    for room, pair in draws:
        baseline_m = np.linalg.norm(np.subtract(room.camera.position_m, room.projector.position_m))
        assert 0.0008 < pair.bow * baseline_m < 0.003


def test_what_bows_leave_open_is_part_of_the_sigmas(draws, flat):
    for _, pair in draws:
        assert pair.sigmas["camera_f"] > 1.5 * flat[1].sigmas["camera_f"]


def test_flat_walls_are_not_said_to_bow(flat):
    assert flat[1].bow == 0
    assert np.abs(errors_by_sigma(*flat)).max() < 3


def test_what_bows_more_than_plaster_does_is_refused_as_not_flat():
    with pytest.raises(CalibrationError, match="is not flat: its points leave the plane"):
        fitted(0.08, 0)


def test_walls_may_bow_and_stand_askew_as_far_as_was_said():
    errors = [errors_by_sigma(*fitted(0.004, draw, true_deg=0.3, askew_deg=0.3)) for draw in range(3)]
    assert np.abs(errors).max() < 4


def test_walls_that_lean_further_than_they_bow_are_not_square():
    with pytest.raises(CalibrationError, match=r"not at right angles: .*askew_deg; 0\.3 in usual houses"):
        fitted(0.004, 1, true_deg=0.3)


@pytest.fixture(scope="module")
def first():
    """A room, its points, a fit to them as they are, and how its walls bow."""
    room = BowedRoom(bow_m=0.006, draw=1)
    x1, x2 = room.correspondences(8)
    order = np.random.default_rng(0).permutation(len(x1))
    x1, x2 = x1[order], x2[order]
    fit = next(candidates(x1, x2, room.nominal, right_angles=True))
    return room, x1, x2, fit, bows_of(fit, fit.fit, fit.error)


def test_a_fit_to_straightened_points_finds_little_left_of_bows(first):
    room, x1, x2, fit, bows = first
    assert bows.variance_px2 < 0.5 * bows.variance_as_flat_px2
    again = adjust(x1, bows.straightened(x1, x2), fit, room.nominal, rounds=Rounds(limits_px=(1.0,), iterations=10))
    left = bows_of(again, again.fit, again.error)
    assert left is None or left.most < 0.3 * bows.most


def test_points_on_no_wall_stay_where_they_are(first):
    _, x1, _, _, bows = first
    stray = np.full((len(x1), 2), 300.0) + np.arange(len(x1))[:, None]
    off = bows.straightened(x1, stray) - stray
    assert (np.abs(off).max(axis=1) == 0).mean() > 0.95


def test_bows_only_ever_take_from_what_the_points_tell(first):
    _, _, _, fit, bows = first
    taken = taken_by_bows(fit, fit.fit, fit.error, bows.spread)
    assert np.allclose(taken, taken.T)
    left, whole = (np.linalg.eigvalsh(one) for one in (fit.fit.hessian - taken, fit.fit.hessian))
    assert left.min() > -1e-6 * whole.max()
    assert np.trace(taken) > 0.1 * np.trace(fit.fit.hessian - fit.fit.priors.weight * fit.fit.priors.precision)
