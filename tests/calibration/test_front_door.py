"""What ``import calibration`` shows, and what it says of itself."""

import inspect
from pathlib import Path

import pytest

import calibration
from tests.front_door import distribution_version, documentation_gaps, documented_share, run_examples


def test_some_twenty_names_are_shown_and_nothing_else() -> None:
    assert dir(calibration) == sorted(calibration.__all__)
    assert len(calibration.__all__) <= 29
    assert all(hasattr(calibration, name) for name in calibration.__all__)


def test_the_package_says_that_it_is_typed() -> None:
    assert Path(calibration.__file__).with_name("py.typed").is_file()


def test_each_public_function_says_what_it_takes_and_gives() -> None:
    gaps, count = documentation_gaps(calibration)
    assert count > 15
    assert documented_share(calibration) >= 0.9, gaps


def test_the_example_does_what_it_shows() -> None:
    assert run_examples(calibration) > 8


def test_the_version_is_that_of_the_distribution() -> None:
    assert calibration.__version__ == distribution_version()


@pytest.mark.parametrize("name", sorted({*calibration.__all__} - {"CODES", "__version__"}))
def test_every_public_name_begins_with_a_sentence(name: str) -> None:
    first = (inspect.getdoc(getattr(calibration, name)) or "").partition("\n\n")[0]
    assert first.endswith(".")
    assert len(first.split()) >= 4
