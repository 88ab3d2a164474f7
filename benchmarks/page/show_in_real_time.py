"""A kept show of `rig serve` in real time with a fault a minute: no crash, black when it cannot show, back in 10 s.

    nice python benchmarks/page/show_in_real_time.py --minutes 30 --seed 18

Server and show run in processes of their own, as `rig serve --show` has them; only the display and the camera that
films are stand-ins, whose plugs are files. In the first half a film of 3 s is shown again and again, in the second a
camera. Faults: output away, film away, film of garbage, camera away (8 to 20 s each), the show's process killed, and a
flood of pages (300 connections, of which 30 ask for pictures and read none).
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import httpx
import numpy as np

FILM_S, RATE_HZ, SHAPE = 3.0, 30.0, (240, 320)
BACK_S, LATE_S, GROWTH_MB = 10.0, 5.0, 8.0
"""A film that is away is shown to its end: 3 s, and what was read ahead."""
KINDS = {
    "film": ("output", "film away", "film broken", "killed", "flood"),
    "camera": ("output", "camera", "killed", "flood"),
}
ROLE, FOLDER = "SOAK_ROLE", "SOAK_FOLDER"


def serve() -> None:
    """`rig serve --show`, whose show runs with the stand-ins."""
    from rig.page.serve import ServeRequest, serve_page

    started = asyncio.create_subprocess_exec

    async def as_worker(*_: str, **more: object) -> asyncio.subprocess.Process:
        return await started(sys.executable, __file__, **{**more, "env": {**os.environ, ROLE: "show"}})  # type: ignore[arg-type]

    asyncio.create_subprocess_exec = as_worker  # type: ignore[assignment]
    root = Path(os.environ[FOLDER])
    serve_page(ServeRequest(root=root, port=0, show="soak"), lambda address: print(address, flush=True))


def show() -> None:
    """The show's process, with a display and a camera whose plugs are files."""
    from rig.devices.protocols import ExposureRange, RawFrame
    from rig.devices.simulated import display
    from rig.errors import DeviceLost
    from rig.live import pipeline
    from rig.live.sources import camera
    from rig.page.jobs import worker
    from rig.page.jobs.wire import Wire

    folder = Path(os.environ[FOLDER])
    seen = (folder / "seen").open("a", buffering=1)

    class Display(display.ClockedDisplay):
        told_s = 0.0

        @property
        def is_plugged(self) -> bool:
            return not (folder / "output-away").exists()

        @is_plugged.setter
        def is_plugged(self, _: bool) -> None: ...

        def show(self, codes: np.ndarray, *, name: str) -> object:
            shown = super().show(codes, name=name)
            now_s = time.monotonic()
            if codes.max() > 0 and now_s - self.told_s > 0.1:
                self.told_s = now_s
                seen.write(f"{now_s}\n")
            return shown

    class Camera:
        full_scale_dn, shape, exposure_range_s = 255, (*SHAPE, 3), ExposureRange(1e-4, 1.0)
        number = 0
        pixels = np.full((*SHAPE, 3), 180, np.uint8)

        def open(self) -> None:
            if (folder / "camera-away").exists():
                raise DeviceLost("the soak test's camera is away")

        def close(self) -> None: ...

        def capture(self, **_: float) -> RawFrame:
            self.open()
            time.sleep(1 / RATE_HZ)  # noqa: TID251 - a camera's own time
            self.number += 1
            return RawFrame(pixels=self.pixels, exposure_s=0.01, started_s=time.monotonic(), sequence=self.number)

    pipeline.ClockedDisplay = Display  # type: ignore[misc,assignment]
    camera.best_camera = lambda *_: Camera()  # type: ignore[assignment,return-value]
    sys.exit(worker.work(Wire.of_this_process()))


@dataclass
class Watch:
    """What the show did, minute by minute."""

    address: str
    server: int
    folder: Path
    random: np.random.Generator
    wrong: list[str] = field(default_factory=list)
    backs_s: list[float] = field(default_factory=list)
    memory_mb: list[tuple[float, float]] = field(default_factory=list)

    def get(self, path: str) -> dict[str, object]:
        found: dict[str, object] = httpx.get(self.address + path, timeout=20).json()
        return found

    def post(self, path: str) -> None:
        httpx.post(self.address + path, json={}, headers={"x-rig-client": "soak"}, timeout=60).raise_for_status()

    def show(self) -> int | None:
        """The id of the show's process."""
        children = Path(f"/proc/{self.server}/task/{self.server}/children").read_text(encoding="ascii").split()
        return int(children[0]) if children else None

    def bright_s(self, after_s: float) -> float:
        """When the first picture that was not black came after a time."""
        times = [float(line) for line in (self.folder / "seen").read_text(encoding="ascii").splitlines()]
        return next((one for one in times if one > after_s), math.inf)

    def minute(self, kind: str, end_s: float) -> None:
        begun_s = time.monotonic()
        lasts_s = float(self.random.uniform(8, 20))
        self._fault(kind, lasts_s)
        over_s = time.monotonic()
        if (
            kind in ("film away", "film broken", "camera", "output")
            and begun_s + LATE_S < self.bright_s(begun_s + LATE_S) < over_s
        ):
            self.wrong.append(f"{kind}: a picture while there was none")
        while (back_s := self.bright_s(over_s) - over_s) == math.inf and time.monotonic() < over_s + 4 * BACK_S:
            time.sleep(0.2)  # noqa: TID251 - other processes work
        self.backs_s.append(back_s)
        if back_s > BACK_S:
            self.wrong.append(f"{kind}: back only after {back_s:.1f} s")
        time.sleep(max(end_s - time.monotonic(), 0))  # noqa: TID251 - other processes work
        health, process = self.get("health"), self.show()
        shown_mb = resident_mb(process) if process else math.nan
        self.memory_mb.append((float(str(health["memory_mb"])), shown_mb))
        print(
            f"{kind:12} {lasts_s:5.1f} s, back after {back_s:5.2f} s; "
            f"server {health['memory_mb']} MB, show {shown_mb:.1f} MB",
            flush=True,
        )

    def _fault(self, kind: str, lasts_s: float) -> None:
        film = self.folder / "uploads" / "film.mp4"
        aside = self.folder / "film.aside"
        if kind == "killed":
            process = self.show()
            if process:
                os.kill(process, signal.SIGKILL)
            return
        if kind == "flood":
            self._flood(lasts_s)
            return
        plug = self.folder / f"{kind}-away"
        if kind.startswith("film"):
            film.rename(aside)
            if kind == "film broken":
                film.write_bytes(self.random.bytes(200_000))
        else:
            plug.touch()
        time.sleep(lasts_s)  # noqa: TID251 - other processes work
        if kind.startswith("film"):
            aside.replace(film)
        else:
            plug.unlink()

    def _flood(self, lasts_s: float) -> None:
        port = int(self.address.rsplit(":", 1)[1].rstrip("/"))
        with ExitStack() as stack:
            for k in range(300):
                one = stack.enter_context(socket.create_connection(("127.0.0.1", port), 20))
                if k < 30:
                    one.sendall(f"GET /api/frames?client=flood{k} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
            end_s = time.monotonic() + lasts_s
            while time.monotonic() < end_s:
                self.get("api/state")


def resident_mb(process: int) -> float:
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def write_film(path: Path) -> None:
    film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, SHAPE[::-1])
    for k in range(int(FILM_S * RATE_HZ)):
        film.write(np.full((*SHAPE, 3), 120 + k, np.uint8))
    film.release()


def write_show(folder: Path, source: str) -> None:
    (folder / "shows").mkdir(exist_ok=True)
    text = f'profile = "ci-tiny"\nsources = ["{source}"]\n'
    (folder / "shows" / "soak.toml").write_text(text, encoding="utf-8")


def soak(folder: Path, minutes: int, seed: int) -> list[str]:
    (folder / "uploads").mkdir()
    (folder / "seen").touch()
    write_film(folder / "uploads" / "film.mp4")
    write_show(folder, "../uploads/film.mp4")
    environment = {**os.environ, ROLE: "server", FOLDER: str(folder)}
    with subprocess.Popen([sys.executable, __file__], stdout=subprocess.PIPE, text=True, env=environment) as server:
        address = (server.stdout.readline() if server.stdout else "").strip()
        watch = Watch(address, server.pid, folder, np.random.default_rng(seed))
        try:
            _follow(watch, folder, minutes)
        finally:
            server.terminate()
            server.wait(60)
    quarter = len(watch.memory_mb) // 4
    first, last = np.array(watch.memory_mb[quarter : 2 * quarter + 1]), np.array(watch.memory_mb[-quarter - 1 :])
    grown = np.nanmedian(last, axis=0) - np.nanmedian(first, axis=0)
    restarts = watch.memory_mb and json.dumps([round(float(one), 1) for one in grown])
    print(f"{minutes} faults; back after {max(watch.backs_s):.1f} s at most; server and show grew by {restarts} MB")
    if server.returncode not in (0, -signal.SIGTERM):
        watch.wrong.append(f"the server ended with {server.returncode}")
    return watch.wrong + [f"memory grew by {one:.1f} MB" for one in grown if one > GROWTH_MB]


def _follow(watch: Watch, folder: Path, minutes: int) -> None:
    while watch.bright_s(0) == math.inf:
        time.sleep(0.2)  # noqa: TID251 - other processes work
    begun_s, half = time.monotonic(), max(minutes // 2, 1)
    for k in range(minutes):
        if k == half:
            write_show(folder, "camera:soak")
            watch.post("api/shows/soak/keep")
            time.sleep(10)  # noqa: TID251 - the show begins again
        kinds = KINDS["film" if k < half else "camera"]
        watch.minute(kinds[k % len(kinds)], begun_s + 60 * (k + 1))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=int, default=30)
    parser.add_argument("--seed", type=int, default=18)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        wrong = soak(Path(folder), asked.minutes, asked.seed)
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    {"server": serve, "show": show}.get(os.environ.get(ROLE, ""), lambda: sys.exit(main()))()
