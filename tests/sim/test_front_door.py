"""What ``import sim`` shows, what it says of itself, and strategies that other packages add."""

import dataclasses
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import sim
from sim import compensation
from tests.front_door import distribution_version, documentation_gaps, documented_share, run_examples, stub_names


def test_some_twenty_names_are_shown_and_nothing_else() -> None:
    assert dir(sim) == sorted(sim.__all__)
    assert len(sim.__all__) <= 28
    assert [name for name in sim.__all__ if callable(getattr(sim, name)) and not getattr(sim, name).__doc__] == []


def test_type_checkers_and_editors_see_the_same_names() -> None:
    assert stub_names(sim) == set(sim.__all__)
    assert Path(sim.__file__).with_name("py.typed").exists()


def test_each_public_function_says_what_it_takes_and_gives() -> None:
    gaps, count = documentation_gaps(sim)
    assert count > 40
    assert documented_share(sim) >= 0.9, gaps


def test_the_example_does_what_it_shows() -> None:
    assert run_examples(sim) > 8


def test_the_version_is_that_of_the_distribution() -> None:
    assert sim.__version__ == distribution_version()


def test_an_unknown_name_is_answered_with_those_there_are() -> None:
    with pytest.raises(AttributeError, match="no attribute 'radiosity'; there are Scene, Mesh"):
        _ = sim.radiosity


@pytest.mark.parametrize("first", ["sim.form_factors", "sim.errors", "sim.form_factors.compressed"])
def test_the_function_form_factors_stays_in_front_of_its_room(first: str) -> None:
    code = f"import {first}, sim.planning.plan; assert sim.form_factors(sim.room(patch_size_m=2.0)).closure_max < 1e-9"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(sim.__file__).parents[1])


@pytest.fixture
def half() -> sim.Strategy:
    """A strategy of another package, taken away again."""

    def solve(transport, target, lower, upper, share=0.5):
        problem = compensation.result.prepare(transport, target, lower, upper)
        return problem.result(share * problem.target)

    yield sim.Strategy(name="half", solve=solve, summary="half of the target", version="3")
    compensation._known.pop("half", None)


def test_a_registered_strategy_is_found_by_name(half: sim.Strategy) -> None:
    room = sim.room(patch_size_m=1.2)
    lens = sim.Lens.from_horizontal_field_of_view(8, 6, 90.0)
    transport = sim.coaxial_transport(room, sim.form_factors(room), lens, sim.Pose.look_at((1, 1, 1), (2, 2, 1)))
    compensation.register(half)
    compensation.register(half)
    assert list(sim.STRATEGIES)[-1] == "half"
    assert compensation.strategy("half").version == "3"
    shown = sim.compensate("half", transport, np.full(48, 0.4), share=0.25)
    assert shown.projector_image == pytest.approx(np.full(48, 0.1))


def test_no_strategy_takes_the_name_of_another(half: sim.Strategy) -> None:
    with pytest.raises(sim.SimulationError, match="'exact' is there already: the exact inverse"):
        compensation.register(dataclasses.replace(half, name="exact"))
    with pytest.raises(sim.SimulationError, match="letters"):
        dataclasses.replace(half, name="half of it")
    with pytest.raises(sim.SimulationError, match="no version"):
        dataclasses.replace(half, version="")


def test_every_strategy_is_described_for_tables_and_help() -> None:
    for name, strategy in sim.STRATEGIES.items():
        assert strategy.name == name
        assert strategy.summary
        assert "\n" not in strategy.summary
        assert strategy.publication or name == "none"


def test_the_page_has_a_row_for_every_strategy() -> None:
    page = (Path(__file__).parents[2] / "docs/explanation/compensation.md").read_text(encoding="utf-8")
    table = page.partition("## The strategies")[2].partition("\n## ")[0]
    assert re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE) == list(sim.STRATEGIES)
