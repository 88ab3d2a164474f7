"""A surface that is known beforehand: a mesh from a file, found in the room by what the camera sees of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.geometry.pinhole import PinholeModel
from calibration.surfaces.known.registration import Registration, better_size, register
from calibration.surfaces.point_map import PointMap
from rig.errors import UsageError
from rig.files.atomic import sha256_of
from rig.files.mesh import UNITS_M
from rig.offline.mesh_file import MeshOptions, open_mesh_file
from rig.profile.schema import Profile
from rig.profile.tables import SurfaceFile
from rig.records import JsonObject, Record
from rig.stages.surface.triangles import cut_to_size, outwards, smooth_parts, within_room
from rig.terminal import silent
from sim.geometry.mending.remarks import Facets
from sim.geometry.mending.simplification import simplified

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

MOST_MEDIAN, MOST_THROUGH = 1.5e-3, 0.1
"""Of the distance, which half of what the camera sees of the mesh may miss by, as a measured surface may; and the share
of the mesh behind which the camera may see something else: legs that are thinner than its pixels are."""
_TOLD_SCALE = 5e-3
"""By which a mesh may be too large or small and nothing is said: a tape's error, and that of a print."""
_BETTER = 0.8
"""Of the misfit, what is left where another size is said to fit better."""
_MOST_FACETS = 3000
"""Of a mesh before it is cut into patches: finer ones are simplified."""
_WHOLE_ROOM = 0.7
"""Of the room's length and width: a mesh that reaches so far holds the room's own walls, too."""
_LEAST_SEEN = 400
"""Camera pixels: a face of 20 by 20."""
_PLAUSIBLE = (0.2, 1.5)
"""Size of what is seen over that of the mesh, in a unit that may be meant."""


@dataclass(frozen=True, kw_only=True)
class RegistrationRecord(Record):
    """Where a known mesh stands, and how well it fits what the camera sees."""

    file: str
    unit: str
    rotation: tuple[tuple[float, float, float], ...]
    """world_from_mesh, row by row."""
    translation_m: tuple[float, float, float]
    misfit_median_m: float
    """Of the absolute distances from the points to the mesh."""
    misfit_p95_m: float
    bias_m: float
    """Median by which points lie before the mesh."""
    sigma_m: float
    """Median standard deviation of the points: a mesh cannot fit better."""
    see_through: float
    """Share of the mesh, where it looks at the camera, behind which the camera sees something else."""
    loosest_m: float
    """How far the loosest of its motions may move a corner: a standard deviation."""
    loosest: str
    """Which motion that is."""
    remarks: tuple[str, ...] = ()
    """What else is to be known, in words."""


@dataclass(frozen=True, eq=False, kw_only=True)
class KnownSurface:
    """A mesh in the room, in patches."""

    vertices_m: FloatArray
    triangles: IntArray
    part: IntArray
    record: RegistrationRecord
    misfit_m: FloatArray
    """(H, W) by which the camera's points lie before the mesh; NaN where it sees none of it."""
    is_open: bool = False
    """Parts of it are sheets, which have backs."""


def known_settings(profile: Profile) -> JsonObject:
    """Return what a model depends on: the file, where the surface is one. Raises UsageError where it is missing."""
    if not isinstance(profile.surface, SurfaceFile):
        return {}
    path = mesh_path(profile, profile.surface)
    if not path.is_file():
        raise UsageError(
            f"{path}: no such file, which [surface] file names; correct it (its path begins at the profile)"
        )
    own = profile.surface
    return {"file_sha256": sha256_of(path), "unit": own.unit, "up": own.up}


def mesh_path(profile: Profile, surface: SurfaceFile) -> Path:
    """Return where the mesh of a profile lies."""
    return profile.path.parent / surface.file


def known_surface(
    profile: Profile,
    surface: SurfaceFile,
    *,
    points: PointMap,
    stands: NDArray[np.bool_],
    camera: PinholeModel,
    size_m: tuple[float, float, float],
) -> KnownSurface:
    """Find the profile's mesh in what the camera sees.

    Parameters
    ----------
    profile, surface
        Of the rig.
    points
        Of all valid pixels.
    stands : (H, W)
        Pixels that see something before the walls.
    camera
        Whose pixels these are.
    size_m
        Of the room.

    Raises
    ------
    UsageError
        The file is missing, cannot be read, or cannot be mended.
    CalibrationError
        The camera sees too little before the walls; or the mesh does not fit, with the cause.
    """
    path = mesh_path(profile, surface)
    facets, is_open = _facets(path, surface)
    extent = np.ptp(facets.corners.reshape(-1, 3), axis=0)
    share = extent[:2] / np.array(size_m[:2])
    is_whole = bool(((share > _WHOLE_ROOM) & (share < 1 / _WHOLE_ROOM)).all())
    chosen = points.known if is_whole else stands & points.known
    if chosen.sum() < _LEAST_SEEN:
        raise CalibrationError(
            f"{path.name}: {int(chosen.sum())} camera pixels see something before the walls, {_LEAST_SEEN} are needed "
            "to find a mesh; is what it describes in the room, and in the light? [surface] kind = 'box' models a room "
            "without it"
        )
    # Sheets may be seen from either side.
    corners = np.concatenate([facets.corners, facets.corners[is_open][:, ::-1]])
    seen = _SeenOfMesh(points=points, chosen=chosen, camera=camera)
    found = seen.register(corners)
    _refuse_misfit(found, seen, corners, name=path.name, unit=surface.unit)
    record = _record(path.name, surface.unit, found, seen, remarks=_remarks(found, seen, corners))
    known = _placed(facets, found, profile, size_m, record=record, chosen=chosen)
    return replace(known, is_open=bool(is_open.any()))


@dataclass(frozen=True, eq=False, kw_only=True)
class _SeenOfMesh:
    """What the camera sees of the mesh, and of all else."""

    points: PointMap
    chosen: NDArray[np.bool_]
    camera: PinholeModel

    def register(self, corners: FloatArray, *, upright: bool = True) -> Registration:
        """Find triangles (T, 3, 3) in it."""
        return register(self.points, self.chosen, self.camera, corners, upright=upright)

    @property
    def distance_m(self) -> float:
        """Median."""
        return float(np.median(self.points.distance_m[self.chosen]))

    @property
    def sigma_m(self) -> float:
        """Median."""
        return float(np.median(self.points.sigma_m[self.chosen]))

    @property
    def size_m(self) -> float:
        """Diagonal of the box about nearly all points."""
        points = self.points
        places = points.origin_m + points.distance_m[self.chosen][:, None] * points.rays[self.chosen]
        return float(np.linalg.norm(np.ptp(np.quantile(places, [0.02, 0.98], axis=0), axis=0)))


def _facets(path: Path, surface: SurfaceFile) -> tuple[Facets, NDArray[np.bool_]]:
    """The file's facets, bodies lit from outside, and (T,) which belong to open sheets."""
    file = open_mesh_file(path, MeshOptions(unit=surface.unit, up=surface.up, sides="file"), 0.5, silent)
    triangles, is_open = outwards(file.facets.points, file.facets.triangles)
    return replace(file.facets, triangles=triangles), is_open


def _refuse_misfit(found: Registration, seen: _SeenOfMesh, corners: FloatArray, *, name: str, unit: str) -> None:
    """Raise CalibrationError for a mesh that is not what the camera sees, with the likeliest cause."""
    limit_m = MOST_MEDIAN * seen.distance_m + seen.sigma_m
    if _is_good(found, limit_m):
        return
    median_m = float(np.median(np.abs(found.misfit_m)))
    raise CalibrationError(
        f"{name} does not fit what the camera sees: half of {int(seen.chosen.sum())} points are more than "
        f"{1000 * median_m:.1f} mm from it where it fits best, the limit is {1000 * limit_m:.1f} mm, and the camera "
        f"sees through {100 * found.see_through:.0f} % of it, the limit is {100 * MOST_THROUGH:.0f} %. "
        f"{_cause(found, seen, corners, unit=unit, limit_m=limit_m)}"
    )


def _is_good(found: Registration, limit_m: float) -> bool:
    return bool(np.median(np.abs(found.misfit_m)) <= limit_m and found.see_through <= MOST_THROUGH)


def _cause(found: Registration, seen: _SeenOfMesh, corners: FloatArray, *, unit: str, limit_m: float) -> str:
    """What would make it fit: another unit, way up or size, tried one after the other."""
    mesh_m = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
    for other, metres in UNITS_M.items():
        factor = metres / UNITS_M[unit]
        if factor == 1 or not _PLAUSIBLE[0] < seen.size_m / (factor * mesh_m) < _PLAUSIBLE[1]:
            continue
        if _is_good(seen.register(factor * corners), limit_m):
            return f"It fits where its numbers are in {other}: write [surface] unit = {other!r}"
    if not _PLAUSIBLE[0] < seen.size_m / mesh_m < _PLAUSIBLE[1]:
        return (
            f"What the camera sees is {seen.size_m:.3g} m large, the mesh {mesh_m:.3g} m: look at [surface] unit, or "
            "let [surface] kind = 'free' measure what there is"
        )
    if _is_good(seen.register(corners, upright=False), limit_m):
        return "It fits another way up: write [surface] up = the file's axis that points up in the room"
    scale, median_m = better_size(seen.points, seen.chosen, corners, found.pose)
    if median_m <= limit_m:
        return f"It fits {scale:.4f} times as large: the file, or a length of [[scale]], is off by that"
    return (
        "It fits in no unit, way up or size: something else is in the room, or more than the file has; "
        "[surface] kind = 'free' measures what there is"
    )


def _remarks(found: Registration, seen: _SeenOfMesh, corners: FloatArray) -> tuple[str, ...]:
    """What a mesh that fits is still to be known by: its size, other places, motions that nothing holds."""
    remarks = []
    scale, now = better_size(seen.points, seen.chosen, corners, found.pose)
    median = float(np.median(np.abs(found.misfit_m)))
    if abs(scale - 1) > _TOLD_SCALE and now < _BETTER * median:
        remarks.append(
            f"it would fit better {scale:.4f} times as large ({1000 * now:.1f} mm instead of "
            f"{1000 * median:.1f} mm at the median): the file, or a length of [[scale]], is off"
        )
    if found.also is not None:
        remarks.append(
            "another place explains what the camera sees as well: which of the two is right shows only on sides that "
            "the camera does not see"
        )
    if found.loosest_m > MOST_MEDIAN * seen.distance_m:
        remarks.append(
            f"{found.loosest} is not held by what the camera sees: corners may be {1000 * found.loosest_m:.0f} mm off"
        )
    return tuple(remarks)


def _record(
    name: str, unit: str, found: Registration, seen: _SeenOfMesh, *, remarks: tuple[str, ...]
) -> RegistrationRecord:
    off = np.abs(found.misfit_m)
    first, second, third = ((row[0], row[1], row[2]) for row in found.pose.rotation.tolist())
    x, y, z = found.pose.translation_m.tolist()
    return RegistrationRecord(
        file=name,
        unit=unit,
        rotation=(first, second, third),
        translation_m=(x, y, z),
        misfit_median_m=float(np.median(off)),
        misfit_p95_m=float(np.quantile(off, 0.95)),
        bias_m=float(np.median(found.misfit_m)),
        sigma_m=seen.sigma_m,
        see_through=found.see_through,
        loosest_m=found.loosest_m,
        loosest=found.loosest,
        remarks=remarks,
    )


def _placed(
    facets: Facets,
    found: Registration,
    profile: Profile,
    size_m: tuple[float, float, float],
    *,
    record: RegistrationRecord,
    chosen: NDArray[np.bool_],
) -> KnownSurface:
    """The mesh in the room: as fine as patches are wanted, without what is the room's own."""
    lighter = simplified(facets, _MOST_FACETS) if facets.n_facets > _MOST_FACETS else facets
    vertices, triangles = within_room(found.pose.to_world(lighter.points), lighter.triangles, size_m, name=record.file)
    vertices, triangles = cut_to_size(vertices, triangles, profile.room.patch_size_m)
    misfit = np.full(chosen.shape, np.nan)
    misfit[chosen] = found.misfit_m
    return KnownSurface(
        vertices_m=vertices,
        triangles=triangles,
        part=smooth_parts(vertices, triangles),
        record=record,
        misfit_m=misfit,
    )
