"""Where walls stand of which nobody saw any: their place by the light that they send back.

Along an axis of which neither wall was measured, geometry knows the room's size by tape and no more. But the light that
comes back from a floor depends on its height: with a wrong one no reflectance explains the global light on the walls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from calibration.light.reflectance import ReflectanceFit, ReflectanceSource
from rig.records import Record
from rig.stages.geometry import BoxSurface, GeometryRecord
from rig.stages.light.fit import (
    LEAST_PIXELS,
    BandLight,
    BareRoom,
    Shift,
    bare_room,
    direct_gain,
    fit_lenses,
    fit_reflectance,
    on_the_model,
    pixels_that_tell,
)
from rig.stages.scene_model import PosedLens, unit_emission
from rig.terminal import OnStep

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_EVERY_PX, _COARSER = 4, 2
"""Every so many-th pixel of both devices, and patches of so many times the size: a sixteenth of the work."""
_FAR_M = 20.0
"""By which a room is longer, each way, while it is asked how far its lit walls reach."""
_REACH = (0.2, 99.8)
"""Percentiles of the lit points: wrong codes lie beyond."""
_ROOM_M = 0.05
"""Between a lens and the nearest wall, at least."""
_ON_WALL_PX = 0.5
"""Of the projector, five times the noise: a strip of a floor that was not found is off by more, but for its rim."""
_GRID, _REFINEMENTS = 9, 6
"""Places that are tried, evenly between those that can be, and then around the best."""
_INDEPENDENT = 12
"""Observations that all patches together are worth: what the model is too coarse for is alike in neighbours."""
_LEAST_MISFIT = 0.01
"""Of global light, relative: what coarse patches leave in a room that is right."""
_LEAST_SIGMA_M = 0.02
"""What coarse patches leave of a place that the light tells well."""
_FINE = 400
"""Steps of the integral over what the light leaves open."""


@dataclass(frozen=True, kw_only=True)
class PlacedByLight(Record):
    """Two opposite walls that nobody saw, at the place at which the light is explained best."""

    axis: str
    """`x`, `y` or `z`: along which they stand."""
    shift_m: float
    """By which both devices are further along it than step `geometry` guessed."""
    projector_m: float
    """Of the projector's lens along it, in the room: above the floor, for `z`."""
    sigma_m: float
    """Standard deviation: how far the light leaves the place open."""
    light_error: float
    """Relative standard deviation of global light that follows from it."""


def shift_of(placed: tuple[PlacedByLight, ...]) -> Shift:
    """Return by how much the devices are moved in the room, together."""
    along = {one.axis: one.shift_m for one in placed}
    return along.get("x", 0.0), along.get("y", 0.0), along.get("z", 0.0)


def unmeasured_axes(surface: BoxSurface, *, height_known: bool) -> tuple[str, ...]:
    """Return the axes of a closed room along which no wall was measured."""
    pairs = {"x": {"x0", "x1"}, "y": {"y0", "y1"}, "z": {"floor", "ceiling"}}
    if len(surface.faces) < 2 * len(pairs):
        return ()
    return tuple(a for a, both in pairs.items() if not both & set(surface.seen) and not (a == "z" and height_known))


@dataclass(frozen=True, eq=False, kw_only=True)
class SeenInWhite:
    """What the camera saw while the projector showed white, all bands together."""

    light: BandLight
    lit: BoolArray
    """(H, W)"""
    projector_xy_px: NDArray[np.float32]
    """(H, W, 2) what each camera pixel sees of the projector's picture."""
    border: NDArray[np.float32]
    """(H, W) share of white that a pixel sees: less than 1 beside the picture's border."""


def place_unseen_walls(
    record: GeometryRecord,
    axes: tuple[str, ...],
    patch_size_m: float,
    *,
    size_sigmas_m: Sequence[float],
    seen: SeenInWhite,
    on_step: OnStep,
) -> tuple[PlacedByLight, ...]:
    """Find the place of the walls along axes of which nobody saw any.

    Parameters
    ----------
    record
        With the room's size.
    axes
        Of :func:`unmeasured_axes`; with several, each is found with those before it in their place.
    patch_size_m
        Of the model.
    size_sigmas_m
        Standard deviations of the room's size by tape: along x, y, z. [m]
    seen
        By the camera.
    on_step
        Told how far it is.

    Returns
    -------
    tuple of PlacedByLight
        One an axis.
    """
    placed: tuple[PlacedByLight, ...] = ()
    for axis in axes:
        sigma_m = size_sigmas_m["xyz".index(axis)]
        found = _placed(record, axis, patch_size_m, sigma_m, seen=seen, before=shift_of(placed), on_step=on_step)
        placed = (*placed, found)
    return placed


def _placed(
    record: GeometryRecord,
    axis: str,
    patch_size_m: float,
    by_tape_m: float,
    *,
    seen: SeenInWhite,
    before: Shift,
    on_step: OnStep,
) -> PlacedByLight:
    k = "xyz".index(axis)
    low, high = _possible(record, k, seen, before)
    guess = _with(before, k, (low + high) / 2)
    search = _CoarseRoom.begun(record, patch_size_m, guess, seen=seen)
    total = _GRID + _REFINEMENTS
    tried: dict[float, float] = {}

    def cost(shift_m: float) -> float:
        on_step("place walls that nobody saw by their light", len(tried) % total, total)
        tried[shift_m] = search.cost(_with(before, k, shift_m))
        return tried[shift_m]

    grid = np.linspace(low, high, _GRID)
    best = int(np.argmin([cost(float(shift_m)) for shift_m in grid]))
    around = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, _GRID - 1)])
    minimize_scalar(cost, bounds=around, method="bounded", options={"maxiter": _REFINEMENTS, "xatol": 0.005})
    on_step("place walls that nobody saw by their light", total, total)
    shift_m = float(min(tried, key=lambda place: tried[place]))
    sigma_m = float(np.hypot(_spread(tried, shift_m), by_tape_m))
    other = shift_m + sigma_m if shift_m + sigma_m <= high else shift_m - sigma_m
    room = bare_room(record, patch_size_m, _with(before, k, shift_m))
    return PlacedByLight(
        axis=axis,
        shift_m=shift_m,
        projector_m=float(room.projector.pose.position_m[k]),
        sigma_m=sigma_m,
        light_error=search.difference(_with(before, k, shift_m), _with(before, k, other)),
    )


def _with(shift_m: Shift, k: int, value: float) -> Shift:
    moved = list(shift_m)
    moved[k] = value
    return moved[0], moved[1], moved[2]


def _possible(record: GeometryRecord, k: int, seen: SeenInWhite, before: Shift) -> tuple[float, float]:
    """Shifts along axis k that leave what is lit of the measured walls between the two that nobody saw."""
    size_m = record.surface.size_m[k]
    longer = list(record.surface.size_m)
    longer[k] += 2 * _FAR_M
    surface = replace(record.surface, size_m=(longer[0], longer[1], longer[2]), faces=record.surface.seen)
    room = bare_room(replace(record, surface=surface), max(longer), _with(before, k, _FAR_M))
    known = seen.lit & on_the_model(room, seen.projector_xy_px, _ON_WALL_PX)
    points = room.camera_hits.points_m[known.ravel(), k] - _FAR_M
    lowest, highest = np.percentile(points, _REACH) if len(points) else (0.0, 0.0)
    ends = -float(lowest), size_m - float(highest)
    devices_m = [float(device.pose.position_m[k]) - _FAR_M for device in (room.camera, room.projector)]
    # Walls that reach further than the room is long: the tape or the geometry is off, by as much as the place may be.
    # But no device stands in a wall.
    inside = _ROOM_M - min(devices_m), size_m - _ROOM_M - max(devices_m)
    low, high = np.clip([min(ends), max(ends)], *inside).tolist()
    return low, high


def _spread(tried: dict[float, float], best: float) -> float:
    """Root mean square distance from the best place, each weighed by its likelihood; linear between those tried."""
    places = np.array(sorted(tried))
    fine = np.linspace(places[0], places[-1], _FINE)
    costs = np.interp(fine, places, [tried[place] for place in places])
    weight = np.exp(-0.5 * (costs - min(tried.values())))
    return float(np.hypot(np.sqrt(np.average((fine - best) ** 2, weights=weight)), _LEAST_SIGMA_M))


@dataclass(frozen=True, eq=False, kw_only=True)
class _CoarseRoom:
    """The room in few patches and few pixels, with the light that any place of its walls has to explain."""

    room: BareRoom
    """At the shift where the search began."""
    began: Shift
    gain: FloatArray
    light: BandLight
    inner: BoolArray

    @classmethod
    def begun(cls, record: GeometryRecord, patch_size_m: float, shift_m: Shift, *, seen: SeenInWhite) -> _CoarseRoom:
        full = bare_room(record, _COARSER * patch_size_m, shift_m)
        gain = direct_gain(seen.light, seen.lit, full.camera_hits, seen.border)
        inner = pixels_that_tell(full, seen.lit, seen.projector_xy_px, seen.border)
        full = full.with_vignetting(fit_lenses(full, gain, inner))
        few = (slice(None, None, _EVERY_PX),) * 2
        light = BandLight(seen.light.direct[few], seen.light.global_[few], seen.light.white[few])
        room = replace(full, camera=_fewer(full.camera), projector=_fewer(full.projector))
        return cls(room=room, began=shift_m, gain=gain[few], light=light, inner=inner[few])

    def at(self, shift_m: Shift) -> BareRoom:
        by_m = (np.array(shift_m) - self.began).tolist()
        return self.room.moved((by_m[0], by_m[1], by_m[2]))

    def fitted(self, room: BareRoom) -> ReflectanceFit:
        least = LEAST_PIXELS * _COARSER**2 // _EVERY_PX**2
        return fit_reflectance(room, self.gain, self.light, self.inner, least_pixels=least)

    def cost(self, shift_m: Shift) -> float:
        """Minus twice the logarithm of the likelihood, whose variance is what the best reflectances leave."""
        misfit = self.fitted(self.at(shift_m)).usual_misfit
        return float(_INDEPENDENT * np.log(misfit**2 + _LEAST_MISFIT**2))

    def difference(self, one: Shift, other: Shift) -> float:
        """By how much global light of half pictures differs between two places, of what tells it from white's."""
        (share, direct), (elsewhere, _) = (self._shares_of_halves(shift_m) for shift_m in (one, other))
        own = np.sqrt(np.nanmean((share - direct) ** 2))
        return float(np.sqrt(np.nanmean((elsewhere - share) ** 2)) / max(float(own), 1e-9))

    def _shares_of_halves(self, shift_m: Shift) -> tuple[FloatArray, FloatArray]:
        """(P, 2) left and top half's global light over white's, and the same of direct light; NaN where unlit."""
        room = self.at(shift_m)
        fit, factors = self.fitted(room), room.form_factors.matrix
        height, width = room.projector.lens.shape
        halves = np.ones((3, height, width))
        halves[1, :, width // 2 :] = halves[2, height // 2 :] = 0
        irradiance = np.asarray(unit_emission(room.scene, room.projector) @ halves.reshape(3, -1).T)
        rho = fit.reflectance[:, None]
        radiosity = np.linalg.solve(np.eye(len(rho)) - rho * factors, rho * irradiance)
        arriving, lit = factors @ radiosity, (fit.source == ReflectanceSource.DIRECT)[:, None]
        shares = (np.where(lit & (light[:, :1] > 0), light, np.nan) for light in (arriving, irradiance))
        global_share, direct_share = (light[:, 1:] / light[:, :1] for light in shares)
        return global_share, direct_share


def _fewer(device: PosedLens) -> PosedLens:
    """The same device with every so many-th pixel only."""
    lens = device.lens
    x, y = lens.principal_point_px
    fewer = replace(
        lens,
        width_px=-(-lens.width_px // _EVERY_PX),
        height_px=-(-lens.height_px // _EVERY_PX),
        focal_px=(lens.focal_px[0] / _EVERY_PX, lens.focal_px[1] / _EVERY_PX),
        principal_point_px=(x / _EVERY_PX, y / _EVERY_PX),
    )
    return replace(device, lens=fewer)
