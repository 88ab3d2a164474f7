"""The model's gloss against the simulated world and Mitsuba 3: python benchmarks/gloss_against_world.py [SCENE ...].

Glossy scenes of the library (``glossy``, ``gain-screen``), a white picture and one of bright blocks, seen by a pinhole
camera apart from a pinhole projector. The truth is the simulated world (Embree, code of its own) with two seeds, or
with ``--mitsuba`` a path tracer. Held against it: the model with its lobes (``gloss``), and a matte model that sends
back as much of even light (``matte``). As a control, both without any gloss (``control``): what patches and edges
leave.
Pictures are compared in blocks of 8 x 8 camera pixels. Printed in percent of the mean: bias, rms of the blocks'
differences, the truth's own noise (from its seeds), and the rms without it. Exit status 1 when a bias of ``gloss`` is
above --bias.

Needs ``pip install embreex``, and mitsuba for ``--mitsuba``.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from world_against_mitsuba import CAMERA, PROJECTOR, ROOT, blocks_of, pictures, scene_of, settings_of

from rig.devices.simulated.mesh.find import find_scene
from rig.devices.simulated.mesh.scene import TriangleScene
from rig.devices.simulated.mesh.world import MeshWorld, exchange_of
from sim.form_factors import form_factors
from sim.geometry.optics import Lens, Pose
from sim.geometry.scene import Face, Scene
from sim.light.gloss.material import Gloss, matte_equivalent
from sim.light.gloss.transport_of_scene import GlossSampling, glossy_transport

FloatArray = NDArray[np.float64]
SCENES = ("glossy", "gain-screen")
THICKNESS_M = 1e-3
"""Between the two sides of a free-standing sheet in the model, whose patches have one lit side."""


def model_scene(
    world: TriangleScene, patch_size_m: float, middle_m: FloatArray
) -> tuple[Scene, FloatArray, FloatArray]:
    """The world's rectangles as gridded faces, with each patch's gloss and roughness."""
    faces: list[Face] = []
    values: list[tuple[int, int]] = []
    for first in range(0, len(world.triangles_m), 2):
        a, b, _c = world.triangles_m[first]
        d = world.triangles_m[first + 1, 2]
        normal = np.cross(b - a, d - a) / np.linalg.norm(np.cross(b - a, d - a))
        sides = [(a, b - a, d - a)]
        if world.materials[world.material[first]] == "screen":
            sides.append((a - THICKNESS_M * normal, d - a, b - a))
        elif normal @ (middle_m - a) < 0:
            sides = [(a, d - a, b - a)]
        for origin, u, v in sides:
            columns, rows = (max(1, round(float(np.linalg.norm(edge)) / patch_size_m)) for edge in (u, v))
            face = Face(
                name=f"{world.materials[world.material[first]]} {len(faces)}",
                origin_m=origin,
                edge_u_m=u,
                edge_v_m=v,
                rows=rows,
                columns=columns,
                first_patch=sum(one.n_patches for one in faces),
            )
            faces.append(face)
            values.append((first, face.n_patches))
    each = [
        np.repeat([array[i] for i, _ in values], [n for _, n in values])
        for array in (world.reflectance.mean(axis=1), world.gloss, world.roughness)
    ]
    convex = not any(name == "screen" for name in world.materials)
    return Scene(world.name, tuple(faces), each[0], convex), each[1], each[2]


def lens_of(device: Any, shape: tuple[int, int]) -> tuple[Lens, Pose]:
    """A pinhole of the profile's focal length, looking where it looks."""
    height, width = shape
    lens = Lens(
        width_px=width,
        height_px=height,
        focal_px=(device.focal_px, device.focal_px),
        principal_point_px=((width - 1) / 2, (height - 1) / 2),
    )
    return lens, Pose.look_at(device.position_m, device.look_at_m)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Row:
    """One picture of one scene by one model, in percent of the truth's mean."""

    scene: str
    picture: str
    model: str
    truth: str
    bias: float
    rms: float
    noise: float
    rms_beyond_noise: float
    seconds: float


def model_pictures(
    world: TriangleScene, settings: Any, options: argparse.Namespace, *, glossy: bool
) -> tuple[Any, float]:
    """The model's pictures by title, and the processor time of all of them."""
    started = time.process_time()
    middle = np.asarray(settings.size_m) / 2
    scene, share, roughness = model_scene(world, options.patch_size_m, middle)
    gloss = Gloss.of(scene, share, roughness)
    if not glossy:
        scene = scene.with_reflectance(matte_equivalent(scene, gloss))
        gloss = Gloss.of(scene, 0.0)
    projector, camera = lens_of(settings.projector, PROJECTOR), lens_of(settings.camera, CAMERA)
    transport = glossy_transport(
        scene,
        form_factors(scene, visibility="none" if scene.convex else "fair"),
        *projector,
        gloss=gloss,
        camera_lens=camera[0],
        camera_pose=camera[1],
        subsamples=4,
        sampling=GlossSampling(patch_rays=options.patch_rays, camera_rays=options.camera_rays, seed=options.seed),
    )
    scale = settings.projector.flux / (PROJECTOR[0] * PROJECTOR[1]) * settings.projector.focal_px**2
    found = {
        title: scale * np.asarray(transport @ picture.ravel().astype(float)).reshape(CAMERA)
        for title, picture in pictures().items()
    }
    return found, time.process_time() - started


def world_pictures(scene: TriangleScene, settings: Any, options: argparse.Namespace) -> dict[str, FloatArray]:
    """(runs, H, W) pictures of worlds that differ in their seeds, by title."""
    runs: dict[str, list[FloatArray]] = {}
    for seed in range(options.runs):
        seeded = settings.model_copy(update={"seed": 100 + seed})
        world = MeshWorld(seeded, exchange_of(scene, seeded), CAMERA, PROJECTOR)
        for title, picture in pictures().items():
            runs.setdefault(title, []).append(np.asarray(world.light_of(picture).total, dtype=float))
    return {title: np.array(each) for title, each in runs.items()}


def mitsuba_pictures(scene: TriangleScene, settings: Any, options: argparse.Namespace) -> dict[str, FloatArray]:
    """(runs, H, W) pictures of a path tracer, by title."""
    import mitsuba

    mitsuba.set_variant(options.variant)
    found = {}
    for title, picture in pictures().items():
        with tempfile.TemporaryDirectory() as folder:
            loaded = scene_of(mitsuba, scene, settings, picture, Path(folder))
        found[title] = np.array(
            [
                np.pi * np.array(mitsuba.render(loaded, spp=options.spp, seed=seed), dtype=float)[..., 0]
                for seed in range(options.runs)
            ]
        )
    return found


def matte_scene(scene: TriangleScene) -> TriangleScene:
    """The scene without lobes."""
    return dataclasses.replace(scene, gloss=np.zeros_like(scene.gloss))


def row_of(names: tuple[str, str, str, str], found: FloatArray, runs: FloatArray, seconds: float) -> Row:
    """Hold a model's picture against the truth's runs."""
    each = np.array([blocks_of(run) for run in runs])
    truth, mean = each.mean(axis=0), each.mean()
    noise = float(np.sqrt(np.mean(each.var(axis=0, ddof=1)) / len(each)))
    rms = float(np.sqrt(np.mean((blocks_of(found) - truth) ** 2)))
    return Row(
        scene=names[0],
        picture=names[1],
        model=names[2],
        truth=names[3],
        bias=100 * float(blocks_of(found).mean() / mean - 1),
        rms=100 * rms / mean,
        noise=100 * noise / mean,
        rms_beyond_noise=100 * float(np.sqrt(max(rms**2 - noise**2, 0))) / mean,
        seconds=seconds,
    )


def compare(name: str, options: argparse.Namespace) -> list[Row]:
    """All rows of a scene."""
    settings = settings_of(name, options.rays, options.cell_size_m)
    scene = find_scene(settings, ROOT)
    make, truth = (mitsuba_pictures, "mitsuba") if options.mitsuba else (world_pictures, "world")
    rows = []
    for model, kind, glossy in (
        ("gloss", scene, True),
        ("matte", scene, False),
        ("control", matte_scene(scene), False),
    ):
        found, seconds = model_pictures(kind, settings, options, glossy=glossy)
        if model != "matte":
            runs = make(kind, settings, options)
        for title, picture in found.items():
            row = row_of((name, title, model, truth), picture, runs[title], seconds)
            rows.append(row)
            print(
                f"{row.scene:12s} {row.picture:7s} {row.model:8s} bias {row.bias:+.2f} %  rms {row.rms:.2f} %  noise "
                f"{row.noise:.2f} %  beyond {row.rms_beyond_noise:.2f} %  {row.seconds:.1f} s",
                file=sys.stderr if options.json else sys.stdout,
                flush=True,
            )
        if options.out:
            np.savez(f"{options.out}-{name}-{model}.npz", **{f"model_{k}": v for k, v in found.items()}, **runs)
    return rows


def main() -> int:
    """Compare, print, judge."""
    parser = argparse.ArgumentParser(description="The model's gloss against the simulated world and Mitsuba 3.")
    parser.add_argument("scenes", nargs="*", default=list(SCENES), help="glossy ones of the library; default: both")
    parser.add_argument("--patch-size-m", type=float, default=0.2, help="of the model")
    parser.add_argument("--patch-rays", type=int, default=256, help="of the model, pairs from each glossy patch")
    parser.add_argument("--camera-rays", type=int, default=32, help="of the model, from each pixel that sees gloss")
    parser.add_argument("--seed", type=int, default=0, help="of the model")
    parser.add_argument("--runs", type=int, default=2, help="of the truth, with different seeds")
    parser.add_argument("--rays", type=int, default=1024, help="of the world, from each of its light samples")
    parser.add_argument("--cell-size-m", type=float, default=0.12, help="of the world")
    parser.add_argument("--mitsuba", action="store_true", help="a path tracer is the truth")
    parser.add_argument("--spp", type=int, default=64, help="of the path tracer, samples of a pixel in each run")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--bias", type=float, default=1.0, help="largest mean bias, percent")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--out", help="beginning of files for the pictures")
    options = parser.parse_args()
    rows = [row for name in options.scenes for row in compare(name, options)]
    if options.json:
        print(json.dumps([dataclasses.asdict(row) for row in rows], indent=1))
    return int(max(abs(row.bias) for row in rows if row.model == "gloss") > options.bias)


if __name__ == "__main__":
    raise SystemExit(main())
