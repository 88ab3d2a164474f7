"""Files that people write for what is not a session: rooms, studies, shows, boards and lenses; and recordings."""

import json
import math
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.rig.conftest import Finished
from tests.rig.hostile.conftest import ANSWERS, REFUSALS, Said
from tests.rig.hostile.mutations import mutated
from tests.rig.sweeps.conftest import STUDY

pytestmark = pytest.mark.timeout(60, func_only=True)
ROOT = Path(__file__).parents[3]
ROOM = b"""
[room]
size_m = [4.8, 4.8, 2.4]
patch_m = 0.8

[paint]
all = 0.7
floor = "classic-gray"

[projector]
throw_ratio = 0.4
lumens = 3000
contrast = 1000
width_px = 1600
height_px = 1200
position_m = [1.2, 1.2, 1.2]
look_at_m = [2.2, 2.2, 1.1]

[[viewer]]
name = "guest"
eye_m = [1.0, 3.0, 1.6]

[show]
white_cdm2 = 20
pictures = ["grey"]
strategies = ["direct"]
width_px = 64
"""
SHOW = b"""
session = "nowhere"
sources = ["film.mp4", "pictures"]
strategy = "bounded"
gain = 0.9
on = ["09:00-12:30", "13:00-18:00"]
switch_off = true
lamp_hours_limit = 3000
record = "recordings"
record_limit_gb = 20

[log]
size_mb = 5
files = 5
"""


@contextmanager
def spoilt(path: Path, seed: int) -> Iterator[None]:
    """Within, a file is spoilt."""
    data = path.read_bytes()
    path.write_bytes(mutated(data, seed))
    try:
        yield
    finally:
        path.write_bytes(data)


def numbers(found: object) -> Iterator[float]:
    """All numbers of a JSON document."""
    if isinstance(found, dict):
        found = list(found.values())
    if isinstance(found, list):
        for one in found:
            yield from numbers(one)
    elif isinstance(found, float):
        yield found


@pytest.mark.parametrize("seed", range(42))
def test_a_spoilt_room(rig: Callable[..., Said], tmp_path: Path, seed: int) -> None:
    path = tmp_path / "room.toml"
    path.write_bytes(mutated(ROOM, seed))
    planned = rig("plan", path, "--no-search", "--json", "--report", tmp_path / "room.html")
    assert planned.status in (*ANSWERS, 2)
    assert (tmp_path / "room.html").exists() == (planned.status in ANSWERS)
    if planned.status in ANSWERS:
        assert all(math.isfinite(value) for value in numbers(json.loads(planned.out)))


@pytest.mark.parametrize("seed", range(28))
def test_a_spoilt_study(rig: Callable[..., Said], tmp_path: Path, seed: int) -> None:
    path = tmp_path / "study.toml"
    path.write_bytes(mutated(STUDY.encode(), seed))
    swept = rig("sweep", path, "--folder", tmp_path / "points", "--workers", "1", "--json")
    assert swept.status in (*ANSWERS, 2)


@pytest.mark.parametrize("seed", range(28))
def test_a_spoilt_show(rig: Callable[..., Said], tmp_path: Path, seed: int) -> None:
    path = tmp_path / "show.toml"
    path.write_bytes(mutated(SHOW, seed))
    assert rig("live", "--show", path).status in (2, 4)


@pytest.mark.parametrize(("name", "data"), [("room", ROOM), ("study", STUDY.encode())])
def test_what_is_spoilt_here_was_whole(rig: Callable[..., Said], tmp_path: Path, name: str, data: bytes) -> None:
    path = tmp_path / f"{name}.toml"
    path.write_bytes(data)
    if name == "room":
        assert rig("plan", path, "--no-search", "--report", tmp_path / "room.html").status in ANSWERS
    else:
        assert rig("sweep", path, "--folder", tmp_path / "points", "--workers", "1").status == 0


@pytest.mark.parametrize("seed", range(28))
def test_a_spoilt_list_of_corners_or_its_manifest(
    rig: Callable[..., Said], boards: Path, tmp_path: Path, seed: int
) -> None:
    with spoilt(boards / ("lenses.toml", "corners.vnl", "projector.vnl")[seed % 3], seed):
        found = rig("lenses", boards / "lenses.toml", "-o", tmp_path / "out.toml", "--json")
    assert (tmp_path / "out.toml").exists() == (found.status in ANSWERS and bool(found.out))
    if found.out:
        assert all(math.isfinite(value) for value in numbers(json.loads(found.out)))


@pytest.mark.parametrize("seed", range(28))
def test_a_spoilt_lens_file_of_a_profile(rig: Callable[..., Said], boards: Path, tmp_path: Path, seed: int) -> None:
    with spoilt(boards / "out.toml", seed):
        checked = rig("profile", "check", boards / "profile.toml")
        planned = rig("run", tmp_path / "new", "-p", boards / "profile.toml", "--dry-run")
    assert checked.status in (0, 2)
    assert (planned.status == 0) <= (checked.status == 0), "what is planned is a profile that holds"


@pytest.fixture(scope="module")
def recording(finished: Finished, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of a session, and beside it a profile that replays it."""
    folder = tmp_path_factory.mktemp("recording")
    shutil.copytree(finished.folder, folder / "recorded")
    text = (finished.folder / "profile.toml").read_text(encoding="utf-8").split("[simulation]")[0]
    text = text.replace('driver = "simulated"', 'driver = "replay"')
    (folder / "replay.toml").write_text(f'{text}\n[replay]\nsession = "{folder / "recorded"}"\n', encoding="utf-8")
    return folder


@pytest.mark.parametrize("seed", range(28))
def test_a_spoilt_recording_is_refused_by_the_name_of_what_is_spoilt(
    rig: Callable[..., Said], recording: Path, tmp_path: Path, seed: int
) -> None:
    recorded = recording / "recorded"
    paths = (recorded / "journal.jsonl", *sorted(recorded.glob("frames/exposure/*.exr")))
    path = paths[seed % len(paths)]
    with spoilt(path, seed):
        found = rig("calibrate", tmp_path / "new", "-p", recording / "replay.toml", "--json")
    assert found.status in REFUSALS
    assert found.out == ""
    assert path.name in found.err
