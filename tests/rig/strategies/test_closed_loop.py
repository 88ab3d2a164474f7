"""The closed loop: what it gains on the smallest rig, when it stops, what noise may do, and that it goes on."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.capture.rig import Rig
from rig.errors import UsageError
from rig.run.plan import plan_session
from rig.run.request import SessionRequest
from rig.run.session import opened_session
from rig.session import Session
from rig.stages.target import load_target
from rig.strategies import closed_loop
from rig.strategies.closed_loop import (
    CapturedLight,
    ControlledScene,
    Loop,
    close_loop,
    controlled_scene_of,
    corrected,
    trusted,
)
from rig.terminal import silent

SHAPE = (192, 256)


@pytest.fixture
def session_folder(finished: Any, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished.folder, tmp_path / "session"))


def close(folder: Path, loop: Loop) -> dict[str, Any]:
    with opened_session(plan_session(SessionRequest(folder=folder))) as work:
        return close_loop(work, load_target(None, SHAPE), loop, silent)


@pytest.mark.parametrize("rule", ["image", "model"])
def test_each_rule_lowers_the_measured_error_of_a_computed_picture(session_folder: Path, rule: str) -> None:
    found = close(session_folder, Loop("exact", 3, rule))
    errors = [capture.mean for capture in found.captures]
    assert errors[found.best - 1] == min(errors)
    # The loop over the model has little to find: its first picture (8.74 grey levels) is nearer than ever to its best.
    assert min(errors) < (0.75 if rule == "image" else 0.995) * errors[0]
    assert errors[0] < 8.78


def test_the_loop_finds_by_measuring_what_direct_light_alone_leaves_out(session_folder: Path) -> None:
    """`direct` knows of no interreflection: its first picture is far too bright, and the camera sees it."""
    found = close(session_folder, Loop("direct", 5, "image"))
    errors = [capture.mean for capture in found.captures]
    assert errors[0] > 60
    assert min(errors) < 0.2 * errors[0]


def test_the_best_picture_is_kept_and_the_loop_stops_when_the_error_no_longer_falls(session_folder: Path) -> None:
    found = close(session_folder, Loop("bounded", 12, "image"))
    errors = [capture.mean for capture in found.captures]
    assert len(errors) < 12
    assert found.stopped == f"capture {len(errors)} was no better than capture {found.best}"
    assert found.best == int(np.argmin(errors)) + 1 == len(errors) - 1
    with Session.open(session_folder) as session:
        step = session.finished("loop-bounded-image")
        codes, last = (step.load_image("loop-bounded-image-best")["codes"], f"loop-bounded-image-{len(errors)}.e0.r0")
        assert last in step.frame_names
        assert codes.shape == SHAPE


def test_one_capture_measures_and_corrects_nothing(session_folder: Path) -> None:
    found = close(session_folder, Loop("bounded", 1))
    assert found.best == len(found.captures) == 1
    assert found.stopped == "all 1 captures were used"


def test_a_loop_that_was_interrupted_goes_on_and_ends_as_if_it_had_not_been(
    session_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    undisturbed = Path(shutil.copytree(session_folder, tmp_path / "undisturbed"))
    whole = close(undisturbed, Loop("bounded", 3))
    shot = 0

    def shoot_or_die(self: Rig, *arguments: Any, **named: Any) -> Any:
        nonlocal shot
        shot += 1
        if shot == 4:
            raise KeyboardInterrupt
        return shoot(self, *arguments, **named)

    shoot: Callable[..., Any] = Rig.shoot
    monkeypatch.setattr(Rig, "shoot", shoot_or_die)
    with pytest.raises(KeyboardInterrupt):
        close(session_folder, Loop("bounded", 3))
    assert close(session_folder, Loop("bounded", 3)) == whole
    frames = sorted((undisturbed / "frames" / "loop-bounded-image").glob("*.exr"))
    assert frames
    for path in frames:
        assert (session_folder / path.relative_to(undisturbed)).read_bytes() == path.read_bytes()


def test_a_loop_that_is_done_needs_no_device(session_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = close(session_folder, Loop("bounded", 2))
    monkeypatch.setattr(closed_loop, "_closed", lambda *_: pytest.fail("it was done again"))
    assert close(session_folder, Loop("bounded", 2)) == first


@pytest.mark.parametrize(
    ("loop", "message"),
    [
        (Loop("magic"), "unknown strategy magic"),
        (Loop("bounded", 0), "0 captures; a closed loop takes 1"),
        (Loop("bounded", 65), "65 captures"),
        (Loop("bounded", 2, "guess"), "unknown rule 'guess'"),
    ],
)
def test_what_cannot_be_is_refused(loop: Loop, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        loop.checked()


# The correction itself, on numbers


@pytest.fixture
def room(session_folder: Path) -> ControlledScene:
    target = load_target(None, SHAPE)
    with Session.open(session_folder) as session:
        return controlled_scene_of(session, session.finished("compensate"), target)


def test_where_nothing_was_measured_the_picture_stays(room: ControlledScene) -> None:
    image = np.full_like(room.wanted, 0.4)
    unknown = np.full_like(room.wanted, np.nan)
    after = corrected(room, Loop("bounded", 2, "image"), image, CapturedLight(image, unknown, unknown))
    assert np.array_equal(after, image)


def test_a_model_that_predicts_what_is_seen_changes_nothing(room: ControlledScene) -> None:
    image = room.solved("bounded", room.wanted).projector_image
    light = room.model.room.through_camera(room.transport.forward(image))
    seen = CapturedLight(image, light, np.full_like(light, 1e-12))
    assert corrected(room, Loop("bounded", 2, "model"), image, seen) == pytest.approx(image, abs=1e-6)


def test_a_pixel_that_is_too_dark_gets_more_light_and_no_more_than_there_is(room: ControlledScene) -> None:
    image = np.full_like(room.wanted, 0.99)
    wanted = room.model.room.through_camera(room.wanted)
    seen = CapturedLight(image, wanted - 0.02 * room.operator.diagonal, np.full_like(image, 1e-12))
    after = corrected(room, Loop("none", 2, "image"), image, seen)
    assert after == pytest.approx(np.full_like(image, min(0.99 + 0.02 * room.damping, 1.0)))
    assert 0.5 < room.damping < 1.0


def test_a_residual_that_is_all_noise_is_not_believed_and_one_far_above_it_is(room: ControlledScene) -> None:
    rng = np.random.default_rng(4)
    noise = rng.normal(0, 0.01, room.wanted.shape)
    variance = np.full_like(noise, 0.01**2)
    believed = trusted(room, noise, variance)
    assert np.sqrt(np.mean(believed**2)) < 0.35 * np.sqrt(np.mean(noise**2))
    assert trusted(room, noise + 0.2, variance) == pytest.approx(noise + 0.2, rel=0.02, abs=0.005)


def test_noise_is_told_to_the_strategies_that_regularise_by_it(room: ControlledScene) -> None:
    quiet = room.solved("tikhonov", room.wanted)
    loud = replace(room, model=replace(room.model, white_variance=room.model.white_variance * 1e4))
    assert float(loud.solved("tikhonov", room.wanted).notes["noise_rms"]) == pytest.approx(
        100 * float(quiet.notes["noise_rms"])
    )
