"""A whole session with photographs of known pictures on top of its model."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from rig.run.request import SessionRequest
from rig.run.session import run_session
from rig.session import Session
from rig.stages.model import load_model, load_prior_model
from rig.stages.results import SessionResult
from rig.stages.transport.records import TransportRecord
from rig.terminal import silent

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
ASKED = 3


@dataclass(frozen=True)
class Learned:
    """A finished session; tests only read it."""

    folder: Path
    result: SessionResult

    @property
    def session(self) -> Session:
        return Session.read(self.folder)


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Learned:
    folder = tmp_path_factory.mktemp("learned")
    text = (ROOT / "hw_profiles" / "ci-tiny.toml").read_text("utf-8")
    (folder / "tiny.toml").write_text(text + f"\n[transport]\nphotographs = {ASKED}\n", "utf-8")
    request = SessionRequest(folder=folder / "session", profile=folder / "tiny.toml", strategies=("none", "bounded"))
    return Learned(folder / "session", run_session(request, silent))


def test_it_says_what_each_photograph_and_another_would_bring(learned: Learned) -> None:
    found = learned.session.finished("transport").load_record("transport", TransportRecord)
    assert len(found.photographs) <= ASKED
    assert len(found.photographs) == ASKED or found.another_brings < found.noise_of_place
    assert all(each.brings >= found.noise_of_place for each in found.photographs)
    assert all(0 < each.brings <= each.rms_before for each in found.photographs)


def test_results_and_report_say_it_too(learned: Learned) -> None:
    metrics = json.loads((learned.folder / "metrics.json").read_text("utf-8"))
    assert metrics["model"]["learned"]["photographs"] <= ASKED
    page = (learned.folder / "report.html").read_text("utf-8")
    assert "of known pictures taught it" in page or "No photograph of a known picture was taken" in page


def test_it_predicts_within_its_sigma(learned: Learned) -> None:
    assert learned.result.within_limits, [row for row in learned.result.limits if not row.met]
    assert learned.result.comparison.within_3_sigma > 0.93


def test_white_keeps_the_light_that_was_measured(learned: Learned) -> None:
    before, after = load_prior_model(learned.session), load_model(learned.session)
    white = np.ones(before.scene_model.projector.lens.n_pixels)
    one, other = (each.room.camera_transport.bands[0] @ white for each in (before, after))
    lit = before.lit.ravel()
    assert np.abs(other[lit] / one[lit] - 1).max() < 0.02


def test_going_on_photographs_nothing_twice(learned: Learned) -> None:
    before = (learned.folder / "journal.jsonl").read_text("utf-8").count('"frame"')
    run_session(SessionRequest(folder=learned.folder, strategies=("none", "bounded")), silent)
    assert (learned.folder / "journal.jsonl").read_text("utf-8").count('"frame"') == before
