"""What a study says: its points, and its mistakes, named before anything is computed."""

from pathlib import Path

import numpy as np
import pytest

from rig.errors import ProfileError, UsageError
from rig.files.toml import toml_text
from rig.sweeps.design import count_of, samples_of, settings_of
from rig.sweeps.records import point_id
from rig.sweeps.run import SweepRequest, run_sweep
from rig.sweeps.study import LatinHypercube, read_study


def points_of(study: Path) -> list[dict[str, object]]:
    return list(settings_of(read_study(study)))


def refused(study: Path, text: str, tmp_path: Path) -> str:
    study.write_text(text, encoding="utf-8")
    with pytest.raises((ProfileError, UsageError)) as refusal:
        run_sweep(SweepRequest(study=study, folder=tmp_path / "points"))
    assert not (tmp_path / "points" / "points.jsonl").exists()
    return str(refusal.value)


def test_every_row_meets_every_place_of_the_grid_and_every_sample(study):
    study.write_text(
        'schema = 1\nsubject = "paper"\n[grid]\nreflectance = {from = 0.1, to = 0.9, count = 5}\n'
        "[[list]]\nceiling = false\n[[list]]\npicture_scale = 0.5\n"
        "[latin_hypercube]\npoints = 3\nranges.x_m = [1.0, 2.0]\n",
        encoding="utf-8",
    )
    points = points_of(study)
    assert len(points) == count_of(read_study(study)) == 5 * 2 * 3
    assert sorted({point["reflectance"] for point in points}) == [0.1, 0.3, 0.5, 0.7, 0.9]
    assert sum("ceiling" in point for point in points) == 15


def test_a_latin_hypercube_meets_each_part_of_each_range_once():
    samples = samples_of(LatinHypercube(points=40, seed=3, ranges={"a": [0.0, 1.0], "b": {"c": [-2.0, 2.0]}}))
    for name, low, width in (("a", 0.0, 1.0), ("b.c", -2.0, 4.0)):
        parts = np.floor((np.array([sample[name] for sample in samples]) - low) / width * 40)
        assert sorted(parts) == list(range(40))


def test_samples_stay_the_same_from_version_to_version():
    assert samples_of(LatinHypercube(points=2, seed=1, ranges={"a": [0, 1]})) == [{"a": 0.0720798}, {"a": 0.974325}]


def test_a_point_has_another_name_in_another_version():
    assert point_id("paper", "1", {"x": 1}) == point_id("paper", "1", {"x": 1})
    assert point_id("paper", "1", {"x": 1}) != point_id("paper", "2", {"x": 1})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[grid]\nreflectance = []", "grid.reflectance: is empty"),
        ("[grid]\nreflectance = 0.3", "grid.reflectance: is 0.3, should be a list"),
        ("[grid]\nreflectanse = [0.3]", "did you mean reflectance"),
        ("[grid]\nreflectance = [0.3, 1.5]", "reflectance: is 1.5"),
        ("[fixed]\nz_m = 1.0\n[grid]\nz_m = [1.0]", "is set in [fixed] already"),
        ("[latin_hypercube]\npoints = 3\nranges.x_m = [2.0, 1.0]", "low below high"),
        ("[latin_hypercube]\npoints = 0\nranges.x_m = [1.0, 2.0]", "latin_hypercube.points"),
        ('[fixed]\nstrategies = ["best"]', "'best' is none"),
        ("[grids]\nreflectance = [0.3]", "did you mean grid"),
        ("[grid]\nx_m = {from = 1.0, to = 2.0, count = 1000}\ny_m = {from = 1.0, to = 2.0, count = 1001}", "1001000"),
        (
            '[grid]\nreflectance = {from = "a", to = 1.0, count = 3}',
            "grid.reflectance: from is 'a', should be a number",
        ),
        ("[grid]\nreflectance = {from = 0.1, to = inf, count = 3}", "grid.reflectance: to is inf"),
        ("[grid]\nreflectance = {from = 0.1, to = 0.2, count = true}", "count is True, should be 1 ... 1000000"),
        ("[latin_hypercube]\npoints = 3\nranges.x_m = [1.0, inf]", "low below high"),
        ("[grid]\nreflectance = [nan]", "reflectance"),
        ('base = "ci-tiny"', "leave base out"),
        ("[grid", "is not TOML"),
    ],
)
def test_a_mistake_is_named_and_nothing_is_computed(study, tmp_path, text, words):
    assert words in refused(study, f'schema = 1\nsubject = "paper"\n{text}\n', tmp_path)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ('subject = "papre"', "did you mean paper"),
        ('subject = "session"', "base: missing"),
        ('subject = "session"\nbase = "no-such-rig"', "no such profile"),
        ('subject = "session"\nbase = "ci-tiny"\n[grid]\nsimulatoin.seed = [1]', "did you mean simulation"),
        ('subject = "session"\nbase = "ci-tiny"\n[grid]\nsimulation.seed = [1.5]', "simulation.seed"),
        ('subject = "session"\nbase = "ci-tiny"\n[fixed]\ncamera.driver = "v4l2"', "driver"),
    ],
)
def test_a_subject_and_its_base_are_checked_too(study, tmp_path, lines, words):
    assert words in refused(study, f"schema = 1\n{lines}\n", tmp_path)


def test_tables_written_as_toml_keep_all_digits():
    import tomllib

    data = {"a": 0.1 + 0.2, "b": {"c d": [1, 2.5], "e": {"f": True}}, "g": [{"h": "x\ny"}, {"h": 1e-300}]}
    assert tomllib.loads(toml_text(data)) == data
