"""Self-calibration against rooms whose lenses, poses and walls are known."""

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.geometry.known.scale import points_of_projector_pixels, scale_from_baseline, scale_from_spots
from calibration.geometry.stereo import calibrate_stereo


def calibrated(room, step_px=4, **options):
    return calibrate_stereo(*room.correspondences(step_px), room.nominal, **options)


def baseline_m(room):
    return float(np.linalg.norm(np.subtract(room.camera.position_m, room.projector.position_m)))


def projector_in_camera(room):
    return room.camera.rotation @ np.subtract(room.projector.position_m, room.camera.position_m)


def angle_deg(a, b):
    return np.degrees(np.arccos(np.clip((np.trace(a @ b.T) - 1) / 2, -1, 1)))


def surface_errors_m(room, pair):
    """Where the fit puts what projector pixels light, against where it is."""
    height, width = room.projector.shape
    xy = np.stack(np.meshgrid(np.linspace(20, width - 20, 30), np.linspace(20, height - 20, 20)), -1).reshape(-1, 2)
    truth, _ = room.hits(room.projector, xy)
    truth = (truth - room.camera.position_m) @ room.camera.rotation.T
    error = np.linalg.norm(points_of_projector_pixels(pair, xy) - truth, axis=1)
    return error[np.isfinite(error)]


def flat_wall(room):
    """Pixels that see x = 4.8 m only, without noise."""
    xy = np.stack(np.meshgrid(np.arange(0, 1280, 8.0), np.arange(0, 960, 8.0)), -1).reshape(-1, 2)
    points, _ = room.hits(room.camera, xy)
    on_wall = np.abs(points[:, 0] - 4.8) < 1e-9
    image, seen = room.projector.image_of(points[on_wall])
    return xy[on_wall][seen], image[seen]


@pytest.fixture(scope="module")
def pair(room):
    return scale_from_baseline(calibrated(room), baseline_m(room))


def test_the_relative_pose_is_found_to_millimetres(room, pair):
    expected = room.projector.rotation @ room.camera.rotation.T
    assert np.linalg.norm(pair.projector.position_m - projector_in_camera(room)) < 0.008
    assert angle_deg(pair.projector.rotation, expected) < 0.1


def test_both_focal_lengths_are_found_within_three_per_mille(room, pair):
    assert pair.camera.focal_px[0] == pytest.approx(room.camera.focal_px, rel=0.003)
    assert pair.projector.focal_px[0] == pytest.approx(room.projector.focal_px, rel=0.003)


def test_lens_terms_lie_within_four_of_their_standard_deviations(room, pair):
    for name, model, truth in (("camera", pair.camera, room.camera), ("projector", pair.projector, room.projector)):
        found = (model.focal_px[0], *model.principal_point_px, *model.distortion[:4])
        expected = (truth.focal_px, *truth.principal_point_px, *truth.distortion[:4])
        for term, a, b in zip(("f", "cx", "cy", "k1", "k2", "p1", "p2"), found, expected, strict=True):
            assert abs(a - b) < 4 * pair.sigmas[f"{name}_{term}"], (name, term, a, b)


def test_the_walls_lie_within_millimetres(room, pair):
    assert np.median(surface_errors_m(room, pair)) < 0.003


def test_what_is_left_over_is_the_noise(room, pair):
    assert pair.projector_rms_px == pytest.approx(np.sqrt(2) * room.noise_px, rel=0.1)
    assert pair.inlier_share > 0.97


def test_four_faces_are_found_on_three_axes(pair):
    assert sorted(pair.axes) == [0, 0, 1, 2]
    assert np.allclose(pair.room_axes @ pair.room_axes.T, np.eye(3), atol=1e-9)


def test_data_sheets_ten_percent_off_do_no_harm(room):
    wrong = room.changed(camera_hfov_deg=110.0, projector_hfov_deg=90.0)
    pair = scale_from_baseline(calibrated(wrong), baseline_m(room))
    assert pair.camera.focal_px[0] == pytest.approx(room.camera.focal_px, rel=0.003)
    assert np.median(surface_errors_m(room, pair)) < 0.003


@pytest.mark.parametrize(("device", "hfov_deg"), [("camera", 120.0), ("projector", 75.0)])
def test_one_wrong_data_sheet_is_named_and_not_the_walls_angles(room, device, hfov_deg):
    wrong = room.changed(**{f"{device}_hfov_deg": hfov_deg})
    with pytest.raises(CalibrationError, match=rf"^the {device}'s focal length comes out .* Check hfov_deg"):
        calibrated(wrong)


@pytest.mark.parametrize("principal_point_px", [(508.0, 700.0), (620.0, 384.0)])
def test_a_shifted_projector_lens_is_found(room, principal_point_px):
    shifted = room.changed(projector={"principal_point_px": principal_point_px})
    pair = scale_from_baseline(calibrated(shifted), baseline_m(room))
    # 700 rows of shift leave no floor in the picture: three faces determine less.
    assert pair.projector.principal_point_px == pytest.approx(principal_point_px, abs=8)
    assert pair.projector.focal_px[0] == pytest.approx(room.projector.focal_px, rel=0.006)


def test_terms_outside_the_fitted_family_do_little_harm(room):
    lens = (0.05, -0.02, 0.001, 0.001, 0.004)
    other = room.changed(camera={"distortion": lens}, projector={"distortion": (-0.05, 0.01, -0.0005, 0.0, -0.001)})
    pair = scale_from_baseline(calibrated(other), baseline_m(room))
    assert np.linalg.norm(pair.projector.position_m - projector_in_camera(room)) < 0.008
    assert np.median(surface_errors_m(other, pair)) < 0.005


def test_an_open_corner_is_enough(room):
    corner = room.changed(faces=("x1", "y1", "floor"))
    pair = scale_from_baseline(calibrated(corner), baseline_m(room))
    assert sorted(pair.axes) == [0, 1, 2]
    assert np.median(surface_errors_m(corner, pair)) < 0.015


def test_free_planes_say_that_the_focal_lengths_rest_on_the_data_sheets(room):
    pair = calibrated(room, right_angles=False)
    assert set(pair.axes) == {-1}
    assert pair.sigmas["camera_f"] > 0.01 * pair.camera.focal_px[0]
    assert abs(pair.camera.focal_px[0] - room.camera.focal_px) < 3 * pair.sigmas["camera_f"]


def test_the_same_points_give_the_same_numbers(room):
    once, again = calibrated(room, step_px=10), calibrated(room, step_px=10)
    assert again.camera.focal_px == once.camera.focal_px
    assert np.array_equal(again.planes, once.planes)


def test_a_tape_measure_between_two_spots_gives_metres(room, pair):
    spots = np.array([[150.0, 300.0], [870.0, 300.0]])
    a, b = room.hits(room.projector, spots)[0]
    unscaled = scale_from_baseline(pair, 1.0)
    scaled = scale_from_spots(unscaled, spots, float(np.linalg.norm(b - a)))
    assert scaled.baseline == pytest.approx(baseline_m(room), rel=0.001)


def test_two_spots_at_one_place_are_refused(pair):
    with pytest.raises(CalibrationError, match="one place"):
        scale_from_spots(pair, [[300, 300], [300, 300]], 1.0)


def test_no_baseline_is_refused_with_the_parallax_and_its_limit(room):
    together = room.changed(camera={"position_m": room.projector.position_m})
    with pytest.raises(CalibrationError, match=r"parallax .* px, below the limit of 2 px.*[Mm]ove the camera aside"):
        calibrated(together)


def test_a_flat_scene_is_refused(room):
    camera_xy, projector_xy = flat_wall(room)
    with pytest.raises(CalibrationError, match="flat scene does not determine"):
        calibrate_stereo(camera_xy, projector_xy, room.nominal)


def test_few_correspondences_are_refused(room):
    camera_xy, projector_xy = room.correspondences(40)
    with pytest.raises(CalibrationError, match="at least 500 are needed"):
        calibrate_stereo(camera_xy[:400], projector_xy[:400], room.nominal)


def test_a_map_of_nonsense_is_refused(room):
    random = np.random.default_rng(5)
    camera_xy = random.uniform(0, 900, (3000, 2))
    projector_xy = random.uniform(0, 700, (3000, 2))
    with pytest.raises(CalibrationError):
        calibrate_stereo(camera_xy, projector_xy, room.nominal)
