"""How well a session knows lengths and places, and what would make them surer."""

from __future__ import annotations

from rig.stages.results import GeometryResult

SURER = (
    "show three surfaces, move the camera away from the projector, give both devices a lens file (rig lenses), or a "
    "second length by tape (surface.size_m with both walls of a side seen, surface.lens_height_m with the floor seen)"
)
_WHERE = ("x", "y", "z", "x0", "x1", "y0", "y1", "floor", "ceiling")
"""Axes of the room, and its surfaces."""


def length_sigma_percent(geometry: GeometryResult) -> float:
    """Return the largest standard deviation of a length of the room that was measured, tape included, as a share of it.

    A wall alone has no size: before it the lengths are those between wall, camera and projector.
    """
    if len(geometry.faces_seen) == 1:
        return 100 * geometry.sigmas["baseline_m"] / geometry.baseline_m
    sigmas_m = [geometry.sigmas.get(f"room_{axis}_m", 0.0) for axis in "xyz"]
    return max(100 * sigma / length for sigma, length in zip(sigmas_m, geometry.room_size_m, strict=True))


def place_sigma_percent(geometry: GeometryResult) -> float:
    """Return the largest standard deviation of a device's or a measured surface's place, in % of the longest side."""
    return 100 * max(_place_sigmas(geometry).values()) / max(geometry.room_size_m)


def _least_certain(geometry: GeometryResult) -> str:
    """In words."""
    sigmas = _place_sigmas(geometry)
    what, which, _ = max(sigmas, key=lambda name: sigmas[name]).split("_")
    if what == "surface":
        return f"the distance of {which} from the projector"
    return f"the camera against the projector along {which}" if what == "relative" else f"the {what}'s {which}"


def _place_sigmas(geometry: GeometryResult) -> dict[str, float]:
    """By name, in metres: of what nobody measured there is none."""
    kinds = ("camera", "projector", "relative", "surface")
    return {f"{k}_{w}_m": s for k in kinds for w in _WHERE if (s := geometry.sigmas.get(f"{k}_{w}_m")) is not None}


def length_advice(geometry: GeometryResult) -> str:
    """Return what to do where a length of the room is not known well enough."""
    return _through_openings(geometry) or f"what is lit and seen tells the lengths badly: {SURER}"


def place_advice(geometry: GeometryResult) -> str:
    """Return what to do where the place of a device or a surface is not known well enough."""
    return _through_openings(geometry) or (
        f"{_least_certain(geometry)} is known to no better: {SURER}. If you can live with it, raise "
        "limits.geometry_sigma_percent"
    )


def _through_openings(geometry: GeometryResult) -> str:
    """Return what to do where an opening leaves open from where to where the tape was held; empty without one."""
    if not geometry.openings_m:
        return ""
    face = max(geometry.openings_m, key=lambda one: geometry.openings_m[one])
    return (
        f"{face} is open, and nobody saw the wall opposite: whether surface.size_m was measured to {face} or to what "
        f"is seen {geometry.openings_m[face]:.2f} m behind it is not known. Measure from wall to wall and set "
        "surface.size_to_walls = true (what was photographed stays), or show the wall opposite"
    )
