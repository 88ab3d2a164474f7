"""Recordings that an earlier version made, which photographed less than a session does now."""

import json
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from rig.files.journal import JOURNAL_NAME
from rig.profile.schema import Profile, load_profile
from rig.run.script import open_rig
from rig.session import Session
from rig.stages.comparison import compare_all, comparison_settings, project_and_photograph

if TYPE_CHECKING:
    from tests.rig.conftest import Finished


def without(folder: Path, pattern: str) -> None:
    """Take the frames of a pattern out of a session, as if it had never been shown."""
    journal = folder / JOURNAL_NAME
    lines = journal.read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [line for line in lines if pattern not in str(json.loads(line).get("frame", ""))]
    assert len(kept) < len(lines)
    unsealed = (re.sub(r', "seal": "[0-9a-f]+"}$', "}", line) for line in kept)  # as journals of earlier versions are
    journal.write_text("".join(unsealed), encoding="utf-8")


def replaying(folder: Path, recording: Path) -> Profile:
    text = load_profile("ci-tiny").raw.decode()
    text = text[: text.index("[simulation]")].replace('driver = "simulated"', 'driver = "replay"')
    (folder / "replay.toml").write_text(f'{text}\n[replay]\nsession = "{recording}"\n', encoding="utf-8")
    return load_profile(folder / "replay.toml")


@pytest.fixture
def old(finished: "Finished", tmp_path: Path) -> Path:
    shutil.copytree(finished.folder, tmp_path / "old")
    (tmp_path / "old" / "lock").unlink(missing_ok=True)
    without(tmp_path / "old", "lamp-")
    return tmp_path / "old"


def test_pictures_recorded_without_white_around_them_are_compared_as_they_are(
    finished: "Finished", old: Path, tmp_path: Path
) -> None:
    shutil.copytree(old, tmp_path / "again")
    said: list[str] = []
    with open_rig(replaying(tmp_path, old)) as rig, Session.open(tmp_path / "again") as session:
        project = session.step("project", settings={"replayed": True}, needs=("compensate",))
        project_and_photograph(rig, session, project, lambda label, done, total: said.append(label))
        project.finish()
        compared = session.step("compare", settings=comparison_settings(session), needs=("project",))
        compare_all(session, compared, lambda label, done, total: None)
        errors = json.loads((tmp_path / "again" / "metrics.json").read_text())["comparison"]
        assert compared.load_record("lamp", dict)["shares"] == [1.0, 1.0]
    assert any("no white around its pictures" in line for line in said)
    assert errors["rmse"] > 0
