"""Fixtures that several folders of tests share, and how many threads their libraries have.

It imports no library that computes: those read the environment once, when they are loaded.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from rig.profile.schema import Profile

ROOT = Path(__file__).parents[1]
# Workers of pytest fill the processors: threads that wait for each other in there take twice the processor time.
for name, value in {"OPENBLAS_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"}.items():
    os.environ.setdefault(name, value)


@pytest.fixture(scope="session")
def tiny_profile() -> Profile:
    """The smallest complete simulated rig."""
    from rig.profile.schema import load_profile

    return load_profile(ROOT / "hw_profiles" / "ci-tiny.toml")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with a slow test begin first: no worker then waits long for the last of them."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


def pytest_sessionfinish() -> None:
    """Let go of what the device lab's tests share, before the interpreter waits for its threads."""
    lab = sys.modules.get("tests.contract.lab")
    if lab is not None:
        lab.UNTIL_THE_END.close()
