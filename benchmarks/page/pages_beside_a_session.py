"""Whether open pages disturb a session's captures: intervals between photographs without pages and with eight.

    python benchmarks/page/pages_beside_a_session.py --rounds 2

`rig serve` runs a session on the emulated GigE camera, which is triggered over its real protocol and goes by the
machine's clock; it is stopped when its Gray code is photographed. Rounds without and with pages take turns; three of
the eight pages read nothing. What is counted is in the session's journal: when each exposure began; and frames that
were refused. Nothing but `rig virtual --kind gige` may be at the address of loopback meanwhile.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import httpx
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from pages_beside_a_show import HEADERS, READING, STALLED, cpu_s, pages

PROFILE = Path(__file__).parents[2] / "hw_profiles" / "emulated-gige.toml"
STEPS = ("exposure", "response", "gray")
Photographs = dict[str, list[float]]


def photographs(folder: Path) -> Photographs:
    """When each photograph of each step began. [s]."""
    found: Photographs = {}
    journal = folder / "journal.jsonl"
    for line in journal.read_text(encoding="utf-8").splitlines() if journal.exists() else []:
        event = json.loads(line)
        if event["event"] == "frame":
            found.setdefault(event["step"], []).append(event["frame"]["started_s"])
    return found


def session(address: str, root: Path, name: str) -> tuple[Photographs, int]:
    """Run a session until its code is photographed; returns its photographs and how many frames were refused."""
    asked = {"session": name, "profile": "gige", "target": "default"}
    httpx.post(f"{address}api/jobs/run", json=asked, headers=HEADERS, timeout=60).raise_for_status()
    while not set(photographs(root / name)) - set(STEPS):
        job = httpx.get(f"{address}api/job", timeout=20).json()
        if job["phase"] not in ("running", "done"):
            raise SystemExit(f"the session ended: {job['error']}")
        time.sleep(0.5)  # noqa: TID251 - other processes work
    ended = httpx.post(f"{address}api/job/stop", json={}, headers=HEADERS, timeout=120).json()
    taken = photographs(root / name)
    return {step: taken[step] for step in STEPS if step in taken}, len(ended["faults"])


def compare(address: str, server: int, root: Path, rounds: int) -> None:
    port = int(address.rsplit(":", 1)[1].rstrip("/"))
    intervals: dict[bool, list[float]] = {False: [], True: []}
    refused, served_s = {False: 0, True: 0}, {False: 0.0, True: 0.0}
    for k in range(2 * rounds):
        with ExitStack() as stack:
            if k % 2:
                pages(stack, port)
            used_s = cpu_s(server)
            taken, faults = session(address, root, f"round-{k}")
            served_s[k % 2 == 1] += cpu_s(server) - used_s
        refused[k % 2 == 1] += faults
        for times_s in taken.values():
            intervals[k % 2 == 1] += np.diff(times_s).tolist()
    for with_pages, found in intervals.items():
        title = f"{READING} pages that read, {STALLED} that do not" if with_pages else "no page"
        median, late = 1e3 * np.percentile(found, (50, 95))
        print(
            f"{title}: {len(found)} intervals, median {median:.1f} ms, 95 of 100 below {late:.1f} ms; "
            f"{refused[with_pages]} frames refused; server {served_s[with_pages]:.2f} s of a processor"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=2)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        root = Path(folder)
        (root / "profiles").mkdir()
        (root / "profiles" / "gige.toml").write_text(PROFILE.read_text(encoding="utf-8"), encoding="utf-8")
        virtual = (sys.executable, "-m", "rig", "virtual", "--kind", "gige")
        pipe = subprocess.PIPE
        camera = stack.enter_context(subprocess.Popen(virtual, stdin=pipe, stdout=pipe, text=True))
        stack.callback(camera.terminate)
        if camera.stdout is None or not camera.stdout.readline():
            raise SystemExit("the virtual camera did not start")
        command = [sys.executable, "-m", "rig", "serve", folder, "--port", "0"]
        server = stack.enter_context(subprocess.Popen(command, stdout=pipe, text=True))
        stack.callback(server.terminate)
        address = (server.stdout.readline() if server.stdout else "").strip()
        compare(address, server.pid, root, asked.rounds)


if __name__ == "__main__":
    main()
