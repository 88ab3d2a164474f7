"""Lenses and poses against OpenCV and against themselves backwards."""

import cv2
import numpy as np
import pytest

from sim.errors import SimulationError
from sim.geometry.optics import Lens, Pose, fold_squared, pixel_rays, project, rays_at, solid_angles

BENT = Lens(
    width_px=320,
    height_px=240,
    focal_px=(300.0, 310.0),
    principal_point_px=(150.0, 130.0),
    distortion=(-0.2, 0.05, 0.002, -0.001, 0.01),
)
POSE = Pose.look_at((1.0, 2.0, 1.5), (3.0, 2.5, 1.0), roll_deg=10.0)


def test_projection_follows_opencv():
    rng = np.random.default_rng(0)
    local = rng.uniform((-1, -0.7, 2), (1, 0.7, 5), (50, 3))
    world = (local - POSE.translation_m) @ POSE.rotation
    K = np.array([[300.0, 0, 150.0], [0, 310.0, 130.0], [0, 0, 1]])
    rvec, _ = cv2.Rodrigues(POSE.rotation)
    expected, _ = cv2.projectPoints(
        world, rvec, POSE.translation_m, cameraMatrix=K, distCoeffs=np.array(BENT.distortion)
    )
    assert np.allclose(project(BENT, POSE, world), expected.reshape(-1, 2), atol=1e-8)


def test_rays_and_projection_undo_each_other():
    xy = BENT.pixel_grid()
    points = POSE.position_m + 2.5 * rays_at(BENT, POSE, xy)
    assert np.abs(project(BENT, POSE, points) - xy).max() < 1e-8


def test_look_at_looks_there_level_and_upright():
    lens = Lens.from_horizontal_field_of_view(101, 51, 90.0)
    pose = Pose.look_at((0, 0, 1), (2, 0, 1))
    assert np.allclose(pose.position_m, (0, 0, 1))
    centre, right, above = project(lens, pose, [[2, 0, 1], [2, -0.5, 1], [2, 0, 1.5]])
    assert np.allclose(centre, (50, 25))
    assert right[0] > 50
    assert above[1] < 25


def test_the_field_of_view_spans_pixel_edge_to_pixel_edge():
    lens = Lens.from_horizontal_field_of_view(640, 480, 100.0)
    pose = Pose.look_at((0, 0, 0), (1, 0, 0))
    left, right = rays_at(lens, pose, [[-0.5, 239.5], [639.5, 239.5]])
    assert np.degrees(np.arccos(left @ right)) == pytest.approx(100.0)


def test_points_behind_the_device_have_no_image():
    pose = Pose.look_at((0, 0, 0), (1, 0, 0))
    assert np.isnan(project(BENT, pose, [[-1.0, 0.0, 0.0]])).all()


FOLDING = [(-0.041, -0.033, 0.0, 0.0, 0.0), (-0.4, 0.0, 0.001, -0.002, 0.0), (-0.05, 0.4, -0.007, -0.002, -1.0)]


@pytest.mark.parametrize("distortion", FOLDING)
def test_what_a_lens_images_is_what_its_pixels_see_and_nothing_from_beyond_its_edge(
    distortion: tuple[float, float, float, float, float],
) -> None:
    """The polynomial of a distortion turns back at some angle, and would have what lies further out in the picture."""
    lens = Lens(
        width_px=640,
        height_px=480,
        focal_px=(1000.0, 990.0),
        principal_point_px=(310.0, 420.0),
        distortion=distortion,
    )
    ahead = np.random.default_rng(7).normal(size=(200_000, 3))
    ahead[:, 2] = np.abs(ahead[:, 2])
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    xy = project(lens, Pose(np.eye(3), np.zeros(3)), ahead)
    inside = ((xy > -0.5) & (xy < (639.5, 479.5))).all(axis=1)
    assert inside.sum() > 5000
    assert np.abs(rays_at(lens, Pose(np.eye(3), np.zeros(3)), xy[inside]) - ahead[inside]).max() < 1e-6
    share = solid_angles(lens, lens.pixel_grid()).sum() / (2 * np.pi)
    assert inside.mean() == pytest.approx(share, abs=4 * np.sqrt(share / len(ahead)))


@pytest.mark.parametrize("k3", [0.0, 1e-300, 1e-17, -1e-17])
def test_a_term_that_is_nearly_nothing_does_not_move_the_fold(k3: float) -> None:
    assert fold_squared((-0.4, 0.0, 0.0, 0.0, k3)) == pytest.approx(1 / 1.2, rel=1e-12)
    assert fold_squared((0.4, 0.0, 0.0, 0.0, abs(k3))) == np.inf


@pytest.mark.parametrize("lens", [BENT, Lens.from_horizontal_field_of_view(64, 48, 120.0)])
def test_the_pixels_solid_angles_add_up_to_the_images(lens):
    grid = lens.pixel_grid()
    fine = np.mean(
        [solid_angles(lens, grid + np.array([dx, dy])).sum() for dx in (-0.25, 0.25) for dy in (-0.25, 0.25)]
    )
    w, h = lens.width_px, lens.height_px
    rim = np.concatenate(
        [
            np.stack([np.arange(w) - 0.5, np.full(w, -0.5)], 1),
            np.stack([np.full(h, w - 0.5), np.arange(h) - 0.5], 1),
            np.stack([w - 0.5 - np.arange(w), np.full(w, h - 0.5)], 1),
            np.stack([np.full(h, -0.5), h - 0.5 - np.arange(h)], 1),
        ]
    )
    rays = rays_at(lens, Pose(np.eye(3), np.zeros(3)), rim)
    axis = np.array([0.0, 0.0, 1.0])
    following = np.roll(rays, -1, axis=0)
    # Van Oosterom and Strackee: solid angle of the triangle (axis, a, b).
    triple = np.abs(np.einsum("nk,nk->n", np.cross(rays, following), np.broadcast_to(axis, rays.shape)))
    below = 1 + rays @ axis + following @ axis + (rays * following).sum(1)
    assert fine == pytest.approx(2 * np.arctan2(triple, below).sum(), rel=1e-3)


def test_pixel_rays_are_unit_and_shaped_like_the_image():
    rays = pixel_rays(BENT, POSE)
    assert rays.shape == (240, 320, 3)
    assert np.allclose(np.linalg.norm(rays, axis=-1), 1)


def test_impossible_optics_are_refused():
    with pytest.raises(SimulationError, match="between 0 and 180"):
        Lens.from_horizontal_field_of_view(64, 48, 180.0)
    with pytest.raises(SimulationError, match="above 0"):
        Lens(width_px=64, height_px=48, focal_px=(0.0, 1.0), principal_point_px=(0.0, 0.0))
    for terms in ((0.1, float("nan"), 0.0, 0.0, 0.0), (0.1, 0.0)):
        with pytest.raises(SimulationError, match="distortion k1, k2, p1, p2, k3"):
            Lens(width_px=64, height_px=48, focal_px=(9.0, 9.0), principal_point_px=(0.0, 0.0), distortion=terms)
    with pytest.raises(SimulationError, match="straight along"):
        Pose.look_at((0, 0, 0), (0, 0, 1))
    with pytest.raises(SimulationError, match="not one"):
        Pose(np.ones((3, 3)), np.zeros(3))
    folding = Lens(
        width_px=320,
        height_px=240,
        focal_px=(100.0, 100.0),
        principal_point_px=(160.0, 120.0),
        distortion=(-0.9, 0.0, 0.0, 0.0, 0.0),
    )
    with pytest.raises(SimulationError, match="cannot be undone"):
        pixel_rays(folding, POSE)
