"""The simulated world of the library against a path tracer: python benchmarks/world_against_mitsuba.py [SCENE ...].

Mitsuba 3 renders each scene with the same triangles, materials, camera and projector (pinholes, no blur) as the
simulated world computes them, for a white picture and for one of bright blocks. Pictures are compared in blocks of
8 x 8 camera pixels. Printed for each scene and picture: mean bias (the world's mean over Mitsuba's), rms of the blocks'
differences over the mean, what of it Mitsuba's own noise explains (from the spread of its runs), and the rms without
it. Exit status 1 when a mean bias is above --bias.

Needs ``pip install mitsuba embreex`` and, for the ``llvm`` variants, LLVM 16 or newer (DRJIT_LIBLLVM_PATH names it).
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from rig.devices.simulated.mesh.find import find_scene
from rig.devices.simulated.mesh.scene import TriangleScene
from rig.devices.simulated.mesh.world import MeshWorld, exchange_of
from rig.devices.simulated.settings import SimulationSettings
from rig.devices.simulated.worlds.scenes import SCENES

FloatArray = NDArray[np.float64]

ROOT = Path(__file__).parents[1]
CAMERA, PROJECTOR, BLOCK_PX = (120, 160), (96, 128), 8
"""(height, width) of both pictures."""
CAMERA_FOCAL_PX, PROJECTOR_FOCAL_PX = 66.5, 53.9
"""Those of sim-room at this size."""
MAX_DEPTH, ROULETTE_DEPTH = 64, 12


def settings_of(scene: str, rays: int, cell_size_m: float) -> SimulationSettings:
    """The profile sim-furnished with another scene, its lenses made pinholes, its surfaces without texture."""
    table = tomllib.loads((ROOT / "hw_profiles" / "sim-furnished.toml").read_text())["simulation"]
    pinhole = {"roll_deg": 0.0, "distortion": [0.0] * 5, "vignetting": [0.0, 0.0], "blur_px": 0.0}
    for device, (height, width), focal_px in (
        (table["camera"][0], CAMERA, CAMERA_FOCAL_PX),
        (table["projector"][0], PROJECTOR, PROJECTOR_FOCAL_PX),
    ):
        for key in ("corner_blur_px", "aperture_m", "focus_m"):
            device.pop(key, None)
        middle = [(width - 1) / 2, (height - 1) / 2]
        device |= pinhole | {"focal_px": focal_px, "principal_point_px": middle}
    more = {
        "scene": scene,
        "texture": 0.0,
        "ambient": 0.0,
        "pixel_samples": 4,
        "rays": rays,
        "cell_size_m": cell_size_m,
    }
    return SimulationSettings.model_validate(table | more)


def pictures() -> dict[str, NDArray[np.float32]]:
    """Linear light: white, and a third of the picture in bright blocks."""
    white = np.ones(PROJECTOR, np.float32)
    blocks = np.kron(np.random.default_rng(3).uniform(size=(6, 8)) < 0.33, np.ones((16, 16))).astype(np.float32)
    return {"white": white, "blocks": blocks}


def view_of(device: Any, shape: tuple[int, int], mi: Any) -> dict[str, Any]:
    """Place and field of view, as Mitsuba wants them."""
    to_world = mi.ScalarTransform4f().look_at(
        origin=list(device.position_m), target=list(device.look_at_m), up=[0, 0, 1]
    )
    return {"fov": float(np.degrees(2 * np.arctan(shape[1] / 2 / device.focal_px))), "to_world": to_world}


def material_of(reflectance: float, gloss: float, roughness: float) -> dict[str, Any]:
    """Matte and GGX side by side; both sides of a triangle are alike."""

    def colour(value: float) -> dict[str, Any]:
        return {"type": "rgb", "value": float(value)}

    matte = {"type": "diffuse", "reflectance": colour(reflectance)}
    if gloss <= 0:
        return {"type": "twosided", "bsdf": matte}
    share = gloss / (gloss + reflectance)
    lobe = {
        "type": "roughconductor",
        "material": "none",
        "distribution": "ggx",
        "alpha": float(roughness),
        "specular_reflectance": colour(gloss / share),
    }
    matte["reflectance"] = colour(reflectance / (1 - share))
    return {"type": "twosided", "bsdf": {"type": "blendbsdf", "weight": float(share), "a": matte, "b": lobe}}


def scene_of(
    mi: Any, scene: TriangleScene, settings: SimulationSettings, picture: NDArray[np.float32], folder: Path
) -> Any:
    """Load a scene's triangles with the projector showing a picture."""
    flux_scale = settings.projector.flux * settings.projector.focal_px**2 / (PROJECTOR[0] * PROJECTOR[1]) / np.pi
    bitmap = mi.Bitmap(np.repeat(picture[..., None] * np.float32(flux_scale), 3, axis=2))
    texture = {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "nearest", "wrap_mode": "clamp"}
    film = {
        "type": "hdrfilm",
        "width": CAMERA[1],
        "height": CAMERA[0],
        "pixel_format": "rgb",
        "rfilter": {"type": "box"},
    }
    content: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": MAX_DEPTH, "rr_depth": ROULETTE_DEPTH},
        "sensor": {"type": "perspective", "fov_axis": "x", "near_clip": 0.01, "far_clip": 100.0, "film": film}
        | view_of(settings.camera, CAMERA, mi),
        "projector": {"type": "projector", "irradiance": texture} | view_of(settings.projector, PROJECTOR, mi),
    }
    for k, name in enumerate(scene.materials):
        on = np.flatnonzero(scene.material == k)
        file = folder / f"{scene.name}-{k}.ply"
        corners = scene.triangles_m[on].reshape(-1, 3)
        trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False).export(file)
        material = material_of(scene.reflectance[on[0]].mean(), scene.gloss[on[0]], scene.roughness[on[0]])
        content[f"part_{name}"] = {"type": "ply", "filename": str(file), "face_normals": True, "bsdf": material}
    return mi.load_dict(content)


def blocks_of(picture: NDArray[Any]) -> FloatArray:
    """Means of blocks."""
    height, width = picture.shape
    return np.asarray(
        picture.astype(float).reshape(height // BLOCK_PX, BLOCK_PX, width // BLOCK_PX, BLOCK_PX).mean(axis=(1, 3))
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Row:
    """What is found for one picture in one scene; shares of the mean, in percent."""

    scene: str
    picture: str
    bias: float
    bias_noise: float
    rms: float
    noise: float
    rms_beyond_noise: float
    direct_share: float
    world_s: float
    mitsuba_s: float


def compare(mi: Any, name: str, options: argparse.Namespace) -> list[Row]:
    """Both pictures of one scene."""
    settings = settings_of(name, options.rays, options.cell_size_m)
    started = time.perf_counter()
    exchange = exchange_of(find_scene(settings, ROOT), settings)
    world = MeshWorld(settings, exchange, CAMERA, PROJECTOR)
    prepared_s = time.perf_counter() - started
    rows = []
    for title, picture in pictures().items():
        started = time.perf_counter()
        light = world.light_of(picture)
        world_s = prepared_s + time.perf_counter() - started
        with tempfile.TemporaryDirectory() as folder:
            scene = scene_of(mi, exchange.scene, settings, picture, Path(folder))
        started = time.perf_counter()
        runs = [
            np.pi * np.array(mi.render(scene, spp=options.spp, seed=seed), dtype=np.float64)[..., 0]
            for seed in range(options.runs)
        ]
        mitsuba_s = time.perf_counter() - started
        if options.out:
            np.savez(f"{options.out}-{name}-{title}.npz", world=light.total, direct=light.direct, runs=np.array(runs))
        rows.append(row_of(name, title, light, np.array(runs), (world_s, mitsuba_s)))
    return rows


def row_of(name: str, title: str, light: Any, runs: FloatArray, seconds: tuple[float, float]) -> Row:
    """Hold the world against the runs."""
    each = np.array([blocks_of(run) for run in runs])
    truth, error = each.mean(axis=0), each.std(axis=0, ddof=1) / np.sqrt(len(each))
    found, mean = blocks_of(light.total), each.mean()
    rms, noise = (float(np.sqrt(np.mean(part**2))) for part in (found - truth, error))
    return Row(
        scene=name,
        picture=title,
        bias=100 * float(found.mean() / mean - 1),
        bias_noise=100 * float(each.mean(axis=(1, 2)).std(ddof=1) / np.sqrt(len(each)) / mean),
        rms=100 * rms / mean,
        noise=100 * noise / mean,
        rms_beyond_noise=100 * float(np.sqrt(max(rms**2 - noise**2, 0))) / mean,
        direct_share=100 * float(light.direct.mean() / light.total.mean()),
        world_s=seconds[0],
        mitsuba_s=seconds[1],
    )


def main() -> int:
    """Compare, print, judge."""
    parser = argparse.ArgumentParser(description="The simulated world against Mitsuba 3.")
    parser.add_argument("scenes", nargs="*", default=list(SCENES), help="of the library; default: all")
    parser.add_argument("--spp", type=int, default=512, help="samples of a pixel in each run")
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--rays", type=int, default=1024, help="of the world, from each of its light samples")
    parser.add_argument("--cell-size-m", type=float, default=0.12)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--bias", type=float, default=0.3, help="largest mean bias, percent")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--out", help="beginning of files for the pictures")
    options = parser.parse_args()
    import mitsuba

    mitsuba.set_variant(options.variant)
    rows = []
    for name in options.scenes:
        for row in compare(mitsuba, name, options):
            rows.append(row)
            print(
                f"{row.scene:12s} {row.picture:7s} bias {row.bias:+.2f} ± {row.bias_noise:.2f} %  rms {row.rms:.2f} %  "
                f"noise {row.noise:.2f} %  beyond {row.rms_beyond_noise:.2f} %  direct {row.direct_share:.0f} %  "
                f"{row.world_s:.1f} s, Mitsuba {row.mitsuba_s:.1f} s",
                file=sys.stderr if options.json else sys.stdout,
                flush=True,
            )
    if options.json:
        print(json.dumps([dataclasses.asdict(row) for row in rows], indent=1))
    return int(max(abs(row.bias) for row in rows) > options.bias)


if __name__ == "__main__":
    raise SystemExit(main())
