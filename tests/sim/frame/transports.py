"""Transports, targets and response curves for tests of frames."""

import numpy as np
from scipy.sparse import csr_array, diags_array

from sim import _kernel
from sim.form_factors import form_factors
from sim.frame.compensator import FrameCompensator
from sim.geometry.optics import Lens, Pose, rays_at
from sim.geometry.scene import intersect
from sim.light.colour import ColourTransport
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport
from sim.light.transport_of_scene import area_emission, irradiance_at, smooth_view
from sim.scenes.gridded import ROOM_FACES, room

POSE = Pose.look_at((1.2, 1.2, 1.2), (2.2, 2.2, 1.2))
GAMMA = (np.arange(256) / 255) ** 2.2
# Flat at both ends, as projectors' bright modes are.
S_CURVE = np.cumsum(np.concatenate([[0], np.sin(np.pi * np.arange(0.5, 255) / 255) ** 3]))
MIXING = np.array([[1.0, 0.1, 0.02], [0.08, 1.0, 0.1], [0.0, 0.06, 1.0]])


def transport(width=45, height=29, reflectance=0.7, faces=ROOM_FACES, patch_size_m=0.6, pose=POSE):
    """What a camera at the projector sees of a room, pixel by pixel of the projector."""
    scene = room((4.8, 4.8, 2.4), patch_size_m, reflectance, faces)
    lens = Lens.from_horizontal_field_of_view(width, height, 100.0)
    rays = rays_at(lens, pose, lens.pixel_grid())
    hits = intersect(scene, pose.position_m, rays)
    met = np.flatnonzero(hits.patch >= 0)
    points = pose.position_m + hits.distance[met, None] * rays[met]
    light = np.zeros(lens.n_pixels)
    light[met] = reflectance * irradiance_at(scene, lens, pose, points_m=points, patch=hits.patch[met])
    return LightTransport(
        csr_array(diags_array(light)),
        area_emission(scene, lens, pose, subsamples=2, convention="physical"),
        Radiosity(form_factors(scene), scene.reflectance),
        smooth_view(scene, hits, np.full(lens.n_pixels, reflectance)),
        pixel_patch=hits.patch,
    )


def in_colour(width=45, height=29, mixing=MIXING):
    return ColourTransport([transport(width, height, rho) for rho in (0.75, 0.65, 0.5)], mixing)


def level(colour):
    """A target's full scale: 0.6 of the median of white, band by band."""
    if isinstance(colour, LightTransport):
        return 0.6 * np.median(colour @ np.ones(colour.shape[1]))
    return 0.6 * np.median(colour.forward(np.ones((colour.bands[0].shape[1], 3))), axis=0)


def picture(shape, seed=0):
    """Smooth shapes with some noise, from dark to bright."""
    generator = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]] / max(shape)
    waves = [0.5 + 0.45 * np.sin(5 * x + 3 * k) * np.cos(4 * y - k + seed / 5) for k in range(3)]
    return np.rint(255 * np.clip(np.stack(waves, axis=-1) + generator.normal(0, 0.03, (*shape, 3)), 0, 1)).astype(
        np.uint8
    )


def difference(a, b):
    return np.abs(a.astype(int) - b.astype(int))


def check_same_bytes(model, strategy, codes, *, threads):
    """No count of threads and no instruction set changes a byte of a frame."""
    first = FrameCompensator(model, strategy, threads=1).frame(codes)
    for count in threads:
        assert np.array_equal(FrameCompensator(model, strategy, count).frame(codes), first)
    try:
        for name in _kernel.instruction_sets():
            _kernel.set_instruction_set(name)
            assert np.array_equal(FrameCompensator(model, strategy).frame(codes), first)
    finally:
        _kernel.set_instruction_set(_kernel.best_instruction_set())
