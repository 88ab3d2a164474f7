"""What stands in a room like a wall and is none: a partition, and the strips of a curved screen."""

import numpy as np
import pytest

from calibration.geometry.bundle_unknowns import PlanarScene
from calibration.geometry.known.scale import scale_from_baseline
from calibration.geometry.pinhole import PinholeModel
from calibration.geometry.planes import Axes
from calibration.geometry.room import room_from_stereo
from calibration.geometry.stereo import calibrate_stereo
from calibration.geometry.support import bending_planes

PARTITION_X_M, PARTITION_END_Y_M = 2.6, 2.35
BEFORE_IT_M = 4.8 - PARTITION_X_M


def with_partition(room, xy, image):
    """The same pixels with a wall into the room, which hides what is behind it from both devices."""
    origin, rays = np.array(room.camera.position_m), room.camera.rays(xy)
    with np.errstate(divide="ignore"):
        along = (PARTITION_X_M - origin[0]) / rays[:, 0]
    there = origin + along[:, None] * rays
    on_it = (along > 0) & (there[:, 1] < PARTITION_END_Y_M) & (there[:, 2] > 0) & (there[:, 2] < room.size_m[2])
    lit, inside = room.projector.image_of(there)
    behind = room.hits(room.camera, xy)[0]
    shadow = crosses(np.array(room.projector.position_m), behind)
    image = image.copy()
    image[on_it & inside] = lit[on_it & inside]
    keep = np.where(on_it, inside, ~shadow)
    return xy[keep], image[keep]


def crosses(origin, points):
    """Tell where the partition stands between a device and points."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (PARTITION_X_M - origin[0]) / (points[:, 0] - origin[0])
        y = origin[1] + share * (points[:, 1] - origin[1])
    return (share > 0) & (share < 1) & (y < PARTITION_END_Y_M)


def test_the_wall_behind_a_partition_closes_the_room(room):
    pair = calibrate_stereo(*with_partition(room, *room.correspondences(3)), room.nominal)
    baseline_m = float(np.linalg.norm(np.subtract(room.camera.position_m, room.projector.position_m)))
    box = room_from_stereo(scale_from_baseline(pair, baseline_m), room.size_m)
    assert box.camera.position_m == pytest.approx(room.camera.position_m, abs=0.05)


def devices():
    camera = PinholeModel(
        width_px=640, height_px=480, focal_px=(400.0, 400.0), principal_point_px=(320.0, 240.0),
        distortion=(0.0,) * 5, rotation=np.eye(3), translation_m=np.zeros(3),
    )  # fmt: skip
    projector = PinholeModel(
        width_px=640, height_px=480, focal_px=(400.0, 400.0), principal_point_px=(320.0, 240.0),
        distortion=(0.0,) * 5, rotation=np.eye(3), translation_m=np.array([-0.5, 0.0, 0.0]),
    )  # fmt: skip
    return camera, projector


def seen(depth_m):
    """Correspondences of a surface whose depth is a function of the camera's x over z."""
    _, projector = devices()
    x, y = np.meshgrid(np.arange(0, 640, 6.0), np.arange(0, 480, 12.0))
    xy = np.stack([x.ravel(), y.ravel()], axis=1)
    rays = np.stack([(xy[:, 0] - 320) / 400, (xy[:, 1] - 240) / 400, np.ones(len(xy))], axis=1)
    points = rays * depth_m(rays[:, 0])[:, None] + projector.translation_m
    return xy, points[:, :2] / points[:, 2:] * 400 + np.array([320.0, 240.0])


def scene(planes):
    camera, projector = devices()
    axes = Axes(np.eye(3), np.full(len(planes), -1))
    return PlanarScene(camera=camera, projector=projector, planes=np.array(planes), axes=axes)


def test_a_tangent_of_a_cylinder_bends_and_a_wall_does_not():
    flat = seen(lambda x: np.full_like(x, 3.0))
    assert not bending_planes(scene([[0, 0, 1 / 3.0]]), *flat).any()
    # A parabola in depth over the picture, of which the plane explains the middle.
    curved = seen(lambda x: 3.0 + 1.5 * x**2)
    assert bending_planes(scene([[0, 0, 1 / 3.0]]), *curved).all()
