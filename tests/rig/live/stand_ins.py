"""Stand-ins for everything around the live loop, in virtual time."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from rig.devices.clock import VirtualClock
from rig.devices.simulated.display import ClockedDisplay
from rig.live.show.controls import Controls
from rig.live.show.frame_mailbox import LiveFrame
from rig.live.show.loop import LiveLoop, LoopArguments, ShownFrame
from rig.live.sources.source import Pixels

SHAPE = (9, 16)
RATE_HZ = 60.0
PERIOD_S = 1 / RATE_HZ


@dataclass(frozen=True)
class Report:
    error: float = 0.1


class Doubler:
    """Doubles codes, and takes its time for it."""

    def __init__(self, clock: VirtualClock, busy_s: float = 0.0, factor: int = 2):
        self.clock, self.busy_s, self.factor = clock, busy_s, factor
        self.last: Report | None = None
        self.resets = 0
        self.gains: list[float] = []

    def frame(self, codes: Pixels, out: Pixels | None = None, gain: float = 1.0) -> Pixels:
        self.clock.wait_until_s(self.clock.now_s() + self.busy_s)
        self.gains.append(gain)
        self.last = Report()
        result = np.empty_like(codes) if out is None else out
        result[:] = np.minimum(codes.astype(int) * self.factor * gain, 255).astype(np.uint8)
        return result

    def reset(self) -> None:
        self.resets += 1


class ScriptedQueue:
    """Frames that arrive at given times, each filled with its number's code; newest wins."""

    def __init__(self, clock: VirtualClock, arrivals_s: Iterable[float], numbers: Iterable[int] | None = None):
        self.clock = clock
        times = list(arrivals_s)
        self.left = list(zip(times, numbers or range(1, len(times) + 1), strict=True))
        self.dropped = 0
        self.is_timed = False

    @property
    def ended(self) -> bool:
        return not self.left

    def take(self, latch_s: float, target_s: float) -> LiveFrame | None:
        if self.left and self.left[0][0] > self.clock.now_s():
            self.clock.wait_until_s(min(self.left[0][0], latch_s))
        there = [entry for entry in self.left if entry[0] <= self.clock.now_s()]
        if not there:
            self.clock.wait_until_s(latch_s)
            return None
        self.dropped += len(there) - 1
        del self.left[: len(there)]
        arrived_s, number = there[-1]
        return LiveFrame(number, np.full((*SHAPE, 3), number % 100, np.uint8), arrived_s)

    def skip(self, target_s: float) -> None:
        self.left = [entry for entry in self.left if entry[0] > self.clock.now_s()]


@dataclass(kw_only=True)
class Stage:
    """A loop on a simulated display in virtual time, and what it has shown."""

    clock: VirtualClock
    display: ClockedDisplay
    queue: ScriptedQueue
    loop: LiveLoop
    compensators: dict[str, Doubler]
    pressed: list[str]
    switched: list[float]
    shown: list[ShownFrame] = field(default_factory=list)
    codes: list[int] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def run(self, most: int = 10_000) -> None:
        for _ in range(most):
            if self.loop.ended:
                return
            self.loop.step()

    def run_until_s(self, time_s: float) -> None:
        while self.clock.now_s() < time_s and not self.loop.ended:
            self.loop.step()


def stage(
    arrivals_s: Iterable[float],
    *,
    busy_s: float = 0.0,
    numbers: Iterable[int] | None = None,
    controls: Controls | None = None,
    replug_timeout_s: float = 20.0,
) -> Stage:
    clock = VirtualClock()
    display = ClockedDisplay(SHAPE, RATE_HZ, clock)
    display.open()
    queue = ScriptedQueue(clock, arrivals_s, numbers)
    compensators = {"exact": Doubler(clock, busy_s), "bounded": Doubler(clock, busy_s, factor=1)}
    pressed: list[str] = []
    switched: list[float] = []
    shown: list[ShownFrame] = []
    codes: list[int] = []
    notes: list[str] = []

    def on_shown(frame: ShownFrame) -> None:
        shown.append(frame)
        codes.append(int(frame.codes[0, 0, 0]))

    arguments = LoopArguments(
        projector=display,
        queue=queue,
        compensators=compensators,
        clock=clock,
        refresh_rate_hz=RATE_HZ,
        replug_timeout_s=replug_timeout_s,
        keys=lambda: "".join(pressed.pop(0) for _ in range(len(pressed))),
        next_source=lambda: switched.append(clock.now_s()),
        on_shown=on_shown,
        notes=notes,
    )
    loop = LiveLoop(arguments, controls or Controls(strategy="exact"))
    return Stage(
        clock=clock,
        display=display,
        queue=queue,
        loop=loop,
        compensators=compensators,
        pressed=pressed,
        switched=switched,
        shown=shown,
        codes=codes,
        notes=notes,
    )
