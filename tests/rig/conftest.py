"""A whole session of the smallest rig, made once."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.made_once import made_once


@dataclass(frozen=True)
class Finished:
    """An undisturbed `rig run`; tests only read it, or copy it."""

    folder: Path
    out: str
    err: str


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    made = made_once(tmp_path_factory, "undisturbed", _run)
    return Finished(made / "session", (made / "out").read_text("utf-8"), (made / "err").read_text("utf-8"))


def _run(folder: Path) -> None:
    command = [sys.executable, "-m", "rig", "run", str(folder / "session"), "-p", "ci-tiny", "--json"]
    run = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)
    assert run.returncode in (0, 1), run.stderr
    (folder / "out").write_text(run.stdout, encoding="utf-8")
    (folder / "err").write_text(run.stderr, encoding="utf-8")
