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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with a slow test begin first: no worker then waits long for the last of them."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


def pytest_sessionfinish() -> None:
    """Let go of what the device lab's tests share, before the interpreter waits for its threads."""
    lab = sys.modules.get("tests.contract.lab")
    if lab is not None:
        lab.UNTIL_THE_END.close()
