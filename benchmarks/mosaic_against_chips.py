"""Errors of a colour rig whose camera has a mosaic of filters, beside those of three chips in the same room.

    python benchmarks/mosaic_against_chips.py [seeds] [shrink]

The room is sim-colour's, with so many times fewer pixels along each axis (2). Each seed is run twice: with all three
bands at each pixel, and with one; noise, texture and everything else are the same seed's. Printed are the errors of
each, and the median of their ratio over the seeds with its own error (1.25 times the scatter over the root of the
number of seeds, from the median absolute deviation). Errors of places scatter from seed to seed by far more than by the
mosaic; what the session states of them does not, so ratios of stated standard deviations are printed as well: of poses
and lengths, and of lenses.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rig.run.request import SessionRequest
from rig.run.session import run_session
from rig.stages.results import SessionResult
from rig.terminal import silent

PROFILE = Path(__file__).parents[1] / "hw_profiles" / "sim-colour.toml"
STRATEGIES = ("none", "bounded")
_SIZES = r"^(width_px|height_px) = (\d+)$"
_PLACES = r"^(focal_px|principal_point_px|spots_px) = (.*)$"


def shrunk(text: str, by: int) -> str:
    """A rig with fewer pixels along each axis; a pixel's centre is a whole number, as OpenCV counts."""

    def place(found: re.Match[str]) -> str:
        offset = 0.0 if found[1] == "focal_px" else 0.5
        moved = re.sub(r"\d+\.?\d*", lambda one: repr((float(one[0]) + offset) / by - offset), found[2])
        return f"{found[1]} = {moved}"

    text = re.sub(_SIZES, lambda found: f"{found[1]} = {int(found[2]) // by}", text, flags=re.MULTILINE)
    return re.sub(_PLACES, place, text, flags=re.MULTILINE)


def errors_of(result: SessionResult) -> Mapping[str, float]:
    truth = result.truth
    if truth is None:
        raise ValueError("the session was not simulated")
    none, bounded = (result.comparison.frames[name] for name in STRATEGIES)
    return {
        "geometry rms, px": result.geometry.rms_px,
        "camera position, mm": truth.camera_position_mm,
        "camera rotation, deg": truth.camera_rotation_deg,
        "focal length, %": truth.focal_percent,
        "surfaces, mm": truth.surface_median_mm,
        "reflectance rmse": truth.reflectance_rmse,
        "reflectance rmse, lit and seen": truth.reflectance_rmse_lit_and_seen,
        "direct bias, %": abs(truth.direct_bias_percent),
        "global bias, %": abs(truth.global_bias_percent),
        "mixing, largest": truth.mixing_max_error or 0.0,
        "prediction rmse, none": none.rmse,
        "prediction bias, none": abs(none.bias),
        "prediction rmse, bounded": bounded.rmse,
        "prediction bias, bounded": abs(bounded.bias),
        "picture rms, uncompensated": result.measured.uncompensated.rms,
        "picture rms, bounded": result.strategies["bounded"].measured.rms,
        "within 3 sigma, none, % outside": 100 * (1 - none.within_3_sigma),
        "within 3 sigma, bounded, % outside": 100 * (1 - bounded.within_3_sigma),
        **{f"stated sigma, {name}": sigma for name, sigma in result.geometry.sigmas.items()},
    }


def run(text: str, folder: Path) -> Mapping[str, float]:
    path = folder / "rig.toml"
    path.write_text(text, "utf-8")
    request = SessionRequest(folder=folder / "session", profile=path, strategies=STRATEGIES)
    return errors_of(run_session(request, silent))


def pair(seed: int, by: int) -> tuple[Mapping[str, float], Mapping[str, float]]:
    text = re.sub(r"^seed = \d+", f"seed = {seed}", shrunk(PROFILE.read_text("utf-8"), by), flags=re.MULTILINE)
    with tempfile.TemporaryDirectory() as whole, tempfile.TemporaryDirectory() as raw:
        chips = run(text, Path(whole))
        return chips, run(text.replace("channels = 3", 'channels = 3\nmosaic = "RGGB"', 1), Path(raw))


def main(seeds: int, by: int) -> None:
    found = []
    for seed in range(1, seeds + 1):
        found.append(pair(seed, by))
        print(f"seed {seed} done", file=sys.stderr, flush=True)
    print(f"{'error':36} {'chips':>10} {'mosaic':>10} {'ratio':>7} {'+-':>6}   of each seed, chips / mosaic")
    for name in found[0][0]:
        if name not in found[0][1]:
            continue
        chips, mosaic = (np.array([one[k][name] for one in found]) for k in (0, 1))
        ratio = mosaic / np.maximum(chips, 1e-12)
        error = 1.25 * 1.4826 * np.median(np.abs(ratio - np.median(ratio))) / np.sqrt(seeds)
        each = "  ".join(f"{a:.3g}/{b:.3g}" for a, b in zip(chips, mosaic, strict=True))
        print(f"{name:36} {np.median(chips):10.4g} {np.median(mosaic):10.4g} {np.median(ratio):7.3f} ", end="")
        print(f"{error:6.3f}   {each}")


def parsed() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", type=int, nargs="?", default=4, help="how many: 4")
    parser.add_argument("shrink", type=int, nargs="?", default=2, help="so many times fewer pixels along each axis: 2")
    return parser.parse_args()


if __name__ == "__main__":
    given = parsed()
    main(given.seeds, given.shrink)
