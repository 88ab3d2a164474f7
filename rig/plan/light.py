"""The light of a planned room in absolute units: lux where it lands, lm/m² and cd/m² where it leaves.

The light model counts in the irradiance of a white pixel on a plane across the optical axis at 1 m
(:mod:`sim.light.transport_of_scene`). White then sends the area that the picture covers at 1 m, so that one of these
units is lumens / area [lx]; of several projectors the first one's is meant. Matt patches of exitance M [lm/m²] have
the luminance M / π [cd/m²].
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array, hstack

from rig.plan.projectors.joined import JoinedViews
from rig.plan.projectors.numbers import projector_numbers
from rig.plan.projectors.view import ProjectorView
from rig.plan.request import PlannedProjector, PlanRequest, RoomLight
from rig.plan.room import ImpossiblePlace, PlannedRoom, check_inside, planned_room
from sim.errors import SimulationError
from sim.geometry.optics import Pose
from sim.geometry.scene import Hits
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport
from sim.light.transport_of_scene import area_emission, smooth_view

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LEAST_AIM_M = 0.01
"""From a lens to the point that it is aimed at: nearer, its rounded digits say where the picture goes."""
SUBSAMPLES = 2
"""A pixel is split into so many along each side for the light that lands on a patch."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LitRoom:
    """A room with its projectors; n pixels of all of them, P patches, S surfaces."""

    room: PlannedRoom
    joined: JoinedViews
    transport: LightTransport
    """Of the projectors' views, in the light model's unit for the first of them."""
    ambient_exitance: FloatArray
    """(P,) light that leaves the patches while the projectors are off. [lm/m²]"""

    @property
    def views(self) -> tuple[ProjectorView, ...]:
        """Each projector."""
        return self.joined.views

    @property
    def floor_m(self) -> float:
        """How high the floor lies [m]."""
        return float(self.room.surface.vertices[:, :, 2].min())

    @property
    def n_pixels(self) -> int:
        """Of all pictures together."""
        return len(self.joined.scale)

    @property
    def lux_per_unit(self) -> float:
        """Of the light model's unit [lx]."""
        return self.views[0].lux_per_unit

    @property
    def black(self) -> float:
        """The least that a pixel sends, white = 1."""
        return self.joined.black

    @property
    def hits(self) -> Hits:
        """What each pixel meets."""
        return self.joined.hits

    @property
    def lit(self) -> BoolArray:
        """(n,) pixels that meet a surface."""
        return np.asarray(self.hits.patch >= 0)

    @property
    def footprints_m2(self) -> FloatArray:
        """(n,) area on the surface that each pixel stands for; 0 where it meets none [m²]."""
        return self.joined.footprints_m2

    @cached_property
    def ambient_cdm2(self) -> FloatArray:
        """(n,) luminance of the pixels' points while the projectors are off [cd/m²]."""
        own = self.room.own_exitance
        smooth = np.asarray(self.transport.view @ (self.ambient_exitance - own))
        return (smooth + np.where(self.lit, own[self.hits.patch], 0.0)) / np.pi

    @cached_property
    def unstoppable_cdm2(self) -> FloatArray:
        """(n,) luminance that no picture takes away, black aside: the room's, and what poor contrast adds [cd/m²]."""
        return self.ambient_cdm2 + self.from_units(np.asarray(self.transport @ self.joined.residue))

    def pictures(self, of_shape: Callable[[tuple[int, int]], FloatArray]) -> FloatArray:
        """Return (n,) a picture on all projectors, made for each shape; one picture at a place where they overlap."""
        shown = np.concatenate([np.ravel(of_shape(one.lens.shape)) for one in self.views])
        return np.asarray(self.joined.content @ shown)

    def even(self, level: float) -> FloatArray:
        """Return (n,) what the projectors send at an even level, white = 1, in the transport's terms."""
        return level + self.joined.residue

    def luminance(self, projected: FloatArray) -> FloatArray:
        """Return (n,) what is seen of a projector image (n,), room light included [cd/m²]."""
        return self.from_units(np.asarray(self.transport @ projected)) + self.unstoppable_cdm2

    def from_units(self, camera_image: FloatArray) -> FloatArray:
        """Return the luminance of values of the light model [cd/m²]."""
        return camera_image * (self.lux_per_unit / np.pi)

    def to_units(self, luminance_cdm2: FloatArray) -> FloatArray:
        """Return what a picture must add for a luminance, in the light model's unit."""
        return (luminance_cdm2 - self.unstoppable_cdm2) * (np.pi / self.lux_per_unit)

    def patch_lux(self, level: float) -> tuple[FloatArray, FloatArray]:
        """Return (P,) direct and indirect illuminance of the projectors at an even level, white = 1 [lx]."""
        E, B = self.transport.radiosity_of(self.even(level))
        lux = self.lux_per_unit / self.room.surface.reflectance
        return E * lux, (B - E) * lux


def lit_room(request: PlanRequest, width_px: int | None = None) -> LitRoom:
    """Return the room of a request with its projectors in it.

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
    asked = tuple((request.place_of(k), one) for k, one in enumerate(request.projectors))
    numbers = [projector_numbers(one, place) for place, one in asked]
    poses = [_pose(one, place) for place, one in asked]
    room = planned_room(request)
    for place, one in asked:
        check_inside(room.surface, one.position_m, f"{place}.position_m")
    for viewer in request.viewer:
        check_inside(room.surface, viewer.eye_m, f"viewer {viewer.name}")
    columns = width_px or request.show.width_px
    views = tuple(
        ProjectorView(numbers=number, lens=number.lens(columns), pose=pose, surface=room.surface)
        for number, pose in zip(numbers, poses, strict=True)
    )
    for (place, _), view in zip(asked, views, strict=True):
        if not view.lit.any():
            raise ImpossiblePlace(f"{place}.look_at_m: no pixel meets a surface; aim at a wall")
    joined = JoinedViews(views=views)
    return LitRoom(
        room=room,
        joined=joined,
        transport=_transport(room, joined),
        ambient_exitance=ambient_exitance(room, request.room_light),
    )


def _transport(room: PlannedRoom, joined: JoinedViews) -> LightTransport:
    """T of the projectors' own views: direct light by pixel, the rest smooth between patches; any surface."""
    surface, hits = room.surface, joined.hits
    rho = np.where(hits.patch >= 0, surface.reflectance[hits.patch], 0.0)
    sent = [
        area_emission(surface, one.lens, one.pose, subsamples=SUBSAMPLES, convention="physical") for one in joined.views
    ]
    grid = joined.views[0].lens.pixel_grid() if len(joined.views) == 1 else None
    return LightTransport(
        csr_array(diags_array(rho * joined.irradiance)),
        csr_array(hstack(sent) @ diags_array(joined.scale)),
        Radiosity(room.factors, surface.reflectance, solver="repeated"),
        smooth_view(surface, hits, rho),
        pixel_patch=hits.patch,
        pixel_xy_px=grid,
    )


def _pose(asked: PlannedProjector, place: str) -> Pose:
    try:
        if math.dist(asked.position_m, asked.look_at_m) < LEAST_AIM_M:
            raise SimulationError("the aim is at the lens")
        return Pose.look_at(asked.position_m, asked.look_at_m, roll_deg=asked.roll_deg)
    except SimulationError as error:
        raise ImpossiblePlace(
            f"{place}.look_at_m: {list(asked.look_at_m)} from {list(asked.position_m)}: the aim is at the lens, or "
            "straight up or down; move it a little"
        ) from error


def ambient_exitance(room: PlannedRoom, light: RoomLight) -> FloatArray:
    """Return (P,) what leaves the patches while the projectors are off [lm/m²].

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
