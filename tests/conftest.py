"""Fixtures that several folders of tests share."""

import sys
from pathlib import Path

import pytest

from rig.profile.schema import Profile, load_profile

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def tiny_profile() -> Profile:
    """The smallest complete simulated rig."""
    return load_profile(ROOT / "hw_profiles" / "ci-tiny.toml")


def pytest_sessionfinish() -> None:
    """Let go of what the device lab's tests share, before the interpreter waits for its threads."""
    lab = sys.modules.get("tests.contract.lab")
    if lab is not None:
        lab.UNTIL_THE_END.close()
