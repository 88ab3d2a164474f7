"""One flat wall: lenses that rest on data sheets, and sigmas that hold what they leave open."""

import numpy as np
import pytest

from calibration.geometry.epipolar import NominalIntrinsics
from calibration.geometry.pinhole import PinholeModel, project, rotation_of, vector_of, world_rays
from calibration.geometry.stereo import calibrate_stereo

NOMINAL = NominalIntrinsics.of(
    camera_shape=(960, 1280), projector_shape=(768, 1024), camera_hfov_deg=70.0, projector_hfov_deg=50.0
)
SEEDS = range(20)


def device(random, shape, focal_px, centre_sigma, pose):
    """A lens off its data sheet as the priors have it."""
    height_px, width_px = shape
    f = focal_px * (1 + 0.05 * random.normal())
    centre = np.array([0.5, 0.5]) + np.array(centre_sigma) * random.normal(size=2)
    return PinholeModel(
        width_px=width_px,
        height_px=height_px,
        focal_px=(f, f),
        principal_point_px=(float(centre[0] * width_px), float(centre[1] * height_px)),
        distortion=(0.05 * random.normal(), 0.02 * random.normal(), 0.0, 0.0, 0.0),
        rotation=pose[0],
        translation_m=pose[1],
    )


def scene(seed, baseline=(-0.5, 0.1, 0.1)):
    """Camera, projector and plane: devices side by side, 2 m before a wall that is turned by some degrees."""
    random = np.random.default_rng(seed)
    camera = device(random, NOMINAL.camera_shape, NOMINAL.camera_focal_px, (0.02, 0.02), (np.eye(3), np.zeros(3)))
    rotation = rotation_of([0.05 * random.normal(), 0.1 * random.normal(), 0.03 * random.normal()])
    position = np.array(baseline) * (1 + 0.2 * random.normal(size=3))
    pose = rotation, -rotation @ position
    projector = device(random, NOMINAL.projector_shape, NOMINAL.projector_focal_px, (0.03, 0.1), pose)
    normal = rotation_of([0.15 * random.normal(), 0.15 * random.normal(), 0.0])[:, 2]
    return camera, projector, normal / 2.0


def correspondences(camera, projector, plane, noise_px=0.1):
    xy = np.stack(np.meshgrid(np.arange(0, 1280, 12.0), np.arange(0, 960, 12.0)), -1).reshape(-1, 2)
    rays = world_rays(camera, xy)
    image = project(projector, rays / (rays @ plane)[:, None])
    seen = (image > 0).all(axis=1) & (image < (projector.width_px - 1, projector.height_px - 1)).all(axis=1)
    return xy[seen], image[seen] + noise_px * np.random.default_rng(1).normal(size=(int(seen.sum()), 2))


def figures(pair):
    """Wall in baselines, its normal, the relative turn and the direction of the projector."""
    distance = -np.log(np.linalg.norm(pair.planes[0]) * pair.baseline)
    normal = pair.planes[0] / np.linalg.norm(pair.planes[0])
    direction = pair.projector.position_m / pair.baseline
    return np.concatenate([[distance], normal, vector_of(pair.projector.rotation), direction])


@pytest.mark.parametrize("seed", SEEDS)
def test_the_wall_and_the_pose_lie_within_three_of_their_sigmas(seed):
    camera, projector, plane = scene(seed)
    pair = calibrate_stereo(*correspondences(camera, projector, plane), NOMINAL, one_wall=True)
    baseline = float(np.linalg.norm(projector.position_m))
    normal, direction = plane / np.linalg.norm(plane), projector.position_m / baseline
    turn = vector_of(projector.rotation)
    truth = np.concatenate([[-np.log(np.linalg.norm(plane) * baseline)], normal, turn, direction])
    sigma = pair.sigmas_of(figures)
    print(seed, np.round((figures(pair) - truth) / sigma, 1), np.round(sigma, 3), pair.rms_px)
    assert (np.abs(figures(pair) - truth) < 3 * sigma).all()
