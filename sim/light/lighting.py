"""Test lightings that a plan is made for: irradiance of white at every point of a surface, 1 = white."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim.arguments import word_of
from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError
from sim.form_factors.occlusion import segments_blocked
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.geometry.optics import Lens, Pose, project
from sim.geometry.rays import stands_in_air
from sim.kept import Kept

SAMPLES = 4
"""Light is sampled at SAMPLES x SAMPLES points of a patch, and at the square of that where it varies."""
POINTS_AT_A_TIME = 1 << 13
"""Their arrays take less than 2 MB."""

Irradiance = Callable[[FloatArray, FloatArray, IntArray], FloatArray]
"""(N,) irradiance from points (N, 3) [m], normals (N, 3) and regions (N,); 1 = white."""


@dataclass(frozen=True, kw_only=True)
class Lighting:
    """How white light falls on a scene, by name."""

    name: str
    description: str
    irradiance: Irradiance
    source_m: FloatArray | None = None
    """(3,) where all of it comes from [m]; None: from everywhere alike."""
    even: bool = False
    """One number on each region: one point of a patch tells it all."""


TEST_LIGHTINGS = ("projector", "floor", "uniform")


@dataclass(frozen=True, kw_only=True)
class PlacedProjector:
    """A white projector where somebody wants it, instead of a test lighting: 4:3, cos(theta) without fall-off."""

    position_m: tuple[float, float, float]
    look_at_m: tuple[float, float, float]
    hfov_deg: float = 100.0
    """Horizontal field of view. [degrees]"""

    @property
    def lens(self) -> Lens:
        """Its lens. Raises SimulationError for a field of view that is none."""
        return Lens.from_horizontal_field_of_view(640, 480, self.hfov_deg)

    @property
    def pose(self) -> Pose:
        """Where it stands. Raises SimulationError for an aim at its own place, or straight up or down."""
        return Pose.look_at(self.position_m, self.look_at_m)


def make_test_lighting(name: str | PlacedProjector, cells: AdaptivePatches) -> Lighting:
    """Return one of ``TEST_LIGHTINGS`` for a scene, or that of a projector that is placed.

    ``projector``: white from a 640 x 480 projector with a horizontal field of view of 100 degrees, standing at
    5/24 of the scene's length and width and half its height, aimed level at the far corner: cos(theta) without
    fall-off (the paper's convention), with shadows. ``floor``: irradiance 1 on the lowest region that faces
    up, or on the first region. ``uniform``: irradiance 1 everywhere.

    Parameters
    ----------
    name : {"projector", "floor", "uniform"} or PlacedProjector
    cells : AdaptivePatches
        Of the scene.

    Returns
    -------
    Lighting

    Raises
    ------
    SimulationError
        For an unknown name, or a projector that lights nothing.
    """
    if isinstance(name, PlacedProjector):
        return _lighting_something(name, cells)
    word_of("light", name, TEST_LIGHTINGS)
    if name == "uniform":
        return Lighting(
            name=name,
            description="white light 1 on every surface",
            irradiance=lambda points, _normals, _region: np.ones(len(points)),
            even=True,
        )
    if name == "floor":
        lit = _floor(cells)
        return Lighting(
            name=name,
            description="white light 1 on the floor",
            irradiance=lambda _points, _normals, region: (region == lit) * 1.0,
            even=True,
        )
    return _lighting_something(standard_projector(cells), cells)


def _lighting_something(projector: PlacedProjector, cells: AdaptivePatches) -> Lighting:
    if not stands_in_air(cells, projector.position_m):
        place = ", ".join(f"{one:g}" for one in projector.position_m)
        raise SimulationError(
            f"{cells.name}: a projector at ({place}) m is in or behind a wall, or outside; move it into the room's air"
        )
    light = _projector(projector, cells)
    if not emission(cells.quarters().quarters(), light).irradiance.any():
        raise SimulationError(
            f"{cells.name}: the projector lights nothing from {list(projector.position_m)} m towards "
            f"{list(projector.look_at_m)} m; move it, aim at a surface's lit side, or use the light 'floor'"
        )
    return light


def _floor(cells: AdaptivePatches) -> int:
    up = np.flatnonzero(cells.normals[:, 2] > 1 - 1e-6)
    lowest = up[np.argmin(cells.centres[up, 2])] if len(up) else 0
    return int(cells.region[lowest])


def standard_projector(cells: AdaptivePatches) -> PlacedProjector:
    """Return the projector of the test lighting of that name."""
    corners = cells.vertices.reshape(-1, 3)
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    position, aim = low + size * np.array([5 / 24, 5 / 24, 0.5]), low + size * np.array([1, 1, 0.5])
    return PlacedProjector(position_m=tuple(position.tolist()), look_at_m=tuple(aim.tolist()))


def _projector(placed: PlacedProjector, cells: AdaptivePatches) -> Lighting:
    lens, pose = placed.lens, placed.pose

    def irradiance(points: FloatArray, normals: FloatArray, _region: IntArray) -> FloatArray:
        ray = points - pose.position_m
        cosine = -np.einsum("nk,nk->n", ray, normals) / np.maximum(np.linalg.norm(ray, axis=1), 1e-12)
        xy = project(lens, pose, points)
        with np.errstate(invalid="ignore"):
            lit = ((xy > -0.5) & (xy < np.array([lens.width_px, lens.height_px]) - 0.5)).all(axis=1) & (cosine > 0)
        if not cells.convex:
            lit[lit] = ~segments_blocked(cells, np.tile(pose.position_m, (int(lit.sum()), 1)), points[lit])
        return np.where(lit, cosine, 0.0)

    x, y, z = pose.position_m
    return Lighting(
        name="projector",
        description=f"white from a projector at ({x:.2f}, {y:.2f}, {z:.2f}) m, {placed.hfov_deg:g} degrees wide",
        irradiance=irradiance,
        source_m=pose.position_m,
    )


@dataclass(frozen=True, eq=False)
class Emission:
    """White light on patches."""

    irradiance: FloatArray
    """(P,) mean over each patch; 1 = white."""
    variance: FloatArray
    """(P,) of the irradiance within each patch."""


_known = Kept[AdaptivePatches, tuple[Lighting, Emission]]("_emission")


def emission(cells: AdaptivePatches, light: Lighting) -> Emission:
    """Return the mean and variance of a lighting over each patch, found once: a plan's patches are simulated next."""
    kept = _known.get(cells)
    if kept is None or kept[0] is not light:
        kept = _known.keep(cells, (light, _even(cells, light) if light.even else _uneven(cells, light)))
    return kept[1]


def remember_emission(cells: AdaptivePatches, light: Lighting, known: Emission) -> None:
    """Keep the light on patches that was found piece by piece."""
    _known.keep(cells, (light, known))


def _even(cells: AdaptivePatches, light: Lighting) -> Emission:
    return Emission(light.irradiance(cells.centres, cells.normals, cells.region), np.zeros(cells.n_patches))


def _uneven(cells: AdaptivePatches, light: Lighting) -> Emission:
    mean, variance = _sampled(cells, light, SAMPLES)
    varies = variance > 1e-12
    if varies.any():
        mean[varies], variance[varies] = _sampled(cells.chosen(varies), light, SAMPLES**2)
    return Emission(mean, variance)


def _sampled(cells: AdaptivePatches, light: Lighting, n: int) -> tuple[FloatArray, FloatArray]:
    step = max(1, POINTS_AT_A_TIME // n**2)
    starts = range(0, cells.n_patches, step)
    parts = [_moments(cells.chosen(np.arange(k, min(k + step, cells.n_patches))), light, n) for k in starts]
    mean, variance = (np.concatenate(part) for part in zip(*parts, strict=True))
    return mean, variance


def _moments(cells: AdaptivePatches, light: Lighting, n: int) -> tuple[FloatArray, FloatArray]:
    """(P,) means and variances over n x n points."""
    points, weights = sample_points(cells, n)
    normals, region = np.repeat(cells.normals, n * n, axis=0), np.repeat(cells.region, n * n)
    values = light.irradiance(points.reshape(-1, 3), normals, region).reshape(-1, n * n)
    mean = (weights * values).sum(axis=1)
    return mean, (weights * (values - mean[:, None]) ** 2).sum(axis=1)


def sample_points(cells: AdaptivePatches, n: int) -> tuple[FloatArray, FloatArray]:
    """Return (P, n², 3) midpoints of an n x n division of each patch [m] and their (P, n²) shares of its area."""
    places = (np.arange(n) + 0.5) / n
    s, t = (grid.ravel()[None, :, None] for grid in np.meshgrid(places, places))
    a, b, c, d = (corner[:, None] for corner in np.moveaxis(cells.vertices, 1, 0))
    points = (1 - s) * (1 - t) * a + s * (1 - t) * b + s * t * c + (1 - s) * t * d
    along = np.cross((1 - t) * (b - a) + t * (c - d), (1 - s) * (d - a) + s * (c - b))
    weights = np.linalg.norm(along, axis=2)
    return points, weights / weights.sum(axis=1, keepdims=True)
