"""How many frames a plan tells: those that a session takes, once it knows how noisy its photographs are."""

from collections import Counter

import pytest

from rig.run.plan import plan_session
from rig.run.request import SessionRequest
from tests.rig.conftest import Finished


def planned(finished: Finished) -> dict[str, int]:
    plan = plan_session(SessionRequest(folder=finished.folder))
    return {step.step: step.frames for step in plan.steps}


def test_a_plan_tells_the_frames_that_the_session_took(finished: Finished) -> None:
    session = plan_session(SessionRequest(folder=finished.folder)).session
    assert session is not None
    taken = Counter(event["step"] for event in session.frame_log() if event["event"] == "frame")
    told = planned(finished)
    for step in ("separation", "project"):
        assert told[step] == taken[step]


def test_photographs_that_noise_asks_for_are_in_the_plan(finished: Finished, monkeypatch: pytest.MonkeyPatch) -> None:
    quiet = planned(finished)
    monkeypatch.setattr("rig.stages.light.repeats.quiet_repeats", lambda _: 6)
    noisy = planned(finished)
    assert noisy["project"] == 6 * quiet["project"]
    assert noisy["separation"] > quiet["separation"]
    assert noisy["gray"] == quiet["gray"]
