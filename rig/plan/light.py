"""The light of a planned room in absolute units: lux where it lands, lm/m² and cd/m² where it leaves.

The light model counts in the irradiance of a white pixel on a plane across the optical axis at 1 m
(:mod:`sim.light.transport_of_scene`). White then sends the area that the picture covers at 1 m, so that one of these
units is lumens / area [lx]. Matt patches of exitance M [lm/m²] have the luminance M / π [cd/m²].
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from rig.plan.projector import ProjectorNumbers, projector_numbers
from rig.plan.request import PlanRequest, RoomLight
from rig.plan.room import ImpossiblePlace, PlannedRoom, check_inside, planned_room
from sim.errors import SimulationError
from sim.geometry.optics import Lens, Pose, rays_at, solid_angles
from sim.geometry.rays import trace
from sim.geometry.scene import Hits
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport
from sim.light.transport_of_scene import area_emission, smooth_view

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SUBSAMPLES = 2
"""A pixel is split into so many along each side for the light that lands on a patch."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LitRoom:
    """A room with its projector; n pixels, P patches, S surfaces."""

    room: PlannedRoom
    numbers: ProjectorNumbers
    lens: Lens
    pose: Pose
    transport: LightTransport
    """Of the projector's view, in the light model's unit."""
    lux_per_unit: float
    ambient_exitance: FloatArray
    """(P,) light that leaves the patches while the projector is off. [lm/m²]"""

    @property
    def black(self) -> float:
        """Light of a black pixel, white = 1."""
        return 1 / self.numbers.contrast

    @cached_property
    def hits(self) -> Hits:
        """What each pixel meets."""
        return trace(self.room.surface, self.pose.position_m, self.rays)

    @cached_property
    def rays(self) -> FloatArray:
        """(n, 3) unit directions of the pixels."""
        return rays_at(self.lens, self.pose, self.lens.pixel_grid())

    @property
    def lit(self) -> BoolArray:
        """(n,) pixels that meet a surface."""
        return np.asarray(self.hits.patch >= 0)

    @cached_property
    def footprints_m2(self) -> FloatArray:
        """(n,) area on the surface that each pixel covers; 0 where it meets none [m²]."""
        hits, seen = self.hits, self.lit
        across = solid_angles(self.lens, self.lens.pixel_grid()) * np.where(seen, hits.distance, 0.0) ** 2
        return np.where(seen, across / np.where(seen, np.maximum(hits.cos_incidence, 1e-6), 1.0), 0.0)

    @cached_property
    def ambient_cdm2(self) -> FloatArray:
        """(n,) luminance of the pixels' points while the projector is off [cd/m²]."""
        own = self.room.own_exitance
        smooth = np.asarray(self.transport.view @ (self.ambient_exitance - own))
        return (smooth + np.where(self.lit, own[self.hits.patch], 0.0)) / np.pi

    def luminance(self, projected: FloatArray) -> FloatArray:
        """Return (n,) what is seen of a projector image (n,), room light included [cd/m²]."""
        return self.from_units(np.asarray(self.transport @ projected)) + self.ambient_cdm2

    def from_units(self, camera_image: FloatArray) -> FloatArray:
        """Return the luminance of values of the light model [cd/m²]."""
        return camera_image * (self.lux_per_unit / np.pi)

    def to_units(self, luminance_cdm2: FloatArray) -> FloatArray:
        """Return what the projector must add for a luminance, in the light model's unit."""
        return (luminance_cdm2 - self.ambient_cdm2) * (np.pi / self.lux_per_unit)

    def patch_lux(self, projected: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (P,) direct and indirect illuminance that a projector image (n,) makes [lx]."""
        E, B = self.transport.radiosity_of(projected)
        lux = self.lux_per_unit / self.room.surface.reflectance
        return E * lux, (B - E) * lux


def lit_room(request: PlanRequest, width_px: int | None = None) -> LitRoom:
    """Return the room of a request with its projector in it.

    Parameters
    ----------
    request
        Of a plan.
    width_px
        Columns of the pictures; None: the request's.

    Raises
    ------
    UsageError
        For anything in it that cannot be.
    """
    numbers, pose = projector_numbers(request.projector), _pose(request)
    room = planned_room(request)
    check_inside(room.surface, request.projector.position_m, "projector.position_m")
    for viewer in request.viewer:
        check_inside(room.surface, viewer.eye_m, f"viewer {viewer.name}")
    lens = numbers.lens(width_px or request.show.width_px)
    transport = _transport(room, lens, pose)
    if not (transport.pixel_patch >= 0).any():
        raise ImpossiblePlace("projector.look_at_m: no pixel meets a surface; aim at a wall")
    flux = lens.n_pixels / (lens.focal_px[0] * lens.focal_px[1])
    return LitRoom(
        room=room,
        numbers=numbers,
        lens=lens,
        pose=pose,
        transport=transport,
        lux_per_unit=numbers.lumens / flux,
        ambient_exitance=ambient_exitance(room, request.room_light),
    )


def _transport(room: PlannedRoom, lens: Lens, pose: Pose) -> LightTransport:
    """T of the projector's own view: direct light by pixel, the rest smooth between patches; any surface."""
    surface, pixels = room.surface, lens.pixel_grid()
    hits = trace(surface, pose.position_m, rays_at(lens, pose, pixels))
    met = hits.patch >= 0
    rho = np.where(met, surface.reflectance[hits.patch], 0.0)
    intensity = 1 / (lens.focal_px[0] * lens.focal_px[1] * solid_angles(lens, pixels))
    distance = np.where(met, hits.distance, 1.0)
    direct = np.where(met, rho * np.maximum(hits.cos_incidence, 0.0) * intensity / distance**2, 0.0)
    return LightTransport(
        csr_array(diags_array(direct)),
        area_emission(surface, lens, pose, subsamples=SUBSAMPLES, convention="physical"),
        Radiosity(room.factors, surface.reflectance, solver="repeated"),
        smooth_view(surface, hits, rho),
        pixel_patch=hits.patch,
        pixel_xy_px=pixels,
    )


def _pose(request: PlanRequest) -> Pose:
    asked = request.projector
    try:
        return Pose.look_at(asked.position_m, asked.look_at_m, roll_deg=asked.roll_deg)
    except SimulationError as error:
        raise ImpossiblePlace(
            f"projector.look_at_m: {list(asked.look_at_m)} from {list(asked.position_m)}: the aim is at the lens, or "
            "straight up or down; move it a little"
        ) from error


def ambient_exitance(room: PlannedRoom, light: RoomLight) -> FloatArray:
    """Return (P,) what leaves the patches while the projector is off [lm/m²].

    Parameters
    ----------
    room
        Its openings shine as they are said to.
    light
        Measured on the surfaces, or lamps that shine alike on all of them: lumens over the surface's area.
    """
    surface = room.surface
    sent = room.own_exitance.copy()
    if light.lamp_lm:
        sent += surface.reflectance * light.lamp_lm / surface.areas.sum()
    left = Radiosity(room.factors, surface.reflectance).solve(sent) if sent.any() else sent
    return np.asarray(left + surface.reflectance * (light.lux or 0.0))
