"""Strategies at full projector resolution: python benchmarks/full_resolution.py [--height H] [--patch M] [NAME ...].

The paper's room in the ``physical`` convention, walls with a fine texture, interreflection bilinear between patch
centres. Prints seconds of one thread's processor time, steps, and for the optimum its certificate; grey, then colour.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.sparse import csr_array, diags_array
from skimage.data import astronaut
from skimage.transform import resize

from sim.compensation import compensate
from sim.form_factors import form_factors
from sim.geometry.optics import Lens, Pose, rays_at
from sim.geometry.scene import intersect
from sim.light.colour import ColourTransport
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport
from sim.light.transport_of_scene import coaxial_transport, smooth_view
from sim.scenes.gridded import room

POSE = Pose.look_at((1.15, 1.15, 1.25), (2.15, 2.15, 1.0))
REFLECTANCES = (0.7, 0.65, 0.55)
MIXING = np.array([[0.9, 0.08, 0.02], [0.06, 0.8, 0.1], [0.0, 0.12, 0.7]])
TARGET_WHITE_SHARE = 0.7
TEXTURE = 0.02


def transport_of(lens: Lens, patch_size_m: float, reflectance: float) -> LightTransport:
    """Textured walls: direct light and view vary from pixel to pixel."""
    scene = room((4.8, 4.8, 2.4), patch_size_m, reflectance)
    factors = form_factors(scene)
    even = coaxial_transport(scene, factors, lens, POSE, convention="physical", emission_rule="area", subsamples=1)
    texture = 1 + TEXTURE * np.random.default_rng(1).normal(size=lens.n_pixels)
    hits = intersect(scene, POSE.position_m, rays_at(lens, POSE, lens.pixel_grid()))
    view = smooth_view(scene, hits, reflectance * texture)
    direct = csr_array(diags_array(even.direct_matrix.diagonal() * texture))
    radiosity = Radiosity(factors, scene.reflectance, solver="direct")
    return LightTransport(
        direct, even.emission, radiosity, view, pixel_patch=even.pixel_patch, pixel_xy_px=lens.pixel_grid()
    )


def report(title: str, transport: LightTransport | ColourTransport, target: np.ndarray, names: list[str]) -> None:
    """Run the strategies on one transport."""
    print(title, flush=True)
    level = target.max() / 255
    for name in names:
        started = time.process_time()
        result = compensate(name, transport, target)
        seconds = time.process_time() - started
        error = np.abs(result.predicted - target).mean() / level
        line = f"  {name:18s} {seconds:7.2f} s  {result.iterations:3d} steps  mean error {error:5.1f} of 255"
        if "gap" in result.notes:
            line += f"  gap {result.notes['gap']:.1e}, {result.notes['products']} products, "
            line += f"{result.clipped.mean():.0%} clipped"
        print(line, flush=True)


def main() -> None:
    """Build, run, print."""
    parser = argparse.ArgumentParser(description="Strategies at full projector resolution.")
    parser.add_argument("--height", type=int, default=1080)
    parser.add_argument("--patch", type=float, default=0.2, help="patch size in m")
    parser.add_argument("names", nargs="*", default=["direct", "exact", "reverse_radiosity", "bounded"])
    options = parser.parse_args()
    height, width = options.height, options.height * 16 // 9
    lens = Lens.from_horizontal_field_of_view(width, height, 100.0)
    picture = (resize(astronaut() / 255.0, (height, width), order=1) ** 2.2).reshape(-1, 3)
    bands = [transport_of(lens, options.patch, reflectance) for reflectance in REFLECTANCES]
    for band in bands:
        # Made once a scene, not once a picture.
        _ = band.interreflection
    lit, viewed = bands[0].interreflection.patch_to_patch.shape[::-1]
    print(f"{width} x {height}, {bands[0].radiosity.n_patches} patches, {lit} lit, {viewed} viewed")
    white = bands[0] @ np.ones(lens.n_pixels)
    report("grey", bands[0], picture.mean(axis=1) * TARGET_WHITE_SHARE * np.median(white), options.names)
    colour = ColourTransport(bands, MIXING)
    white = np.median(colour.forward(np.ones((lens.n_pixels, 3))), axis=0)
    report("colour", colour, picture * TARGET_WHITE_SHARE * white, options.names)


if __name__ == "__main__":
    main()
