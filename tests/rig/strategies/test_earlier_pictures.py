"""What photographs of one picture's loop tell of the light is known for other pictures, and only while it is true."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from skimage import data

from rig.capture.rig import Rig
from rig.run.plan import plan_session
from rig.run.request import SessionRequest
from rig.run.session import opened_session, run_session
from rig.session import Session
from rig.stages.linear_light import LightImage
from rig.stages.model import load_model, load_prior_model
from rig.stages.results import SessionResult
from rig.stages.target import load_target
from rig.stages.transport import earlier
from rig.stages.transport.evidence import EvidenceRecord, gathered_evidence, told_records
from rig.strategies import closed_loop
from rig.strategies.closed_loop import Loop, close_loop
from rig.terminal import silent

ROOT = Path(__file__).parents[3]
SHAPE = (192, 256)
STRATEGIES = ("none", "bounded")


def close(folder: Path, captures: int = 2) -> dict[str, Any]:
    with opened_session(plan_session(SessionRequest(folder=folder))) as work:
        return close_loop(work, load_target(None, SHAPE), Loop("bounded", captures), silent)


def the_told(folder: Path) -> EvidenceRecord:
    (record,) = told_records(Session.read(folder)).values()
    return record


def another_picture(folder: Path) -> Path:
    """A photograph that no loop was closed on."""
    path = folder / "camera.png"
    cv2.imwrite(str(path), cv2.resize(data.camera(), SHAPE[::-1], interpolation=cv2.INTER_AREA))
    return path


# A matte room, whose model is right: there is nothing to be learned


@pytest.fixture
def matte(finished: Any, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished.folder, tmp_path / "session"))


def test_photographs_that_are_explained_within_noise_do_not_count_and_say_so(matte: Path) -> None:
    close(matte)
    (picture,) = the_told(matte).pictures
    assert picture.brings < picture.noise
    assert "less than the noise of" in picture.refused
    said: list[str] = []
    with Session.open(matte) as session:
        before = load_model(session)
        earlier.gather_evidence(session, load_target(None, SHAPE), lambda words, *_: said.append(words))
        assert load_model(session) is before
        assert not session.is_finished("evidence")
    assert "2 photographs of photograph 'astronaut'" in said[0]
    assert "do not count" in said[0]


def dimmer(light: LightImage) -> LightImage:
    return LightImage(np.float32(0.97) * light.value, light.variance, light.saturated)


def moved_by_a_pixel(light: LightImage) -> LightImage:
    return LightImage(*(np.roll(part, 1, axis=1) for part in (light.value, light.variance, light.saturated)))


def unsure_and_moved(light: LightImage) -> LightImage:
    moved = moved_by_a_pixel(light)
    return LightImage(moved.value, moved.variance * 1e4, moved.saturated)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (dimmer, "of the first is within three standard deviations"),
        (moved_by_a_pixel, "of the first is within three standard deviations"),
        (unsure_and_moved, "details of the first correlate with the prediction's"),
    ],
)
def test_photographs_of_a_room_that_is_not_as_it_was_measured_do_not_count(
    matte: Path, monkeypatch: pytest.MonkeyPatch, change: Callable[[LightImage], LightImage], why: str
) -> None:
    """The step that judges photographs sees a dimmer lamp, or a camera that moved, also where nothing is sure."""
    merged: Callable[..., LightImage] = earlier.merge_exposures
    monkeypatch.setattr(earlier, "merge_exposures", lambda *arguments: change(merged(*arguments)))
    close(matte, captures=1)
    (picture,) = the_told(matte).pictures
    assert why in picture.refused
    assert not the_told(matte).counts


def test_a_loop_that_was_interrupted_before_its_photographs_were_read_photographs_nothing_again(
    matte: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def die(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(closed_loop, "keep_evidence", die)
        with pytest.raises(KeyboardInterrupt):
            close(matte)
    assert not told_records(Session.read(matte))
    monkeypatch.setattr(Rig, "shoot", lambda *_, **__: pytest.fail("it was photographed again"))
    close(matte)
    assert the_told(matte).photographs == 2


def test_the_picture_of_the_loop_stays_done(matte: Path) -> None:
    close(matte)
    assert all(step.done for step in plan_session(SessionRequest(folder=matte)).steps)


# A glossy room, which the matte model gets wrong


class Glossy:
    """A session of a glossy room, another picture shown without and with what a loop's photographs taught it."""

    def __init__(self, folder: Path) -> None:
        text = (ROOT / "hw_profiles" / "ci-tiny.toml").read_text("utf-8")
        posters, camera = (text.index(f"[[simulation.{name}]]") for name in ("posters", "camera"))
        self.text = (text[:posters] + text[camera:]).replace("seed = 20141\n", 'seed = 20141\nscene = "glossy"\n')
        self.folder, self.other = folder / "with", another_picture(folder)
        (folder / "glossy.toml").write_text(self.text, "utf-8")
        run_session(SessionRequest(folder=self.folder, profile=folder / "glossy.toml", strategies=STRATEGIES))
        without = Path(shutil.copytree(self.folder, folder / "without"))
        close(self.folder, captures=3)
        self.without, self.with_it = (self.shown(path) for path in (without, self.folder))
        self.after = Path(shutil.copytree(self.folder, folder / "after"))
        """To be written to."""

    def shown(self, folder: Path) -> SessionResult:
        return run_session(SessionRequest(folder=folder, target=self.other, strategies=STRATEGIES))


@pytest.fixture(scope="module")
def glossy(tmp_path_factory: pytest.TempPathFactory) -> Glossy:
    pytest.importorskip("embreex", reason="the glossy world is traced by Embree: pip install 'procam-rig[world]'")
    return Glossy(tmp_path_factory.mktemp("glossy"))


@pytest.mark.slow
def test_another_picture_is_predicted_better_and_within_its_sigma(glossy: Glossy) -> None:
    before, after = glossy.without.comparison, glossy.with_it.comparison
    for name in STRATEGIES:
        assert after.frames[name].rmse < 0.95 * before.frames[name].rmse
    assert after.rmse < 0.9 * before.rmse
    assert after.within_3_sigma >= 0.93


@pytest.mark.slow
def test_another_picture_comes_out_no_worse(glossy: Glossy) -> None:
    before, after = (each.strategies["bounded"].measured for each in (glossy.without, glossy.with_it))
    assert after.mean <= before.mean + 0.05
    assert after.rms <= before.rms + 0.05


@pytest.mark.slow
def test_results_and_report_say_what_was_learned(glossy: Glossy) -> None:
    found = glossy.with_it.model.evidence
    assert found is not None
    assert found.photographs == 3
    assert 0 < found.rms_left < found.rms_before
    page = (glossy.folder / "report.html").read_text("utf-8")
    assert "learned from 3 photographs of 1 earlier picture: predicted error" in page
    assert glossy.without.model.evidence is None


@pytest.mark.slow
def test_photographs_of_another_model_are_not_used_and_that_is_said(glossy: Glossy) -> None:
    changed = glossy.folder.parent / "changed.toml"
    changed.write_text(glossy.text.replace("target_white_share = 0.7", "target_white_share = 0.6"), "utf-8")
    said: list[str] = []
    request = SessionRequest(folder=glossy.after, profile=changed, target=glossy.other, strategies=STRATEGIES)
    result = run_session(request, lambda words, *_: said.append(words))
    assert any(words.startswith("3 photographs of earlier pictures do not count") for words in said)
    assert result.model.evidence is None
    session = Session.read(glossy.after)
    assert gathered_evidence(session) is None
    assert load_model(session) is load_prior_model(session)
