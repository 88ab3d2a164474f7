"""Light's ways from a projector into a scene and from a scene into a camera, found once for all pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack

from rig.devices.simulated.defocus import DiscLevels, looked_up
from rig.devices.simulated.mesh.exchange import Exchange
from rig.devices.simulated.mesh.scene import FloatArray, IntArray
from rig.devices.simulated.mesh.shading import ProjectorLight, Reflectance
from rig.devices.simulated.mesh.walks import Leg, reflected, walks
from rig.devices.simulated.optics import SimulatedOptics, directions
from rig.devices.simulated.pair import pixel_grid

Float32Array = NDArray[np.float32]

_BATCH_RAYS = 1 << 18
_ROW = 1024
"""Samples side by side in what OpenCV takes for a picture; its sides are below 32768."""
_LOBE_RAYS = 8
"""From each sample of a camera pixel on something glossy; chosen: 32 a pixel, with 2 x 2 samples."""


@dataclass(frozen=True, kw_only=True)
class LookUps:
    """Samples of the projector's picture that camera pixels see; each adds its gain times the picture's light."""

    pixel: IntArray
    """(n,) camera pixel."""
    x_px: Float32Array
    """(n / 1024, 1024) in the projector's picture, as `y_px` is."""
    y_px: Float32Array
    gain: Float32Array
    """(n,) camera radiosity for white."""
    levels: DiscLevels


@dataclass(frozen=True, kw_only=True)
class CameraPaths:
    """What a camera sees."""

    direct: LookUps
    """Projector to surface to camera."""
    mirrored: LookUps
    """Projector to surface to glossy surfaces to camera."""
    view: csr_array
    """(pixels, 2 V) radiosity seen for each node's irradiance."""


@dataclass(frozen=True, kw_only=True)
class ProjectorPaths:
    """Where a projector's light goes first."""

    landing: csr_array
    """(2 C, pixels) mean irradiance of cells."""
    by_gloss: csr_array
    """(2 V, pixels) irradiance at nodes by way of glossy surfaces."""


def camera_paths(
    exchange: Exchange,
    camera: SimulatedOptics,
    light: ProjectorLight,
    reflectance: Reflectance,
    *,
    samples: int,
    seed: int,
) -> CameraPaths:
    """Follow `samples` x `samples` rays of each camera pixel, and on from glossy surfaces."""
    strips = [
        _Strip(
            exchange=exchange,
            light=light,
            reflectance=reflectance,
            random=np.random.default_rng((seed, 8, first)),
            first=first,
        ).follow(camera, pixels, rays)
        for first, pixels, rays in _pixel_rays(camera, samples)
    ]
    return CameraPaths(
        direct=_look_ups([found for strip in strips for found in strip.direct]),
        mirrored=_look_ups([found for strip in strips for found in strip.mirrored]),
        view=csr_array(vstack([strip.view for strip in strips], format="csr")),
    )


def _pixel_rays(optics: SimulatedOptics, samples: int) -> Iterator[tuple[int, IntArray, FloatArray]]:
    """Some rows at a time: the first pixel, and for each ray its pixel, counted from that one, and direction."""
    height, width = optics.shape
    grid = pixel_grid(optics.shape, samples)
    step = max(1, _BATCH_RAYS // (width * samples**2))
    for row in range(0, height, step):
        rows = min(step, height - row)
        y, x = np.arange(rows * samples) // samples, np.arange(width * samples) // samples
        rays = directions(optics, grid[row * samples : (row + rows) * samples])
        yield row * width, (y[:, None] * width + x).ravel(), rays.reshape(-1, 3)


@dataclass(eq=False, kw_only=True)
class _Strip:
    """Some rows of a camera's pixels."""

    exchange: Exchange
    light: ProjectorLight
    reflectance: Reflectance
    random: np.random.Generator
    first: int
    direct: list[_LitPlaces] = field(default_factory=list)
    mirrored: list[_LitPlaces] = field(default_factory=list)
    rows: list[IntArray] = field(default_factory=list)
    nodes: list[IntArray] = field(default_factory=list)
    weights: list[FloatArray] = field(default_factory=list)
    n_pixels: int = 0

    def follow(self, camera: SimulatedOptics, pixels: IntArray, rays: FloatArray) -> _Strip:
        """Follow rays of these pixels, counted from the strip's first."""
        self.n_pixels = int(pixels[-1]) + 1
        share = self.n_pixels / len(pixels)
        hits = self.exchange.tracer.hits(camera.position_m, rays)
        met = np.flatnonzero(~hits.escaped)
        leg = Leg(walk=pixels[met], hits=hits[met], directions=rays[met], share=np.full(len(met), share))
        self.direct.append(self._land(leg))
        self._follow_gloss(leg, share)
        return self

    @property
    def view(self) -> csr_array:
        """(pixels of the strip, 2 V)."""
        place = np.concatenate(self.rows), np.concatenate(self.nodes)
        shape = (self.n_pixels, 2 * self.exchange.grid.n_nodes)
        return csr_array((np.concatenate(self.weights).astype(np.float32), place), shape=shape)

    def _follow_gloss(self, leg: Leg, share: float) -> None:
        tracer, scene = self.exchange.tracer, self.exchange.scene
        glossy = np.flatnonzero(scene.gloss[leg.hits.facet] > 0)
        if not len(glossy):
            return
        starts = np.repeat(glossy, _LOBE_RAYS)
        hits, pixel = leg.hits[starts], leg.walk[starts]
        chances = self.random.uniform(size=(len(starts), 2))
        chances[:, 0] = (np.tile(np.arange(_LOBE_RAYS), len(glossy)) + chances[:, 0]) / _LOBE_RAYS
        ways, weight = reflected(tracer, hits, leg.directions[starts], chances)
        going = np.flatnonzero(weight > 0)
        left = (scene.gloss[hits.facet] * weight)[going]
        for further in walks(tracer, tracer.lifted_m(hits)[going], ways[going], share=left, random=self.random):
            landed = replace(further, walk=pixel[going[further.walk]], share=further.share * share / _LOBE_RAYS)
            self.mirrored.append(self._land(landed))

    def _land(self, leg: Leg) -> _LitPlaces:
        """Direct light where rays land; how their pixels see the irradiance there is noted."""
        grid, tracer = self.exchange.grid, self.exchange.tracer
        points = tracer.points_m(leg.hits)
        value = self.reflectance.at(leg.hits.facet, points)
        blend = self.exchange.partitions.seen(grid.blend_of(leg.hits), points, leg.hits)
        self.rows.append(np.repeat(leg.walk, 3))
        self.nodes.append(blend.nodes.ravel())
        self.weights.append((blend.weights * (leg.share * value)[:, None]).ravel())
        light = self.light.sent_back(leg.hits, points, leg.directions, value)
        lit = np.flatnonzero(light.gain > 0)
        return _LitPlaces(
            pixel=self.first + leg.walk[lit],
            xy_px=light.xy_px[lit].astype(np.float32),
            gain=(light.gain * leg.share)[lit].astype(np.float32),
            circle_px=light.circle_px[lit],
        )


@dataclass(frozen=True, kw_only=True)
class _LitPlaces:
    """Lit places that pixels see."""

    pixel: IntArray
    xy_px: Float32Array
    gain: Float32Array
    circle_px: FloatArray


def _look_ups(found: list[_LitPlaces]) -> LookUps:
    """All of them, filled up to whole rows with samples that add nothing."""
    n = sum(len(one.pixel) for one in found)
    missing = -n % _ROW
    xy = np.concatenate([*(one.xy_px for one in found), np.zeros((missing, 2), np.float32)])
    circle = np.concatenate([one.circle_px for one in found]) if n else np.zeros(0)
    return LookUps(
        pixel=np.concatenate([*(one.pixel for one in found), np.zeros(missing, np.int64)]),
        x_px=xy[:, 0].reshape(-1, _ROW),
        y_px=xy[:, 1].reshape(-1, _ROW),
        gain=np.concatenate([*(one.gain for one in found), np.zeros(missing, np.float32)]),
        levels=DiscLevels.of(np.concatenate([circle, np.full(missing, circle.min(initial=0))]).reshape(-1, _ROW)),
    )


def projector_paths(exchange: Exchange, light: ProjectorLight, *, samples: int, seed: int) -> ProjectorPaths:
    """Share the flux of each projector pixel among `samples` x `samples` rays, and follow those that meet gloss."""
    projector, tracer, grid = light.optics, exchange.tracer, exchange.grid
    cell_area, node_area = grid.cell_area_m2, exchange.node_area_m2
    landed: list[_Entries] = []
    by_gloss: list[_Entries] = []
    for first, pixels, rays in _pixel_rays(projector, samples):
        random = np.random.default_rng((seed, 9, first))
        width = projector.shape[1]
        numbers = first + pixels
        xy = np.stack([numbers % width, numbers // width], axis=1).astype(float)
        flux = light.pixel_flux(xy) / samples**2
        for k, leg in enumerate(walks(tracer, projector.position_m, rays, share=np.ones(len(rays)), random=random)):
            arriving, pixel = flux[leg.walk] * leg.share, numbers[leg.walk]
            if k == 0:
                cells = grid.cells_of(leg.hits)
                landed.append(_Entries(cells, pixel, arriving / cell_area[cells % grid.n_cells]))
                continue
            blend = exchange.partitions.seen(grid.blend_of(leg.hits), tracer.points_m(leg.hits), leg.hits)
            density = arriving[:, None] * blend.weights / node_area[blend.nodes % grid.n_nodes]
            by_gloss.append(_Entries(blend.nodes.ravel(), np.repeat(pixel, 3), density.ravel()))
    n_pixels = projector.shape[0] * projector.shape[1]
    return ProjectorPaths(
        landing=_matrix(landed, (2 * grid.n_cells, n_pixels)), by_gloss=_matrix(by_gloss, (2 * grid.n_nodes, n_pixels))
    )


class _Entries(NamedTuple):
    """Of a sparse matrix."""

    rows: IntArray
    columns: IntArray
    values: FloatArray


def _matrix(entries: list[_Entries], shape: tuple[int, int]) -> csr_array:
    if not entries:
        return csr_array(shape, dtype=np.float32)
    rows, columns, values = (np.concatenate(part) for part in zip(*entries, strict=True))
    return csr_array((values.astype(np.float32), (rows, columns)), shape=shape)


def light_on(pixels: int, seen: LookUps, picture: Float32Array, margin_px: int) -> Float32Array:
    """(pixels,) the picture's light at all samples, summed in the camera's pixels.

    Parameters
    ----------
    picture : (H + 2 margin, W + 2 margin)
        Linear light, dark around.
    """
    if not len(seen.gain):
        return np.zeros(pixels, dtype=np.float32)
    light = looked_up(picture, (seen.x_px, seen.y_px), seen.levels, margin_px)
    return np.bincount(seen.pixel, light.ravel() * seen.gain, minlength=pixels).astype(np.float32)
