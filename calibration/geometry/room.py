"""From measured planes to a box: the room's own frame, its size, and the walls that nobody saw."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.pinhole import PinholeModel
from calibration.geometry.stereo import StereoCalibration

FACES = ("x0", "x1", "y0", "y1", "floor", "ceiling")
"""Two faces an axis: the one at 0, the one at the room's size."""
_BEHIND_M = 0.5
"""Behind the rearmost device: where a wall that nobody saw or measured is put; tripods leave so much."""
_UNKNOWN_SIZE_M = 4.0
"""Of a room along an axis of which nothing was seen or measured: a usual room's."""
_TWO_SURFACES_M = 0.3
"""Parallel planes further apart are two surfaces, not one found twice."""


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
    notes: str
    """What was assumed, in words."""


def room_from_stereo(
    stereo: StereoCalibration, size_m: tuple[float, float, float] | None = None, closed: bool = True
) -> RoomBox:
    """Turn the planes of a scaled calibration into a room.

    Up is the axis nearest to the camera's -y. The x axis points to the wall most to the right of the projector's
    view, y to the left or ahead, so that x, y, z are right-handed. A seen wall stands where it was measured; one that
    nobody sees stands `size_m` away from the one opposite, or, without a size, 0.5 m behind the rearmost device.

    Parameters
    ----------
    stereo : StereoCalibration
        In metres.
    size_m : (x, y, z), optional
        By tape measure. [m]
    closed : bool
        All six faces are there, seen or not.

    Returns
    -------
    RoomBox
        Devices in the room's frame.

    Raises
    ------
    CalibrationError
        If no plane belongs to a room, or two parallel planes contradict each other.
    """
    on_axis = [k for k, axis in enumerate(stereo.axes) if axis >= 0]
    if len({stereo.axes[k] for k in on_axis}) < 2:
        raise CalibrationError(
            f"{len(on_axis)} of {len(stereo.axes)} planes stand at right angles: no room can be made of them; "
            "aim at a corner of the room"
        )
    frame = _room_directions(stereo)
    low, high, seen = _extents(stereo, frame)
    devices = np.stack([frame @ stereo.camera.position_m, frame @ stereo.projector.position_m])
    notes = _close(devices, low, high, size_m)
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
        notes=notes,
    )


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


Extents = list[float | None]


def _extents(stereo: StereoCalibration, frame: FloatArray) -> tuple[Extents, Extents, set[str]]:
    """Positions of the seen faces along each axis, in the camera's frame's origin."""
    low: Extents = [None, None, None]
    high: Extents = [None, None, None]
    seen: set[str] = set()
    for plane, axis in zip(stereo.planes, stereo.axes, strict=True):
        if axis < 0:
            continue
        alignment = frame @ plane / np.linalg.norm(plane)
        k = int(np.abs(alignment).argmax())
        position = float(np.sign(alignment[k]) / np.linalg.norm(plane))
        side, name = (high, FACES[2 * k + 1]) if position > 0 else (low, FACES[2 * k])
        held = side[k]
        if held is not None and abs(held - position) > _TWO_SURFACES_M:
            # A second, parallel surface (a cupboard, a step): the outer one is the room's wall.
            position = max(held, position, key=abs)
        side[k] = position
        seen.add(name)
    return low, high, seen


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
