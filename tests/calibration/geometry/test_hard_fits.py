"""Fits along bent valleys, points that are less certain than others, and one device before the other."""

import numpy as np
import pytest

from calibration.geometry import plane_search
from calibration.geometry.epipolar import SampsonError, nominal_unknowns
from calibration.geometry.flat import plane_starts
from calibration.geometry.pinhole import rotation_of, vector_of
from calibration.geometry.planes import Axes, corner_axes
from calibration.geometry.robust_fit import Priors, robust_fit
from calibration.geometry.stereo import calibrate_stereo


def valley(z):
    """Rosenbrock's function as residuals of two points: a bent valley, a hundred times steeper across than along."""
    return np.array([[10 * (z[1] - z[0] ** 2), 0.1 * (1 - z[0])], [0.0, 0.0]])


def test_a_fit_walks_along_a_bent_valley_to_its_end():
    priors = Priors.independent(np.zeros(2), np.full(2, np.inf), 1.0)
    fit = robust_fit(valley, np.array([-1.2, 1.44]), priors, iterations=40, least_scale_px=1.0)
    assert fit.z == pytest.approx([1.0, 1.0], abs=1e-3)  # straight steps are 1.2 away then


@pytest.mark.parametrize("seed", range(4))
def test_sampson_distances_have_the_slopes_that_they_state(room, seed):
    random = np.random.default_rng(seed)
    x1, x2 = room.correspondences(20)
    error = SampsonError(x1, x2, room.nominal)
    q = nominal_unknowns()
    q += random.normal(scale=0.005, size=len(q))  # with more, some rays are still on their way to undistorted
    stated, step = error.jacobian(q), 1e-6
    for slope, direction in zip(stated, step * np.eye(len(q)), strict=True):
        difference = (error(q + direction) - error(q - direction)) / (2 * step)
        assert np.allclose(slope, difference, rtol=0, atol=1e-4 * np.abs(difference).max())


@pytest.mark.parametrize("angle_rad", [1e-9, 1e-6, 1e-3, 1.0, 3.0])
def test_a_rotation_however_small_comes_back_as_its_vector(angle_rad):
    vector = angle_rad * np.array([0.6, -0.48, 0.64])
    assert vector_of(rotation_of(vector)) == pytest.approx(vector, rel=1e-6, abs=1e-15)


def focal_error(room, pair):
    return max(
        abs(pair.camera.focal_px[0] / room.camera.focal_px - 1),
        abs(pair.projector.focal_px[0] / room.projector.focal_px - 1),
    )


@pytest.fixture(scope="module")
def rounded_alike(room):
    """Correspondences a third of which are off together, in waves, as where codes are rounded alike."""
    x1, x2 = room.changed(outlier_share=0.0, noise_px=0.02).correspondences(6)
    off = x1[:, 1] > np.quantile(x1[:, 1], 0.67)
    x2[off] += 0.3 * np.sin(x1[off, :1] / 25) * [1.0, 0.5]
    sigma = np.where(off[:, None], 0.25, 0.02) * np.ones(2)
    return x1, x2, sigma


def test_points_that_say_how_uncertain_they_are_do_less_harm(room, rounded_alike):
    x1, x2, sigma = rounded_alike
    told = calibrate_stereo(x1, x2, room.nominal, sigma_px=sigma)
    untold = calibrate_stereo(x1, x2, room.nominal)
    assert focal_error(room, told) < 0.5 * focal_error(room, untold)
    assert told.sigmas["camera_f"] < untold.sigmas["camera_f"]


def test_the_same_sigma_everywhere_changes_nothing(room):
    x1, x2 = room.correspondences(8)
    plain = calibrate_stereo(x1, x2, room.nominal)
    told = calibrate_stereo(x1, x2, room.nominal, sigma_px=np.full_like(x2, 0.1))
    assert told.camera.focal_px == plain.camera.focal_px
    assert told.sigmas == plain.sigmas


def test_a_camera_before_the_projector_is_found(room):
    """All epipolar lines meet inside of both pictures."""
    axis = np.subtract((4.8, 4.72, 1.2), room.projector.position_m)
    ahead = room.projector.position_m + 0.54 * axis / np.linalg.norm(axis) + [0.02, -0.01, 0.06]
    other = room.changed(camera={"position_m": tuple(ahead)})
    pair = calibrate_stereo(*other.correspondences(5), other.nominal)
    assert focal_error(other, pair) < 0.02
    relative = other.camera.rotation @ np.subtract(other.projector.position_m, other.camera.position_m)
    assert pair.projector.position_m == pytest.approx(relative / np.linalg.norm(relative), abs=0.03)


@pytest.mark.parametrize("seed", [10, 11, 24])
def test_a_long_bent_lens_in_line_before_a_shifted_projector_is_found(room, seed):
    """Flat walls explained none of these points: lenses' terms were held as tightly as those of wide lenses."""
    random = np.random.default_rng(seed)
    axis = np.subtract((4.8, 4.72, 1.2), room.projector.position_m)
    ahead = room.projector.position_m + 0.55 * axis / np.linalg.norm(axis) + random.uniform(-0.1, 0.1, 3)
    focal_px = 2.4 * room.camera.focal_px
    column, row = room.projector.principal_point_px
    other = room.changed(
        camera={"position_m": tuple(ahead), "focal_px": focal_px, "distortion": (-0.13, -0.05, 5e-4, 6e-6, 0.0)},
        projector={"principal_point_px": (column, row + random.uniform(0.1, 0.45) * room.projector.shape[0])},
        camera_hfov_deg=np.degrees(2 * np.arctan(room.camera.shape[1] / 2 / focal_px)),
        outlier_share=0.0,
        edge_bias_px=0.0,
        noise_px=0.05,
        seed=seed,
    )
    pair = calibrate_stereo(*other.correspondences(4), other.nominal)
    assert focal_error(other, pair) < 0.03
    relative = other.camera.rotation @ np.subtract(other.projector.position_m, other.camera.position_m)
    assert pair.projector.position_m == pytest.approx(relative / np.linalg.norm(relative), abs=0.03)


SMALL_CAMERA = {"shape": (240, 320), "focal_px": 132.925, "principal_point_px": (160.7, 117.8)}
SMALL_PROJECTOR = {"shape": (192, 256), "focal_px": 107.8, "principal_point_px": (126.8, 100.2)}


@pytest.mark.parametrize("seed", [1, 7])
def test_a_square_corner_is_found_square_from_the_first_start(room, monkeypatch, seed):
    """With lenses as free as at the end, the corner settles at 150 degrees in these noises, and no angle is right."""
    small = room.changed(
        camera=SMALL_CAMERA, projector=SMALL_PROJECTOR, outlier_share=0.0, edge_bias_px=0.0, noise_px=0.05, seed=seed
    )
    monkeypatch.setattr(plane_starts, "COLUMN_SHARES", plane_starts.COLUMN_SHARES[:1])
    x1, x2 = small.correspondences(4)
    order = np.random.default_rng(seed).permutation(len(x1))
    first = next(plane_search.candidates(x1[order], x2[order], small.nominal, right_angles=True))
    assert first.share_on_axes > 0.98
    assert len(set(first.axes.of_plane.tolist())) == 3


def upright_walls(first_deg, second_deg):
    """Planes of two upright walls, by the directions of their normals from straight ahead, and of a floor."""
    across, ahead = np.sin(np.radians([first_deg, second_deg])), np.cos(np.radians([first_deg, second_deg]))
    return np.vstack([np.column_stack([across, np.zeros(2), ahead]) / 3.0, [0.0, 0.8, 0.0]])


def test_walls_that_nearly_face_each_other_may_be_a_corners():
    """A rig's first fit saw its corner at 156 degrees, and explained all of it as a corridor, to 0.06 px."""
    planes = upright_walls(78.0, -78.0)
    seen = Axes(np.eye(3), np.array([0, 0, 1]))
    (corner,) = corner_axes(planes, seen)
    assert corner.of_plane.tolist() == [0, 1, 2]
    assert corner.directions @ corner.directions.T == pytest.approx(np.eye(3), abs=1e-12)
    straight = np.array([0.0, 0.0, 1.0])
    assert corner.directions @ straight == pytest.approx([np.sqrt(0.5), np.sqrt(0.5), 0.0], abs=1e-12)
    assert np.abs(corner.directions[2]) == pytest.approx([0, 1, 0])
    for wall, direction in zip(planes[:2], corner.directions[:2], strict=True):
        assert wall @ direction > 0.8 * np.linalg.norm(wall), "each wall turns by less than 37 degrees"


@pytest.mark.parametrize(("first_deg", "second_deg"), [(89.0, -89.0), (78.0, 80.0)])
def test_walls_that_face_each_other_or_stand_behind_each_other_are_no_corner(first_deg, second_deg):
    assert corner_axes(upright_walls(first_deg, second_deg), Axes(np.eye(3), np.array([0, 0, 1]))) == []


def test_without_a_third_wall_there_is_nothing_to_stand_a_corner_on():
    assert corner_axes(upright_walls(78.0, -78.0)[:2], Axes(np.eye(3), np.array([0, 0]))) == []


@pytest.mark.parametrize("faces", [("x0", "x1", "floor"), ("x0", "x1", "y1", "floor")])
def test_a_corridor_stays_one(room, faces):
    corridor = room.changed(
        faces=faces,
        camera={"position_m": (2.3, 0.6, 1.4), "look_at_m": (2.5, 4.0, 0.9), "focal_px": 400.0},
        projector={"position_m": (1.9, 0.9, 1.2), "look_at_m": (2.2, 4.0, 0.7), "focal_px": 330.0},
        camera_hfov_deg=116.0,
        projector_hfov_deg=114.0,
        outlier_share=0.0,
        edge_bias_px=0.0,
    )
    pair = calibrate_stereo(*corridor.correspondences(5), corridor.nominal)
    normals = pair.planes / np.linalg.norm(pair.planes, axis=1, keepdims=True)
    assert (normals @ normals.T).min() == pytest.approx(-1.0, abs=1e-6), "two walls face each other"
    assert focal_error(corridor, pair) < 0.03
