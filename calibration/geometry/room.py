"""From measured planes to a box: the room's own frame, its size, and the walls that nobody saw."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.noise import SIGMAS
from calibration.geometry.pinhole import PinholeModel, points_on_planes
from calibration.geometry.plane_search import MOST_SLANTED
from calibration.geometry.planes import Axes, orthogonal_axes
from calibration.geometry.stereo import StereoCalibration
from calibration.geometry.support import LEAST_BEHIND, shares_behind

FACES = ("x0", "x1", "y0", "y1", "floor", "ceiling")
"""Two faces an axis: the one at 0, the one at the room's size."""
_BEHIND_M = 0.5
"""Behind the rearmost device: where a wall that nobody saw or measured is put; tripods leave so much."""
_UNKNOWN_SIZE_M = 4.0
"""Of a room along an axis of which nothing was seen or measured: a usual room's."""
MOST_OFF_SQUARE_DEG = 2.0
"""How far planes that were fitted without right angles may stand from a box's: 7 cm at the end of a wall of 2 m."""
_STANDING = '. What stands before a wall is modelled with [surface] kind = "free"'
_PAIRS_NAMED = 6
_OPEN_DEG = 90.0
"""Standard deviation from which on an angle is not known at all."""
_WALL_MARGIN = 0.1
"""Of the lit piece of a wall that stands alone, on each side: pixels at its rim do not enter the geometry."""
_MOSTLY = 0.9
"""Cosine from which on a direction counts as along another one."""
_NEARLY_ALL = 95
"""Percentile of distances that a wall is said to be off by."""
_TWO_SURFACES_M = 0.3
"""Of parallel surfaces within so much of the outermost, the one with most points is the wall: a niche is no room."""


Extents = list[float | None]


@dataclass(frozen=True, eq=False, kw_only=True)
class RoomBox:
    """A box-shaped room and the devices in it; world is the room's frame (z up, origin at a lower corner)."""

    size_m: tuple[float, float, float]
    seen: tuple[str, ...]
    """Faces that were measured."""
    faces: tuple[str, ...]
    """Faces that the model has: all six of a closed room, else those seen."""
    camera: PinholeModel
    projector: PinholeModel
    angle_error_deg: float
    """Largest deviation of a measured plane from its axis."""
    off_m: float = 0.0
    """How far what was measured of the walls lies off them: 95 % of the points by no more."""
    notes: str
    """What was assumed, in words."""

    @property
    def lengths_measured(self) -> list[int]:
        """Axes along which both faces were measured, so that the points tell the room's length."""
        return [k for k in range(3) if {FACES[2 * k], FACES[2 * k + 1]} <= set(self.seen)]


def room_from_stereo(
    stereo: StereoCalibration,
    size_m: tuple[float, float, float] | None = None,
    closed: bool = True,
    *,
    lens_height_m: float | None = None,
    with_things: bool = False,
) -> RoomBox:
    """Turn the planes of a scaled calibration into a room.

    Up is the axis nearest to the camera's -y. The x axis points to the wall most to the right of the projector's
    view, y to the left or ahead, so that x, y, z are right-handed. A seen wall stands where it was measured; one that
    nobody sees stands `size_m` away from the one opposite, or, without a size, 0.5 m behind the rearmost device.

    Of one wall alone that wall becomes `x0`, as far as it is lit and seen: x points from it to the devices, z up it.

    Parameters
    ----------
    stereo : StereoCalibration
        In metres.
    size_m : (x, y, z), optional
        By tape measure. [m]
    closed : bool
        All six faces are there, seen or not.
    lens_height_m : float, optional
        Of the projector's lens above a floor that nobody sees, by tape measure. [m]
    with_things : bool
        What stands in the room is modelled, too: a plane behind which others are seen may be as large as it is.

    Returns
    -------
    RoomBox
        Devices in the room's frame.

    Raises
    ------
    CalibrationError
        If the planes make no box, with their angles; or a wall that nobody saw would stand before a device.
    """
    if len(stereo.planes) == 1 and not closed:
        return _wall_alone(stereo)
    stereo = _on_axes(stereo, with_things=with_things)
    on_axis = [k for k, axis in enumerate(stereo.axes) if axis >= 0]
    frame = _room_directions(stereo)
    low, high, seen, off_m = _extents(stereo, frame)
    devices = np.stack([frame @ stereo.camera.position_m, frame @ stereo.projector.position_m])
    if lens_height_m is not None and low[2] is None:
        low[2] = float(devices[1, 2]) - lens_height_m
    notes = _close(devices, low, high, size_m)
    if lens_height_m is not None and "floor" not in seen:
        notes += f" The floor is {lens_height_m:g} m below the projector's lens, by tape."
    if stereo.bow:
        notes += f" Walls bow, by up to {1000 * stereo.bow:.1f} mm rms, which is part of all sigmas."
    _check_inside(stereo, frame, devices, (low, high))
    origin = np.array([value for value in low if value is not None])
    size = np.array([b - a for a, b in zip(low, high, strict=True) if a is not None and b is not None])
    normals = stereo.planes[on_axis] / np.linalg.norm(stereo.planes[on_axis], axis=1, keepdims=True)
    angle = float(np.degrees(np.arccos(np.clip(np.abs(normals @ frame.T).max(axis=1), 0, 1))).max())
    measured = tuple(name for name in FACES if name in seen)
    return RoomBox(
        size_m=(float(size[0]), float(size[1]), float(size[2])),
        seen=measured,
        faces=FACES if closed else measured,
        camera=_moved(stereo.camera, frame, origin),
        projector=_moved(stereo.projector, frame, origin),
        angle_error_deg=angle,
        off_m=off_m,
        notes=notes,
    )


def _wall_alone(stereo: StereoCalibration) -> RoomBox:
    """One face with a margin around what is lit and seen; the depth of the box reaches behind the rearmost device."""
    frame = _wall_directions(stereo)
    points = lit_points(stereo) @ frame.T
    low, high = points.min(axis=0), points.max(axis=0)
    margin = _WALL_MARGIN * (high - low)
    devices = np.stack([frame @ stereo.camera.position_m, frame @ stereo.projector.position_m])
    size = np.append(devices[:, 0].max() + _BEHIND_M - low[0], (high - low + 2 * margin)[1:])
    origin = np.append(low[0], (low - margin)[1:])
    return RoomBox(
        size_m=(float(size[0]), float(size[1]), float(size[2])),
        seen=FACES[:1],
        faces=FACES[:1],
        camera=_moved(stereo.camera, frame, origin),
        projector=_moved(stereo.projector, frame, origin),
        angle_error_deg=0.0,
        notes=stereo.notes,
    )


def _wall_directions(stereo: StereoCalibration) -> FloatArray:
    """(3, 3) rows: off the wall, along it to the right of who faces it, up it; in the camera's frame."""
    off = -stereo.planes[0] / np.linalg.norm(stereo.planes[0])
    # A camera that looks along the wall's up has its own up off the wall: then up is ahead of it.
    up = np.array([0.0, -1.0, 0.0]) if abs(off[1]) < _MOSTLY else np.array([0.0, 0.0, 1.0])
    up = up - (up @ off) * off
    up /= np.linalg.norm(up)
    return np.stack([off, np.cross(up, off), up])


def lit_points(stereo: StereoCalibration) -> FloatArray:
    """(M, 3) what the explained correspondences light."""
    planes = stereo.planes[stereo.explained.plane]
    return points_on_planes(stereo.projector, stereo.explained.projector_xy_px, planes)


def _on_axes(stereo: StereoCalibration, *, with_things: bool) -> StereoCalibration:
    """The same calibration, with axes where free planes stand at right angles; refuses what makes no box."""
    if all(axis < 0 for axis in stereo.axes) and len(stereo.axes) > 1:
        stereo = _with_axes(stereo, orthogonal_axes(stereo.planes, MOST_OFF_SQUARE_DEG))
    stands = shares_behind(stereo.planes, lit_points(stereo), stereo.explained.plane) >= LEAST_BEHIND
    frames = [stereo, *_other_frames(stereo)]
    for framed in frames:
        if len(set(framed.axes) - {-1}) > 1 and not (_slanted(framed) & ~(stands & with_things)).any():
            return framed
    standing = any((_slanted(framed) & stands).any() for framed in frames)
    raise CalibrationError(_no_box(stereo) + (_STANDING if standing else ""))


def _with_axes(stereo: StereoCalibration, axes: Axes) -> StereoCalibration:
    return replace(stereo, axes=tuple(axes.of_plane.tolist()), room_axes=axes.directions)


def _slanted(stereo: StereoCalibration) -> BoolArray:
    """(K,) planes with too many points for small furniture that are none of a box's."""
    return np.array([axis < 0 and _share(stereo, k) > MOST_SLANTED for k, axis in enumerate(stereo.axes)], dtype=bool)


def _other_frames(stereo: StereoCalibration) -> Iterator[StereoCalibration]:
    """Yield the calibration with a box's axes along each slanted plane: a screen that was found first gave its own."""
    for plane in np.flatnonzero(_slanted(stereo)):
        order = np.concatenate([[plane], np.delete(np.arange(len(stereo.planes)), plane)])
        found = orthogonal_axes(stereo.planes[order], MOST_OFF_SQUARE_DEG)
        of_plane = np.empty_like(found.of_plane)
        of_plane[order] = found.of_plane
        yield _with_axes(stereo, Axes(found.directions, of_plane))


def _no_box(stereo: StereoCalibration) -> str:
    """Why planes make no box, or may make one and are not known to."""
    pairs = list(combinations(range(len(stereo.planes)), 2))
    degrees, sigmas = _angles(stereo, pairs)
    off_square = np.abs((degrees + 45) % 90 - 45)
    tolerance = np.maximum(SIGMAS * sigmas, MOST_OFF_SQUARE_DEG)
    named = np.sort(np.argsort(-off_square, kind="stable")[:_PAIRS_NAMED])
    told = (
        f"{len(stereo.axes)} planes were found: {_in_words([pairs[k] for k in named], degrees[named], sigmas[named])}"
    )
    if (off_square < tolerance).all() and (np.abs(degrees - 90) < tolerance).any():
        return (
            f"a session needs a box, and whether the walls make one is not known: {told}; right angles are within "
            "these uncertainties. If they are square, say so (right_angles = true); if not, move the camera away from "
            "the projector, show more of each wall, or give both devices a lens file (rig lenses)"
        )
    return (
        f"a session needs a box, and the walls make none: {told}; all have to stand at right angles to within "
        f"{MOST_OFF_SQUARE_DEG:g} degrees. The walls of a session make a box, whatever stands in it: aim at a corner "
        "of the room whose walls, or wall and floor, are square"
    )


def _share(stereo: StereoCalibration, plane: int) -> float:
    """Of the explained points, those on one plane."""
    return float((stereo.explained.plane == plane).mean()) if len(stereo.explained.plane) else 0.0


def _angles(stereo: StereoCalibration, pairs: Sequence[tuple[int, int]]) -> tuple[FloatArray, FloatArray]:
    """Angles between pairs of planes, and their standard deviations. [degrees]."""

    def degrees(calibration: StereoCalibration) -> FloatArray:
        normals = calibration.planes / np.linalg.norm(calibration.planes, axis=1, keepdims=True)
        return np.array([180 - np.degrees(np.arccos(np.clip(normals[a] @ normals[b], -1, 1))) for a, b in pairs])

    if not pairs:
        return np.zeros(0), np.zeros(0)
    return degrees(stereo), np.asarray(stereo.sigmas_of(degrees))


def _in_words(pairs: Sequence[tuple[int, int]], degrees: FloatArray, sigmas: FloatArray) -> str:
    if not pairs:
        return "it stands alone"
    named = [
        f"{a + 1} and {b + 1} at {v:.1f} +- {s:.1f}" if s < _OPEN_DEG else f"{a + 1} and {b + 1} at any angle"
        for (a, b), v, s in zip(pairs, degrees, sigmas, strict=True)
    ]
    return f"walls {', '.join(named)} degrees"


def _check_inside(
    stereo: StereoCalibration, frame: FloatArray, devices: FloatArray, walls: tuple[Extents, Extents]
) -> None:
    """Refuse a room whose walls, once all are placed, leave a device outside."""
    low, high = walls
    for number, name in enumerate(("camera", "projector")):
        for k in range(3):
            for bound, face, sign in ((low[k], FACES[2 * k], 1), (high[k], FACES[2 * k + 1], -1)):
                outside = 0.0 if bound is None else sign * (bound - float(devices[number, k]))
                if outside > 0:
                    raise CalibrationError(_outside(name, outside, face, _place_sigma_m(stereo, frame[k], number)))


def _outside(name: str, outside_m: float, face: str, sigma_m: float) -> str:
    if outside_m > SIGMAS * sigma_m:
        return (
            f"the {name} would stand {outside_m:.2f} m behind wall {face}: [surface] size_m is too small along "
            f"{'xyz'[FACES.index(face) // 2]} (x ends at the wall on the right), or a length of [[scale]] is wrong"
        )
    return (
        f"the points put the {name} {outside_m:.2f} +- {sigma_m:.2f} m behind wall {face}, where [surface] size_m has "
        "it: they tell the distance of the wall before it too badly. Move the camera further aside, show more of floor "
        "or ceiling, or give both devices a lens file (rig lenses); if these are good, check size_m and [[scale]]"
    )


def _place_sigma_m(stereo: StereoCalibration, along: FloatArray, device: int) -> float:
    """Standard deviation of the place of the camera (0) or the projector (1) along a direction of the room."""
    seen = np.abs(stereo.planes @ along) > _MOSTLY * np.linalg.norm(stereo.planes, axis=1)

    def distances(calibration: StereoCalibration) -> FloatArray:
        planes = calibration.planes[seen]
        position = (calibration.camera, calibration.projector)[device].position_m
        return np.asarray((1 - planes @ position) / np.linalg.norm(planes, axis=1))

    return stereo.baseline * float(stereo.sigmas_of(distances).max(initial=0.0))


def _room_directions(stereo: StereoCalibration) -> FloatArray:
    """(3, 3) rows: room x, y, z in the camera's frame."""
    axes = stereo.room_axes
    up_axis = int(np.abs(axes[:, 1]).argmax())
    up = axes[up_axis] * -np.sign(axes[up_axis, 1])
    sides = [axes[k] for k in range(3) if k != up_axis]
    right = stereo.projector.rotation[0]
    ahead = stereo.projector.rotation[2]
    # Of the four horizontal directions, x is the one furthest to the right that still lies ahead.
    candidates = [sign * side for side in sides for sign in (1.0, -1.0)]
    x = max(candidates, key=lambda d: float(d @ right) + 0.999 * float(d @ ahead))
    y = np.cross(up, x)
    if y @ ahead < -0.3:
        x, y = -y, x
    return np.stack([x, y, up])


def _extents(stereo: StereoCalibration, frame: FloatArray) -> tuple[Extents, Extents, set[str], float]:
    """Positions of the seen faces along each axis, in the camera's frame's origin, and how far points lie off them.

    A plane that is a little askew becomes the wall that is nearest to what was measured of it.
    """
    points, off = lit_points(stereo) @ frame.T, [np.zeros(1)]
    found: dict[str, list[tuple[float, int]]] = {}
    for number, (plane, axis) in enumerate(zip(stereo.planes, stereo.axes, strict=True)):
        if axis < 0:
            continue
        alignment = frame @ plane / np.linalg.norm(plane)
        k = int(np.abs(alignment).argmax())
        on_plane = points[stereo.explained.plane == number, k]
        foot = float(np.sign(alignment[k]) / np.linalg.norm(plane))
        position = float(on_plane.mean()) if len(on_plane) else foot
        off.append(np.abs(on_plane - position))
        found.setdefault(FACES[2 * k + (foot > 0)], []).append((position, len(on_plane)))
    places = [_wall_among(found[name]) if name in found else None for name in FACES]
    return places[::2], places[1::2], set(found), float(np.percentile(np.concatenate(off), _NEARLY_ALL))


def _wall_among(surfaces: list[tuple[float, int]]) -> float:
    """Position of the wall among parallel surfaces, each with its points: a cupboard or a beam stands before it.

    The outermost; but of those that are not far from it, as the wall around a niche is, the one with most points.
    """
    outermost = max((position for position, _ in surfaces), key=abs)
    near = [one for one in surfaces if abs(one[0] - outermost) <= _TWO_SURFACES_M]
    return max(near, key=lambda one: one[1])[0]


def _close(devices: FloatArray, low: Extents, high: Extents, size_m: tuple[float, float, float] | None) -> str:
    """Place what nobody saw, with the devices at (2, 3); says in words what was assumed."""
    assumed = []
    for k in range(3):
        a, b = low[k], high[k]
        if a is None and b is None:
            a = float(devices[:, k].min()) - _BEHIND_M
            b = a + (size_m[k] if size_m is not None else _UNKNOWN_SIZE_M)
            assumed.append(f"{FACES[2 * k]} and {FACES[2 * k + 1]} (neither seen)")
        elif a is None and b is not None:
            a = b - size_m[k] if size_m is not None else float(devices[:, k].min()) - _BEHIND_M
            assumed.append(FACES[2 * k])
        elif b is None and a is not None:
            b = a + size_m[k] if size_m is not None else float(devices[:, k].max()) + _BEHIND_M
            assumed.append(FACES[2 * k + 1])
        low[k], high[k] = a, b
    if not assumed:
        return "All six faces were seen."
    source = "by the tape-measured size of the profile" if size_m is not None else "0.5 m behind the rearmost device"
    return f"Not seen, placed {source}: {', '.join(assumed)}."


def _moved(model: PinholeModel, frame: FloatArray, origin: FloatArray) -> PinholeModel:
    """The same device in room coordinates: x_room = frame x_camera - origin."""
    rotation = model.rotation @ frame.T
    return replace(model, rotation=rotation, translation_m=model.translation_m + rotation @ origin)
