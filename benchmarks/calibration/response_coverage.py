"""Radiometric calibration of random simulated rigs against the truth: refusals, errors, and whether sigmas are true.

    python benchmarks/calibration/response_coverage.py --rigs 40 --seed 1 --effects tone 8-bit lamp

Only the first two steps of a session are run. A curve is judged at levels from 2 to 90 % of full scale's light; its
score is error over stated standard error.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from random_profiles import EFFECTS, rig_of

from calibration.radiometry.response import light_of_levels
from rig.capture.rig import open_rig
from rig.devices.simulated.devices import toned
from rig.devices.simulated.settings import SimulatedCameraSettings
from rig.errors import RigError
from rig.profile.schema import Profile
from rig.run.steps import ShootingStep, steps_of
from rig.session import Session
from rig.stages.error_tree import one_error_tree
from rig.stages.linear_light import RadiometricCalibration
from rig.stages.radiometry import load_radiometric_calibration
from rig.terminal import silent

JUDGED = np.array([0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9])
"""Light, share of full scale."""


@dataclass(frozen=True)
class Judged:
    """One rig's radiometric calibration against the truth."""

    error: NDArray[np.float64]
    """Of light at :data:`JUDGED`, share of full scale."""
    score: NDArray[np.float64]
    """The same over its standard error."""
    gain_ratio: float
    projector_error: float
    """Largest, share of white."""


def calibrated(text: str, folder: Path) -> tuple[Profile, RadiometricCalibration]:
    """Run the steps `exposure` and `response` on a profile."""
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    profile = Profile.parse(text.encode(), path)
    with one_error_tree(), open_rig(profile) as rig, Session.open(folder / "session", profile) as session:
        for definition in steps_of("calibrate", profile)[:2]:
            if not isinstance(definition, ShootingStep):
                raise TypeError(f"step {definition.name} does not photograph")
            step = session.step(definition.name, settings=definition.settings(session), needs=definition.needs)
            definition.shoot(rig, session, step, silent)
            step.finish()
        return profile, load_radiometric_calibration(session)


def true_levels(camera: SimulatedCameraSettings, light: NDArray[np.float64], full_scale_dn: int) -> NDArray[np.float64]:
    """Digital numbers of light without noise."""
    y = light * (1 + camera.compression) / (1 + camera.compression * light)
    toned_y = toned(y.astype(np.float32), camera.tone, camera.s_shape).astype(np.float64)
    return np.asarray(camera.black_level_dn + (full_scale_dn - camera.black_level_dn) * toned_y)


def judged(profile: Profile, found: RadiometricCalibration) -> Judged:
    """Compare with the simulated world."""
    if profile.simulation is None:
        raise ValueError("only a simulated rig has a truth to be judged by")
    camera, projector = profile.simulation.camera, profile.simulation.projector
    above = true_levels(camera, JUDGED, found.full_scale_dn) - found.offset_dn
    error = light_of_levels(found.camera, above) - JUDGED
    sigma = np.interp(above, found.camera.levels, found.camera.sigma if found.camera.sigma is not None else [])
    x = np.arange(256) / 255
    true = (1 - projector.s_shape) * x ** projector.gamma[0] + projector.s_shape * x * x * (3 - 2 * x)
    projected = np.abs(np.interp(np.arange(256), found.projector[0].levels, found.projector[0].linear) - true).max()
    true_gain = camera.full_well_e / (found.full_scale_dn - camera.black_level_dn)
    return Judged(error, error / sigma, found.gain_e_per_dn / true_gain, float(projected))


def table(results: Sequence[Judged], refusals: Sequence[str]) -> str:
    """The distributions, in words and numbers."""
    scores, errors = np.array([one.score for one in results]), np.array([one.error for one in results])
    gains = np.array([one.gain_ratio for one in results])
    lines = [f"{len(results)} of {len(results) + len(refusals)} calibrated", *refusals]
    if results:
        typical = np.median(np.abs(scores)) / 0.6745
        lines += [
            f"light within 3 sigma: {np.mean(np.abs(scores) < 3):.3f}; scatter over stated sigma: {typical:.2f}",
            "error of light, share of full scale: median {:.5f}, p90 {:.5f}, max {:.5f}".format(
                *np.quantile(np.abs(errors).max(axis=1), [0.5, 0.9, 1.0])
            ),
            "gain over truth: {:.3f} ... {:.3f}".format(*np.quantile(gains, [0.05, 0.95])),
            "projector, largest error of light: median {:.4f}, max {:.4f}".format(
                *np.quantile([one.projector_error for one in results], [0.5, 1.0])
            ),
        ]
    return "\n".join(lines)


def main() -> int:
    """Calibrate random rigs and print how far off they are."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--effects", nargs="*", choices=EFFECTS, default=[])
    wanted = parser.parse_args()
    results, refusals = [], []
    for seed in range(wanted.seed, wanted.seed + wanted.rigs):
        with tempfile.TemporaryDirectory() as scratch:
            try:
                results.append(judged(*calibrated(rig_of(seed, wanted.effects), Path(scratch))))
                print(seed, np.round(results[-1].score, 1), f"{np.abs(results[-1].error).max():.5f}", flush=True)
            except RigError as error:
                refusals.append(f"  rig {seed}: {error}")
                print(refusals[-1], flush=True)
    print(table(results, refusals))
    return 0


if __name__ == "__main__":
    sys.exit(main())
