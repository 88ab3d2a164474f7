"""What a trigger by wire brings: frames of a light that is not steady, each at the same place of its period.

    python benchmarks/gige_trigger.py [frames]

The emulated GigE camera on 127.0.0.1 looks at a projector that refreshes 60 times a second and is dark for a part of
each refresh, as one with a colour wheel or pulses of light is. A frame's number is the exact integral of that light
over its exposure. For each kind of trigger and some exposures the scatter of the frames' numbers is printed, in per
cent of their mean; how far the mean is from that of steady light; and the time from asking for a frame to having it.
"""

from __future__ import annotations

import argparse
from statistics import median

import numpy as np

from rig.devices.clock import SystemClock
from rig.devices.genicam.camera import GenicamCamera
from rig.devices.genicam.settings import GenicamOptions
from rig.emulated.gige.camera import EmulatedGigeCamera, GigeRequest, encoded
from rig.emulated.gige.description import EmulatedSensor
from rig.emulated.gige.wire import PulseWire

WIDTH, HEIGHT, REFRESH_HZ, LIT = 64, 48, 60.0, 0.6
"""LIT: share of a refresh in which there is light, from its begin on."""
PERIODS = (0.4, 1.0, 1.5, 2.0, 4.5)
"""Exposures, in refreshes."""
FULL_DN = 3000.0
"""Of steady light."""
CLOCK = SystemClock()


def lit_s(until_s: float) -> float:
    """Seconds of light from 0 on."""
    whole, part = divmod(until_s * REFRESH_HZ, 1.0)
    return (whole * LIT + min(part, LIT)) / REFRESH_HZ


class Flicker:
    """Sees the light's mean over the exposure, and counts frames in the first pixel, as noise would."""

    def __init__(self) -> None:
        self.frames = 0

    def expose(self, request: GigeRequest) -> bytes:
        began_s = CLOCK.now_s()
        ended_s = began_s + request.exposure_s
        CLOCK.wait_until_s(ended_s)
        self.frames += 1
        share = (lit_s(ended_s) - lit_s(began_s)) / request.exposure_s / LIT
        pixels = np.full((*request.shape, 1), round(FULL_DN * share), np.uint16)
        pixels[0, 0] = self.frames % 4096
        return encoded(pixels, request.pixel_format)


def row(trigger: str, periods: float, count: int) -> str:
    camera = GenicamCamera(
        "127.0.0.1",
        shape=(HEIGHT, WIDTH, 1),
        pixel_format="Mono12",
        bit_depth=12,
        frame_rate_hz=30.0 if periods < 2 else 10.0,
        exposure_range_s=(1e-4, 1.0),
        options=GenicamOptions.model_validate({"trigger": trigger}),
        clock=CLOCK,
    )
    camera.open()
    camera.set_exposure(periods / REFRESH_HZ)
    numbers, waits_s, random = [], [], np.random.default_rng(19)
    for k in range(count + 4):
        CLOCK.wait_until_s(CLOCK.now_s() + float(random.uniform(0, 1 / REFRESH_HZ)))
        asked_s = CLOCK.now_s()
        frame = camera.capture(after_s=asked_s, timeout_s=5.0)
        if k >= 4:  # the first ones tie the clocks
            waits_s.append(CLOCK.now_s() - asked_s)
            numbers.append(float(frame.pixels[1, 1, 0]))
    camera.close()
    mean = float(np.mean(numbers))
    off = 100 * (mean / FULL_DN - 1)
    return f"{trigger:9}{periods:10.1f}{100 * np.std(numbers) / mean:12.2f}{off:12.2f}{1e3 * median(waits_s):12.0f}"


def main(count: int) -> None:
    sensor = EmulatedSensor(width_px=WIDTH, height_px=HEIGHT, formats=("Mono12",), exposure_range_s=(1e-4, 1.0))
    wire = PulseWire(REFRESH_HZ, CLOCK)
    print(f"{'trigger':9}{'refreshes':>10}{'scatter, %':>12}{'mean off, %':>12}{'wait, ms':>12}")
    with EmulatedGigeCamera(Flicker(), sensor, wait=lambda _: None, wire=wire):
        for periods in PERIODS:
            for trigger in ("software", "free", "line"):
                print(row(trigger, periods, count), flush=True)


def parsed() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("frames", type=int, nargs="?", default=40, help="of each kind: 40")
    return parser.parse_args()


if __name__ == "__main__":
    main(parsed().frames)
