"""A show of hours in virtual time with a fault a minute: never a crash, black where it cannot show, back in 10 s.

    nice python benchmarks/show_soak.py --hours 8 --seed 18

The real keeper and the real loop play on a display that keeps virtual time. Faults, one a minute, last 1 to 40 s: the
source is away (as the reader does, black is offered and tried again later and later), the display is unplugged (for
longer than 20 s the loop gives up and the keeper starts again), the driver fails at once. What is on screen is looked
at whenever it changes.
"""

from __future__ import annotations

import argparse
import sys
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta

import numpy as np

from rig.devices.clock import VirtualClock
from rig.devices.protocols import Codes, Shown
from rig.devices.simulated.display import ClockedDisplay
from rig.errors import DeviceError
from rig.live.show.controls import Controls
from rig.live.show.frame_mailbox import LiveFrame
from rig.live.show.frame_statistics import resident_mb
from rig.live.show.loop import LiveLoop, LoopArguments
from rig.shows.keeper import ShowKeeper
from rig.shows.timetable import Timetable

SHAPE, RATE_HZ, REPLUG_S = (9, 16), 60.0, 20.0
BACK_S, GROWTH_MB = 10.0, 8.0
KINDS = ("source", "display", "driver")
START = datetime(2026, 1, 1)


@dataclass(frozen=True)
class Fault:
    kind: str
    begin_s: float
    end_s: float

    def holds(self, now_s: float) -> bool:
        return self.begin_s <= now_s < self.end_s


@dataclass
class Faults:
    """One a minute; only those around the present are looked at."""

    all: list[Fault]
    fired: set[float] = field(default_factory=set)

    def now(self, kind: str, now_s: float) -> Fault | None:
        minute = int(now_s // 60)
        near = self.all[max(minute - 1, 0) : minute + 2]
        return next((fault for fault in near if fault.kind == kind and fault.holds(now_s)), None)


class SoakDisplay(ClockedDisplay):
    """Away and failing at its times; remembers when it last was bright, and whether it was so without a source."""

    def __init__(self, clock: VirtualClock, faults: Faults):
        self.faults, self.clock = faults, clock
        self.bright_s = array("d")
        self.wrong = 0
        super().__init__(SHAPE, RATE_HZ, clock)

    @property
    def is_plugged(self) -> bool:
        return self.faults.now("display", self.clock.now_s()) is None

    @is_plugged.setter
    def is_plugged(self, _value: bool) -> None:
        pass

    def show(self, codes: Codes, *, name: str) -> Shown:
        now_s = self.clock.now_s()
        fault = self.faults.now("driver", now_s)
        if fault is not None and fault.begin_s not in self.faults.fired:
            self.faults.fired.add(fault.begin_s)
            raise DeviceError("the soak test's driver fails")
        shown = super().show(codes, name=name)
        if codes.max() > 0:
            self._note_bright(shown.on_screen_s)
        return shown

    def _note_bright(self, now_s: float) -> None:
        away = self.faults.now("source", now_s)
        self.wrong += away is not None and now_s > away.begin_s + 0.5
        if not self.bright_s or now_s - self.bright_s[-1] > 0.5:
            self.bright_s.append(now_s)


class SoakQueue:
    """A picture a refresh; while the source is away one black picture, then none, until it is tried again."""

    dropped, is_timed, ended = 0, False, False

    def __init__(self, clock: VirtualClock, faults: Faults):
        self.clock, self.faults = clock, faults
        self.number, self.retry_s, self.pause_s = 0, 0.0, 0.5
        self.bright = np.full((*SHAPE, 3), 200, np.uint8)
        self.black = np.zeros((*SHAPE, 3), np.uint8)

    def take(self, latch_s: float, _target_s: float) -> LiveFrame | None:
        self.clock.wait_until_s(latch_s)
        now_s = self.clock.now_s()
        if now_s < self.retry_s:
            return None
        self.number += 1
        if self.faults.now("source", now_s) is not None:
            self.retry_s, self.pause_s = now_s + self.pause_s, min(2 * self.pause_s, 8.0)
            return LiveFrame(self.number, self.black, now_s)
        self.pause_s = 0.5
        return LiveFrame(self.number, self.bright, now_s)

    def skip(self, target_s: float) -> None:
        self.clock.wait_until_s(target_s)


class NoLamp:
    def lit(self, seconds: float) -> None:
        pass

    def off(self) -> None:
        pass


@dataclass
class Soak:
    hours: float
    seed: int
    clock: VirtualClock = field(default_factory=VirtualClock)
    resident: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        random = np.random.default_rng(self.seed)
        self.end_s = 3600 * self.hours
        begins = 60.0 * np.arange(1, int(self.end_s / 60)) + random.uniform(0, 10, max(int(self.end_s / 60) - 1, 0))
        lasting = random.uniform(1, 40, len(begins))
        kinds = random.choice(KINDS, len(begins))
        found = [Fault(str(k), float(b), float(b + d)) for k, b, d in zip(kinds, begins, lasting, strict=True)]
        self.faults = Faults([Fault("none", 0, 0), *found])
        self.display, self.queue = SoakDisplay(self.clock, self.faults), SoakQueue(self.clock, self.faults)

    def play(self, _seconds: float | None) -> str:
        """As a run of `rig live`: open, step, and black at the end whatever happens."""
        arguments = LoopArguments(
            projector=self.display,
            queue=self.queue,
            compensators={},
            clock=self.clock,
            refresh_rate_hz=RATE_HZ,
            replug_timeout_s=REPLUG_S,
        )
        try:
            self.display.open()
            loop = LiveLoop(arguments, Controls(strategy="bounded", compensating=False))
            while self.clock.now_s() < self.end_s:
                loop.step()
                self._watch_memory()
            return "quit"
        finally:
            self.display.close()

    def _watch_memory(self) -> None:
        if len(self.resident) < 20 and self.clock.now_s() > len(self.resident) * self.end_s / 20:
            self.resident.append(resident_mb())

    def keep(self) -> list[str]:
        """Return what was wrong, empty where nothing was."""
        keeper = ShowKeeper(
            play=self.play,
            timetable=Timetable(()),
            clock=self.clock,
            time_of_day=lambda: START + timedelta(seconds=self.clock.now_s()),
            is_ended=lambda: self.clock.now_s() >= self.end_s,
            lamp=NoLamp(),
        )
        kept = keeper.keep()
        backs = self._backs()
        growth = self.resident[-1] - self.resident[len(self.resident) // 4]
        print(
            f"{self.hours:g} h, {len(self.faults.all) - 1} faults, {kept.runs} runs; back after "
            f"{max(backs, default=0.0):.1f} s at most; {self.display.wrong} pictures without a source; memory grew by "
            f"{growth:.1f} MB"
        )
        wrong = [f"back only {back:.1f} s after a fault" for back in backs if back > BACK_S]
        wrong += [f"{self.display.wrong} pictures that are not black without a source"] * bool(self.display.wrong)
        wrong += ["not black at the end"] * bool(self.display.picture.any())
        return wrong + [f"memory grew by {growth:.1f} MB"] * (growth > GROWTH_MB)

    def _backs(self) -> list[float]:
        """From the end of each fault to the next picture. [s]."""
        bright = np.array(self.display.bright_s)
        ends = [fault.end_s if fault.kind != "driver" else fault.begin_s for fault in self.faults.all[1:]]
        ends = [end for end in ends if end < self.end_s - BACK_S]
        return [float(bright[np.searchsorted(bright, end)] - end) if bright[-1] > end else np.inf for end in ends]


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=8.0)
    parser.add_argument("--seed", type=int, default=18)
    asked = parser.parse_args(arguments)
    wrong = Soak(asked.hours, asked.seed).keep()
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
