"""Two walls and a strip of the floor: too little for the search, enough to close the room."""

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.stereo import calibrate_stereo

CAMERA_FOCAL_PX, PROJECTOR_FOCAL_PX = 763.0, 667.0


def above(room, height_m):
    """The room with a far ceiling and narrower lenses, both devices so much higher."""
    devices = {
        name: {"focal_px": focal_px, "position_m": up(device.position_m), "look_at_m": up(device.look_at_m)}
        for name, device, focal_px in (
            ("camera", room.camera, CAMERA_FOCAL_PX),
            ("projector", room.projector, PROJECTOR_FOCAL_PX),
        )
        for up in [lambda place: (place[0], place[1], place[2] + height_m)]
    }
    return room.changed(size_m=(4.8, 4.8, 9.0), camera_hfov_deg=80.0, projector_hfov_deg=75.0, **devices)


def calibrated(room, correspondences, beside=0):
    nominal = NominalIntrinsics.of(
        camera_shape=room.camera.shape,
        projector_shape=room.projector.shape,
        camera_hfov_deg=room.camera_hfov_deg,
        projector_hfov_deg=room.projector_hfov_deg,
    )
    return calibrate_stereo(*correspondences, nominal, beside=beside)


def heights_below_camera(room, pair):
    """In metres, of planes across the third direction: the baseline is known."""
    baseline_m = np.linalg.norm(np.subtract(room.camera.position_m, room.projector.position_m))
    return [baseline_m / np.linalg.norm(plane) for plane, axis in zip(pair.planes, pair.axes, strict=True) if axis == 2]


def with_table(room, xy, image):
    """The same pixels with a table's top before the walls, 0.9 m below the camera, at which their light ends."""
    origin, rays = np.array(room.camera.position_m), room.camera.rays(xy)
    with np.errstate(divide="ignore"):
        along = -0.9 / rays[:, 2]
    top = origin + along[:, None] * rays
    on_top = (along > 0) & (top[:, :2] > 3.3).all(axis=1) & (top[:, :2] < 4.5).all(axis=1)
    there, seen = room.projector.image_of(top)
    image, keep = image.copy(), ~on_top | seen
    image[on_top & seen] = there[on_top & seen]
    return xy[keep], image[keep], (on_top & seen).mean()


@pytest.fixture(scope="module")
def strip(room):
    """Of the floor about one point in a hundred."""
    seen = above(room, 1.2)
    xy, image = seen.correspondences(5)
    share = np.mean(np.abs(seen.hits(seen.camera, xy)[0][:, 2]) < 1e-9)
    assert 0.003 < share < 0.015
    return seen, calibrated(seen, (xy, image))


def test_a_strip_of_the_floor_is_found_where_it_is(strip):
    seen, pair = strip
    assert sorted(pair.axes) == [0, 1, 2]
    assert heights_below_camera(seen, pair) == pytest.approx([seen.camera.position_m[2]], rel=0.02)


def test_a_strip_is_found_though_all_of_it_lies_beside_edges(room):
    """Glare leaves whole codes among it, and what is next to those is no point that walls are looked for in."""
    seen = above(room, 1.2)
    xy, image = seen.correspondences(5)
    on_floor = np.abs(seen.hits(seen.camera, xy)[0][:, 2]) < 1e-9
    order = np.argsort(on_floor, kind="stable")
    pair = calibrated(seen, (xy[order], image[order]), beside=int(on_floor.sum()))
    assert sorted(pair.axes) == [0, 1, 2]
    assert heights_below_camera(seen, pair) == pytest.approx([seen.camera.position_m[2]], rel=0.02)


def test_with_the_strip_the_lenses_are_right_within_three_sigmas(strip):
    _, pair = strip
    for name, model, focal_px in (
        ("camera", pair.camera, CAMERA_FOCAL_PX),
        ("projector", pair.projector, PROJECTOR_FOCAL_PX),
    ):
        assert abs(model.focal_px[0] - focal_px) < 3 * pair.sigmas[f"{name}_f"]


def test_a_table_before_the_walls_is_no_floor(room):
    """With the room's own wide lenses: narrower ones do not tell two walls from their reversal."""
    higher = above(room, 3.2)
    wide = {name: {"focal_px": getattr(room, name).focal_px} for name in ("camera", "projector")}
    degrees = {"camera_hfov_deg": room.camera_hfov_deg, "projector_hfov_deg": room.projector_hfov_deg}
    seen = higher.changed(**wide, **degrees)
    xy, image, share = with_table(seen, *seen.correspondences(5))
    assert 0.003 < share < 0.03
    assert sorted(calibrated(seen, (xy, image)).axes) == [0, 1]


def test_narrow_lenses_do_not_tell_two_walls_from_their_reversal(room):
    """A table's top or none: without floor and ceiling, near and far may be exchanged, and both rooms are named."""
    seen = above(room, 1.8)
    with pytest.raises(CalibrationError, match=r"two rooms explain the points equally well.*or walls .* away"):
        calibrated(seen, with_table(seen, *seen.correspondences(5))[:2])
