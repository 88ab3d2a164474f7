"""Sessions on the smallest simulated rig with a few lines of its profile changed by chance, as people change theirs.

    python benchmarks/calibration/varied_profiles.py --seeds 1-20 --work FOLDER

Random rigs vary the room and the lenses; this varies all else: bit depths and tone curves, codes, checks, levels,
exposures, light too bright or too dark, wrong data sheets and tapes, frames that are late or lost. A line a session:
what was changed, whether it ended within its limits, how far it is from the truth, or why it was refused. Nothing may
end in a traceback, nor within its limits and far from the truth; whether a refusal names the true cause a person has to
read.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PROFILE = Path(__file__).parents[2] / "hw_profiles" / "ci-tiny.toml"
CAMERA, PROJECTOR, SCALE = "[camera]", "[projector]", "[scale]"
SEEN, SHOWN = "[simulation.camera]", "[simulation.projector]"


@dataclass(frozen=True)
class Change:
    """Lines of one table that are set together, with the values to choose from: a tuple of them for several keys."""

    table: str
    keys: tuple[str, ...]
    values: tuple[Any, ...]


def _one(table: str, key: str, *values: Any) -> Change:
    return Change(table, (key,), tuple((value,) for value in values))


CHANGES = (
    _one(SEEN, "tone", "srgb", 1.8, 2.2, 2.4),
    _one(SEEN, "blur_px", 0.15, 0.8, 1.5),
    _one(SEEN, "vignetting", [-0.5, 0.0], [0.0, 0.0]),
    _one(SEEN, "sensitivity_e_per_s", 5e4, 3e5, 4e6, 3e7),
    _one(SEEN, "full_well_e", 5000.0, 100000.0),
    _one(SEEN, "read_noise_e", 1.0, 40.0),
    _one(SEEN, "stale_frame_rate", 0.2),
    _one(SEEN, "dropped_frame_rate", 0.1),
    _one(SEEN, "readout_s", 0.02),
    _one(SEEN, "pipeline_frames", 1, 2),
    _one(SHOWN, "blur_px", 0.15, 1.0, 2.0),
    _one(SHOWN, "vignetting", [-0.4, 0.0], [0.0, 0.0]),
    _one(SHOWN, "flux", 0.5, 3.0, 60.0),
    _one(SHOWN, "contrast", 40.0, 200.0, 20000.0),
    _one(SHOWN, "gamma", 1.0, 1.8, 2.8),
    _one(SHOWN, "s_shape", 0.0, 0.6),
    _one(SHOWN, "lamp_drift", -0.05, 0.03),
    _one("simulation", "texture", 0.0, 0.15, 0.3),
    _one("simulation", "ambient", 0.0, 0.005, 0.03),
    Change(
        "simulation",
        ("ambient", "ambient_flicker_hz", "ambient_flicker"),
        tuple((0.01, hz, 0.3) for hz in (100.0, 120.0, 87.0, 3.0)),
    ),
    _one(CAMERA, "hfov_deg", 80.0, 125.0),
    _one(CAMERA, "frame_rate_hz", 7.5, 120.0),
    _one(PROJECTOR, "hfov_deg", 75.0, 120.0),
    _one(SCALE, "distance_m", 4.73, 5.02),
    _one("surface", "patch_size_m", 0.15, 0.7, 1.3),
    _one("surface", "right_angles", False),
    _one("surface", "kind", "free"),
    _one("surface", "size_m", None),
    _one("patterns", "code", "gray", "gray-plain", "xor-02", "xor-04", "gray-phase", "three-frequency", "micro-phase"),
    _one("patterns", "checker_size_px", 4, 6, 16, 32),
    _one("patterns", "checker_shifts", 9, 16, 36),
    _one("patterns", "response_levels", 3, 5, 17, 33),
    _one("patterns", "exposures", [1.0], [1.0, 4.0, 16.0], [0.5, 2.0], [2.0, 0.25]),
    _one("patterns", "frames_averaged", 2, 3),
    _one("brightness", "target_white_share", 0.1, 0.4, 1.0),
    _one("transport", "photographs", 2, 8),
)
BLACK_DN = {8: 4.0, 10: 16.0, 14: 256.0, 16: 1024.0}
"""The same black for each bit depth."""


def changed(text: str, table: str, key: str, value: Any) -> str:
    """A profile with one line set, or left out where the value is None."""
    line = "" if value is None else f"{key} = {json.dumps(value)}\n"
    head = f"[{table}]\n"
    if head not in text:
        return f"{text}\n{head}{line}"
    before, after = text.split(head, 1)
    own, *others = re.split(r"(?m)^(?=\[)", after, maxsplit=1)
    return before + head + line + re.sub(rf"(?m)^{key} = .*\n", "", own) + "".join(others)


def varied(seed: int) -> tuple[str, str]:
    """Return a profile with two to five changes, and these in words."""
    chance = random.Random(seed)
    plain = re.sub(r"(?m)^(\[.*\]) +#.*$", r"\1", PROFILE.read_text("utf-8"))
    text, said = changed(plain, "simulation", "seed", chance.randrange(1, 100_000)), []
    if chance.random() < 0.3:
        bits = chance.choice(list(BLACK_DN))
        text = changed(changed(text, CAMERA, "bit_depth", bits), SEEN, "black_level_dn", BLACK_DN[bits])
        said.append(f"bit_depth={bits}")
    for change in chance.sample(CHANGES, chance.choice([2, 3, 4])):
        for key, value in zip(change.keys, chance.choice(change.values), strict=True):
            text = changed(text, change.table, key, value)
            said.append(f"{change.table.strip('[]')}.{key}={value}")
            if key == "tone":
                text = changed(text, SEEN, "compression", None)
    return text, " ".join(said)


def line_of(answer: dict[str, Any]) -> str:
    """What one ended session has found, beside the truth."""
    truth, light = answer["truth"], answer["comparison"]
    failed = [f"{row['what']}: {row['value']:.3g}" for row in answer["limits"] if not row["met"]]
    verdict = "within" if answer["within_limits"] else "OUTSIDE"
    return (
        f"{verdict} | rms {light['rmse']:.2f} (noise {light['noise_rms']:.2f}), "
        f"within 3 sigma {light['within_3_sigma']:.3f}, camera {truth['camera_position_mm']:.2f} mm, "
        f"reflectance {truth['reflectance_rmse_lit_and_seen']:.4f}, direct {truth['direct_bias_percent']:.2f} %, "
        f"global {truth['global_bias_percent']:.2f} %, surface {truth['surface_median_percent']:.3f} % | "
        + "; ".join(failed)
    )


def outcome(seed: int, work: Path) -> str:
    """Run one session; what became of it."""
    text, said = varied(seed)
    profile, session = work / f"varied-{seed}.toml", work / f"varied-{seed}"
    profile.write_text(text, "utf-8")
    command = ["run", str(session), "-p", str(profile), "--strategies", "none,bounded", "--json"]
    done = subprocess.run([sys.executable, "-m", "rig", *command], capture_output=True, text=True, check=False)
    shutil.rmtree(session, ignore_errors=True)
    if "Traceback" in done.stderr:
        return f"{seed} | {said} | TRACEBACK\n{done.stderr[-2000:]}"
    if not done.stdout.strip():
        return f"{seed} | {said} | refused ({done.returncode}): " + " ".join(
            re.findall(r"(?m)^rig: (.*)$", done.stderr)
        )
    return f"{seed} | {said} | {line_of(json.loads(done.stdout))}"


def main(given: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1-10", help="first-last")
    parser.add_argument("--work", type=Path, required=True, help="folder for profiles; sessions are deleted")
    arguments = parser.parse_args(given)
    first, last = map(int, arguments.seeds.split("-"))
    arguments.work.mkdir(parents=True, exist_ok=True)
    for seed in range(first, last + 1):
        print(outcome(seed, arguments.work), flush=True)


if __name__ == "__main__":
    main()
