"""Which device moved is found in rooms of which everything is known."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.geometry.moved.find import find_motion
from calibration.geometry.moved.records import ComparedPixels, MotionFound, SeenWalls
from calibration.geometry.pinhole import PinholeModel, project, rotation_of, world_rays

FloatArray = NDArray[np.float64]
SIZE_M = np.array([4.0, 4.0, 2.5])
NOISE_PX = 0.05


def looking(position_m: tuple[float, float, float], width_px: int, height_px: int) -> PinholeModel:
    forward = np.array([3.5, 3.5, 1.2]) - np.array(position_m)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return PinholeModel(
        width_px=width_px,
        height_px=height_px,
        focal_px=(0.5 * width_px, 0.5 * width_px),
        principal_point_px=(width_px / 2 - 0.5, height_px / 2 - 0.5),
        distortion=(0.0, 0.0, 0.0, 0.0, 0.0),
        rotation=rotation,
        translation_m=-rotation @ np.array(position_m),
    )


CAMERA, PROJECTOR = looking((0.5, 1.2, 1.4), 320, 240), looking((1.0, 0.8, 1.1), 256, 192)


def moved(
    device: PinholeModel, turn_deg: tuple[float, ...] = (0, 0, 0), by_m: tuple[float, ...] = (0, 0, 0)
) -> PinholeModel:
    rotation = rotation_of(np.radians(turn_deg)) @ device.rotation
    return replace(device, rotation=rotation, translation_m=-rotation @ (device.position_m + np.array(by_m)))


def walls_seen(camera: PinholeModel, xy_px: FloatArray, size_m: FloatArray = SIZE_M) -> SeenWalls:
    """The nearest face of the box along each ray."""
    rays, origin = world_rays(camera, xy_px), camera.position_m
    faces = [(axis, at) for axis in range(3) for at in (0.0, size_m[axis])]
    with np.errstate(divide="ignore"):
        distance = np.stack([(at - origin[axis]) / rays[:, axis] for axis, at in faces], axis=1)
    label = np.where(distance > 1e-9, distance, np.inf).argmin(axis=1)
    normal = np.eye(3)[[axis for axis, _ in faces]][label]
    return SeenWalls(normal, np.array([at for _, at in faces])[label], label.astype(np.int64))


def flat_wall(camera: PinholeModel, xy_px: FloatArray) -> SeenWalls:
    n = len(xy_px)
    return SeenWalls(np.tile([1.0, 0.0, 0.0], (n, 1)), np.full(n, 4.0), np.zeros(n, np.int64))


def seen(camera: PinholeModel, projector: PinholeModel, xy: FloatArray, walls=walls_seen) -> FloatArray:
    rays, found = world_rays(camera, xy), walls(camera, xy)
    along = (found.offset_m - found.normal @ camera.position_m) / (found.normal * rays).sum(axis=1)
    return project(projector, camera.position_m + along[:, None] * rays)


def found(camera: PinholeModel, projector: PinholeModel, *, walls=walls_seen, walls_now=walls_seen) -> MotionFound:
    columns, rows = np.meshgrid(np.arange(4, 320, 8), np.arange(4, 240, 8))
    xy = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float)
    before, now = seen(CAMERA, PROJECTOR, xy, walls), seen(camera, projector, xy, walls_now)
    inside = ((before > 0) & (before < (256, 192)) & (now > 0) & (now < (256, 192))).all(axis=1)
    noise = np.random.default_rng(5).normal(0, NOISE_PX, (2, *before.shape))
    pixels = ComparedPixels(
        camera_xy_px=xy[inside], before_px=(before + noise[0])[inside], now_px=(now + noise[1])[inside]
    )
    return find_motion(CAMERA, PROJECTOR, pixels, walls)


def test_a_rig_that_stands_still_is_told_as_standing_still() -> None:
    result = found(CAMERA, PROJECTOR)
    assert result.moved == "nothing"
    assert result.camera.image_px < 4 * result.camera.image_sigma_px
    assert result.camera_now is CAMERA


@pytest.mark.parametrize("turn_deg", [(0.1, 0.0, 0.0), (0.0, -0.5, 0.2), (1.0, 1.2, -1.2)])
def test_a_camera_that_was_turned_is_named_with_its_turn(turn_deg: tuple[float, ...]) -> None:
    result = found(moved(CAMERA, turn_deg), PROJECTOR)
    assert result.moved == "camera"
    assert np.linalg.norm(result.camera.turn_deg - turn_deg) < 0.1 * np.linalg.norm(turn_deg)
    assert (np.abs(result.camera.turn_deg - turn_deg) < 5 * result.camera.turn_sigma_deg).all()


@pytest.mark.parametrize("by_m", [(0.012, 0.0, 0.0), (0.01, -0.02, 0.03)])
def test_a_projector_that_was_shifted_is_named_with_its_shift(by_m: tuple[float, ...]) -> None:
    result = found(CAMERA, moved(PROJECTOR, by_m=by_m))
    assert result.moved == "projector"
    assert (np.abs(result.projector.shift_m - by_m) < 5 * result.projector.shift_sigma_m).all()
    assert np.linalg.norm(result.projector.shift_m - by_m) < 0.2 * np.linalg.norm(by_m)


def test_both_are_named_when_both_moved() -> None:
    result = found(moved(CAMERA, (0.3, 0.6, 0.0)), moved(PROJECTOR, (0.0, 0.4, 0.4), (0.01, 0.0, 0.02)))
    assert result.moved == "both"
    assert np.abs(result.camera.turn_deg - (0.3, 0.6, 0.0)).max() < 0.06
    assert np.abs(result.projector.turn_deg - (0.0, 0.4, 0.4)).max() < 0.06


def test_a_pair_that_moved_as_one_is_not_told_from_walls_that_did() -> None:
    by_m = (0.05, 0.0, 0.0)
    result = found(moved(CAMERA, by_m=by_m), moved(PROJECTOR, by_m=by_m))
    assert result.moved == "together"
    assert (np.abs(result.camera.shift_m - by_m) < 4 * result.camera.shift_sigma_m).all()


@pytest.mark.parametrize("name", ["camera", "projector"])
def test_a_lens_that_was_zoomed_is_no_move(name: str) -> None:
    def zoomed(device: PinholeModel) -> PinholeModel:
        return replace(device, focal_px=(1.01 * device.focal_px[0], 1.01 * device.focal_px[1]))

    camera, projector = (zoomed(CAMERA), PROJECTOR) if name == "camera" else (CAMERA, zoomed(PROJECTOR))
    with pytest.raises(CalibrationError, match=rf"the {name}'s lens was zoomed or focused: .* \+1\.0"):
        found(camera, projector)


def test_what_photographs_do_not_tell_apart_is_said_to_be_either() -> None:
    # a turn about the line of sight to a flat wall, of the camera or of the projector the other way: nearly the same
    result = found(moved(CAMERA, (0.06, 0.0, 0.0)), PROJECTOR, walls=flat_wall, walls_now=flat_wall)
    assert result.moved in ("either", "camera")


def test_another_room_is_refused_with_its_cause() -> None:
    def other_room(camera: PinholeModel, xy_px: FloatArray) -> SeenWalls:
        return walls_seen(camera, xy_px, np.array([3.2, 3.5, 2.1]))

    with pytest.raises(CalibrationError, match="another rig's session"):
        found(moved(CAMERA, (3.0, 8.0, 3.0)), PROJECTOR, walls_now=other_room)


def test_too_few_pixels_are_refused_with_their_number() -> None:
    xy = np.full((20, 2), 100.0)
    pixels = ComparedPixels(camera_xy_px=xy, before_px=xy, now_px=xy)
    with pytest.raises(CalibrationError, match="only 20 camera pixels"):
        find_motion(CAMERA, PROJECTOR, pixels, walls_seen)


def off_by_lines(xy_px: FloatArray, label: NDArray[np.int64], random: np.random.Generator) -> FloatArray:
    """Errors (N, 2) that twelve neighbouring lines of the projector share all along a wall."""
    lines = np.repeat(random.normal(0, 0.06, (6, 2, 22)), 12, axis=2)
    return np.stack([lines[label, k, xy_px[:, k].astype(int)] for k in (0, 1)], axis=1)


def turn_over_sigma(seed: int) -> FloatArray:
    """(3,) errors of a camera's turn over their sigmas, both maps off by whole lines."""
    random = np.random.default_rng(seed)
    turn_deg = random.normal(0, 0.4, 3)
    camera = moved(CAMERA, tuple(turn_deg))
    xy = np.stack(np.meshgrid(np.arange(4, 320, 4), np.arange(4, 240, 4)), -1).reshape(-1, 2).astype(float)
    before, now = seen(CAMERA, PROJECTOR, xy), seen(camera, PROJECTOR, xy)
    inside = ((before > 0) & (before < (256, 192)) & (now > 0) & (now < (256, 192))).all(axis=1)
    xy, before, now = xy[inside], before[inside], now[inside]
    before = before + off_by_lines(before, walls_seen(CAMERA, xy).label, random)
    now = now + off_by_lines(now, walls_seen(camera, xy).label, random)
    pixels = ComparedPixels(camera_xy_px=xy, before_px=before, now_px=now)
    told = find_motion(CAMERA, PROJECTOR, pixels, walls_seen).camera
    return np.asarray((told.turn_deg - turn_deg) / told.turn_sigma_deg)


def test_sigmas_of_a_turn_are_true_where_whole_lines_of_the_projector_share_their_error() -> None:
    errors = np.array([turn_over_sigma(seed) for seed in range(8)])
    # 0.73; by squares of the camera's picture alone 0.96.
    assert 0.4 < np.sqrt((errors**2).mean()) < 0.85
