"""Whether calibration without a board is ever wrong in silence, and whether its sigmas are true.

    python benchmarks/calibration/geometry_coverage.py --rigs 40 --seed 1 --jobs 2

Rigs: ci-tiny with other noise (`--tiny`), and random rigs (random_rigs.py) with a camera of 320 x 240 and a projector
of 256 x 192. Correspondences are cast exactly, read as whole codes with the noise of 12 or of 8 bits, and refined
as in a session; lengths by tape are off as random_rigs.py draws them. Shapes: corners of 95 to 140 degrees, leaning
walls, cylinders, domes, and balls in the corner, seen by ci-tiny's devices, with right angles promised and without;
their tape runs between the spots as they lie there. `--drawn` draws more of them, with and without `size_m`; `--askew`
draws rooms whose walls stand 0.3 degrees off square, and profiles that say so; `--bowed` rooms whose walls bulge by 1
to 10 mm, before random rigs of 320 x 240 and 640 x 480 in turn; `--in-line` rigs one of whose devices stands nearly
behind the other. A result is wrong, too, if its walls are not where the lit points are (balls apart, which no wall
stands for).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import random_profiles
from geometry_shapes import SHAPES, askew_room, bowed_room, drawn_shape, with_tape
from geometry_worlds import CodeNoise, Shape, box, exact_map, measured, points_of
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.geometry.pinhole import PinholeModel, vector_of, world_rays
from calibration.geometry.planes import USUAL_ASKEW_DEG
from calibration.geometry.room import FACES
from calibration.structured_light.correspondence import Correspondence
from rig.devices.simulated.optics import SimulatedOptics, make_optics, pixels_of
from rig.profile.schema import Profile, load_profile
from rig.stages.geometry import GeometryRecord, geometry_of

FloatArray = NDArray[np.float64]
SIGMAS, SHARE = 4.0, 0.01
"""Silently wrong: off by more than so many of its own sigmas, or by this share of the room."""
NOISE = {"12 bits": CodeNoise(code_px=0.03), "8 bits": CodeNoise(code_px=0.12, lost_share=0.01)}


@dataclass(frozen=True, kw_only=True)
class Case:
    """One rig before one shape, with one noise."""

    name: str
    profile: Profile
    shape: Shape | None
    """None: the profile's own room."""
    noise: str
    seed: int


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How far a result is from the truth, or why there is none."""

    name: str
    refused: str
    sigmas_off: Mapping[str, float]
    """Of each figure: error by its own sigma."""
    share_off: float
    """Largest error of a length, by the room's size."""
    share_sigma: float
    """Largest sigma of one, and of what the camera's turn moves at the room's far end."""

    @classmethod
    def refusal(cls, name: str, why: str) -> Outcome:
        """Return that there is no result."""
        return cls(name=name, refused=why, sigmas_off={}, share_off=0.0, share_sigma=0.0)

    @property
    def told(self) -> str:
        """In one line."""
        if self.refused:
            return self.refused
        worst = max(self.sigmas_off, key=lambda key: abs(self.sigmas_off[key]))
        return (
            f"ended; {worst} off by {abs(self.sigmas_off[worst]):.1f} sigma; lengths by {100 * self.share_off:.2f} % "
            f"of the room, its sigma {100 * self.share_sigma:.2f} %"
        )

    @property
    def is_silently_wrong(self) -> bool:
        """Wrong, and neither refused nor said to be uncertain."""
        if self.refused:
            return False
        off = max(abs(q) for q in self.sigmas_off.values())
        return off > SIGMAS or self.share_off > max(SHARE, SIGMAS * self.share_sigma)


def cases(
    rigs: int, tiny: int, seed: int, *, shapes: bool, drawn: int, askew: int, bowed: int, in_line: int
) -> Iterator[Case]:
    """Rigs of both kinds with both noises, then shapes, then shapes that are drawn."""
    profile = load_profile("ci-tiny")
    noises = list(NOISE)
    for k in range(tiny):
        yield Case(name=f"tiny {seed + k}", profile=profile, shape=None, noise=noises[k % 2], seed=seed + k)
    for kind, count in (("random", rigs), ("in line", in_line)):
        for k in range(count):
            rig = _random_rig(seed + k, in_line=kind == "in line")
            yield Case(name=f"{kind} {seed + k}", profile=rig, shape=None, noise=noises[k % 2], seed=seed + k)
    if shapes:
        for name, shape in SHAPES.items():
            for right_angles in (True, False):
                yield _before(shape, name, profile, seed, right_angles=right_angles)
    for k in range(seed, seed + drawn):
        random = np.random.default_rng([k, 31])
        name, shape = drawn_shape(random)
        right_angles, sized = random.integers(0, 2, 2).astype(bool)
        title = f"{k}: {name}" + ("" if sized else ", without size_m")
        yield _before(shape, title, profile, k, right_angles=bool(right_angles), sized=bool(sized))
    for k in range(seed, seed + askew):
        yield _askew(_random_rig(k) if k % 2 else profile, k)
    for k in range(seed, seed + bowed):
        yield _bowed(k)


def _random_rig(seed: int, shapes: random_profiles.Shapes = random_profiles.SMALL, *, in_line: bool = False) -> Profile:
    text = random_profiles.rig_of(seed, shapes=shapes, in_line=in_line)
    return Profile.parse(text.encode(), Path(f"random-{seed}.toml"))


def _askew(profile: Profile, seed: int) -> Case:
    """Devices of a profile in its room, each of whose walls stands a little off square."""
    if profile.simulation is None:
        raise ValueError(f"{profile.path}: not a simulated rig")
    settings, random = profile.simulation, np.random.default_rng([seed, 33])
    camera_m = make_optics(settings.camera, profile.camera.shape[:2]).position_m
    shape = askew_room(np.array(settings.size_m), camera_m, USUAL_ASKEW_DEG, random)
    return _before(shape, f"askew {seed}", profile, seed, right_angles=True, askew_deg=USUAL_ASKEW_DEG)


def _bowed(seed: int) -> Case:
    """A random rig in its room, each of whose walls bulges."""
    random = np.random.default_rng([seed, 34])
    profile = _random_rig(seed, (random_profiles.SMALL, random_profiles.Shapes())[seed % 2])
    bow_mm = round(float(random.uniform(1, 10)), 1)
    shape = bowed_room(simulated(profile)[2], bow_mm / 1000, random)
    return _before(shape, f"bowed by {bow_mm} mm {seed}", profile, seed, right_angles=True)


def _before(
    shape: Shape,
    name: str,
    profile: Profile,
    seed: int,
    *,
    right_angles: bool,
    sized: bool = True,
    askew_deg: float = 0.0,
) -> Case:
    """Devices of a profile before a shape, whose owner promises right angles or not."""
    update: dict[str, object] = {"right_angles": right_angles, "askew_deg": askew_deg}
    update |= {} if sized else {"size_m": None}
    other = profile.model_copy(update={"surface": profile.room.model_copy(update=update)})
    other = with_tape(other, shape, np.random.default_rng([seed, 32]))
    title = name if right_angles else f"{name}, free"
    return Case(name=title, profile=other, shape=shape, noise="12 bits", seed=seed)


def outcome_of(case: Case) -> Outcome:
    """Calibrate one case and compare."""
    camera, projector, size_m = simulated(case.profile)
    shape = case.shape or box(size_m)
    correspondence = measured(exact_map(shape, camera, projector), projector.shape, NOISE[case.noise], case.seed)
    return held_to_truth(case.name, case.profile, shape, correspondence)


def simulated(profile: Profile) -> tuple[SimulatedOptics, SimulatedOptics, FloatArray]:
    """Return a profile's true camera and projector, and (3,) the size of its room. [m]"""
    settings = profile.simulation
    if settings is None:
        raise ValueError(f"{profile.path}: not a simulated rig")
    camera = make_optics(settings.camera, profile.camera.shape[:2])
    return camera, make_optics(settings.projector, profile.projector.shape), np.array(settings.size_m)


def held_to_truth(name: str, profile: Profile, shape: Shape, correspondence: Correspondence) -> Outcome:
    """Calibrate from correspondences before a shape, and compare with what a profile's simulation knows."""
    camera, projector, size_m = simulated(profile)
    try:
        record = geometry_of(correspondence, profile, lambda *_: None)
    except CalibrationError as error:
        return Outcome.refusal(name, str(error))
    outcome = compared(name, record, (camera, projector), size_m if shape.is_box else None)
    return replace(outcome, share_off=max(outcome.share_off, _walls_off(record, shape, camera, projector)))


def _walls_off(record: GeometryRecord, shape: Shape, camera: SimulatedOptics, projector: SimulatedOptics) -> float:
    """Distance of measured walls from what the projector lights, in the camera's frame, by the room's size.

    The 95th percentile of the pixels that both devices see; balls apart. Walls that nobody saw are guesses, which a
    session replaces by what their light tells.
    """
    grid = np.stack(np.meshgrid(*(np.arange(4, n - 4, 8.0) for n in projector.shape[::-1])), -1).reshape(-1, 2)
    bare = replace(shape, balls=())
    there = points_of(bare, projector, grid)
    seen = pixels_of(camera, there)
    ahead = (there - camera.position_m) @ camera.rotation[2] > 0
    is_wall = np.abs(points_of(shape, projector, grid) - there).max(axis=1) < 1e-6
    seen_by_both = ahead & is_wall & ((seen > 0) & (seen < camera.shape[::-1])).all(axis=1)
    found, lamp = (next(iter(one.values())).pinhole() for one in (record.cameras, record.projectors))
    rays = world_rays(lamp, grid)
    size = np.array(record.surface.size_m)
    measured_faces = np.isin(np.array(FACES).reshape(3, 2), record.surface.seen)
    reached = np.where(rays > 0, (size - lamp.position_m) / rays, -lamp.position_m / rays)
    along = np.where(np.where(rays > 0, measured_faces[:, 1], measured_faces[:, 0]), reached, np.inf).min(axis=1)
    here = (lamp.position_m + along[:, None] * rays - found.position_m) @ found.rotation.T
    off = np.linalg.norm(here - (there - camera.position_m) @ camera.rotation.T, axis=1)
    return float(np.percentile(off[seen_by_both & np.isfinite(along)], 95) / size.max())


def compared(
    name: str, record: GeometryRecord, devices: tuple[SimulatedOptics, SimulatedOptics], size_m: FloatArray | None
) -> Outcome:
    """Errors of lenses and relative pose, and in a box of its size and the devices' places."""
    found = [next(iter(one.values())).pinhole() for one in (record.cameras, record.projectors)]
    values: dict[str, tuple[float, float]] = {}
    for device, model, truth in zip(("camera", "projector"), found, devices, strict=True):
        terms = ("f", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
        lens = truth.lens
        known = (lens.focal_px, *lens.principal_point_px, *lens.distortion)
        seen = (model.focal_px[0], *model.principal_point_px, *model.distortion)
        values |= {f"{device}_{t}": pair for t, pair in zip(terms, zip(seen, known, strict=True), strict=True)}
    camera, projector = devices
    lengths = {}
    relative = found[0].rotation @ (found[1].position_m - found[0].position_m)
    truth_m = camera.rotation @ (projector.position_m - camera.position_m)
    lengths |= {
        f"relative_{axis}_m": pair for axis, pair in zip("xyz", zip(relative, truth_m, strict=True), strict=True)
    }
    turns = {
        f"relative_rotation_{axis}_deg": (float(value), 0.0)
        for axis, value in zip("xyz", _turn_deg(_relative(*found), _relative(*devices)), strict=True)
    }
    if size_m is not None:
        # The room that is found is turned by quarters: its x is the wall on the right.
        turn = np.rint(found[0].rotation.T @ camera.rotation)
        size = np.abs(turn @ size_m)
        lengths |= {f"room_{a}_m": p for a, p in zip("xyz", zip(record.surface.size_m, size, strict=True), strict=True)}
        for device, model, optics in zip(("camera", "projector"), found, devices, strict=True):
            off = _turn_deg(model.rotation, optics.rotation @ turn.T)
            turns |= {f"{device}_rotation_{a}_deg": (float(v), 0.0) for a, v in zip("xyz", off, strict=True)}
            there = turn @ optics.position_m
            there = np.where(turn.sum(axis=1) < 0, size + there, there)
            pairs = zip(model.position_m, there, strict=True)
            lengths |= {f"{device}_{axis}_m": pair for axis, pair in zip("xyz", pairs, strict=True)}
            if device == "projector":
                lengths |= _surfaces(model.position_m, there, np.array(record.surface.size_m), size)
    extent = float(max(record.surface.size_m))
    sigma = record.sigmas
    lengths = {key: pair for key, pair in lengths.items() if key in sigma}
    return Outcome(
        name=name,
        refused="",
        sigmas_off={key: (a - b) / max(sigma[key], 1e-12) for key, (a, b) in (values | lengths | turns).items()},
        share_off=max(abs(a - b) for a, b in lengths.values()) / extent,
        share_sigma=max(*(sigma[key] / extent for key in lengths), _turn_sigma(sigma)),
    )


def _turn_sigma(sigma: Mapping[str, float]) -> float:
    """By what share of its distance the camera's turn leaves a place open."""
    return float(np.radians(max(sigma.get(f"camera_rotation_{axis}_deg", 0.0) for axis in "xyz")))


def _surfaces(
    found_m: FloatArray, true_m: FloatArray, found_size_m: FloatArray, size_m: FloatArray
) -> dict[str, tuple[float, float]]:
    """Distances of the walls from the projector, as found and as they are."""
    near = {
        f"surface_{face}_m": pair
        for face, pair in zip(("x0", "y0", "floor"), zip(found_m, true_m, strict=True), strict=True)
    }
    far = zip(found_size_m - found_m, size_m - true_m, strict=True)
    return near | {f"surface_{face}_m": pair for face, pair in zip(("x1", "y1", "ceiling"), far, strict=True)}


def _relative(camera: PinholeModel | SimulatedOptics, projector: PinholeModel | SimulatedOptics) -> FloatArray:
    """(3, 3) from the camera's axes to the projector's."""
    return np.asarray(projector.rotation @ camera.rotation.T)


def _turn_deg(found: FloatArray, true: FloatArray) -> FloatArray:
    """(3,) about the device's axes."""
    return np.degrees(vector_of(found @ true.T))


def report(found: Sequence[Outcome]) -> str:
    """What was refused, what was wrong, and the coverage of each figure."""
    ended = [one for one in found if not one.refused]
    wrong = [one for one in ended if one.is_silently_wrong]
    lines = [f"{len(found)} cases: {len(ended)} ended, {len(found) - len(ended)} refused, {len(wrong)} silently wrong"]
    lines += [f"  refused: {one.name}: {one.refused}" for one in found if one.refused]
    lines += [f"  WRONG: {one.name}: {one.told}" for one in wrong]
    lines.append(f"  {'figure':24} {'within 3 sigma':>14} {'rms of error / sigma':>21} {'largest':>8}")
    names = dict.fromkeys(key for one in ended for key in one.sigmas_off)
    for key in names:
        q = np.abs([one.sigmas_off[key] for one in ended if key in one.sigmas_off])
        lines.append(f"  {key:24} {(q < 3).mean():14.3f} {np.sqrt((q**2).mean()):21.2f} {q.max():8.2f}")
    return "\n".join(lines)


def main() -> int:
    """Run the cases and print the report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=40, help="random rigs")
    parser.add_argument("--tiny", type=int, default=20, help="times ci-tiny")
    parser.add_argument("--seed", type=int, default=1, help="of the first; the others follow")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--no-shapes", action="store_true")
    parser.add_argument("--drawn", type=int, default=0, help="shapes that are drawn at random")
    parser.add_argument("--askew", type=int, default=0, help="rooms whose walls stand off square, as profiles say")
    parser.add_argument("--bowed", type=int, default=0, help="rooms whose walls bulge by millimetres")
    parser.add_argument("--in-line", type=int, default=0, help="random rigs, one device nearly behind the other")
    wanted = parser.parse_args()
    counts = {"drawn": wanted.drawn, "askew": wanted.askew, "bowed": wanted.bowed, "in_line": wanted.in_line}
    todo = list(cases(wanted.rigs, wanted.tiny, wanted.seed, shapes=not wanted.no_shapes, **counts))
    found = []
    with ProcessPoolExecutor(wanted.jobs) as executor:
        for one in executor.map(outcome_of, todo):
            found.append(one)
            print(f"{len(found)} of {len(todo)}: {one.name}: {one.told}", file=sys.stderr, flush=True)
    print(report(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
