"""Room files, studies and finished points that went wrong: refused in words, or an answer that physics allows."""

import math
import re
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import TypeVar

import pytest

from rig.cli.app import run_command
from rig.errors import ProfileError, RigError
from rig.files.toml import toml_text
from rig.plan.compute import plan_room
from rig.plan.records import PlanResult
from rig.plan.request import load_room
from rig.records import Json
from rig.sweeps.executors import ExecutorChoice
from rig.sweeps.folder import POINTS, read_lines
from rig.sweeps.records import SweepResult
from rig.sweeps.run import SweepRequest, run_sweep
from tests.rig.hostile.mutations import mutated
from tests.rig.plan.rooms import PLAIN

pytestmark = pytest.mark.timeout(60, func_only=True)

ROOM = toml_text(
    {
        "schema": 1,
        **PLAIN,
        "projector": {**PLAIN["projector"], "lens_shift": [0.0, 0.1], "roll_deg": 1.5, "cost": 900.0},
        "room_light": {"lux": 2.0},
        "named_paint": [{"name": "own", "reflectance": 0.6, "cost": 4.0}],
        "opening": [{"name": "window", "surface": "x0", "from_m": [1.0, 0.9], "to_m": [2.4, 2.1], "emits_cdm2": 5.0}],
        "viewer": [{"name": "guest", "eye_m": [2.0, 3.5, 1.6], "stands": True}],
        "person": [{"name": "host", "at_m": [3.0, 1.0], "height_m": 1.8, "radius_m": 0.25}],
    }
).encode()
STUDY = b"""
schema = 1
subject = "paper"
tries = 2
[fixed]
width_px = 24
height_px = 18
hfov_deg = 90.0
strategies = ["paper"]
[grid]
reflectance = {from = 0.3, to = 0.7, count = 2}
photograph = ["outdoor", "grey"]
[latin_hypercube]
points = 2
seed = 4
ranges.x_m = [1.0, 2.0]
"""


class Here(Executor):
    """Computes a call when it is given."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_result(fn(*args, **kwargs))
        return future


Answer = TypeVar("Answer")


def answer_or_refusal(ask: Callable[[], Answer]) -> Answer | str:
    """What is answered, or the words of a refusal; anything else that is raised fails the test."""
    try:
        return ask()
    except RigError as refusal:
        return f"{type(refusal).__name__}: {refusal}"


def numbers_in(value: Json) -> Iterator[float]:
    if isinstance(value, dict):
        yield from numbers_in(list(value.values()))
    elif isinstance(value, list | tuple):
        for one in value:
            yield from numbers_in(one)
    elif isinstance(value, int | float):
        yield value


def assert_physics_allows(result: PlanResult) -> None:
    assert all(map(math.isfinite, numbers_in(result.as_json())))
    light = result.totals
    assert 0 < light.coverage <= 1 + 1e-9
    assert 0 <= light.global_share < 1
    assert 0 < light.white_cdm2 < 1e6
    assert all(one.black_cdm2 <= one.white_cdm2 * (1 + 1e-9) for one in result.surfaces)
    assert 1 <= result.contrast.checker_in_room <= result.contrast.projector * (1 + 1e-9)
    for picture in result.pictures:
        # Bounded is the best by squares, none the best gain by absolutes.
        assert picture.outcome("bounded").rms <= picture.outcome("none").rms * (1 + 1e-3) + 0.01


@pytest.mark.parametrize("seed", range(112))
def test_a_spoilt_room_file_is_refused_or_answers_what_physics_allows(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "room.toml"
    path.write_bytes(mutated(ROOM, seed))
    result = answer_or_refusal(lambda: plan_room(load_room(path)))
    if isinstance(result, str):
        assert len(result) > 30, "a refusal has words"
    else:
        assert_physics_allows(result)


ODD_NUMBERS = ("-1", "0", "1e-300", "1e-9", "1e9", "1e300", "nan", "inf", "true", '"seven"', "[]")
MAY_BE_NOTHING = {"cost = 900.0", "cost = 4.0", "lux = 2.0", "emits_cdm2 = 5.0", "roll_deg = 1.5"}
"""Numbers that may be 0 and 1e-9; of these only an angle may be below 0."""


@pytest.mark.parametrize("line", [line for line in ROOM.decode().splitlines() if line[-1:].isdigit()])
def test_no_number_of_a_room_file_may_be_any_number(tmp_path: Path, line: str) -> None:
    path = tmp_path / "room.toml"
    for odd in ODD_NUMBERS:
        path.write_text(ROOM.decode().replace(line, f"{line.partition(' = ')[0]} = {odd}", 1))
        if line in MAY_BE_NOTHING and (odd in ("0", "1e-300", "1e-9") or (odd == "-1" and "roll" in line)):
            continue
        if (line.startswith("cost") and odd == "1e9") or (line.startswith("schema") and odd == "true"):
            continue
        with pytest.raises(RigError):
            plan_room(load_room(path))


@pytest.mark.parametrize("seed", range(14))
def test_the_command_refuses_a_spoilt_room_file_with_status_2_and_leaves_no_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], seed: int
) -> None:
    path, page = tmp_path / "room.toml", tmp_path / "page.html"
    path.write_bytes(mutated(ROOM, 1000 + seed))
    status = run_command(["plan", str(path), "--report", str(page), "--json"])
    assert "Traceback" not in capsys.readouterr().err
    assert status in (0, 2)
    assert page.exists() == (status == 0)


def swept(study: Path, folder: Path) -> SweepResult:
    return run_sweep(SweepRequest(study=study, folder=folder, where=ExecutorChoice(executor=Here())))


@pytest.mark.parametrize("seed", range(56))
def test_a_spoilt_study_is_refused_before_any_point_or_every_point_has_an_answer(tmp_path: Path, seed: int) -> None:
    study, folder = tmp_path / "study.toml", tmp_path / "points"
    study.write_bytes(mutated(STUDY, seed))
    result = answer_or_refusal(lambda: swept(study, folder))
    if isinstance(result, str):
        assert len(result) > 30, "a refusal has words"
        assert not (folder / POINTS).exists()
        return
    lines = list(read_lines(folder))
    assert len(lines) == len({line.id for line in lines}) == result.points
    for line in lines:
        assert all(map(math.isfinite, numbers_in(dict(line.figures))))
        assert line.error is None or "fault of the program" not in line.error


def figures_of(folder: Path) -> dict[str, dict[str, object]]:
    return {line.id: dict(line.figures) for line in read_lines(folder)}


@pytest.fixture(scope="module")
def finished_points(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "study.toml").write_bytes(STUDY)
    swept(folder / "study.toml", folder / "points")
    return folder


@pytest.mark.parametrize("seed", range(56))
def test_spoilt_points_are_named_or_computed_again_to_the_same_numbers(finished_points: Path, seed: int) -> None:
    study, folder = finished_points / "study.toml", finished_points / "points"
    path = folder / POINTS
    data = path.read_bytes()
    before = figures_of(folder)
    path.write_bytes(mutated(data, seed))
    try:
        result = answer_or_refusal(lambda: swept(study, folder))
        if isinstance(result, str):
            assert re.match(r"SessionCorrupt: .* line \d+ is damaged; delete that line", result)
        else:
            assert figures_of(folder) == before
    finally:
        path.write_bytes(data)


def test_a_study_whose_room_is_spoilt_is_refused_with_the_rooms_mistakes(tmp_path: Path) -> None:
    (tmp_path / "room.toml").write_bytes(ROOM.replace(b"lumens = 3000", b"lumens = 3e9"))
    (tmp_path / "study.toml").write_text(
        'schema = 1\nsubject = "plan"\nbase = "room.toml"\n[grid]\n"paint.all" = [0.3, 0.7]\n'
    )
    with pytest.raises(ProfileError, match=r"projector.lumens: is 3000000000.0, should be less"):
        swept(tmp_path / "study.toml", tmp_path / "points")
