"""The frame kernel's model, built from a session: it has to agree with what the session's own steps computed."""

import cv2
import numpy as np
import pytest

from rig.live.model import guessed_model, session_model, target_curve
from rig.profile.schema import load_profile
from rig.session import Session
from sim.frame.compensator import FrameCompensator
from tests.rig.conftest import Finished


def test_a_frame_gets_the_codes_that_the_sessions_exact_compensation_has(finished: Finished) -> None:
    with Session.read(finished.folder) as session:
        model = session_model(session, is_linear=True)
        step = session.finished("compensate")
        target = np.rint(step.load_image("target")["grey"]).astype(np.uint8)
        wanted = step.load_image("projector-exact")["codes"]
    codes = FrameCompensator(model.frames, "exact").frame(np.repeat(target[..., None], 3, axis=2))
    # The session sharpens edges, which the projector would blur; live pictures stay as they are.
    square = np.ones((7, 7), np.uint8)
    flat = cv2.dilate(target, square) - cv2.erode(target, square) < 8
    difference = np.abs(codes[..., 1].astype(float) - wanted)
    assert flat.mean() > 0.1
    assert np.median(difference) <= 1
    assert difference[flat].mean() < 1.5
    assert (codes[~model.frames.active] == 0).all()


def test_the_black_that_the_camera_sees_is_taken_off_every_wish(finished: Finished) -> None:
    with Session.read(finished.folder) as session:
        model = session_model(session, is_linear=True)
    black = np.zeros((*model.frames.shape, 3), np.uint8)
    faint = np.full_like(black, 1)
    exact, bounded = (FrameCompensator(model.frames, strategy) for strategy in ("exact", "bounded"))
    assert (model.frames.black_emission > 0).any()
    assert bounded.frame(black).max() == 0
    assert (exact.frame(black) > 0).mean() < 0.01, "here and there it counts on light that others cannot take away"
    assert np.median(exact.frame(faint)) <= 1


def test_codes_of_films_are_those_of_srgb() -> None:
    curve = target_curve(is_linear=False)
    assert curve[[0, 255]] == pytest.approx([0, 1])
    assert curve[188] == pytest.approx(0.5, abs=0.005)
    assert np.array_equal(target_curve(is_linear=True), np.arange(256) / 255)


def test_a_guessed_room_needs_no_light_at_its_brightest_beyond_what_the_projector_has() -> None:
    profile = load_profile("ci-tiny")
    model = guessed_model(profile, is_linear=True)
    assert model.frames.shape == profile.projector.shape
    assert model.frames.active.mean() > 0.9
    grey = np.full((*profile.projector.shape, 3), 60, np.uint8)
    codes = FrameCompensator(model.frames, "exact").frame(grey)
    assert 0 < np.median(codes) < 255
    smooth = cv2.GaussianBlur(codes[..., 0], (0, 0), 3).astype(float)
    assert np.abs(codes[..., 0] - smooth)[model.frames.active].mean() < 8
