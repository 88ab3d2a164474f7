"""Furniture that is nearly square, or large, does not refuse a square room."""

from dataclasses import dataclass

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.geometry.epipolar import NominalIntrinsics
from calibration.geometry.room import room_from_stereo
from calibration.geometry.stereo import calibrate_stereo, scale_from_baseline

NOISE_PX = 0.1


@dataclass(frozen=True, kw_only=True)
class Front:
    """The upright front of a thing in the room, turned from the wall at x's end."""

    askew_deg: float
    centre_m: tuple[float, float, float]
    half_size_m: tuple[float, float]
    """Along y and z."""

    def met_by(self, origin_m, rays):
        """(N, 3) where rays meet its plane, (N,) how far along them, and (N,) whether that is on it."""
        turn, centre = np.radians(self.askew_deg), np.array(self.centre_m)
        normal = np.array([np.cos(turn), np.sin(turn), 0.0])
        with np.errstate(divide="ignore", invalid="ignore"):
            along = ((centre - origin_m) @ normal) / (rays @ normal)
            there = origin_m + along[:, None] * rays
        return there, along, (along > 0) & (np.abs(there - centre)[:, 1:] < self.half_size_m).all(axis=1)


CHEST = Front(askew_deg=1.5, centre_m=(3.9, 3.05, 0.5), half_size_m=(0.65, 0.5))
SCREEN = Front(askew_deg=45.0, centre_m=(3.0, 2.9, 1.2), half_size_m=(0.85, 1.0))


def with_front(room, front):
    """Correspondences of a room with something before its walls, which hides what is behind it from both devices."""
    xy, image = room.correspondences(4)
    there, _, on_it = front.met_by(np.array(room.camera.position_m), room.camera.rays(xy))
    lit, inside = room.projector.image_of(there)
    origin_m = np.array(room.projector.position_m)
    _, share, before = front.met_by(origin_m, room.hits(room.camera, xy)[0] - origin_m)
    on_front_px = on_it & inside
    noise = np.random.default_rng(1).normal(0, NOISE_PX, (int(on_front_px.sum()), 2))
    image[on_front_px] = lit[on_front_px] + noise
    keep = np.where(on_it, inside, ~(before & (share < 1)))
    return xy[keep], image[keep]


def nominal_of(room):
    return NominalIntrinsics.of(
        camera_shape=room.camera.shape,
        projector_shape=room.projector.shape,
        camera_hfov_deg=room.camera_hfov_deg,
        projector_hfov_deg=room.projector_hfov_deg,
    )


@pytest.fixture(scope="module")
def pair_with_screen(room):
    return calibrate_stereo(*with_front(room, SCREEN), nominal_of(room))


@pytest.mark.slow
def test_a_chest_a_degree_and_a_half_off_a_wall_does_not_refuse_a_square_room(room):
    # With its front held at right angles, as it passes for a wall, the points contradict the room by 16 sigma.
    pair = calibrate_stereo(*with_front(room, CHEST), nominal_of(room))
    assert sorted(axis for axis in pair.axes if axis >= 0) == [0, 0, 1, 2], "the room's own walls stay square"
    assert pair.axes.count(-1) == 1, "the chest stands as it likes"


@pytest.mark.slow
def test_a_screen_askew_that_passes_for_a_wall_with_other_lenses_does_not_refuse_a_square_room(room, pair_with_screen):
    # Turned by 45 degrees, it is as good a wall of a room as the two that it hides in part, with lenses made for it.
    baseline_m = float(np.linalg.norm(np.subtract(room.camera.position_m, room.projector.position_m)))
    box = room_from_stereo(scale_from_baseline(pair_with_screen, baseline_m), room.size_m, with_things=True)
    sigma = float(pair_with_screen.sigmas_of(lambda fit: np.array([fit.camera.focal_px[0]]))[0])
    assert abs(pair_with_screen.camera.focal_px[0] - room.camera.focal_px) < 4 * sigma
    np.testing.assert_allclose(box.size_m, room.size_m, rtol=0.01)
    assert set(box.seen) >= {"x1", "y1"}, "walls behind the screen, not the screen"


@pytest.mark.slow
def test_where_a_box_has_no_place_for_things_a_screen_before_its_walls_is_named_with_the_remedy(room, pair_with_screen):
    with pytest.raises(CalibrationError, match=r'walls make none: .* at 135.* degrees.*kind = "free"'):
        room_from_stereo(pair_with_screen, room.size_m, with_things=False)
