"""Lenses from corners of boards: found from every start, true to their sigmas, refused when they cannot be known."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.lenses.bundle import BEND, SHARED, linearise, moved, residuals
from calibration.lenses.calibrate import LensFit, LensRequest, calibrate_lenses
from calibration.lenses.choice import choose_model
from calibration.lenses.fit import Settled, free_shared, settle
from calibration.lenses.halves import compare_halves, halves_of
from calibration.lenses.lens import ideal_coordinates, pixel_area, project_points
from calibration.lenses.next_pose import suggest_pose
from calibration.lenses.prior import no_prior
from calibration.lenses.records import BoardSightings, RigState
from calibration.lenses.start import camera_guesses, guess_poses
from calibration.lenses.uncertainty import FAR_M, Anchor, pixel_grid, projection_covariance, worst_sigma
from tests.calibration.lenses.board_world import (
    BOARD,
    CAMERA,
    CAMERA_SIZE,
    PAIR,
    PROJECTOR,
    PROJECTOR_SIZE,
    rotation,
    sightings,
    truth,
)

ALONE = replace(PAIR, projector_size_px=None, projector_model=None)
WIDE_SIZE, WIDE_FOCAL = (1504, 1004), 500.0


@pytest.fixture(scope="module")
def five_poses() -> LensFit:
    return calibrate_lenses(sightings(truth(5)), PAIR)


def test_the_derivatives_are_those_of_the_residuals() -> None:
    lenses = {"camera": CAMERA + 0.01, "projector": PROJECTOR + 0.02}
    state = replace(truth(2), **lenses, flex_m=np.array([0.004, -0.002, 0.001]), stretch=0.01)
    seen = sightings(truth(2))
    lines, step = linearise(seen, state), 1e-6
    for k in range(SHARED):
        shared = np.zeros(SHARED)
        shared[k] = step
        ahead, behind = (residuals(seen, moved(state, sign * shared, np.zeros((2, 6)))) for sign in (1, -1))
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(lines.by_shared[..., k], slope, atol=1e-6 * max(1, np.abs(slope).max()))
    for k in range(6):
        poses = np.zeros((2, 6))
        poses[:, k] = step
        ahead, behind = (residuals(seen, moved(state, np.zeros(SHARED), sign * poses)) for sign in (1, -1))
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(lines.by_pose[..., k], slope, atol=1e-6 * max(1, np.abs(slope).max()))


def test_a_lens_shifted_projector_is_found_from_every_start(five_poses: LensFit) -> None:
    calibration = five_poses.calibration
    assert calibration.projector is not None
    assert calibration.projector.principal_point_px[1] > PROJECTOR_SIZE[1] + 20
    assert five_poses.starts > 10
    assert five_poses.starts_agree_px < 1e-3
    assert calibration.noise_px == pytest.approx((0.1, 0.1), rel=0.15)


def test_lenses_are_within_their_sigmas(five_poses: LensFit) -> None:
    calibration = five_poses.calibration
    off = np.concatenate([calibration.state.camera - CAMERA, calibration.state.projector - PROJECTOR])
    sigma = calibration.sigmas()[: len(off)]
    z = off[sigma > 0] / sigma[sigma > 0]
    assert np.abs(z).max() < 4
    assert np.sqrt((z**2).mean()) < 2


def test_the_uncertainty_of_projection_is_that_of_its_errors() -> None:
    shares = []
    for seed in range(3):
        state = truth(8, seed=10 + seed)
        fit = calibrate_lenses(sightings(state, seed=seed).camera_only(), ALONE)
        anchor = Anchor.of(fit.settled.sightings, fit.settled.state)
        grid, _ = pixel_grid(*CAMERA_SIZE, columns=6)
        turn, shift = anchor.aligned(state)
        plane, _ = ideal_coordinates(fit.calibration.camera.vector, grid)
        far = FAR_M * np.column_stack([plane, np.ones(len(plane))])
        apart = project_points(CAMERA, far @ turn.T + shift) - grid
        covariance = projection_covariance(anchor, fit.calibration.covariance, grid, FAR_M, in_projector=False)
        shares.append((apart**2).sum(axis=1) / np.trace(covariance, axis1=1, axis2=2))
        assert np.isfinite(worst_sigma(covariance)).all()
    assert 0.3 < np.sqrt(np.mean(shares)) < 1.7


def test_halves_differ_by_what_their_uncertainties_say() -> None:
    fit = calibrate_lenses(sightings(truth(14, seed=3)), PAIR)
    halves = halves_of(fit.settled)
    assert halves is not None
    for in_projector, size in ((False, CAMERA_SIZE), (True, PROJECTOR_SIZE)):
        found = compare_halves(halves, pixel_grid(*size, columns=8)[0], in_projector=in_projector)
        assert 0.2 < found.ratio < 2.0


def test_halves_of_which_one_has_no_lit_board_say_nothing_of_the_projector() -> None:
    seen = sightings(truth(8, seed=3))
    settled = calibrate_lenses(seen, PAIR).settled
    dark = np.random.default_rng(0).permutation(8)[:4]  # the first half
    lit = settled.sightings.projector_weight * ~np.isin(seen.view, dark)
    halves = halves_of(replace(settled, sightings=replace(settled.sightings, projector_weight=lit)))
    assert halves is not None
    told = [
        compare_halves(halves, pixel_grid(*size, columns=8)[0], in_projector=in_projector).tells(size[0])
        for in_projector, size in ((False, CAMERA_SIZE), (True, PROJECTOR_SIZE))
    ]
    assert told == [True, False]


def test_a_bump_of_a_view_is_left_out_and_does_no_harm() -> None:
    state, seen = truth(8, seed=4), sightings(truth(8, seed=4)).camera_only()
    zoomed = seen.view == 3
    xy = seen.camera_xy_px.copy()
    xy[zoomed] = (xy[zoomed] - 300) * [1.05, 0.98] + 300
    fit = calibrate_lenses(replace(seen, camera_xy_px=xy), ALONE)
    assert not fit.calibration.used[zoomed].any()
    assert fit.calibration.used[~zoomed, 0].mean() > 0.99
    assert abs(fit.calibration.state.camera[0] - state.camera[0]) < 4 * fit.calibration.sigmas()[0]


def test_one_misread_corner_costs_no_view() -> None:
    """At the rim of a projector's light an edge is taken for a corner's."""
    seen = sightings(truth(6))
    misread = np.flatnonzero(seen.view == 2)[7]
    xy = seen.camera_xy_px.copy()
    xy[misread] += [6.0, -3.0]
    used = calibrate_lenses(replace(seen, camera_xy_px=xy), PAIR).calibration.used
    assert not used[misread, 0]
    assert used[seen.view == 2].mean() > 0.95


def test_boards_of_one_tilt_are_refused_with_that_cause() -> None:
    state = truth(6, seed=5)
    turn = np.broadcast_to(rotation(0.01, 0.02, 0.0), (6, 3, 3)).copy()
    seen = sightings(replace(state, rotations=turn)).camera_only()
    with pytest.raises(CalibrationError, match=r"focal length is not determined.*one tilt"):
        calibrate_lenses(seen, ALONE)


def test_a_projector_that_was_moved_between_the_poses_is_named() -> None:
    state, turn = truth(4), rotation(0, 0.03, 0)
    moved_state = replace(
        state,
        projector_rotation=turn @ state.projector_rotation,
        projector_translation_m=turn @ state.projector_translation_m,
    )
    before, after = sightings(state), sightings(moved_state)
    lit = np.where(before.view[:, None] < 2, before.projector_xy_px, after.projector_xy_px)
    with pytest.raises(CalibrationError, match=r"the views contradict each other.*were moved against each other"):
        calibrate_lenses(replace(before, projector_xy_px=lit), PAIR)


def test_two_views_are_refused() -> None:
    with pytest.raises(CalibrationError, match=r"2 views .* at least 3"):
        calibrate_lenses(sightings(truth(2)).camera_only(), ALONE)


def test_a_mirrored_projector_is_named() -> None:
    seen = sightings(truth(5))
    flipped = seen.projector_xy_px * [-1, 1] + [PROJECTOR_SIZE[0] - 1, 0]
    mirrored = replace(seen, projector_xy_px=flipped, projector_by_camera=np.zeros_like(seen.projector_by_camera))
    with pytest.raises(CalibrationError, match="mirrored"):
        calibrate_lenses(mirrored, PAIR)


def test_a_wide_lens_and_a_bent_board_are_found_from_a_guess() -> None:
    seen, bend = wide_set(18)
    request = LensRequest(camera_size_px=WIDE_SIZE, camera_model="rational", flex=True)
    fit = calibrate_lenses(seen, request)
    flex = fit.calibration.state.flex_m
    sigma = fit.calibration.sigmas()[BEND]
    assert (np.abs(flex - [*bend, 0.0]) < 4 * sigma + 5e-5).all()
    rms = np.sqrt((fit.calibration.residual_px[fit.calibration.used[:, 0], :2] ** 2).sum(axis=1).mean())
    assert rms < 1.06 * 0.2 * np.sqrt(2)


def test_left_out_views_choose_the_rational_model_for_a_wide_lens() -> None:
    seen, _ = wide_set(10)

    def attempt(model: str, some: BoardSightings, start: RigState | None) -> Settled:
        first = camera_guesses(some, WIDE_SIZE, wide=model == "rational")[0].state if start is None else start
        if model == "rational":
            first = camera_guesses(some, WIDE_SIZE, wide=True)[0].state
        return settle(some, first, free_shared(model, None, flex=True), prior=no_prior(), least_gain=1e-4)

    model, _, scores = choose_model(seen, attempt, ("k1", "k1k2p1p2", "rational"))
    assert model == "rational"
    assert scores[0].left_out_px > scores[1].left_out_px > scores[2].left_out_px


def test_a_suggested_pose_promises_less_uncertainty(five_poses: LensFit) -> None:
    calibration = five_poses.calibration
    pose = suggest_pose(five_poses.settled, calibration.camera, calibration.projector)
    assert pose is not None
    assert pose.sigma_after_px < pose.sigma_before_px
    assert "of the camera's picture" in pose.words


def test_pixels_of_a_strongly_distorted_lens_come_back_to_their_points() -> None:
    lens = camera_guesses(wide_set(4)[0], WIDE_SIZE, wide=True)[0].lens
    plane = np.random.default_rng(0).uniform(-2, 2, (200, 2))
    xy = project_points(lens, np.column_stack([plane, np.ones(len(plane))]))
    back, there = ideal_coordinates(lens, xy)
    assert there.all()
    np.testing.assert_allclose(back, plane, atol=1e-6)
    assert (pixel_area(lens, plane) > 0).all()


def wide_set(count: int) -> tuple[BoardSightings, np.ndarray]:
    """A lens whose picture grows nearly with the angle, which no fitted model is; a bent board of 8 × 8 corners."""
    rng = np.random.default_rng(1)
    side = np.arange(8) * 0.06
    board = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    bend, half = np.array([1.2e-3, 0.5e-3]), board.max(axis=0) / 2
    bent = np.column_stack([board, (1 - ((board - half) / half) ** 2) @ bend])
    seen: list[np.ndarray] = []
    while len(seen) < count:
        turn = rotation(*rng.uniform(-0.7, 0.7, 2), rng.uniform(-0.2, 0.2))
        points = (bent - [*half, 0]) @ turn.T + [*rng.uniform(-0.7, 0.7, 2), rng.uniform(0.5, 1.0)]
        radius = np.hypot(points[:, 0], points[:, 1])
        angle = np.arctan2(radius, points[:, 2])
        grown = WIDE_FOCAL * (angle + 0.02 * angle**3) / np.maximum(radius, 1e-12)
        xy = points[:, :2] * grown[:, None] + [752.0, 500.0]
        if angle.max() < 1.2 and ((xy > 0) & (xy < np.array(WIDE_SIZE) - 1)).all():
            seen.append(xy + 0.2 * rng.normal(size=xy.shape))
    view = np.repeat(np.arange(count), len(board))
    return BoardSightings.of_camera(view, np.tile(board, (count, 1)), np.concatenate(seen)), bend


def test_poses_follow_from_the_true_lens() -> None:
    state, seen = truth(3), sightings(truth(3), camera_px=0.0)
    guess = guess_poses(seen, CAMERA)
    assert guess.miss_px < 0.5
    np.testing.assert_allclose(guess.state.translations_m, state.translations_m, atol=5e-3)
    assert len(BOARD.points_m) == 54


def test_views_that_the_projector_does_not_light_say_nothing_of_its_lens() -> None:
    """Each of five is left out in turn; of a wide camera's boards many stand beside the projector's picture."""
    state = truth(6)
    seen = sightings(state, seed=3)
    dark = replace(seen, projector_weight=np.where(seen.view < 2, 0.0, seen.projector_weight))
    fit = calibrate_lenses(dark, replace(PAIR, camera_model=None, projector_model=None))
    off = (fit.calibration.state.projector - state.projector)[:4]
    assert (np.abs(off) < 4 * fit.calibration.sigmas()[12:16]).all()


def test_rows_that_are_not_in_the_order_of_their_views_are_refused() -> None:
    """Each view's would be sought in one piece: lenses came out 116 sigma off."""
    seen = sightings(truth(3))
    with pytest.raises(CalibrationError, match="order of their views"):
        replace(seen, view=seen.view[::-1])
