"""The simulated world's own light transport in the projector's view: what an oracle would compute with.

Only scores may use it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse import csr_array, diags_array

from rig.devices.simulated.optics import (
    blur_variance_px2,
    directions,
    flux_density,
    pixels_of,
    relative_illumination,
)
from rig.devices.simulated.pair import SeenLight, SimulatedPair, pixel_grid
from rig.devices.simulated.room import SimulatedRoom, interpolation, reflectance_at, trace
from rig.devices.simulated.world import SimulatedWorld
from rig.errors import ProfileError
from rig.stages.model import FittedScene
from sim.light.colour import ColourTransport
from sim.light.picture_blur import PictureBlur
from sim.light.transport import LightTransport

FloatArray = NDArray[np.float64]

SAMPLES = 2
"""Sub-samples of a projector pixel along each axis."""


class CellRadiosity:
    """The simulated room as the system (I - G) B = E; its factors are not reciprocal, so it is factored as it is."""

    def __init__(self, room: SimulatedRoom):
        self.form_factors = room.form_factors
        self.reflectance: FloatArray = room.reflectance.astype(np.float64)
        self.n_patches = len(self.reflectance)

    @cached_property
    def _factor(self) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        matrix = -self.reflectance.astype(np.float32)[:, None] * self.form_factors
        matrix[np.diag_indices_from(matrix)] += 1
        factor, pivots = lu_factor(matrix, overwrite_a=True, check_finite=False)
        return factor, pivots

    def solve(self, E: FloatArray) -> FloatArray:
        """Return B of E, (N,) or (N, K)."""
        return self._solved(E, transposed=False)

    def solve_adjoint(self, e: FloatArray) -> FloatArray:
        """Return (I - G)⁻ᵀ e."""
        return self._solved(e, transposed=True)

    def gather(self, B: FloatArray) -> FloatArray:
        """Return G B."""
        return np.asarray(self.reflectance * (self.form_factors @ B.astype(np.float32)), dtype=np.float64)

    def _solved(self, right: FloatArray, *, transposed: bool) -> FloatArray:
        solved = lu_solve(self._factor, right.astype(np.float32), trans=int(transposed), check_finite=False)
        return np.asarray(solved, dtype=np.float64)


def ground_truth_transport(worlds: Sequence[SimulatedPair], model: FittedScene) -> ColourTransport:
    """Return T of the simulated world from the model's steered pixels to what the camera sees there.

    It is in the session's unit, and of light on the wall: of lens blur it has the projector's alone, as the model's own
    view.
    Raises ProfileError of a world that is no box.
    """
    boxes = [world for world in worlds if isinstance(world, SimulatedWorld)]
    if len(boxes) < len(worlds):
        raise ProfileError(
            "simulation.scene: what knowing the world would give is there for boxes only; leave out --oracle"
        )
    bands = [_true_band(world, model, b) for b, world in enumerate(boxes)]
    return ColourTransport(bands, ground_truth_mixing(worlds))


def ground_truth_mixing(worlds: Sequence[SimulatedPair]) -> FloatArray:
    """Return (B, B) share of white in each band that each channel of the projector makes."""
    if len(worlds) == 1:
        return np.eye(1)
    weights = np.stack([world.channel_weights for world in worlds])
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _true_band(world: SimulatedWorld, model: FittedScene, band: int) -> LightTransport:
    direct, reflected, view = _surface(world)
    chosen = np.flatnonzero(model.room.active)
    white = world.channel_weights.sum()
    scale = _unit(world, model, band) * white * (1 - 1 / world.settings.projector.contrast)
    radiosity = CellRadiosity(world.room)
    cells = diags_array(1 / radiosity.reflectance)  # B - E = ρ H, and the view is of the irradiance H
    seen = csr_array(diags_array(reflected) @ view @ cells)[chosen]
    emission = csr_array(world.emission[:, chosen].astype(np.float64)) * scale
    patch = model.scene_model.projector_hits.hits.patch[chosen]
    variance = blur_variance_px2(world.projector)
    return LightTransport(
        csr_array(diags_array(direct[chosen] * scale)),
        emission,
        radiosity,  # type: ignore[arg-type]
        seen,
        pixel_patch=patch,
        blur=PictureBlur(variance_px2=np.stack([variance, variance], axis=-1), chosen=model.room.active),
    )


def _surface(world: SimulatedWorld) -> tuple[FloatArray, FloatArray, csr_array]:
    """(n,) direct light of white and (n,) reflectance, both dimmed by the camera; (n, cells) irradiance seen."""
    height, width = world.projector.shape
    grid = pixel_grid(world.projector.shape, SAMPLES)
    surface = trace(world.room, world.projector.position_m, directions(world.projector, grid))
    reflectance = np.zeros(surface.wall.shape)
    for k in range(len(world.room.walls)):
        on = surface.wall == k
        reflectance[on] = reflectance_at(world.room, k, surface.points_m[on])
    dimmed = reflectance * relative_illumination(world.camera, pixels_of(world.camera, surface.points_m))
    flux = world.settings.projector.flux / (height * width) * relative_illumination(world.projector, grid)
    direct = dimmed * flux * flux_density(world.projector, surface.points_m, surface.cos_incidence)
    centres = pixel_grid(world.projector.shape)
    view = interpolation(
        world.room, trace(world.room, world.projector.position_m, directions(world.projector, centres))
    )
    return _pixel_means(direct), _pixel_means(dimmed), view


def _pixel_means(fine: FloatArray) -> FloatArray:
    """(n,) means over sub-samples; 0 where rays escape."""
    height, width = (size // SAMPLES for size in fine.shape)
    means = np.nan_to_num(fine).reshape(height, SAMPLES, width, SAMPLES).mean(axis=(1, 3))
    return np.asarray(means.ravel())


def _unit(world: SimulatedWorld, model: FittedScene, band: int) -> float:
    """Session's light over the simulated world's in a band, by white: the unit of light is relative."""
    eye = SeenLight(world, 2)
    white, black = (eye.of(np.full(world.projector.shape, code, np.uint8)) for code in (255, 0))
    return float(model.white[..., band][model.lit].mean() / (white - black)[model.lit].mean())
