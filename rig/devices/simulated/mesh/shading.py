"""What light does at a place: reflectance there, and the projector's light that it sends back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.devices.simulated.defocus import circle_px
from rig.devices.simulated.mesh.gloss import frames_of, lobe
from rig.devices.simulated.mesh.scene import LARGEST_ALBEDO, FloatArray, IntArray
from rig.devices.simulated.mesh.tracer import RayHits, Tracer
from rig.devices.simulated.optics import SimulatedOptics, flux_density, pixels_of, relative_illumination

_WAVES = np.array([[1.3, 0.4, 0.7], [-0.7, 2.1, 1.1]])
"""Of the texture, periods in five metres along each axis; chosen as on the walls of a box."""
_WAVES_LENGTH_M = 5.0


@dataclass(frozen=True, slots=True)
class Reflectance:
    """Matte reflectance of a scene in one band of light, with a smooth texture."""

    tracer: Tracer
    band: int | None
    texture: float

    def at(self, facet: IntArray, points_m: FloatArray) -> FloatArray:
        """(n,) at points of triangles."""
        colours = self.tracer.scene.reflectance[facet]
        value = colours.mean(axis=1) if self.band is None else colours[:, self.band]
        if self.texture:
            phase = 2 * np.pi * points_m @ _WAVES.T / _WAVES_LENGTH_M + 1.7 * self.tracer.scene.material[facet][:, None]
            value = value + self.texture * (0.6 * np.sin(phase[:, 0]) + 0.4 * np.sin(phase[:, 1]))
        return np.asarray(np.clip(value, 0, LARGEST_ALBEDO - self.tracer.scene.gloss[facet]))


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectLight:
    """Projector light that n places send back along given directions."""

    xy_px: FloatArray
    """(n, 2) where the projector's lens sees each place."""
    gain: FloatArray
    """(n,) radiosity for white, pi times the radiance; 0 in shadow and outside the picture."""
    circle_px: FloatArray
    """(n,) diameter of the disc that a projector pixel becomes there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProjectorLight:
    """A projector in a scene."""

    tracer: Tracer
    optics: SimulatedOptics
    flux: float
    margin_px: float
    """How far beyond the picture its blurred light reaches."""

    def pixel_flux(self, xy_px: FloatArray) -> FloatArray:
        """(n,) flux of pixels; that of the picture's edge goes on outside."""
        height, width = self.optics.shape
        inside = np.clip(xy_px, -0.5, (width - 0.5, height - 0.5))
        return self.flux / (height * width) * relative_illumination(self.optics, inside)

    def sent_back(
        self, hits: RayHits, points_m: FloatArray, directions: FloatArray, reflectance: FloatArray
    ) -> DirectLight:
        """Light of white that places send back to where rays came from, along `directions` (n, 3)."""
        height, width = self.optics.shape
        xy, gain, circle = np.full((len(points_m), 2), -1e3), np.zeros(len(points_m)), np.zeros(len(points_m))
        normals = self.tracer.normals_towards(hits)
        to_lens = self.optics.position_m - points_m
        distance = np.linalg.norm(to_lens, axis=1)
        cosine = np.einsum("ij,ij->i", to_lens, normals) / np.maximum(distance, 1e-12)
        with np.errstate(invalid="ignore"):
            pixels = pixels_of(self.optics, points_m)
            low, high = -0.5 - self.margin_px, np.array((width, height)) - 0.5 + self.margin_px
            reached = (cosine > 1e-6) & (pixels > low).all(axis=1) & (pixels < high).all(axis=1)
        lit = np.flatnonzero(reached)
        lit = lit[self.tracer.clear(points_m[lit] + self.tracer.lift_m * normals[lit], self.optics.position_m)]
        arriving = to_lens[lit] / distance[lit, None]
        sent = reflectance[lit] + self._glossy(hits[lit], normals[lit], arriving, -directions[lit])
        density = flux_density(self.optics, points_m[lit], cosine[lit])
        xy[lit], gain[lit] = pixels[lit], density * self.pixel_flux(pixels[lit]) * sent
        circle[lit] = circle_px(self.optics, self.optics.depth_m(points_m[lit]))
        return DirectLight(xy_px=xy, gain=gain, circle_px=circle)

    def _glossy(self, hits: RayHits, normals: FloatArray, arriving: FloatArray, leaving: FloatArray) -> FloatArray:
        """(n,) pi times the glossy lobe."""
        value = np.zeros(len(normals))
        on = np.flatnonzero(self.tracer.scene.gloss[hits.facet] > 0)
        if len(on):
            axes = frames_of(normals[on])
            coming, going = (np.einsum("nij,nj->ni", axes, way[on]) for way in (arriving, leaving))
            facet = hits.facet[on]
            shape = lobe(coming, going, self.tracer.scene.roughness[facet])
            value[on] = np.pi * self.tracer.scene.gloss[facet] * shape
        return value
