"""Fixtures that several folders of tests share."""

from pathlib import Path

import pytest

from rig.profile import Profile, load_profile

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def tiny_profile() -> Profile:
    """The smallest complete simulated rig."""
    return load_profile(ROOT / "hw_profiles" / "ci-tiny.toml")
