"""Whole sessions in the worlds of the library, sim-furnished with one line changed: errors, surface, compensation.

    python benchmarks/calibration/library_worlds.py
    python benchmarks/calibration/library_worlds.py glossy gain-screen --photographs 32

Each line: rms of measured against simulated pictures and its noise [grey levels], share within 3 sigma, error of the
surface that is seen [% of the distance], and mean error of `bounded` over that of the uncompensated picture at its
best gain.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
from random_rigs import rig_command
from random_worlds import PROFILE, rewritten

WORLDS = ("furnished", "cylinder", "dome", "relief", "l-room", "glossy", "gain-screen")

SHOWN = ("--strategies", "none,bounded", "--loop", "none", "--only-target")


def profile_of(world: str, photographs: int, seed: int) -> str:
    """Return sim-furnished's text for another world."""
    lines = {
        r'(?m)^name = "sim-furnished"': f'name = "sim-{world}"',
        r'(?m)^scene = "furnished"': f'scene = "{world}"',
        r"(?m)^seed = 20141": f"seed = {seed}",
    }
    text = rewritten(PROFILE.read_text("utf-8"), lines)
    return text + (f"\n[transport]\nphotographs = {photographs}\n" if photographs else "")


def line(world: str, answer: dict[str, Any], shown: dict[str, Any]) -> str:
    """What a session in this world found, as a row."""
    compared, truth = answer["comparison"], answer["truth"]
    measured = {row["strategy"]: row["measured"] for row in shown["pictures"][0]["rows"]}
    ratio = measured["bounded"]["mean"] / measured["none"]["mean_at_best_gain"]
    surface = ", ".join(
        "-" if truth[key] is None else f"{truth[key]:.3f}" for key in ("surface_median_percent", "surface_p95_percent")
    )
    unmet = "; ".join(limit["what"] for limit in answer["limits"] if not limit["met"])
    errors = f"{compared['rmse']:.2f} ({compared['noise_rms']:.2f}) | {compared['within_3_sigma']:.3f}"
    return f"| {world} | {errors} | {surface} | {ratio:.3f} | {unmet or 'within limits'} |"


def main() -> int:
    """Run the sessions; exit status 1 where one is refused or outside its limits."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="*", metavar="WORLD", help=f"all without: {', '.join(WORLDS)}")
    parser.add_argument("--photographs", type=int, default=0, help="that teach the model of the room's light, at most")
    parser.add_argument("--seed", type=int, default=20141, help="of noise and texture")
    parser.add_argument("--keep", type=Path, help="keep the sessions there")
    wanted = parser.parse_args()
    print("| world | rms (noise) | within 3 sigma | surface median, p95, % | bounded | limits |")
    print("|---|---|---|---|---|---|", flush=True)
    failed = 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = wanted.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        for world in wanted.worlds or WORLDS:
            path = folder / f"{world}.toml"
            path.write_text(profile_of(world, wanted.photographs, wanted.seed), encoding="utf-8")
            session = str(path.with_suffix(""))
            done = rig_command(["run", session, "-p", str(path), "--json", "--strategies", "none,bounded"])
            failed += done.status != 0
            if "comparison" not in done.answer:
                print(f"| {world} | refused: {done.said} |", flush=True)
                continue
            shown = rig_command(["compare-strategies", session, *SHOWN, "--json"])
            print(line(world, done.answer, shown.answer), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
