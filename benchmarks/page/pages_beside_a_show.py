"""Whether open pages disturb a show: late pictures without pages and with eight, three of which read nothing.

    python benchmarks/page/pages_beside_a_show.py --seconds 20 --rounds 3

`rig serve` and its show run as they always do, on a simulated display of 60 Hz that keeps the machine's time. Rounds
without and with pages take turns, so that what else the machine does falls on both.
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import httpx

READING, STALLED = 5, 3
HEADERS = {"x-rig-client": "bench"}


def cpu_s(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def pages(stack: ExitStack, port: int) -> None:
    """Open pictures and events as a page does; those that read do so in threads."""
    for k in range(READING + STALLED):
        for path in (f"frames?client=page{k}", "events"):
            one = stack.enter_context(socket.create_connection(("127.0.0.1", port), 20))
            one.sendall(f"GET /api/{path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
            if k < READING:
                threading.Thread(target=read, args=(one,), daemon=True).start()


def read(connection: socket.socket) -> None:
    try:
        while connection.recv(1 << 16):
            pass
    except OSError:
        return


def state(address: str) -> dict[str, float]:
    found: dict[str, float] = httpx.get(f"{address}api/job", timeout=20).json()["state"]
    return found


def measure(address: str, server: int, seconds: float) -> tuple[int, int, float, float]:
    """Pictures, late ones, and the share of a core that show and server take."""
    show = int(Path(f"/proc/{server}/task/{server}/children").read_text(encoding="ascii").split()[0])
    before, begun_s, used = state(address), time.monotonic(), (cpu_s(show), cpu_s(server))
    time.sleep(seconds)  # noqa: TID251 - other processes work
    after, lasted_s = state(address), time.monotonic() - begun_s
    shares = [(cpu_s(process) - past) / lasted_s for process, past in zip((show, server), used, strict=True)]
    return int(after["frames"] - before["frames"]), int(after["late"] - before["late"]), shares[0], shares[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "rig", "serve", folder, "--port", "0"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
            address = (server.stdout.readline() if server.stdout else "").strip()
            try:
                compare(address, server.pid, asked)
            finally:
                server.terminate()


def compare(address: str, server: int, asked: argparse.Namespace) -> None:
    httpx.post(f"{address}api/jobs/show", json={"profile": "ci-tiny"}, headers=HEADERS, timeout=60).raise_for_status()
    while state(address).get("frames", 0) < 300:
        time.sleep(0.5)  # noqa: TID251 - other processes work
    found: dict[bool, list[tuple[int, int, float, float]]] = {False: [], True: []}
    for k in range(2 * asked.rounds):
        with ExitStack() as stack:
            if k % 2:
                pages(stack, int(address.rsplit(":", 1)[1].rstrip("/")))
            found[k % 2 == 1].append(measure(address, server, asked.seconds))
    for with_pages, rows in found.items():
        frames, late = (sum(row[k] for row in rows) for k in (0, 1))
        show, serving = (sum(row[k] for row in rows) / len(rows) for k in (2, 3))
        title = f"{READING} pages that read, {STALLED} that do not" if with_pages else "no page"
        on_time = 100 * (1 - late / max(frames, 1))
        print(
            f"{title}: {frames} pictures, {late} late, {on_time:.3f} % on time; "
            f"show {100 * show:.1f} %, server {100 * serving:.1f} % of a core"
        )


if __name__ == "__main__":
    main()
