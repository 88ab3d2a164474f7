"""How many pictures a second a page gets of a camera of 1280 x 960 at 30 Hz, how late, and what it costs the processor.

    python benchmarks/page/preview_rate.py --seconds 15 --pages 1 --stalled 0

The camera is one that has its frames ready (noise and a slope, 12 bits, by default one band): what is measured is the
preview and the server, not a simulated room. Both run as `rig serve` runs them: the preview in a process of its own.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import statistics
import struct
import sys
import tempfile
import threading
import time
from pathlib import Path

import httpx
import numpy as np
import uvicorn

from rig.by_hand import preview as preview_module
from rig.devices.clock import SystemClock
from rig.devices.driver_settings import Devices
from rig.devices.protocols import ExposureRange, RawFrame, Shown
from rig.page.app import make_app
from rig.page.server.guard import GuardSettings

RATE_HZ, SHAPE = 30.0, (960, 1280)
PROFILE = Path(__file__).parents[2] / "hw_profiles" / "ci-tiny.toml"


class ReadyCamera:
    """Gives frames that it has made before, at its pace."""

    full_scale_dn = 4095
    exposure_range_s = ExposureRange(1e-4, 2.0)

    def __init__(self, channels: int) -> None:
        random = np.random.default_rng(1)
        slope = np.linspace(100, 3900, SHAPE[1])[None, :, None]
        self.shape = (*SHAPE, channels)
        self._frames = [np.clip(slope + random.normal(0, 12, self.shape), 0, 4095).astype(np.uint16) for _ in range(6)]
        self._clock, self._number, self._exposure_s = SystemClock(), 0, 0.01

    def open(self) -> None: ...

    def close(self) -> None: ...

    def set_exposure(self, exposure_s: float) -> float:
        self._exposure_s = exposure_s
        return exposure_s

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:  # noqa: ARG002
        started_s = np.ceil(after_s * RATE_HZ) / RATE_HZ
        self._clock.wait_until_s(started_s + self._exposure_s)
        self._number += 1
        return RawFrame(
            pixels=self._frames[self._number % len(self._frames)],
            exposure_s=self._exposure_s,
            started_s=float(started_s),
            sequence=self._number,
        )


class NoProjector:
    """Takes pictures and shows none."""

    shape = (192, 256)

    def open(self) -> None: ...

    def close(self) -> None: ...

    def show(self, codes: np.ndarray, *, name: str) -> Shown:  # noqa: ARG002
        return Shown(time.monotonic(), name)


def worker() -> None:
    """The preview's process, with the camera above in place of the profile's."""
    from rig.page.jobs import worker as jobs
    from rig.page.jobs.wire import Wire

    channels = int(os.environ["BENCH_CHANNELS"])
    preview_module.make_devices = lambda *_, **__: Devices(  # type: ignore[assignment]
        {"camera": ReadyCamera(channels)}, {"projector": NoProjector()}, SystemClock()
    )
    sys.exit(jobs.work(Wire.of_this_process()))


def cpu_s(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def profile_text(channels: int) -> str:
    text = PROFILE.read_text(encoding="utf-8")
    camera, projector, rest = text.partition("[[projector]]")
    camera = camera.replace("width_px = 320", "width_px = 1280").replace("height_px = 240", "height_px = 960")
    return camera.replace("channels = 1", f"channels = {channels}") + projector + rest


async def reader(address: str, name: str, seconds: float, delays: list[float], *, stalled: bool) -> int:
    count = 0
    async with (
        httpx.AsyncClient(timeout=60) as client,
        client.stream("GET", f"{address}/api/frames", params={"client": name}) as stream,
    ):
        end_s, pending = time.monotonic() + seconds, b""
        if stalled:
            await asyncio.sleep(seconds)
            return 0
        async for part in stream.aiter_raw():
            pending += part
            while len(pending) >= 12:
                lengths = struct.unpack(">III", pending[:12])
                if len(pending) < 12 + sum(lengths):
                    break
                facts = json.loads(pending[12 : 12 + lengths[0]])
                delays.append(1e3 * (time.time() - facts["taken_s"]))
                pending, count = pending[12 + sum(lengths) :], count + 1
            if time.monotonic() > end_s:
                break
    return count


async def measure(arguments: argparse.Namespace, address: str, processes: list[int]) -> None:
    headers = {"x-rig-client": "bench"}
    async with httpx.AsyncClient(timeout=60) as client:
        started = await client.post(f"{address}/api/jobs/look", json={"profile": "bench"}, headers=headers)
        started.raise_for_status()
        while (await client.get(f"{address}/api/job")).json()["label"] != "look":
            await asyncio.sleep(0.2)
        process = processes[-1]
        warm: list[float] = []
        await reader(address, "warm", 2.0, warm, stalled=False)
        delays: list[float] = []
        before, begun_s = (cpu_s(process), cpu_s(os.getpid())), time.monotonic()
        counts = await asyncio.gather(
            *(reader(address, f"page{k}", arguments.seconds, delays, stalled=False) for k in range(arguments.pages)),
            *(reader(address, f"stalled{k}", arguments.seconds, [], stalled=True) for k in range(arguments.stalled)),
        )
        elapsed_s = time.monotonic() - begun_s
        after = cpu_s(process), cpu_s(os.getpid())
        await client.post(f"{address}/api/job/stop", json={}, headers=headers)
    rates = [count / elapsed_s for count in counts[: arguments.pages]]
    preview, server = (100 * (b - a) / elapsed_s for a, b in zip(before, after, strict=True))
    print(f"pictures a second: {', '.join(f'{rate:.1f}' for rate in rates)}")
    print(
        f"light to reader: median {statistics.median(delays):.0f} ms, "
        f"95 of 100 below {np.quantile(delays, 0.95):.0f} ms"
    )
    print(f"processor: preview {preview:.1f} % of a core; server, and this script's reading, {server:.1f} %")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--pages", type=int, default=1)
    parser.add_argument("--stalled", type=int, default=0)
    parser.add_argument("--channels", type=int, default=1)
    arguments = parser.parse_args()
    os.environ["BENCH_CHANNELS"] = str(arguments.channels)
    os.environ["BENCH_WORKER"] = "1"
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "profiles").mkdir()
        (root / "profiles" / "bench.toml").write_text(profile_text(arguments.channels), encoding="utf-8")
        started, processes = asyncio.create_subprocess_exec, list[int]()

        async def as_worker(*_: str, **more: object) -> asyncio.subprocess.Process:
            made = await started(sys.executable, __file__, **more)  # type: ignore[arg-type]
            processes.append(made.pid)
            return made

        asyncio.create_subprocess_exec = as_worker  # type: ignore[assignment]
        app = make_app(root, GuardSettings(host="127.0.0.1", port=8799))
        server = uvicorn.Server(uvicorn.Config(app, port=8799, log_level="warning"))
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        while not server.started:
            time.sleep(0.1)  # noqa: TID251 - another thread starts
        asyncio.run(measure(arguments, "http://127.0.0.1:8799", processes))
        server.should_exit = True
        thread.join(10)


if __name__ == "__main__":
    worker() if os.environ.get("BENCH_WORKER") else main()
