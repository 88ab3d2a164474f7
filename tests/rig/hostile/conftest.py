"""The command line on a leash: four gigabytes, no traceback, an end that is an answer or a refusal in words."""

import re
import resource
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from rig.cli.app import run_command
from tests.calibration.lenses.board_world import CAMERA_SIZE, sightings, truth
from tests.rig.lenses.test_lenses import write_lists

ROOT = Path(__file__).parents[3]
MOST_BYTES = 4 << 30
ANSWERS, REFUSALS = (0, 1), (1, 2, 3, 4, 20, 21, 22, 23, 24)

_ONE_OF_MANY = re.compile(
    r"(?<![\w.,])1 (?:event|file|frame|picture|photograph|step|view|corner|face|facet|triangle|point|design|problem)s\b"
)


@pytest.fixture(autouse=True)
def little_memory() -> Iterator[None]:
    """Four gigabytes more than the process has: what asks for more is refused, and counts as a fault."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MOST_BYTES, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@dataclass(frozen=True)
class Said:
    status: int
    out: str
    err: str


@pytest.fixture
def rig(capsys: pytest.CaptureFixture[str]) -> Callable[..., Said]:
    def run(*words: object) -> Said:
        status = run_command([str(word) for word in words])
        captured = capsys.readouterr()
        said = Said(status, captured.out, captured.err)
        assert "Traceback" not in said.err
        assert "not enough memory" not in said.err
        assert not _ONE_OF_MANY.search(said.out + said.err), "one of a kind is told as one"
        assert status in (*ANSWERS, *REFUSALS), said
        if status in REFUSALS and "rig: " in said.err:
            assert len(said.err[said.err.index("rig: ") :]) > len("rig: ") + 10, "a refusal has words"
        return said

    return run


@pytest.fixture(scope="module")
def boards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Lists of corners and their manifest, the lens file that they give, and a profile that names it."""
    folder = tmp_path_factory.mktemp("boards")
    seen = sightings(truth(6, seed=7))
    write_lists(folder, replace(seen, projector_by_camera=np.zeros_like(seen.projector_by_camera)))
    assert run_command(["lenses", str(folder / "lenses.toml"), "-o", str(folder / "out.toml"), "--json"]) in ANSWERS
    text = (ROOT / "hw_profiles" / "ci-tiny.toml").read_text(encoding="utf-8")
    for old, new in (("320", CAMERA_SIZE[0]), ("240", CAMERA_SIZE[1])):
        text = text.replace(f"_px = {old}", f"_px = {new}", 1)
    (folder / "profile.toml").write_text(text.replace("[[camera]]", '[[camera]]\nlens = "out.toml"', 1))
    return folder
