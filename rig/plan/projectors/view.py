"""What one projector of a plan meets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rig.plan.projectors.numbers import ProjectorNumbers
from sim.geometry.optics import Lens, Pose, project, rays_at, solid_angles
from sim.geometry.rays import trace
from sim.geometry.scene import Hits
from sim.geometry.surface import Surface
from sim.light.transport_of_scene import irradiance_at

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, kw_only=True)
class ProjectorView:
    """One projector in a room; n pixels of the picture computed."""

    numbers: ProjectorNumbers
    lens: Lens
    pose: Pose
    surface: Surface

    @property
    def black(self) -> float:
        """Light of a black pixel, white = 1."""
        return 1 / self.numbers.contrast

    @property
    def lux_per_unit(self) -> float:
        """Illuminance of white on a plane across the axis at 1 m [lx]."""
        return self.numbers.lumens * self.lens.focal_px[0] * self.lens.focal_px[1] / self.lens.n_pixels

    @property
    def finer(self) -> float:
        """How many of the projector's own pixels one computed pixel is."""
        return self.numbers.width_px * self.numbers.height_px / self.lens.n_pixels

    @cached_property
    def rays(self) -> FloatArray:
        """(n, 3) unit directions of the pixels."""
        return rays_at(self.lens, self.pose, self.lens.pixel_grid())

    @cached_property
    def hits(self) -> Hits:
        """What each pixel meets."""
        return trace(self.surface, self.pose.position_m, self.rays)

    @property
    def lit(self) -> BoolArray:
        """(n,) pixels that meet a surface."""
        return np.asarray(self.hits.patch >= 0)

    @cached_property
    def points_m(self) -> FloatArray:
        """(n, 3) where the pixels meet a surface; the lens for those that meet none [m]."""
        reach = np.where(self.lit, self.hits.distance, 0.0)
        return np.asarray(self.pose.position_m + reach[:, None] * self.rays)

    @cached_property
    def footprints_m2(self) -> FloatArray:
        """(n,) area on the surface that each pixel covers; 0 where it meets none [m²]."""
        hits, seen = self.hits, self.lit
        across = solid_angles(self.lens, self.lens.pixel_grid()) * np.where(seen, hits.distance, 0.0) ** 2
        return np.where(seen, across / np.where(seen, np.maximum(hits.cos_incidence, 1e-6), 1.0), 0.0)

    @cached_property
    def own_irradiance(self) -> FloatArray:
        """(n,) of white at the pixels' own points; this projector's unit."""
        hits, seen = self.hits, self.lit
        lens = self.lens
        intensity = 1 / (lens.focal_px[0] * lens.focal_px[1] * solid_angles(lens, lens.pixel_grid()))
        distance = np.where(seen, hits.distance, 1.0)
        return np.where(seen, np.maximum(hits.cos_incidence, 0.0) * intensity / distance**2, 0.0)

    def places_of(self, other: ProjectorView) -> tuple[FloatArray, FloatArray]:
        """Return what this projector does where another one's pixels end.

        Parameters
        ----------
        other
            In the same room; m pixels.

        Returns
        -------
        xy_px : (m, 2) array
            Where in this picture each point of the other lies. [px]
        irradiance : (m,) array
            Of this projector's white there, 0 outside of its picture and in shadow; this projector's unit.
        """
        xy = np.full((other.lens.n_pixels, 2), np.nan)
        irradiance = np.zeros(len(xy))
        met = np.flatnonzero(other.lit)
        xy[met] = project(self.lens, self.pose, other.points_m[met])
        size = np.array([self.lens.width_px, self.lens.height_px])
        with np.errstate(invalid="ignore"):
            inside = met[((xy[met] > -0.5) & (xy[met] < size - 0.5)).all(axis=1)]
        irradiance[inside] = irradiance_at(
            self.surface, self.lens, self.pose, points_m=other.points_m[inside], patch=other.hits.patch[inside]
        )
        return xy, irradiance
