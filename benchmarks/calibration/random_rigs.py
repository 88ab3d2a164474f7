"""Whole sessions on random simulated rigs: how far from the truth calibration ends, as a distribution.

    python benchmarks/calibration/random_rigs.py --rigs 40 --seed 1 --jobs 2
    python benchmarks/calibration/random_rigs.py --kind tiny --rigs 100    # ci-tiny, other noise, 8 or 12 bits
    python benchmarks/calibration/random_rigs.py --kind small --rigs 100   # camera 320x240, projector 256x192
    python benchmarks/calibration/random_rigs.py --write FOLDER --rigs 5   # only the profiles, for `rig run`
    python benchmarks/calibration/session_coverage.py FOLDER             # of kept sessions: are their sigmas true?

Rooms of 2.5 to 7 m, reflectance 0.3 to 0.85, fields of view of 45 to 100 degrees, blur of 0.2 to 1.2 px, contrast of
200 to 5000, 8 to 12 bits, posters, room light up to 0.05 that may flicker, lens shift up to 0.6 of the height, a tape
true to 0.3 %. Prints a line a rig, and every figure that random rigs are held to beside its bar; `--json` writes them.
What perfect knowledge of the room would make of the same target is photographed, too, unless `--no-oracle`. A refusal
is held against what the simulated world knows: which walls are lit and seen, and whether the tape's spots are.
`--effects` adds blur that grows to the corners, a lamp that warms up, a tone curve, only 8 bits, frames
that come as JPEG of quality 75 to 95.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from random_profiles import EFFECTS, KINDS, profile_of
from rig_figures import RigOutcome, as_json, table
from rig_truth import is_refusal_true, seen_of, with_what_is_left_open
from session_coverage import judgement

from rig.errors import RigError
from rig.profile.schema import Profile


@dataclass(frozen=True)
class Finished:
    """A process that ended."""

    status: int
    out: str
    err: str
    processor_s: float

    @property
    def answer(self) -> dict[str, Any]:
        """What it printed as JSON; empty where it did not."""
        return json.loads(self.out) if self.out.strip().startswith("{") else {}

    @property
    def said(self) -> str:
        """Its error, in its own words; of a crash the last of them."""
        lines = [line.removeprefix("rig: ") for line in self.err.splitlines() if line.startswith("rig: ")]
        last = (self.err.strip().splitlines() or [f"ended with {self.status}"])[-1]
        return (lines or [last])[0] if self.status else ""


def rig_command(arguments: Sequence[str]) -> Finished:
    """Run `rig`, and count its processor time."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        process = subprocess.Popen([sys.executable, "-m", "rig", *arguments], stdout=out, stderr=err)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        err.seek(0)
        return Finished(process.returncode, out.read(), err.read(), used.ru_utime + used.ru_stime)


def run(path: Path, session: Path, strategies: Sequence[str], *, oracle: bool) -> RigOutcome:
    """Run a session on one rig, and compare it with the rig's world."""
    done = rig_command(["run", str(session), "-p", str(path), "--json", "--strategies", ",".join(strategies)])
    profile = Profile.parse(path.read_bytes(), path)
    seen, has_ended = seen_of(profile), "comparison" in done.answer
    said = "" if has_ended else done.said
    if said and seen is not None:
        seen = with_what_is_left_open(seen, profile)
    outcome = RigOutcome(
        rig=path.stem,
        status=done.status,
        processor_s=done.processor_s,
        said=said,
        is_refusal_true=is_refusal_true(said, seen) if said else None,
        seen=None if seen is None else asdict(seen) | {"planes": seen.planes},
    )
    if not has_ended:
        return outcome
    known = _known(session, "bounded" in strategies and oracle)
    return _judged(outcome, done.answer, session, known)


def _known(session: Path, wanted: bool) -> Finished | None:
    """Photograph what perfect knowledge gives, and the same strategy by the session's model beside it."""
    if not wanted:
        return None
    shown = ["--strategies", "bounded", "--loop", "bounded", "--captures", "1", "--only-target"]
    return rig_command(["compare-strategies", str(session), *shown, "--oracle", "--json"])


def _judged(outcome: RigOutcome, answer: dict[str, Any], session: Path, known: Finished | None) -> RigOutcome:
    compared, truth = answer["comparison"], answer["truth"]
    figures = {key: compared[key] for key in ("rmse", "noise_rms", "sigma_rms", "within_3_sigma", "bias")}
    names = ("direct_bias_percent", "global_bias_percent", "camera_position_mm", "surface_median_mm", "focal_percent")
    figures |= {key: truth[key] for key in names}
    figures |= {"reflectance": truth["reflectance_rmse_lit_and_seen"], "reflectance_all": truth["reflectance_rmse"]}
    ratio = None if known is None else known.answer.get("ratios", {}).get("bounded / oracle")
    if ratio is not None:
        figures["over_oracle"] = ratio
    oracle_s = 0.0 if known is None else known.processor_s
    judged = {
        "figures": figures,
        "within_limits": answer["within_limits"],
        "unmet": tuple(limit["what"] for limit in answer["limits"] if not limit["met"]),
        "said": "",
        "is_refusal_true": None,
        "processor_s": outcome.processor_s + oracle_s,
        "oracle_processor_s": oracle_s,
    }
    try:
        coverage = judgement(session)
        judged |= {
            "sigmas_off": {key: float(score) for key, score in coverage.geometry.sigmas_off.items()},
            "response_sigmas_off": tuple(coverage.response_sigmas),
            "share_off": float(coverage.geometry.share_off),
        }
    except RigError as error:
        print(f"{outcome.rig}: sigmas not compared: {error}", file=sys.stderr)
    return RigOutcome(**(asdict(outcome) | judged))


def main() -> int:
    """Write profiles, or run them and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", choices=KINDS, default="random")
    parser.add_argument("--rigs", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1, help="of the first rig; the others follow")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--effects", nargs="*", choices=EFFECTS, default=[])
    parser.add_argument("--strategies", nargs="*", default=["none", "bounded"])
    parser.add_argument("--no-oracle", action="store_true", help="a third quicker: perfect knowledge is not shown")
    parser.add_argument("--write", type=Path, help="only write the profiles there")
    parser.add_argument("--keep", type=Path, help="keep the sessions there")
    parser.add_argument("--json", type=Path, help="all results; written after every rig")
    wanted = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(wanted.jobs) as executor:
        folder = wanted.write or wanted.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        profiles = []
        for seed in range(wanted.seed, wanted.seed + wanted.rigs):
            profiles.append(folder / f"{wanted.kind}-{seed}.toml")
            profiles[-1].write_text(profile_of(wanted.kind, seed, wanted.effects), encoding="utf-8")
        if wanted.write:
            return 0
        one = partial(run, strategies=wanted.strategies, oracle=not wanted.no_oracle)
        found: list[RigOutcome] = []
        for outcome in executor.map(lambda path: one(path, path.with_suffix("")), profiles):
            found.append(outcome)
            print(f"{len(found)} of {len(profiles)}: {outcome.rig}: {outcome.said or 'ended'}", file=sys.stderr)
            if wanted.json:
                wanted.json.write_text(json.dumps(as_json(found), indent=1), encoding="utf-8")
    print(table(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
