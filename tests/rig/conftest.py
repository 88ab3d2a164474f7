"""A whole session of the smallest rig, made once."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest


@dataclass(frozen=True)
class Finished:
    """An undisturbed `rig run`; tests only read it, or copy it."""

    folder: Path
    out: str
    err: str


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    folder = tmp_path_factory.mktemp("undisturbed") / "session"
    command = [sys.executable, "-m", "rig", "run", str(folder), "-p", "ci-tiny", "--json"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode in (0, 1), run.stderr
    return Finished(folder, run.stdout, run.stderr)
