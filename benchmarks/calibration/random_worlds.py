"""Whole sessions in random simulated rooms with one to five random things in them: how many end within their limits.

    python benchmarks/calibration/random_worlds.py --worlds 20 --seed 1
    python benchmarks/calibration/random_worlds.py --worlds 6 --keep FOLDER     # sessions stay, to be looked at
    python benchmarks/calibration/random_worlds.py --write FOLDER --worlds 5    # only profiles and meshes
    python benchmarks/calibration/random_worlds.py --odd --worlds 14 --seed 500 # shelves, beams, sofas, people, rings

Rooms of 4 to 6 m, 2.4 to 3 m high, matte walls of 0.55 to 0.8; boxes, tables, columns, panels, round columns, vases and
domes of 0.2 to 0.8, that stand apart from each other in the part of the room at which the rig looks. The rig is that of
the profile sim-furnished with pictures of half its width, in a random place: camera 320 x 240, projector 256 x 192.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig.devices.simulated.worlds.shapes import Point, room

sys.path.insert(0, str(Path(__file__).parent))
from odd_things import placed_oddly
from random_rigs import run
from rig_figures import RigOutcome, as_json, table
from world_things import FloatArray, placed

PROFILE = Path(__file__).parents[2] / "hw_profiles" / "sim-furnished.toml"


@dataclass(frozen=True)
class World:
    """A room with things in it, and the rig that looks at them."""

    parts: Mapping[str, FloatArray]
    """Triangles of each material."""
    reflectance: Mapping[str, float]
    profile: str
    kinds: tuple[str, ...]


def world_of(seed: int, *, odd: bool = False) -> World:
    """Return a random world, with things that stand apart, or oddly."""
    random = np.random.default_rng([seed, 16])
    size_m = tuple(random.uniform((4.0, 4.0, 2.4), (6.0, 6.0, 3.0)).round(2).tolist())
    things = (placed_oddly if odd else placed)(random, size_m)
    parts = dict(room(size_m)) | {
        f"{thing.kind}-{k}".replace(" ", "-"): thing.triangles_m for k, thing in enumerate(things)
    }
    wall = random.uniform(0.55, 0.8)
    colours = {
        name: float(random.uniform(0.2, 0.8) if "-" in name else np.clip(wall + random.normal(0, 0.04), 0.45, 0.85))
        for name in parts
    }
    kinds = tuple(thing.kind for thing in things)
    return World(parts, colours, _profile(random, seed, size_m, colours), kinds)


def _profile(random: np.random.Generator, seed: int, size_m: Point, reflectance: Mapping[str, float]) -> str:
    """That of sim-furnished, its pictures half as wide, its rig in another place."""
    text = PROFILE.read_text("utf-8")
    projector = random.uniform((0.14, 0.14, 0.4), (0.26, 0.26, 0.6)) * size_m
    way = random.normal(size=3) * (1.0, 1.0, 0.3)
    # Beside the projector, across its view: where it stands behind, neither sees the wall it stands on.
    camera = projector + random.choice([-1, 1]) * np.array([0.6, -0.6, 0.0]) * random.uniform(0.6, 1.0) + 0.1 * way
    camera = np.clip(camera, 0.25, np.array(size_m) - 0.3)
    target = np.array(size_m) * (1.0, 1.0, 0.5) + random.normal(0, 0.05, 3) * size_m
    focal = {"camera": 265.85 / 2 * random.uniform(0.95, 1.2), "projector": 215.6 / 2 * random.uniform(0.95, 1.2)}
    size = json.dumps([round(x * (1 + 0.003 * random.normal()), 3) for x in size_m])
    new = {
        r'name = "sim-furnished"': f'name = "random-world-{seed}"',
        r"width_px = 640": "width_px = 320",
        r"height_px = 480": "height_px = 240",
        r"width_px = 512": "width_px = 256",
        r"height_px = 384": "height_px = 192",
        r"hfov_deg = 100.0 .*": f"hfov_deg = {_field_deg(320, focal['camera']):.1f}",
        r"hfov_deg = 98.0": f"hfov_deg = {_field_deg(256, focal['projector']):.1f}",
        r"baseline_m = \S+": f"baseline_m = {np.linalg.norm(camera - projector) * (1 + 0.002 * random.normal()):.4f}",
        r"size_m = \[4.80, 4.80, 2.40\]": f"size_m = {size}",
        r"patch_size_m = 0.3": f"patch_size_m = {max(size_m) / 16:.3f}",
        r"seed = 20141": f"seed = {seed}",
        r'scene = "furnished"\nsize_m = \[4.8, 4.8, 2.4\]': f'scene = "random-world-{seed}.obj"',
        # What pixels twice as large leave open of places is twice as much.
        r"geometry_rms_px = 0.5": "geometry_rms_px = 0.5\ngeometry_sigma_percent = 0.9",
        r"cell_size_m = 0.12": f"cell_size_m = {max(size_m) / 36:.3f}",
        r"(?s)\[simulation.reflectance\].*?\n\n": _materials(reflectance),
        r"position_m = \[0.60, 1.42, 1.38\]": f"position_m = {_list(camera)}",
        r"look_at_m = \[4.60, 4.55, 1.12\]": f"look_at_m = {_list(target)}",
        r"position_m = \[1.00, 1.00, 1.20\]": f"position_m = {_list(projector)}",
        r"look_at_m = \[4.80, 4.72, 1.20\]": f"look_at_m = {_list(target + random.normal(0, 0.04, 3) * size_m)}",
        r"focal_px = 265.85": f"focal_px = {focal['camera']:.2f}",
        r"focal_px = 215.6\b": f"focal_px = {focal['projector']:.2f}",
        r"principal_point_px = \[321.9, 236.15\]": "principal_point_px = [160.7, 117.8]",
        r"principal_point_px = \[254.05, 200.95\]": "principal_point_px = [126.8, 100.2]",
    }
    return rewritten(text, new)


def rewritten(text: str, new: Mapping[str, str]) -> str:
    """Return sim-furnished's text with the first match of each pattern replaced; ends where there is none."""
    for old, line in new.items():
        text, count = re.subn(old, line, text, count=1)
        if not count:
            raise SystemExit(f"{PROFILE.name} has no {old!r} any more; mend this benchmark")
    return text


def _field_deg(width_px: int, focal_px: float) -> float:
    return float(2 * np.degrees(np.arctan(width_px / 2 / focal_px)))


def _list(values: FloatArray) -> str:
    return json.dumps([round(float(x), 4) for x in values])


def _materials(reflectance: Mapping[str, float]) -> str:
    tables = (f'[[simulation.material]]\nname = "{k}"\nreflectance = {v:.3f}\n' for k, v in reflectance.items())
    return "\n".join(tables) + "\n"


def write(folder: Path, seed: int, world: World) -> Path:
    """Write a world's profile and mesh; return the profile."""
    name = f"random-world-{seed}"
    # Without a library of materials their names are lost.
    colours = (f"newmtl {part}\nKd {rho:.3f} {rho:.3f} {rho:.3f}\n" for part, rho in world.reflectance.items())
    (folder / f"{name}.mtl").write_text("".join(colours), encoding="utf-8")
    lines, first = [f"mtllib {name}.mtl"], 1
    for part, triangles_m in world.parts.items():
        lines.append(f"usemtl {part}")
        lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in triangles_m.reshape(-1, 3)]
        lines += [f"f {k} {k + 1} {k + 2}" for k in range(first, first + 3 * len(triangles_m), 3)]
        first += 3 * len(triangles_m)
    (folder / f"{name}.obj").write_text("\n".join(lines) + "\n", encoding="utf-8")
    profile = folder / f"{name}.toml"
    profile.write_text(world.profile, encoding="utf-8")
    return profile


def main() -> int:
    """Write worlds, or run sessions in them and say how they ended."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1, help="of the first world; the others follow")
    parser.add_argument(
        "--odd", action="store_true", help="things on walls, under ceilings, in corners, thin or tilted"
    )
    parser.add_argument("--write", type=Path, help="only write profiles and meshes there")
    parser.add_argument("--keep", type=Path, help="keep the sessions there")
    parser.add_argument("--json", type=Path, help="all results")
    wanted = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = wanted.write or wanted.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        seeds = range(wanted.seed, wanted.seed + wanted.worlds)
        worlds = {seed: world_of(seed, odd=wanted.odd) for seed in seeds}
        profiles = {seed: write(folder, seed, world) for seed, world in worlds.items()}
        if wanted.write:
            return 0
        found: list[RigOutcome] = []
        for seed, profile in profiles.items():
            found.append(run(profile, profile.with_suffix(""), ("none", "bounded"), oracle=False))
            print(_line(seed, worlds[seed].kinds, found[-1]), flush=True)
            if wanted.json:
                wanted.json.write_text(json.dumps(as_json(found), indent=1), encoding="utf-8")
    print(table(found))
    return 0


def _line(seed: int, in_it: tuple[str, ...], found: RigOutcome) -> str:
    """One world: what is in it, and how its session ended."""
    kinds, took = ", ".join(in_it), f"{found.processor_s:.0f} s"
    if not found.figures:
        return f"{seed:3} ({kinds}; {took}): refused, exit {found.status}: {found.said}"
    rms, noise = found.figures["rmse"], found.figures["noise_rms"]
    words = "; ".join(found.unmet) or "within limits"
    return f"{seed:3} ({kinds}; {took}): rms {rms:.2f} (noise {noise:.2f}): {words}"


if __name__ == "__main__":
    sys.exit(main())
