"""What a captured frame costs in processor time: our driver, v4l2-ctl and OpenCV on one camera, one after the other.

    python benchmarks/capture_overhead.py platform:vivid-000 --format GREY --size 640x480 --rate 60 --json out.json

Counted is user and system time of the process that captures, start-up left out; what the kernel does elsewhere is not.
In an emulated machine everything is slower by the same factor: there, compare the three, and look at the bare copy,
which is the least that a frame can cost: one pass over its bytes.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np

from rig.devices.clock import SystemClock
from rig.devices.v4l2.abi import fourcc_of
from rig.devices.v4l2.camera import V4l2Camera
from rig.devices.v4l2.find import find_camera
from rig.devices.v4l2.formats import PIXEL_FORMATS


@dataclass(frozen=True)
class Mode:
    device_id: str
    node: Path
    pixel_format: str
    width_px: int
    height_px: int
    rate_hz: float
    frames: int


@dataclass(frozen=True)
class Cost:
    program: str
    frames: int
    rate_hz: float
    cpu_ms_per_frame: float

    @property
    def core_share(self) -> float:
        """Of one processor core, at the rate at which frames came."""
        return self.cpu_ms_per_frame * 1e-3 * self.rate_hz


def cpu_s(whose: int) -> float:
    usage = resource.getrusage(whose)
    return usage.ru_utime + usage.ru_stime


def measured(program: str, frames: int, capture: Callable[[], object]) -> Cost:
    """The cost of taking frames in this process."""
    capture()
    began_s, cpu_began_s = time.monotonic(), cpu_s(resource.RUSAGE_SELF)
    for _ in range(frames):
        capture()
    used_s = cpu_s(resource.RUSAGE_SELF) - cpu_began_s
    return Cost(program, frames, frames / (time.monotonic() - began_s), used_s / frames * 1e3)


def ours(mode: Mode, exposure_range_s: tuple[float, float]) -> Cost:
    camera = V4l2Camera(
        mode.device_id,
        shape=(mode.height_px, mode.width_px, 1),
        pixel_format=mode.pixel_format,
        bit_depth=PIXEL_FORMATS[mode.pixel_format].depths[0],
        frame_rate_hz=mode.rate_hz,
        exposure_range_s=exposure_range_s,
        controls={},
        clock=SystemClock(),
    )
    camera.open()
    try:
        return measured("procam-rig", mode.frames, lambda: camera.capture(after_s=0.0, timeout_s=5.0))
    finally:
        camera.close()


def opencv(mode: Mode) -> Cost:
    capture = cv2.VideoCapture(str(mode.node), cv2.CAP_V4L2)
    code = fourcc_of(mode.pixel_format)
    for key, value in (
        (cv2.CAP_PROP_FOURCC, code),
        (cv2.CAP_PROP_FRAME_WIDTH, mode.width_px),
        (cv2.CAP_PROP_FRAME_HEIGHT, mode.height_px),
        (cv2.CAP_PROP_FPS, mode.rate_hz),
        (cv2.CAP_PROP_CONVERT_RGB, 0),
    ):
        capture.set(key, value)
    if int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF != code:
        raise SystemExit(f"OpenCV does not take {mode.pixel_format} from {mode.node}")
    try:
        return measured("OpenCV VideoCapture", mode.frames, capture.read)
    finally:
        capture.release()


def v4l2_ctl(mode: Mode) -> Cost:
    """Twice: its start-up is what one frame costs."""
    used_s, elapsed_s = [], []
    for frames in (1, mode.frames + 1):
        size = f"--set-fmt-video=width={mode.width_px},height={mode.height_px},pixelformat={mode.pixel_format}"
        command = ["v4l2-ctl", "-d", str(mode.node), size, f"--set-parm={mode.rate_hz:g}", "--stream-mmap=4"]
        began_s, cpu_began_s = time.monotonic(), cpu_s(resource.RUSAGE_CHILDREN)
        subprocess.run([*command, f"--stream-count={frames}"], check=True, capture_output=True)
        used_s.append(cpu_s(resource.RUSAGE_CHILDREN) - cpu_began_s)
        elapsed_s.append(time.monotonic() - began_s)
    return Cost(
        "v4l2-ctl (does not read the pixels)",
        mode.frames,
        mode.frames / (elapsed_s[1] - elapsed_s[0]),
        (used_s[1] - used_s[0]) / mode.frames * 1e3,
    )


def bare_copy(mode: Mode) -> Cost:
    frame = np.zeros((mode.height_px, mode.width_px), np.uint8)
    return measured("(numpy: one pass from 8 to 16 bits)", mode.frames, lambda: frame.astype(np.uint16))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("device_id")
    parser.add_argument("--format", default="GREY")
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--rate", type=float, default=30.0)
    parser.add_argument(
        "--exposures", type=float, nargs=2, help="default: the frame period, for cameras without control"
    )
    parser.add_argument("--frames", type=int, default=150)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    width_px, height_px = map(int, given.size.split("x"))
    node = find_camera(given.device_id).node
    mode = Mode(
        device_id=given.device_id,
        node=node,
        pixel_format=given.format,
        width_px=width_px,
        height_px=height_px,
        rate_hz=given.rate,
        frames=given.frames,
    )
    exposures = tuple(given.exposures or (1 / given.rate, 1 / given.rate))
    costs = [ours(mode, exposures), v4l2_ctl(mode), opencv(mode), bare_copy(mode)]
    print(f"{given.format} {given.size} at {given.rate:g} Hz, {given.frames} frames, load {os.getloadavg()[0]:.1f}")
    print(f"{'program':38} {'frames/s':>9} {'CPU ms/frame':>13} {'of a core':>10}")
    for cost in costs:
        print(f"{cost.program:38} {cost.rate_hz:9.1f} {cost.cpu_ms_per_frame:13.3f} {cost.core_share:10.1%}")
    if given.json:
        points = [{**asdict(cost), "core_share": cost.core_share} for cost in costs]
        given.json.write_text(json.dumps({"mode": given.size, "format": given.format, "costs": points}, indent=1))


if __name__ == "__main__":
    main()
