"""The projector that ``rig simulate`` is told of, from its options."""

from __future__ import annotations

from rig.errors import UsageError
from sim.errors import SimulationError
from sim.light.lighting import PlacedProjector

FARTHEST_M = 1000.0
"""Of a projector from the origin: the largest scene is as large."""


def projector_of(
    at: str | None, look_at: str | None, fov_deg: float | None, light: str | None
) -> PlacedProjector | None:
    """Return the projector that ``rig simulate`` was told of; None for none.

    Raises
    ------
    UsageError
        For half of what is needed, numbers that are none, an impossible lens or aim, or a light beside it.
    """
    if at is None and look_at is None and fov_deg is None:
        return None
    if at is None or look_at is None:
        raise UsageError("--projector-at and --look-at belong together, e.g. 1.2,1.2,1.2 and 2.2,2.2,1.2")
    if light is not None:
        raise UsageError("--projector-at takes the place of --light; leave one out")
    fov = 100.0 if fov_deg is None else fov_deg
    if not 1 <= fov <= 160:
        raise UsageError(f"--fov {fov:g}: lenses have 1 ... 160 degrees; give the horizontal field of view in degrees")
    placed = PlacedProjector(
        position_m=_point("--projector-at", at), look_at_m=_point("--look-at", look_at), hfov_deg=fov
    )
    try:
        _ = placed.pose
    except SimulationError as error:
        raise UsageError(f"--look-at {look_at}: the aim is at the lens, or straight up or down; move it") from error
    return placed


def _point(option: str, text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise UsageError(
            f"{option} {text}: give three numbers in metres, separated by commas, e.g. 1.2,1.2,1.2"
        ) from error
    if not all(abs(one) < FARTHEST_M for one in (x, y, z)):
        raise UsageError(f"{option} {text}: give metres within {FARTHEST_M:g} m")
    return x, y, z
