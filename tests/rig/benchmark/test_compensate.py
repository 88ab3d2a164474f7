"""``rig bench compensate``: its problems, and criteria that catch what they are there for."""

from dataclasses import replace

import pytest

from rig.benchmark.benches.compensate import COLOUR, colour_problem, criteria, grey_problem, measured
from rig.paper.experiments import CONFIGURATIONS, paper_factors
from sim.compensation import STRATEGIES

SHAPE = (24, 32)


@pytest.fixture(scope="module")
def points():
    factors = paper_factors(True)
    grey = grey_problem(CONFIGURATIONS[0], factors, SHAPE)
    return [*measured("reference", *grey, 0.0), *measured(COLOUR, *colour_problem(factors, SHAPE), 0.0)]


def named(points, problem, method):
    return next(point for point in points if (point.problem, point.method) == (problem, method))


def with_changed(points, problem, method, **changes):
    chosen = named(points, problem, method)
    return [replace(point, **changes) if point is chosen else point for point in points]


def test_every_strategy_has_seconds_and_error_on_grey_and_in_colour(points):
    assert {(point.problem, point.method) for point in points} == {
        (problem, name) for problem in ("reference", COLOUR) for name in STRATEGIES
    }
    assert all(point.seconds >= 0 and point.error > 0 for point in points)


def test_the_optimum_keeps_its_bars(points):
    assert [criterion.what for criterion in criteria(points) if not criterion.met] == []


def test_an_optimum_that_another_beats_is_found(points):
    detail = {**named(points, "reference", "exact").detail, "rms": 0.1}
    planted = with_changed(points, "reference", "exact", detail=detail)
    assert [criterion.what for criterion in criteria(planted) if not criterion.met] == [
        "reference: bounded RMS over the least of all"
    ]


def test_a_certificate_with_a_gap_is_found(points):
    detail = {**named(points, COLOUR, "bounded").detail, "note_gap": 2e-6}
    planted = with_changed(points, COLOUR, "bounded", detail=detail)
    assert [criterion.what for criterion in criteria(planted) if not criterion.met] == [
        f"{COLOUR}: bounded, certified gap"
    ]


def test_an_optimum_that_is_hardly_better_than_the_papers_rule_is_found(points):
    paper = named(points, "reference", "paper")
    planted = with_changed(points, "reference", "bounded", error=0.5 * paper.error)
    assert [criterion.what for criterion in criteria(planted) if not criterion.met] == [
        "reference: error of bounded over that of paper"
    ]
