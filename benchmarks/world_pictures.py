"""How fast the simulated world of a profile is: python benchmarks/world_pictures.py [PROFILE] [--scene NAME ...].

Prints, for each scene, triangles, cells and light samples, the seconds until the first picture (by the wall and of
processor time), and how many pictures a minute follow; every picture is another one.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from rig.devices.simulated.mesh.find import find_scene
from rig.devices.simulated.mesh.world import MeshWorld, exchange_of
from rig.devices.simulated.settings import SimulationSettings
from rig.profile.schema import load_profile


def main() -> None:
    """Time all scenes that are asked for."""
    parser = argparse.ArgumentParser(description="Pictures a minute of the simulated world.")
    parser.add_argument("profile", nargs="?", default="sim-furnished")
    parser.add_argument("--scene", nargs="*", help="of the library; default: the profile's")
    parser.add_argument("--pictures", type=int, default=20)
    options = parser.parse_args()
    profile = load_profile(options.profile)
    if profile.simulation is None:
        raise SystemExit(f"{options.profile}: has no [simulation]")
    for name in options.scene or [profile.simulation.scene]:
        table = profile.simulation.model_dump(by_alias=True) | {"scene": name}
        settings = SimulationSettings.model_validate(table)
        started_s, started_cpu_s = time.perf_counter(), time.process_time()
        exchange = exchange_of(find_scene(settings, profile.path.parent), settings)
        world = MeshWorld(settings, exchange, profile.camera.shape[:2], profile.projector.shape)
        world.light(np.full(profile.projector.shape, 255, np.uint8))
        prepared_s, prepared_cpu_s = time.perf_counter() - started_s, time.process_time() - started_cpu_s
        random = np.random.default_rng(1)
        pictures = [random.integers(0, 256, profile.projector.shape, dtype=np.uint8) for _ in range(options.pictures)]
        started_s, started_cpu_s = time.perf_counter(), time.process_time()
        for codes in pictures:
            world.through_lens(world.light(codes).total)
        took_s, took_cpu_s = time.perf_counter() - started_s, time.process_time() - started_cpu_s
        grid = exchange.grid
        size = f"{len(exchange.scene.triangles_m)} triangles, {grid.n_cells} cells, {grid.n_nodes} samples"
        print(
            f"{name}: {size}; prepared in {prepared_s:.1f} s ({prepared_cpu_s:.1f} of processor time); "
            f"{60 * options.pictures / took_s:.0f} pictures a minute, {took_cpu_s / options.pictures:.2f} s of it "
            "each",
            flush=True,
        )


if __name__ == "__main__":
    main()
