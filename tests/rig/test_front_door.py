"""What ``import rig`` shows, what it says of itself, and that it stays quick and alone."""

import subprocess
import sys
from pathlib import Path

import pytest

import rig
from rig.cli.app import VERBS
from tests.front_door import distribution_version, documentation_gaps, documented_share, run_examples

TWINS = {
    "run": "run_session",
    "report": "write_report",
    "live": "run_live",
    "check": "run_check",
    "devices": "list_devices",
    "emulate": "run_emulated",
    "virtual": "run_virtual",
    "lenses": "run_lenses",
    "scan": "run_scan",
    "simulate": "run_simulate",
    "paper": "run_paper",
    "plan": "plan_room",
    "serve": "serve_page",
    "recheck": "run_recheck",
    "bench": "run_bench",
    "show": "show_picture",
    "export": "export_session",
}
"""Verbs whose function has another name: most of theirs are names of rooms."""


def test_not_many_names_are_shown_and_nothing_else() -> None:
    assert dir(rig) == rig.__all__ == sorted(rig.__all__)
    assert len(rig.__all__) <= 46  # twenty-six verbs, what they take and give
    assert [name for name in rig.__all__ if callable(getattr(rig, name)) and not getattr(rig, name).__doc__] == []


def test_every_verb_of_the_command_line_has_a_function() -> None:
    names = [TWINS.get(verb, verb.replace("-", "_")) for verb in VERBS]
    assert [name for name in names if not callable(getattr(rig, name))] == []


@pytest.mark.parametrize("name", ["run", "live", "report", "session"])
def test_a_room_stays_a_room_after_its_functions_were_used(name: str) -> None:
    """A function of a room's name would be there or not, by what was imported before."""
    assert name not in rig.__all__
    for each in rig.__all__:
        getattr(rig, each)
    assert getattr(rig, name).__name__ == f"rig.{name}"


def test_each_public_function_says_what_it_takes_and_gives() -> None:
    gaps, count = documentation_gaps(rig)
    assert count > 40
    assert documented_share(rig) >= 0.9, gaps


@pytest.mark.slow
def test_the_example_does_what_it_shows() -> None:
    assert run_examples(rig) > 6


def test_the_version_is_that_of_the_distribution() -> None:
    assert rig.__version__ == distribution_version()
    assert Path(rig.__file__).with_name("py.typed").exists()


def test_an_unknown_name_is_no_attribute() -> None:
    with pytest.raises(AttributeError, match="no attribute 'calibrat'"):
        _ = rig.calibrat


def test_importing_it_imports_nothing_heavy() -> None:
    code = "import rig, sys; print([m for m in ('numpy', 'cv2', 'matplotlib', 'cyclopts') if m in sys.modules])"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"


def test_a_report_leaves_the_backend_of_figures_alone() -> None:
    code = (
        "import matplotlib; matplotlib.use('svg'); before = matplotlib.get_backend()\n"
        "import rig.report.page, rig.strategies.page, rig.self_check.page, sys\n"
        "from rig.report.figures import error_scale\n"
        "error_scale()\n"
        "print(before == matplotlib.get_backend(), 'matplotlib.pyplot' in sys.modules)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.split() == ["True", "False"]
