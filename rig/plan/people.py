"""People in a planned room: what they keep from the walls, and what they see."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from rig.errors import UsageError
from rig.plan.light import LitRoom
from rig.plan.measures import LEAST, quantile, weighted_mean
from rig.plan.projectors.view import ProjectorView
from rig.plan.records import ShadowOf, ViewerSight
from rig.plan.request import PlannedPerson, PlannedViewer, PlanRequest
from rig.plan.shown import WHITE, PictureInRoom
from sim.geometry.rays import blocked

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

FACE = 0.75
"""Share of a person's height above which light meets the face."""
ABOVE_EYES_M = 0.12
"""From the eyes to the top of a head (DIN 33402-2: 0.11 ... 0.13 m)."""


def people_of(request: PlanRequest, lit: LitRoom) -> tuple[PlannedPerson, ...]:
    """Return all who throw a shadow: people, and viewers who stand.

    Raises
    ------
    UsageError
        For a viewer who stands and whose eyes are where no person's are.
    """
    floor_m = lit.floor_m
    standing = tuple(_standing(one, floor_m) for one in request.viewer if one.stands)
    return (*request.person, *standing)


def _standing(viewer: PlannedViewer, floor_m: float) -> PlannedPerson:
    height_m = viewer.eye_m[2] - floor_m + ABOVE_EYES_M
    try:
        return PlannedPerson(name=viewer.name, at_m=viewer.eye_m[:2], height_m=height_m)
    except ValidationError as error:
        raise UsageError(
            f"viewer {viewer.name}: stands, with eyes {viewer.eye_m[2] - floor_m:g} m above the floor: a person of "
            f"{height_m:.2f} m; people are 0.3 ... 2.8 m high. Correct eye_m, or leave stands out"
        ) from error


def shadow_of(lit: LitRoom, person: PlannedPerson) -> ShadowOf:
    """Return the shadow of somebody who stands in the room.

    Raises
    ------
    UsageError
        For a person outside of the room, or around a projector.
    """
    floor_m = lit.floor_m
    _check_place(lit, person, floor_m)
    met = [meets_person(view, person, floor_m) for view in lit.views]
    height_m, is_met = (np.concatenate(parts) for parts in zip(*met, strict=True))
    shadowed = is_met & lit.lit
    surface_of = lit.room.shape.surface_of[lit.hits.patch]
    area = np.bincount(surface_of[shadowed], lit.footprints_m2[shadowed], len(lit.room.shape.names))
    return ShadowOf(
        person=person.name,
        picture_share=float(shadowed.mean()),
        by_surface_m2={name: float(m2) for name, m2 in zip(lit.room.shape.names, area, strict=True) if m2 > 0},
        dazzled=bool((shadowed & (height_m > floor_m + FACE * person.height_m)).any()),
    )


def _check_place(lit: LitRoom, person: PlannedPerson, floor_m: float) -> None:
    low, high = (f(lit.room.surface.vertices[:, :, :2].reshape(-1, 2), axis=0) for f in (np.min, np.max))
    at = np.array(person.at_m)
    if (at <= low).any() or (at >= high).any():
        raise UsageError(
            f"person {person.name}: {list(person.at_m)} m is outside of the room, x {low[0]:g} ... {high[0]:g} and "
            f"y {low[1]:g} ... {high[1]:g} m; move them inside"
        )
    top_m = float(lit.room.surface.vertices[:, :, 2].max()) - floor_m
    if person.height_m > top_m > 0:
        raise UsageError(
            f"person {person.name}: {person.height_m:g} m high in a room of {top_m:g} m; correct one of the two"
        )
    for view in lit.views:
        lens = view.pose.position_m
        if np.hypot(*(lens[:2] - at)) <= person.radius_m and lens[2] < floor_m + person.height_m:
            raise UsageError(f"person {person.name}: stands where {_the(lit, view)} is; move one of them")


def _the(lit: LitRoom, view: ProjectorView) -> str:
    return "the projector" if len(lit.views) == 1 else f"projector {view.numbers.name}"


def meets_person(view: ProjectorView, person: PlannedPerson, floor_m: float) -> tuple[FloatArray, BoolArray]:
    """Return (n,) height at which each ray of a projector meets a person [m], and whether it does."""
    start = view.pose.position_m - np.array([*person.at_m, floor_m])
    ray = view.rays
    a = (ray[:, :2] ** 2).sum(axis=1)
    b = ray[:, :2] @ start[:2]
    c = float(start[:2] @ start[:2]) - person.radius_m**2
    root = b**2 - a * c
    with np.errstate(invalid="ignore", divide="ignore"):
        side = (-b - np.sqrt(root)) / a
        top = (person.height_m - start[2]) / ray[:, 2]
        over_top = ((start[:2] + top[:, None] * ray[:, :2]) ** 2).sum(axis=1) <= person.radius_m**2
    at_side = start[2] + side * ray[:, 2]
    on_side = (root > 0) & (side > 0) & (at_side >= 0) & (at_side <= person.height_m)
    on_top = over_top & (top > 0)
    first = np.minimum(np.where(on_side, side, np.inf), np.where(on_top, top, np.inf))
    is_met = first < np.where(view.lit, view.hits.distance, np.inf)
    height = np.where(is_met, start[2] + np.where(is_met, first, 0.0) * ray[:, 2], 0.0)
    return height + floor_m, np.asarray(is_met)


def sight_of(lit: LitRoom, viewer: PlannedViewer, shown: PictureInRoom, white_cdm2: float) -> ViewerSight:
    """Return what a viewer sees of the picture.

    Parameters
    ----------
    lit
        The room.
    viewer
        Inside of it.
    shown
        The picture whose error is told.
    white_cdm2
        That is wanted. [cd/m²]
    """
    seen = lit.lit
    points = lit.joined.points_m[seen]
    to_eye = np.asarray(viewer.eye_m) - points
    distance = np.linalg.norm(to_eye, axis=1)
    cosine = np.einsum("nk,nk->n", to_eye, lit.room.surface.normals[lit.hits.patch[seen]]) / distance
    area = lit.footprints_m2[seen]
    free = cosine > 1e-6
    if not lit.room.surface.convex:
        eyes = np.broadcast_to(np.asarray(viewer.eye_m, dtype=np.float64), points.shape)
        free &= ~blocked(lit.room.surface, np.ascontiguousarray(eyes), points + 1e-6 * to_eye)
    solid_angle = np.where(free, area * np.maximum(cosine, 0.0) / distance**2, 0.0)
    finer = lit.joined.spread([one.finer for one in lit.views])[seen] / lit.joined.times_lit[seen]
    density = np.pi / 180 * np.sqrt(finer / np.maximum(solid_angle, 1e-12))
    white = lit.luminance(np.ones(lit.n_pixels))[seen]
    wanted = shown.wanted_cdm2[seen]
    error = np.abs(shown.seen_cdm2["bounded"][seen] - wanted) * (WHITE / white_cdm2)
    return ViewerSight(
        name=viewer.name,
        visible_share=float(area[free].sum() / area.sum()),
        px_per_deg=quantile(density, solid_angle, 0.5),
        px_per_deg_least=quantile(density, solid_angle, LEAST),
        white_cdm2=weighted_mean(white, solid_angle),
        error=weighted_mean(error, solid_angle),
    )
