"""A profile that is changed within a session: only what depends on the change is done again, nothing shot twice."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from rig.cli.app import run_command
from rig.errors import SessionError
from rig.files.journal import JOURNAL_NAME
from rig.profile.schema import Profile, load_profile
from rig.session import Session
from rig.session.ledger import Ledger

if TYPE_CHECKING:
    from tests.rig.conftest import Finished

ROOT = Path(__file__).parents[3]
TINY = (ROOT / "hw_profiles" / "ci-tiny.toml").read_text(encoding="utf-8")
Capture = pytest.CaptureFixture[str]
LIMITS = ("geometry_rms_px = 0.5", "geometry_rms_px = 0.01")
BRIGHTNESS = ("target_white_share = 0.7", "target_white_share = 0.6")
SCALE = ("distance_m = 4.876", "distance_m = 4.901")
ROOM = ("size_m = [4.80, 4.80, 2.40]       #", "size_m = [4.80, 4.80, 2.405]      #")
LEVELS = ("response_levels = 9", "response_levels = 5")
CHECKER = ("checker_shifts = 25", "checker_shifts = 20")


@pytest.fixture
def session(finished: Finished, tmp_path: Path) -> Path:
    return shutil.copytree(finished.folder, tmp_path / "session")


@pytest.fixture
def changed(tmp_path: Path) -> Callable[..., Path]:
    def write(*changes: tuple[str, str]) -> Path:
        text = TINY
        for old, new in changes:
            assert text.count(old) == 1
            text = text.replace(old, new)
        path = tmp_path / "changed.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def to_do(capsys: Capture, session: Path, profile: Path) -> list[str]:
    assert run_command(["run", str(session), "-p", str(profile), "--dry-run", "--json"]) == 0
    plan: dict[str, Any] = json.loads(capsys.readouterr().out)
    return [step["step"] for step in plan["steps"] if not step["done"]]


FROM_MODEL = ["model", "compensate", "project", "compare"]


@pytest.mark.parametrize(
    ("change", "steps"),
    [
        (LIMITS, []),
        (BRIGHTNESS, FROM_MODEL),
        (SCALE, ["geometry", *FROM_MODEL]),
        (ROOM, ["geometry", *FROM_MODEL]),
        (CHECKER, ["separation", *FROM_MODEL]),
        (LEVELS, ["response", "gray", "correspondence", "geometry", "separation", *FROM_MODEL]),
    ],
)
def test_only_the_steps_that_depend_on_a_change_are_to_do(
    change: tuple[str, str], steps: list[str], session: Path, changed: Callable[..., Path], capsys: Capture
) -> None:
    before = (session / JOURNAL_NAME).read_bytes()
    assert to_do(capsys, session, changed(change)) == steps
    assert (session / JOURNAL_NAME).read_bytes() == before


def test_a_changed_limit_changes_the_verdict_and_takes_no_photograph(
    session: Path, changed: Callable[..., Path], capsys: Capture
) -> None:
    frames = sorted((session / "frames").rglob("*.exr"))
    words = ["run", str(session), "-p", str(changed(LIMITS)), "--json"]
    assert run_command(words) == 1
    limits = {row["what"]: row for row in json.loads(capsys.readouterr().out)["limits"]}
    assert limits["geometry: reprojection rms"]["limit"] == 0.01
    assert sorted((session / "frames").rglob("*.exr")) == frames
    # from now on it is the session's own, also without -p
    assert run_command(["run", str(session)]) == 1
    assert (session / "profile.toml").read_bytes() == changed(LIMITS).read_bytes()
    assert run_command(["run", str(session), "-p", "ci-tiny"]) == 0


def test_fewer_patterns_take_no_new_photograph_of_what_was_photographed(
    session: Path, changed: Callable[..., Path]
) -> None:
    before = {step.name: len(list(step.iterdir())) for step in (session / "frames").iterdir()}
    assert run_command(["run", str(session), "-p", str(changed(LEVELS)), "--json"]) in (0, 1)
    after = {step.name: len(list(step.iterdir())) for step in (session / "frames").iterdir()}
    assert {name: after[name] for name in ("exposure", "response", "gray", "separation")} == {
        name: before[name] for name in ("exposure", "response", "gray", "separation")
    }
    with Session.read(session) as read:
        names = read.finished("response").frame_names
    assert sum(name.startswith("level-") for name in names) == 10


@pytest.mark.parametrize(
    ("change", "table"),
    [
        (("focal_px = 132.925", "focal_px = 133.925"), "simulation"),
        (("exposure_s = 0.0166667", "exposure_s = 0.02"), "camera"),
        (("latency_s = 0.06 ", "latency_s = 0.07 "), "projector"),
        (("retries = 8", "retries = 9"), "timing"),
    ],
)
def test_what_was_photographed_with_cannot_change(
    change: tuple[str, str], table: str, session: Path, changed: Callable[..., Path], capsys: Capture
) -> None:
    assert run_command(["run", str(session), "-p", str(changed(change)), "--dry-run"]) == 4
    said = " ".join(capsys.readouterr().err.split())
    assert f"they differ in {table};" in said
    assert "only [[scale]], [surface], [patterns], [transport], [target], [brightness], [limits]" in said


def killed(*_: object) -> None:
    raise KeyboardInterrupt


def open_and_be_killed(session: Path, profile: Profile) -> None:
    with Session.open(session, profile):
        killed()


@pytest.mark.parametrize("after", ["journal", "header", "profile"])
def test_a_change_that_was_cut_short_is_undone_or_ended(
    after: str, session: Path, changed: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed between any two of the files that a change writes, the session opens, and the same command goes on."""
    profile = load_profile(changed(BRIGHTNESS))
    was = Ledger.change_profile

    def change(self: Ledger, given: Profile) -> None:
        patch.setattr(Ledger, "write_summary", killed)
        was(self, given)

    with monkeypatch.context() as patch:
        if after == "journal":
            patch.setattr(Ledger, "change_profile", change)
        elif after == "header":
            patch.setattr("rig.session.ledger.finish_profile_change", killed)
        with pytest.raises(KeyboardInterrupt):
            open_and_be_killed(session, profile)
    with Session.open(session) as again:
        assert again.profile.brightness.target_white_share == (0.7 if after == "journal" else 0.6)
    with Session.open(session, profile) as ended:
        assert ended.profile.brightness.target_white_share == 0.6
    assert (session / "profile.toml").read_bytes() == profile.raw
    assert not (session / "profile.next.toml").exists()


def test_another_profile_is_still_refused(session: Path) -> None:
    with pytest.raises(SessionError, match="give a new folder"):
        Session.open(session, load_profile("sim-room"))
