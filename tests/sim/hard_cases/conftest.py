"""Fixtures that the hard cases share.

`python benchmarks/hard_cases.py` prints the figures, docs/explanation/hard-cases.md shows them.
"""

import pytest

from sim.form_factors import form_factors
from sim.scenes.gridded import paper_room


@pytest.fixture
def measured(record_property):
    """Hold a figure to its limit and keep it for the table."""

    def hold(what, value, limit):
        record_property(what, f"{value:.1e} (limit {limit:.0e})")
        assert value <= limit

    return hold


@pytest.fixture(scope="session")
def closed_room():
    return form_factors(paper_room())
