"""What a path tracer makes of the paper's room: python benchmarks/path_tracer.py [--runs 16] [--spp 256] [--out FILE].

Mitsuba 3 renders the coaxial picture that ``sim.picture.image`` computes (paper convention, white image, rho 0.7) and
leaves the means of its 16 x 16-pixel blocks, their standard error from the spread of the runs, and its times in a
small file: rig/benchmark/data/path_tracer_blocks.npz came from here.

Needs ``pip install mitsuba`` and, for the ``llvm`` variants, LLVM 16 or newer (Debian: ``apt-get install libllvm19``;
its LLVM 14 and 15 crash on processors with AVX-512). DRJIT_LIBLLVM_PATH is respected and otherwise searched for.

Mitsuba's ``projector`` is a pinhole whose pixels carry equal flux: irradiance I / (r² cos³ gamma) times cos theta.
The paper has no fall-off, so the picture is multiplied by r² cos³ gamma / pi beforehand, and the render by pi.
"""

from __future__ import annotations

import argparse
import ctypes.util
import glob
import os
import platform
import statistics
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.geometry.optics import Lens, Pose, pixel_rays
from sim.geometry.scene import intersect
from sim.scenes.gridded import paper_room

FloatArray = NDArray[np.float64]

WIDTH_PX, HEIGHT_PX, FIELD_DEG, BLOCK_PX, REFLECTANCE = 640, 480, 100.0, 16, 0.7
POSITION_M, TARGET_M = (1.0, 1.0, 1.2), (4.8, 4.8, 1.2)
MAX_DEPTH, ROULETTE_DEPTH = 64, 6
LENS = Lens.from_horizontal_field_of_view(WIDTH_PX, HEIGHT_PX, FIELD_DEG)
POSE = Pose.look_at(POSITION_M, TARGET_M)


def find_llvm() -> str | None:
    """Newest LLVM library of the usual places, unless the environment names one."""
    if named := os.environ.get("DRJIT_LIBLLVM_PATH"):
        return named
    folders = ("/usr/lib/*", "/usr/lib", "/usr/lib64", "/usr/local/lib", "/opt/homebrew/opt/llvm/lib")
    found = [path for folder in folders for path in glob.glob(f"{folder}/libLLVM*.so*")]
    versions = {path: _version(path) for path in found}
    usable = [path for path in found if versions[path] >= 16]
    return max(usable, key=lambda path: versions[path], default=ctypes.util.find_library("LLVM"))


def _version(path: str) -> int:
    digits = "".join(c if c.isdigit() else " " for c in os.path.basename(path)).split()
    return int(digits[0]) if digits else 0


def load_mitsuba(variant: str) -> Any:
    """Mitsuba with a variant set."""
    if variant.startswith("llvm") and (library := find_llvm()):
        os.environ["DRJIT_LIBLLVM_PATH"] = library
    import mitsuba

    mitsuba.set_variant(variant)
    return mitsuba


def pixel_geometry() -> tuple[FloatArray, FloatArray]:
    """(H, W) cos theta of the direct light, and the r² cos³ gamma that the paper's convention leaves out."""
    rays = pixel_rays(LENS, POSE)
    hits = intersect(paper_room(reflectance=REFLECTANCE), POSE.position_m, rays.reshape(-1, 3))
    cos_gamma = rays @ POSE.rotation[2]
    return hits.cos_incidence.reshape(LENS.shape), hits.distance.reshape(LENS.shape) ** 2 * cos_gamma**3


def scene_of(mi: Any, picture: FloatArray, max_depth: int) -> Any:
    """Load the room with a projector that shows the picture and a sensor in its place."""
    transform = mi.ScalarTransform4f
    to_world = transform().look_at(origin=list(POSITION_M), target=list(TARGET_M), up=[0, 0, 1])
    view = {"fov": FIELD_DEG, "to_world": to_world}
    bitmap = mi.Bitmap(np.repeat(picture[..., None], 3, axis=2).astype(np.float32))
    texture = {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "nearest", "wrap_mode": "clamp"}
    film = {
        "type": "hdrfilm",
        "width": WIDTH_PX,
        "height": HEIGHT_PX,
        "pixel_format": "rgb",
        "rfilter": {"type": "box"},
    }
    box = {"rfilter": {"type": "box"}}
    content: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": max_depth, "rr_depth": ROULETTE_DEPTH},
        "sensor": {"type": "perspective", "fov_axis": "x", "near_clip": 0.01, "far_clip": 100.0, "film": film | box}
        | view,
        "projector": {"type": "projector", "irradiance": texture} | view,
    }
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": REFLECTANCE}}
    for face in paper_room().faces:
        middle = face.points(0.5, 0.5)
        columns = np.stack([face.edge_u_m / 2, face.edge_v_m / 2, face.normal, middle], axis=1)
        matrix = np.vstack([columns, [0, 0, 0, 1]])
        content[f"face_{face.name}"] = {"type": "rectangle", "to_world": transform(matrix), "bsdf": white}
    return mi.load_dict(content)


def render(mi: Any, scene: Any, spp: int, seed: int) -> tuple[FloatArray, float]:
    """(H, W) picture in the paper's convention, and the seconds that it took."""
    started = time.perf_counter()
    pixels = np.array(mi.render(scene, spp=spp, seed=seed), dtype=np.float64)[..., 0]
    return np.pi * pixels, time.perf_counter() - started


def block_means(picture: FloatArray) -> FloatArray:
    """(H / 16, W / 16) means."""
    return picture.reshape(HEIGHT_PX // BLOCK_PX, BLOCK_PX, WIDTH_PX // BLOCK_PX, BLOCK_PX).mean(axis=(1, 3))


def check_units(mi: Any, warp: FloatArray, cos_theta: FloatArray) -> float:
    """Largest deviation of the direct light alone from rho cos theta, as a share, on block means."""
    direct, _ = render(mi, scene_of(mi, warp, max_depth=2), 64, 1)
    return float(np.abs(block_means(direct) / block_means(REFLECTANCE * cos_theta) - 1).max())


def main() -> None:
    """Render, report, and store the block means."""
    parser = argparse.ArgumentParser(description="Block means of the paper's room from Mitsuba 3.")
    parser.add_argument("--runs", type=int, default=16)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--out", default="path_tracer_blocks.npz")
    options = parser.parse_args()
    mi = load_mitsuba(options.variant)
    cos_theta, falloff = pixel_geometry()
    warp = falloff / np.pi
    deviation = check_units(mi, warp, cos_theta)
    print(f"direct light against rho cos theta: largest deviation of a block {deviation:.2e}", flush=True)
    scene = scene_of(mi, warp, MAX_DEPTH)
    render(mi, scene, options.spp, 10_000)  # compiles
    total, squares, blocks, seconds = np.zeros(LENS.shape), np.zeros(LENS.shape), [], []
    for seed in range(1, options.runs + 1):
        picture, took = render(mi, scene, options.spp, seed)
        total, squares = total + picture, squares + picture**2
        blocks.append(block_means(picture))
        seconds.append(took)
        if seed > 1:
            store(
                options,
                mi.__version__,
                deviation,
                blocks=np.array(blocks),
                seconds=seconds,
                noise=pixel_noise(total, squares, seed),
            )


def pixel_noise(total: FloatArray, squares: FloatArray, runs: int) -> float:
    """Standard deviation of a pixel of one run over the mean of the picture."""
    variance = (squares - total**2 / runs) / (runs - 1)
    return float(np.sqrt(variance.mean()) / (total.mean() / runs))


def store(
    options: argparse.Namespace, version: str, deviation: float, blocks: FloatArray, seconds: list[float], noise: float
) -> None:
    """Write the file anew after each run, so that a run that is cut short leaves one too."""
    runs, median_s = len(blocks), statistics.median(seconds)
    mean, error = blocks.mean(axis=0), blocks.std(axis=0, ddof=1) / np.sqrt(runs)
    relative = float(np.sqrt(((error / mean) ** 2).mean()))
    print(
        f"{runs} x {options.spp} spp: median {median_s:.1f} s a run, pixel noise {100 * noise:.2f} %, "
        f"{noise**2 / 1e-4 * median_s:.0f} s for 1 %; block standard error {100 * relative:.3f} % rms",
        flush=True,
    )
    np.savez_compressed(
        options.out,
        block_mean=mean,
        block_standard_error=error,
        runs=runs,
        spp=options.spp,
        max_depth=MAX_DEPTH,
        roulette_depth=ROULETTE_DEPTH,
        reflectance=REFLECTANCE,
        position_m=POSITION_M,
        target_m=TARGET_M,
        horizontal_field_of_view_deg=FIELD_DEG,
        image_px=(HEIGHT_PX, WIDTH_PX),
        block_px=BLOCK_PX,
        seconds=seconds,
        pixel_noise=noise,
        direct_deviation=deviation,
        tracer=f"Mitsuba {version} {options.variant}, {platform.machine()}, {os.cpu_count()} processors",
    )


if __name__ == "__main__":
    main()
