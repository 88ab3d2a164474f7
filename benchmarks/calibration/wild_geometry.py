"""Calibration without a board far from what it was made for, and told untruths: an answer each, and never a crash.

    python benchmarks/calibration/wild_geometry.py --rigs 100 --seed 1 --jobs 2

Rooms, walls and places are those of random_rigs.py with a camera of 320 x 240 and a projector of 256 x 192; fields of
view of 20 to 130 degrees, the projector's lens shifted both ways by a tenth of the width and three tenths of the
height, lenses 2 cm to 2 m apart, codes off by 0.02 to 0.3 px, up to 30 % of them lost and 5 % stray. A third of the
profiles say something that is not so: another field of view, another tape, sides exchanged, pictures mirrored, turned,
or cropped. Whatever is no refusal in words is a crash; a result from a true profile is held against the truth as in
geometry_coverage.py.
"""

from __future__ import annotations

import argparse
import sys
import traceback
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import random_profiles
from geometry_coverage import Outcome, held_to_truth, simulated
from geometry_shapes import with_tape
from geometry_worlds import CodeNoise, box, exact_map, measured

from calibration.structured_light.correspondence import Correspondence
from rig.devices.simulated.optics import directions
from rig.devices.simulated.pair import pixel_grid
from rig.devices.simulated.settings import SimulatedLensSettings
from rig.profile.schema import Profile

Lens = TypeVar("Lens", bound=SimulatedLensSettings)
_LEAST_SEEN = 0.02
_CAMERA_MIDDLE, _PROJECTOR_MIDDLE, _CROPPED_MIDDLE = (0.03, 0.03), (0.10, 0.30), (0.15, 0.25)
"""Of a lens's axis from the picture's middle, one standard deviation: by mounting, and of cropped ones."""
Random = np.random.Generator
UNTRUTHS = ("",) * 11 + ("field of view", "tape", "sides", "mirrored", "turned", "cropped")
"""Of which one is drawn for each rig."""


@dataclass(frozen=True, kw_only=True)
class Wild:
    """A rig, what is wrong with its profile, and how its codes are misread."""

    profile: Profile
    untruth: str
    noise: CodeNoise


def wild_rig(seed: int) -> Wild:
    """Draw one of which the camera sees two walls that the projector lights; after forty trials, any."""
    for trial in range(40):
        wild = _drawn(seed, np.random.default_rng([seed, 77, trial]))
        if _walls_seen(wild.profile) > 1:
            break
    return wild


def _walls_seen(profile: Profile) -> int:
    """Walls with two hundredths of the camera's pixels each that see what the projector lights."""
    camera, projector, size_m = simulated(profile)
    room = box(size_m)
    lit = np.isfinite(exact_map(room, camera, projector)).all(axis=-1)
    wall = room.first(camera.position_m, directions(camera, pixel_grid(camera.shape)[lit]))
    return int((np.bincount(wall, minlength=6) > _LEAST_SEEN * lit.size).sum())


def _drawn(seed: int, random: Random) -> Wild:
    text = random_profiles.rig_of(seed, shapes=random_profiles.SMALL)
    profile = Profile.parse(text.encode(), Path(f"wild-{seed}.toml"))
    settings = profile.simulation
    if settings is None:
        raise ValueError(f"{profile.path}: not a simulated rig")
    untruth = UNTRUTHS[random.integers(len(UNTRUTHS))]
    projector = _other_lens(settings.projector, profile.projector.shape, _PROJECTOR_MIDDLE, random)
    middle = _CROPPED_MIDDLE if untruth == "cropped" else _CAMERA_MIDDLE
    camera = _other_lens(settings.camera, profile.camera.shape[:2], middle, random)
    apart_m = np.exp(random.uniform(np.log(0.02), np.log(2.0)))
    camera = camera.model_copy(update={"position_m": _beside(camera, projector, apart_m, np.array(settings.size_m))})
    settings = settings.model_copy(update={"cameras": [camera], "projectors": [projector]})
    profile = _told(profile.model_copy(update={"simulation": settings}), untruth, random)
    noise = CodeNoise(
        code_px=float(np.exp(random.uniform(np.log(0.02), np.log(0.3)))),
        lost_share=float(random.uniform(0, 0.3)),
        stray_share=float(random.uniform(0, 0.05)),
    )
    return Wild(profile=profile, untruth=untruth, noise=noise)


def _other_lens(lens: Lens, shape: tuple[int, int], middle_sigma: tuple[float, float], random: Random) -> Lens:
    """Another field of view, and a principal point as far from the middle, as a share of the picture's size."""
    height, width = shape
    focal_px = width / 2 / np.tan(np.radians(random.uniform(20, 130)) / 2)
    off = np.array(middle_sigma) * random.normal(size=2)
    middle = ((width - 1) / 2 + off[0] * width, (height - 1) / 2 + off[1] * height)
    bent = (focal_px / lens.focal_px) ** 2
    k1, k2, *others = lens.distortion
    update = {"focal_px": focal_px, "principal_point_px": middle, "distortion": (k1 * bent, k2 * bent**2, *others)}
    return lens.model_copy(update=update)


def _beside(
    camera: SimulatedLensSettings, projector: SimulatedLensSettings, apart_m: float, size_m: np.ndarray
) -> list:
    """Where a camera is so far from the projector, on the side where it was, within the room."""
    there = np.array(projector.position_m)
    step = np.array(camera.position_m) - there
    return np.clip(there + step * apart_m / np.linalg.norm(step), 0.1, size_m - 0.1).tolist()


def _told(profile: Profile, untruth: str, random: Random) -> Profile:
    """What a profile says of the rig."""
    settings = profile.simulation
    devices = []
    for device, lens in ((profile.camera, settings.camera), (profile.projector, settings.projector)):
        true_deg = 2 * np.degrees(np.arctan(device.width_px / 2 / lens.focal_px))
        off = random.uniform(0.6, 1.5) if untruth == "field of view" else random.uniform(0.97, 1.03)
        devices.append(device.model_copy(update={"hfov_deg": float(np.clip(true_deg * off, 5, 165))}))
    size_m = list(profile.room.size_m)
    if untruth == "sides":
        size_m = [size_m[1], size_m[0], size_m[2] * random.uniform(0.8, 1.2)]
    update = {
        "size_m": tuple(size_m) if random.integers(4) else None,
        "askew_deg": float(random.choice([0.0, 0.3])),
        "right_angles": bool(random.integers(5)),
    }
    surface = profile.room.model_copy(update=update)
    profile = profile.model_copy(update={"cameras": devices[:1], "projectors": devices[1:], "surface": surface})
    profile = with_tape(profile, box(np.array(settings.size_m)), random)
    if untruth == "tape":
        wrong_m = profile.scale.distance_m * random.uniform(0.5, 1.5)
        profile = profile.model_copy(update={"scales": [profile.scale.model_copy(update={"distance_m": wrong_m})]})
    return profile


def _seen(correspondence: Correspondence, untruth: str, shape: tuple[int, int]) -> Correspondence:
    """Mirrored or turned as a projector is that hangs from the ceiling, or shines through a screen."""
    height, width = shape
    xy = np.array(correspondence.projector_xy_px)
    if untruth in ("mirrored", "turned"):
        xy[..., 0] = width - 1 - xy[..., 0]
    if untruth == "turned":
        xy[..., 1] = height - 1 - xy[..., 1]
    return replace(correspondence, projector_xy_px=xy)


def outcome_of(seed: int) -> tuple[str, Outcome]:
    """Calibrate one rig: what was untrue, and what came of it."""
    wild = wild_rig(seed)
    camera, projector, size_m = simulated(wild.profile)
    shape = box(size_m)
    codes = measured(exact_map(shape, camera, projector), projector.shape, wild.noise, seed)
    seen = _seen(codes, wild.untruth, projector.shape)
    name = f"wild {seed}" + (f" ({wild.untruth})" if wild.untruth else "")
    try:
        return wild.untruth, held_to_truth(name, wild.profile, shape, seen)
    except Exception:  # noqa: BLE001 whatever it is, it is what this is looking for
        return wild.untruth, Outcome.refusal(name, "CRASH " + traceback.format_exc(limit=-9))


def main() -> int:
    """Run the rigs; exit status 1 where one crashed, or was wrong in silence."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1, help="of the first; the others follow")
    parser.add_argument("--jobs", type=int, default=2)
    wanted = parser.parse_args()
    counts: Counter[str] = Counter()
    with ProcessPoolExecutor(wanted.jobs) as executor:
        for untruth, one in executor.map(outcome_of, range(wanted.seed, wanted.seed + wanted.rigs)):
            is_wrong = bool(not untruth and one.is_silently_wrong)
            how = "crashed" if one.refused.startswith("CRASH") else "refused" if one.refused else "ended"
            counts.update([how, *(["wrong in silence"] if is_wrong else [])])
            print(f"{'WRONG ' * is_wrong}{one.name}: {one.told}", flush=True)
    print(", ".join(f"{count} {how}" for how, count in counts.items()))
    return 1 if counts["crashed"] or counts["wrong in silence"] else 0


if __name__ == "__main__":
    sys.exit(main())
