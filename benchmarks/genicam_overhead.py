"""What a GigE camera costs above its library, and what a trigger saves: 1280 x 960, Mono12, 30 frames a second.

    python benchmarks/genicam_overhead.py [seconds]

The camera is served by a process of its own on 127.0.0.1. Printed are the processor time of a second of streaming, as a
share of one core, by Aravis alone (buffers taken and given back) and by the driver (frames judged and decoded), and the
time from asking for a frame to having it, with a software trigger and without.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
from statistics import median

import numpy as np

from rig.devices.clock import SystemClock
from rig.devices.genicam.camera import GenicamCamera
from rig.devices.genicam.settings import GenicamOptions
from rig.emulated.gige.camera import EmulatedGigeCamera, GigeRequest
from rig.emulated.gige.description import EmulatedSensor

WIDTH, HEIGHT, RATE_HZ, EXPOSURE_S = 1280, 960, 30.0, 0.005
CLOCK = SystemClock()


class Pictures:
    """A few noisy pictures again and again, made beforehand."""

    def __init__(self) -> None:
        rng = np.random.default_rng(1)
        self.data = [rng.integers(0, 4096, WIDTH * HEIGHT).astype("<u2").tobytes() for _ in range(4)]
        self.count = 0

    def expose(self, request: GigeRequest) -> bytes:
        CLOCK.wait_until_s(CLOCK.now_s() + request.exposure_s)
        self.count += 1
        return self.data[self.count % len(self.data)]


def serve() -> None:
    sensor = EmulatedSensor(width_px=WIDTH, height_px=HEIGHT, formats=("Mono12",), exposure_range_s=(1e-4, 1.0))
    with EmulatedGigeCamera(Pictures(), sensor, wait=lambda _: None):
        print("ready", flush=True)
        sys.stdin.readline()


def camera_of(trigger: str) -> GenicamCamera:
    camera = GenicamCamera(
        "127.0.0.1",
        shape=(HEIGHT, WIDTH, 1),
        pixel_format="Mono12",
        bit_depth=12,
        frame_rate_hz=RATE_HZ,
        exposure_range_s=(1e-4, 1.0),
        options=GenicamOptions.model_validate({"trigger": trigger}),
        clock=CLOCK,
    )
    camera.open()
    camera.set_exposure(EXPOSURE_S)
    return camera


def cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def shares(seconds: float) -> tuple[float, float, float]:
    """Of one core: Aravis alone, the driver, and frames a second that the driver had."""
    camera = camera_of("free")
    stream = camera.stream
    found = []
    for judged in (False, True):
        stream.drop_waiting()
        began_s, before_s, frames = CLOCK.now_s(), cpu_s(), 0
        while CLOCK.now_s() < began_s + seconds:
            if judged:
                camera.capture(after_s=0.0, timeout_s=2.0)
            elif (filled := stream.next(CLOCK.now_s() + 2.0)) is not None:
                stream.give_back(filled)
            frames += 1
        elapsed_s = CLOCK.now_s() - began_s
        found.append((cpu_s() - before_s) / elapsed_s)
    camera.close()
    return found[0], found[1], frames / elapsed_s


def waits_s(trigger: str, count: int = 40) -> list[float]:
    camera, found = camera_of(trigger), []
    for _ in range(count):
        asked_s = CLOCK.now_s()
        camera.capture(after_s=asked_s, timeout_s=5.0)
        found.append(CLOCK.now_s() - asked_s)
    camera.close()
    return found


def main(seconds: float) -> None:
    command = [sys.executable, __file__, "serve"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        if server.stdout is not None:
            server.stdout.readline()
        alone, driver, rate_hz = shares(seconds)
        print(f"{WIDTH} x {HEIGHT} Mono12 at {rate_hz:.1f} frames/s: Aravis {100 * alone:.1f} % of a core, ", end="")
        print(f"driver {100 * driver:.1f} %, above it {100 * (driver - alone):.1f} %")
        for trigger in ("software", "free"):
            waits = waits_s(trigger)
            usual_ms, most_ms = 1e3 * median(waits), 1e3 * max(waits)
            print(f"{trigger}: a frame after {usual_ms:.1f} ms (median), {most_ms:.1f} ms at most, ", end="")
            print(f"exposure {1e3 * EXPOSURE_S:g} ms")
        server.communicate("quit\n")


def parsed() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seconds", type=float, nargs="?", default=5.0, help="of streaming: 5")
    return parser.parse_args()


if __name__ == "__main__":
    serve() if sys.argv[1:] == ["serve"] else main(parsed().seconds)
