"""Kill `rig run` at random moments, resume it, and compare every result with an uninterrupted run.

    python benchmarks/kill_and_resume.py --kills 20 --profile ci-tiny

Each session is killed with SIGKILL (or interrupted, with --signal INT) several times before it may end. Then
metrics.json and every file in frames/, maps/, images/ and calibration/ have to be the same bytes as those of a
session of the same name that nobody disturbed; report.html may differ in its times and its date only.
Exit status 0 when all are equal, 1 when not.
"""

from __future__ import annotations

import argparse
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

NAME = "session"
FOLDERS = ("frames", "maps", "images", "calibration")
VOLATILE = (
    re.compile(rb"Written \d{4}-\d\d-\d\d \d\d:\d\d UTC"),
    re.compile(rb'<img class="chart" src="[^"]*" alt="Bar chart of the seconds'),
    # The commands that were typed, with the session's own folder.
    re.compile(rb"<h2>How to repeat it</h2>.*?</section>", re.DOTALL),
)


@dataclass(frozen=True)
class Kill:
    """One interruption: when, and how far the session had come."""

    after_s: float
    exit_status: int
    journal_lines: int
    last_written: str
    said: str


def command(folder: Path, profile: str) -> list[str]:
    return [sys.executable, "-m", "rig", "run", str(folder), "-p", profile, "--json"]


def undisturbed(root: Path, profile: str) -> tuple[Path, float]:
    """A whole session, and how long it took."""
    started_s = time.monotonic()
    folder = root / "undisturbed" / NAME
    subprocess.run(command(folder, profile), check=True, capture_output=True)
    return folder, time.monotonic() - started_s


def kill_once(folder: Path, profile: str, after_s: float, how: signal.Signals) -> Kill | None:
    """Start a run and end it after a while; None when it came to its end before."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a background job's, which its children would inherit
        signal.signal(signal.SIGINT, signal.default_int_handler)
    with subprocess.Popen(command(folder, profile), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        try:
            _, said = run.communicate(timeout=after_s)
            if run.returncode:
                raise RuntimeError(f"the run failed with status {run.returncode}: {said}")
            return None
        except subprocess.TimeoutExpired:
            run.send_signal(how)
            _, said = run.communicate()
    if how == signal.SIGINT and run.returncode != 0 and (run.returncode != 130 or "Traceback" in said):
        raise RuntimeError(f"status {run.returncode} after Ctrl-C: {said}")
    if run.returncode == 0:
        return None
    journal = folder / "journal.jsonl"
    lines = journal.read_bytes().splitlines() if journal.exists() else []
    return Kill(
        after_s=after_s, exit_status=run.returncode, journal_lines=len(lines), last_written=_short(lines), said=said
    )


def _short(lines: list[bytes]) -> str:
    """Step and file of the last complete line of a journal."""
    for line in reversed(lines):
        words = re.findall(rb'"(?:step|name)": "([^"]*)"', line)
        if words:
            return b" ".join(words).decode()
    return "nothing"


def disturbed(
    folder: Path, profile: str, signals: Sequence[signal.Signals], whole_s: float, dice: random.Random
) -> list[Kill]:
    """A session that gets one signal after the other, each in a run of its own, and then may end."""
    made: list[Kill] = []
    for how in signals:
        kill = kill_once(folder, profile, dice.uniform(0.05, 0.9) * whole_s / min(len(signals), 2), how)
        if kill is None:
            break
        made.append(kill)
    subprocess.run(command(folder, profile), check=True, capture_output=True)
    return made


def results(folder: Path) -> dict[str, bytes]:
    """Every file that has to be the same, with its bytes; the volatile parts of the report blanked."""
    files = [p for name in FOLDERS for p in (folder / name).rglob("*") if p.is_file()]
    found = {p.relative_to(folder).as_posix(): p.read_bytes() for p in [*files, folder / "metrics.json"]}
    page = (folder / "report.html").read_bytes()
    for pattern in VOLATILE:
        page = pattern.sub(b"", page)
    return found | {"report.html": page}


def differences(expected: dict[str, bytes], found: dict[str, bytes]) -> list[str]:
    """Names of files that are missing, new, or differ."""
    return [name for name in sorted(expected.keys() | found.keys()) if expected.get(name) != found.get(name)]


def measure(
    profile: str, kills: int, each: int, seed: int, how: signal.Signals = signal.SIGKILL, root: Path | None = None
) -> list[str]:
    """Print a table of all kills; returns what differed."""
    dice = random.Random(seed)
    folder = Path(tempfile.mkdtemp(prefix="kill-and-resume-", dir=root))
    whole, whole_s = undisturbed(folder, profile)
    expected = results(whole)
    print(f"{profile}: {len(expected)} files, {whole_s:.1f} s undisturbed; seed {seed}, {how.name}")
    print("session  kill  after s  status  journal lines  last written")
    wrong: list[str] = []
    done = session = 0
    while done < kills:
        session += 1
        place = folder / f"disturbed-{session}" / NAME
        made = disturbed(place, profile, [how] * min(each, kills - done), whole_s=whole_s, dice=dice)
        for kill in made:
            done += 1
            print(
                f"{session:7d}  {done:4d}  {kill.after_s:7.2f}  {kill.exit_status:6d}  "
                f"{kill.journal_lines:13d}  {kill.last_written}"
            )
        found = differences(expected, results(place))
        left = [str(p) for p in place.rglob("*.part")]
        wrong += [f"session {session}: {name}" for name in found + left]
        print(f"session {session}: {len(found)} of {len(expected)} files differ, {len(left)} .part files", flush=True)
        if not found:
            shutil.rmtree(place.parent)
    if not wrong:
        shutil.rmtree(folder)
    return wrong


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--each", type=int, default=4, help="kills of one session (default 4)")
    parser.add_argument("--profile", default="ci-tiny")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--signal", choices=("KILL", "INT"), default="KILL")
    given = parser.parse_args(arguments)
    wrong = measure(given.profile, given.kills, given.each, seed=given.seed, how=signal.Signals[f"SIG{given.signal}"])
    print("\n".join(wrong) if wrong else f"{given.kills} kills: every resumed session equals the undisturbed one")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
