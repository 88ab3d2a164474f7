"""A curved screen before the walls does not refuse the room that it stands in."""

import numpy as np
import pytest

from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.stereo import calibrate_stereo

CENTRE_M, RADIUS_M = np.array([2.88, 2.88]), 1.584
OPEN_TOWARDS = -np.array([1.0, 1.0]) / np.sqrt(2)
BOTTOM_M, TOP_M = 0.24, 2.16
NOISE_PX = 0.15
HALF = {
    "camera": {"shape": (480, 640), "focal_px": 265.85, "principal_point_px": (321.9, 236.15)},
    "projector": {"shape": (384, 512), "focal_px": 215.6, "principal_point_px": (254.05, 200.95)},
}
"""Pictures of half the size, in which strips of the screen pass for walls beside the real ones."""


def share_to_screen(origin_m, rays):
    """How far along each ray the screen is first met, infinite where it is not; of a half-cylinder both sides count."""
    start, along = origin_m[:2] - CENTRE_M, rays[:, :2]
    a, b, c = (along**2).sum(1), along @ start, start @ start - RADIUS_M**2
    found = np.full(len(rays), np.inf)
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b**2 - a * c)
        for share in ((-b + root) / a, (-b - root) / a):
            there = origin_m + share[:, None] * rays
            on_it = ((there[:, :2] - CENTRE_M) @ OPEN_TOWARDS < 0) & (there[:, 2] > BOTTOM_M) & (there[:, 2] < TOP_M)
            found = np.where(on_it & (share > 0) & (share < found), share, found)
    return found


def first_points(room, device, rays, walls_m):
    """(N, 3) what rays of a device meet first: the screen, or the wall behind it."""
    origin = np.array(device.position_m)
    to_screen = share_to_screen(origin, rays)
    to_wall = np.linalg.norm(walls_m - origin, axis=1) / np.linalg.norm(rays, axis=1)
    return origin + np.minimum(to_screen, to_wall)[:, None] * rays


def with_screen(room, step_px):
    """Correspondences of the room with the screen in it, where the light reaches."""
    height, width = room.camera.shape
    rows, columns = np.mgrid[0:height:step_px, 0:width:step_px]
    xy = np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64)
    seen = first_points(room, room.camera, room.camera.rays(xy), room.hits(room.camera, xy)[0])
    image, inside = room.projector.image_of(seen)
    xy, seen, image = xy[inside], seen[inside], image[inside]
    lit = first_points(room, room.projector, room.projector.rays(image), room.hits(room.projector, image)[0])
    reached = np.linalg.norm(lit - seen, axis=1) < 0.01
    noise = np.random.default_rng(3).normal(0, NOISE_PX, (int(reached.sum()), 2))
    return xy[reached], image[reached] + noise


@pytest.mark.slow
def test_tangents_of_a_curved_screen_do_not_refuse_the_walls_beside_it(room):
    small = room.changed(**HALF)
    nominal = NominalIntrinsics.of(
        camera_shape=small.camera.shape,
        projector_shape=small.projector.shape,
        camera_hfov_deg=small.camera_hfov_deg,
        projector_hfov_deg=small.projector_hfov_deg,
    )
    # The likeliest fit takes two strips for walls and has a focal length of 375 px.
    pair = calibrate_stereo(*with_screen(small, 3), nominal)
    assert abs(pair.camera.focal_px[0] - 265.85) < 3 * pair.sigmas["camera_f"] < 20
    assert abs(pair.projector.focal_px[0] - 215.6) < 3 * pair.sigmas["projector_f"] < 20
