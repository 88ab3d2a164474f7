"""Devices by name: results say which camera and which projector they belong to, and allow any number.

The steps of this version serve one camera and one projector; :func:`only` is where they say so.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeVar

from rig.errors import SessionError
from rig.profile.schema import Profile

Key = TypeVar("Key")
Value = TypeVar("Value")


class DevicePair(NamedTuple):
    """A camera and a projector, by name."""

    camera: str
    projector: str


def pair_of(profile: Profile) -> DevicePair:
    """Return the only camera and the only projector of a profile."""
    return DevicePair(profile.camera.name, profile.projector.name)


def only(by_name: Mapping[Key, Value]) -> Value:
    """Return the single value of a mapping by device or by pair of devices. Raises SessionError for more."""
    values = list(by_name.values())
    if len(values) != 1:
        names = ", ".join(map(str, by_name)) or "none"
        raise SessionError(f"this version works with one camera and one projector; there are {names}")
    return values[0]
