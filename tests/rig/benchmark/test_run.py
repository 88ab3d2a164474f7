"""``rig bench``: its references against known constants and each other, its clock, its verdicts."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from rig.benchmark import peers
from rig.benchmark.benches import solve
from rig.benchmark.checkout import script
from rig.benchmark.records import Criterion, Outcome, Point
from rig.benchmark.references.box import partly_occluded, uncovered_share
from rig.benchmark.references.polygon import exchange_reference, largest_relative_error
from rig.benchmark.references.room import errors_of, reference_blocks
from rig.benchmark.timing import median_seconds, peak_mb
from rig.cli.app import run_command
from sim.form_factors import form_factors
from sim.scenes.gridded import furnace, paper_room, room_with_box

PITCH_M = 1.2


def whole_matrix(scene, pitch_m):
    exchange = np.zeros((scene.n_patches, scene.n_patches))
    for rows, columns, block in reference_blocks(scene, pitch_m):
        exchange[rows, columns], exchange[columns, rows] = block, block.T
    return exchange / scene.areas[:, None]


# References


def test_the_room_reference_knows_the_unit_cube():
    opposite, adjacent = 0.199824895698, 0.200043776075
    blocks = [float(block[0, 0]) for _, _, block in reference_blocks(furnace(1.0), 1.0)]
    assert sorted(blocks) == pytest.approx([opposite] * 3 + [adjacent] * 12, abs=1e-12)


def test_the_rows_of_the_room_reference_sum_to_one():
    assert whole_matrix(paper_room(patch_size_m=0.6), 0.6).sum(axis=1) == pytest.approx(1.0, abs=1e-14)


def test_two_references_that_share_no_formula_agree():
    scene = paper_room(patch_size_m=PITCH_M)
    matrix = whole_matrix(scene, PITCH_M)
    assert largest_relative_error(matrix, scene, exchange_reference(scene)) < 1e-11


def test_a_planted_error_is_measured():
    scene = paper_room(patch_size_m=PITCH_M)
    matrix = whole_matrix(scene, PITCH_M)
    assert errors_of(matrix, scene, PITCH_M)[0] < 1e-15
    matrix[3, 40] *= 1.01
    assert errors_of(matrix, scene, PITCH_M)[0] == pytest.approx(0.01)


def test_the_box_covers_one_square_metre_of_the_floor():
    scene = room_with_box(0.4)
    covered = scene.areas * (1 - uncovered_share(scene))
    assert covered.sum() == pytest.approx(1.0)
    assert np.flatnonzero(covered).max() < scene.faces[0].n_patches


@pytest.mark.filterwarnings("ignore:room-with-box")
def test_rows_of_the_box_reference_sum_to_the_uncovered_share():
    scene = room_with_box(1.2, box_size_m=(1.0, 1.0, 1.0), box_patch_size_m=0.5)
    exact = form_factors(scene, "closed_form", visibility="exact").matrix
    free = form_factors(scene, "closed_form", visibility="none").matrix
    parted = partly_occluded(scene, free, 1 << 11)
    # Pairs that the reference does not list are wholly free or wholly hidden: there the two must be the same.
    for i, j in ((parted.first, parted.second), (parted.second, parted.first)):
        exact[i, j] = free[i, j] * parted.share
    assert exact.sum(axis=1) == pytest.approx(uncovered_share(scene), abs=5e-3)
    assert parted.change_rms < 5e-3


def test_the_exact_solution_leaves_nothing_over_even_at_high_reflectance():
    scene = paper_room(patch_size_m=0.8)
    factors = form_factors(scene, "closed_form")
    system = solve.System(factors, 0.9999, solve.floor_light(scene, 0.9999))
    B = solve.exact_solution(system)
    areas = scene.areas
    # All that is emitted is absorbed in a closed room.
    assert (areas * (1 - 0.9999) * (factors.matrix @ B)).sum() == pytest.approx((areas * system.E).sum(), rel=1e-9)


# Clock and memory


def test_cases_take_turns():
    calls = []
    seconds = median_seconds({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, repeats=3)
    turns = [name for name, before in zip(calls, ["", *calls], strict=False) if name != before]
    assert turns == ["a", "b"] * 4
    assert seconds.keys() == {"a", "b"}


def test_no_round_begins_after_the_time_is_over():
    turns = []
    works = {name: (lambda name=name: turns.append(name)) for name in ("a", "b")}
    median_seconds(works, budget_s=0.0, repeats=9)
    assert [name for name, before in zip(turns, ["", *turns], strict=False) if name != before] == ["a", "b"] * 2


def test_peak_memory_is_what_a_call_holds_beyond_what_was_held():
    held = np.ones(2_000_000)
    assert peak_mb(lambda: np.ones(10_000_000).sum()) == pytest.approx(80, rel=0.1)
    assert peak_mb(lambda: float(held.sum())) < 5


# Verdicts


def test_a_bar_is_met_on_the_right_side_only_and_never_by_no_number():
    assert Criterion(what="error", value=1.0, limit=1.0).met
    assert not Criterion(what="error", value=1.1, limit=1.0).met
    assert Criterion(what="ratio", value=1.1, limit=1.0, at_least=True).met
    assert not Criterion(what="ratio", value=0.9, limit=1.0, at_least=True).met
    assert not Criterion(what="error", value=math.nan, limit=1.0).met
    assert not Criterion(what="ratio", value=math.nan, limit=1.0, at_least=True).met


@pytest.mark.parametrize(("kind", "status"), [("accuracy", 1), ("time", 0), ("memory", 0)])
def test_only_accuracy_decides_the_exit_status(monkeypatch, capsys, kind, status):
    outcome = Outcome(
        points=(Point(problem="a", method="b", n=4),),
        criteria=(Criterion(what="too much", value=2.0, limit=1.0, unit="s", kind=kind),),
    )
    monkeypatch.setattr(solve, "run", lambda size, on_step: outcome)
    assert run_command(["bench", "solve"]) == status
    line = next(line for line in capsys.readouterr().out.splitlines() if "too much" in line)
    assert "≤ 1 s" in line
    assert ("MISSED" in line) == bool(status)


@pytest.mark.parametrize("name", ["form-factors", "solve", "image", "plan", "compensate", "live", "meshes"])
def test_each_quick_bench_gives_the_promised_json_and_meets_its_accuracy(name, capsys, tmp_path: Path):
    table = tmp_path / "points.csv"
    assert run_command(["bench", name, "--quick", "--json", "--csv", str(table)]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["points"]
    for point in answer["points"]:
        assert {"problem", "method", "n", "seconds", "error", "peak_mb"} <= point.keys()
    assert answer["within_limits"]
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    assert [row["method"] for row in rows] == [point["method"] for point in answer["points"]]


def test_the_paper_samples_err_as_much_as_is_known_of_them():
    with pytest.warns(UserWarning, match="row sums"):
        matrix = form_factors(paper_room(), "paper").matrix
    assert errors_of(matrix, paper_room(), 0.4)[0] == pytest.approx(0.218, abs=1e-3)


def test_peers_that_are_not_installed_are_named(monkeypatch, capsys):
    monkeypatch.setattr(peers, "_version", lambda name: None)
    monkeypatch.setattr(solve, "run", lambda size, on_step: Outcome(points=(), criteria=()))
    assert run_command(["bench", "solve"]) == 0
    assert "absent: pyviewfactor, mitsuba, embreex" in " ".join(capsys.readouterr().out.split())


def test_an_unknown_bench_names_those_there_are(capsys):
    assert run_command(["bench", "speed"]) == 2
    assert "form-factors, solve, image, plan, compensate" in capsys.readouterr().err


def test_quick_and_full_exclude_each_other(capsys):
    assert run_command(["bench", "solve", "--quick", "--full"]) == 2
    assert "--quick and --full" in capsys.readouterr().err


def test_a_script_that_is_not_there_is_no_module():
    assert script("no_such_script") is None
