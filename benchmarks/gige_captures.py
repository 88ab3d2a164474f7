"""Captures over the loopback network with lost packets, late pictures and pulled cables: is any frame a wrong one?

    python benchmarks/gige_captures.py [captures] [seed] [captures between two faults]

Each capture shows a picture of its own on a virtual display, of random numbers that no other capture has, and the
emulated GigE camera's frame has to be those numbers and no others, each pixel of them: a frame of the picture before,
of two pictures at once, or put together from the packets of two frames is wrong. Meanwhile a share of the packets is
lost (0.2 %), pictures come up to 20 ms late and now and then later than the driver waits for one, the cable is pulled,
and the camera forgets who controls it. A capture may be refused; what may not be is a wrong frame.
"""

from __future__ import annotations

import argparse
import os
import threading
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.capture.rig import Rig, open_rig
from rig.devices.clock import SystemClock
from rig.devices.protocols import Advising
from rig.devices.virtual.projector import VirtualDisplay
from rig.emulated.gige.camera import EmulatedGigeCamera, GigeRequest, encoded
from rig.emulated.gige.description import EmulatedSensor
from rig.emulated.watch import DisplayWatch
from rig.errors import DeviceError
from rig.profile.schema import Profile

PROFILE = Path(__file__).parents[1] / "hw_profiles" / "emulated-gige.toml"
WIDTH, HEIGHT, ZOOM, STEP = 64, 48, 2, 16
"""Of the camera; pixels of it a projector pixel has; its digital numbers that a code makes."""
LOST, LATE_S, MUCH_LATER_S = 0.002, 0.02, 1.6
"""Share of packets; delays of pictures; the last is longer than the driver waits for one."""
EXPOSURES_S = (0.001, 0.004)
CLOCK = SystemClock()
Numbers = NDArray[np.uint16]


def codes_of(number: int) -> NDArray[np.uint8]:
    return np.random.default_rng(number).integers(0, 256, (HEIGHT // ZOOM, WIDTH // ZOOM), np.uint8)


def seen_of(codes: NDArray[np.uint8]) -> Numbers:
    return np.kron(codes, np.ones((ZOOM, ZOOM))).astype(np.uint16) * STEP


@dataclass
class Screen:
    """What the camera looks at: the display's own numbers, pictures that change meanwhile mixed.

    The first pixel counts frames, as noise does: without it a frame of an old picture would be the old frame.
    """

    watch: DisplayWatch
    count: int = 0

    def expose(self, request: GigeRequest) -> bytes:
        started_s = CLOCK.now_s()
        mixed = np.zeros((HEIGHT // ZOOM, WIDTH // ZOOM))
        for codes, share in self.watch.during(started_s, started_s + request.exposure_s):
            mixed += share * (codes if codes.ndim == 2 else codes[..., 0])
        seen, self.count = seen_of(np.rint(mixed).astype(np.uint8)), self.count + 1
        seen[0, 0] = self.count % 4096
        return encoded(seen, "Mono12")


@dataclass
class Mischief:
    """Breaks the camera while captures run."""

    camera: EmulatedGigeCamera
    captures: int
    random: np.random.Generator
    every: int
    """Captures between two faults, about."""
    done: Counter[str] = field(default_factory=Counter)
    at: int = 0
    """Captures so far."""
    ended: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        """Of each kind in turn, at any moment of a capture."""
        due = self.every // 2
        while not self.ended.wait(0.01 * self.random.random()):
            if self.at >= due:
                due += int(self.random.uniform(0.5, 1.5) * self.every)
                kind = ("unplugged", "uncontrolled", "much later")[sum(self.done.values()) % 3]
                self.done[kind] += 1
                getattr(self, f"_{kind.replace(' ', '_')}")()

    def _unplugged(self) -> None:
        self.camera.unplug()
        self.ended.wait(0.5 * self.random.random())
        self.camera.plug()

    def _uncontrolled(self) -> None:
        self.camera.forget_heartbeat()

    def _much_later(self) -> None:
        self.camera.faults.jitter_s = MUCH_LATER_S
        self.ended.wait(3.0)
        self.camera.faults.jitter_s = LATE_S


def profile() -> Profile:
    text = PROFILE.read_text("utf-8")
    for old, new in {
        "width_px = 320\nheight_px = 240": f"width_px = {WIDTH}\nheight_px = {HEIGHT}",
        "width_px = 256\nheight_px = 192": f"width_px = {WIDTH // ZOOM}\nheight_px = {HEIGHT // ZOOM}",
        'trigger = "software"': f'trigger = "{TRIGGER}"\npacket_size = 576',
        'output = "emulated-gige"': f'output = "captures-{os.getpid()}"',
        "spots_px = [[37, 75], [217, 75]]": "spots_px = [[4, 9], [27, 9]]",
        "timeout_s = 5.0": "timeout_s = 3.0",
    }.items():
        if old not in text:
            raise ValueError(f"{PROFILE} has no {old!r} any more")
        text = text.replace(old, new)
    return Profile.parse(text.encode(), PROFILE)


TRIGGER = os.environ.get("TRIGGER", "software")


def capture_all(rig: Rig, mischief: Mischief) -> tuple[int, list[str]]:
    """How many captures were refused, and what is wrong of the others."""
    refused, wrong, earlier = 0, [], {}
    for number in range(mischief.captures):
        mischief.at = number
        codes = codes_of(number)
        try:
            frame = rig.shoot(codes, name=str(number), exposure_s=EXPOSURES_S[number // 50 % 2])
        except DeviceError as error:
            refused += 1
            print(f"capture {number} was refused: {error}", flush=True)
            rig.open()
            continue
        got, expected = frame.pixels.ravel()[1:], seen_of(codes).ravel()[1:]
        earlier[number % 4] = expected
        if not np.array_equal(got, expected):
            like = [k for k, one in earlier.items() if np.array_equal(got, one)]
            share = float((got != expected).mean())
            wrong.append(f"capture {number}: {100 * share:.1f} % of the pixels differ, equal to one before: {like}")
            print(wrong[-1], flush=True)
    return refused, wrong


def main(captures: int, seed: int, every: int) -> None:
    rig_profile = profile()
    watch = DisplayWatch(VirtualDisplay(rig_profile.projector.output or ""), (HEIGHT // ZOOM, WIDTH // ZOOM), CLOCK)
    sensor = EmulatedSensor(
        width_px=WIDTH,
        height_px=HEIGHT,
        formats=("Mono12",),
        exposure_range_s=rig_profile.camera.exposure_range_s,
    )
    camera = EmulatedGigeCamera(Screen(watch), sensor, wait=lambda wait_s: CLOCK.wait_until_s(CLOCK.now_s() + wait_s))
    camera.faults.jitter_s = LATE_S
    mischief = Mischief(camera, captures, np.random.default_rng(seed), every)
    breaker = threading.Thread(target=mischief.run)
    with camera:
        camera.lose_packets(LOST)
        with open_rig(rig_profile) as rig:
            began_s = CLOCK.now_s()
            breaker.start()
            try:
                refused, wrong = capture_all(rig, mischief)
            finally:
                mischief.ended.set()
                breaker.join()
            events = Counter(event.kind for event in rig.events)
            print(
                f"{captures} captures in {CLOCK.now_s() - began_s:.0f} s ({TRIGGER}): {len(wrong)} frames wrong, ",
                end="",
            )
            print(f"{refused} captures refused; the camera made {camera.frames} frames")
            print(f"mischief: {dict(mischief.done)}; what the rig noted: {dict(events)}")
            lacking = rig.camera.advice() if isinstance(rig.camera, Advising) else ()
            print(f"transport: {'; '.join(lacking) or 'nothing'}")


def parsed() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", type=int, nargs="?", default=10_000, help="how many: 10000")
    parser.add_argument("seed", type=int, nargs="?", default=1, help="of the faults: 1")
    parser.add_argument("between", type=int, nargs="?", default=250, help="captures between two faults: 250")
    return parser.parse_args()


if __name__ == "__main__":
    given = parsed()
    main(given.captures, given.seed, given.between)
