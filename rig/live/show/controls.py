"""What a person may change while pictures run: keys, and what they do to the settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

_GAIN_STEP = 2 ** (1 / 8)
"""Of one key: eight make twice as bright; a single one is just seen."""
GAIN_RANGE = (1 / 16, 4.0)
"""From hardly visible to what clips nearly every picture; chosen."""
KEYS = {
    "n": "next source",
    "c": "compensation on or off",
    "s": "next strategy",
    "+": "brighter",
    "-": "darker",
    "a": "automatic gain on or off",
    "f": "freeze or go on",
    "b": "black or picture",
    "q": "quit",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Controls:
    """Settings that may change between two frames."""

    strategy: str
    compensating: bool = True
    gain: float = 1.0
    """Times the target's brightness."""
    auto_gain: bool = False
    frozen: bool = False
    black: bool = False

    @property
    def shown_strategy(self) -> str:
        """The strategy that compensates; empty where pictures are shown as they are."""
        return self.strategy if self.compensating else ""


class RemoteControl(Protocol):
    """Commands from elsewhere than the keyboard."""

    def adjusted(self, controls: Controls) -> Controls:
        """Settings after all commands that wait."""
        ...

    def pressed(self) -> str:
        """Keys that commands stand for, a character each."""
        ...


class NoRemote:
    """Stands for a remote control where there is none."""

    def adjusted(self, controls: Controls) -> Controls:
        """Return the same settings."""
        return controls

    def pressed(self) -> str:
        """Return no key."""
        return ""


def pressed(controls: Controls, key: str, strategies: Sequence[str]) -> Controls:
    """Settings after a key; keys that are no setting change nothing."""
    if key == "c":
        return replace(controls, compensating=not controls.compensating)
    if key == "s" and controls.strategy in strategies:
        following = strategies[(strategies.index(controls.strategy) + 1) % len(strategies)]
        return replace(controls, strategy=following, compensating=True)
    if key in ("+", "=", "-"):
        gain = controls.gain / _GAIN_STEP if key == "-" else controls.gain * _GAIN_STEP
        return replace(controls, gain=min(max(gain, GAIN_RANGE[0]), GAIN_RANGE[1]))
    if key == "a":
        return replace(controls, auto_gain=not controls.auto_gain)
    if key == "f":
        return replace(controls, frozen=not controls.frozen)
    return replace(controls, black=not controls.black) if key == "b" else controls
