"""What a display shows during an exposure."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Protocol

import numpy as np

from rig.devices.protocols import Clock, Codes
from rig.errors import CaptureTimeout, DeviceLost, SettingRefused

_SAMPLE_S = 0.02
"""How often the display is looked at during an exposure."""


def ignore(_: str) -> None:
    """Stand for a listener where there is none."""


class ReadableDisplay(Protocol):
    """Something that shows a picture; :class:`rig.devices.kms.readback.Readback` is one."""

    def shape(self) -> tuple[int, int]:
        """(height, width) of what it shows now. Raises DeviceLost when it is dark."""
        ...

    def picture(self) -> Codes:
        """(H, W, 3) uint8 codes that are on screen now. Raises DeviceLost when it is dark."""
        ...


class DisplayWatch:
    """Looks at a display.

    Parameters
    ----------
    display
        Open.
    expected
        (height, width) that it should have.
    note
        Called with what is worth telling: a dark display, a picture of another size.
    """

    def __init__(
        self, display: ReadableDisplay, expected: tuple[int, int], clock: Clock, note: Callable[[str], None] = ignore
    ):
        self._display, self._expected, self._clock, self._note = display, expected, clock, note
        self._noted = ""

    def during(self, started_s: float, ended_s: float) -> list[tuple[Codes, float]]:
        """Pictures on screen during an exposure, each with its share; a change is taken for halfway between looks."""
        looks: list[tuple[float, Codes]] = []
        until_s = started_s
        while True:
            self._clock.wait_until_s(until_s)
            looks.append((min(self._clock.now_s(), ended_s), self._look()))
            if until_s >= ended_s:
                break
            until_s = min(until_s + _SAMPLE_S, ended_s)
        times_s = [time_s for time_s, _ in looks]
        edges_s = [started_s, *((a + b) / 2 for a, b in pairwise(times_s)), ended_s]
        spans_s = [late - early for early, late in pairwise(edges_s)]
        return _merged([codes for _, codes in looks], [span_s / (ended_s - started_s) for span_s in spans_s])

    def _look(self) -> Codes:
        expected = self._expected
        try:
            shape = self._display.shape()
            if shape == expected:
                codes = self._display.picture()
                self._tell("")
                return codes
            self._tell(f"the display shows {_size(shape)}, the room expects {_size(expected)}")
        except (DeviceLost, CaptureTimeout, SettingRefused) as error:
            self._tell(str(error))
        return np.zeros(expected, np.uint8)

    def _tell(self, text: str) -> None:
        """Once for each change."""
        if text != self._noted:
            self._noted = text
            if text:
                self._note(text)


def _size(shape: tuple[int, int]) -> str:
    return f"{shape[1]} x {shape[0]} px"


def _merged(pictures: list[Codes], shares: list[float]) -> list[tuple[Codes, float]]:
    """Equal neighbours as one."""
    merged: list[tuple[Codes, float]] = []
    for codes, share in zip(pictures, shares, strict=True):
        if merged and np.array_equal(merged[-1][0], codes):
            merged[-1] = (codes, merged[-1][1] + share)
        else:
            merged.append((codes, share))
    return [(codes, share) for codes, share in merged if share > 0]
