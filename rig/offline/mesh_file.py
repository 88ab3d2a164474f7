"""A mesh file made ready for ``rig simulate``: read, mended or refused, what was found in words and in a file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.offline.records import MeshRemark, MeshSummary
from rig.terminal import OnStep
from sim.errors import SimulationError
from sim.geometry.mending.mend import MendedMesh, Sides, cleaned_facets, facets_of, mended, oriented_facets
from sim.geometry.mending.remarks import DamagedMesh, Facets, Outcome, Remark
from sim.planning.simplified_plan import SimplifiedPlan

if TYPE_CHECKING:
    from rig.files.mesh import TriangleSoup, Unit, UpAxis

SOUND = 200, 200, 200
COLOURS: dict[Outcome, tuple[int, int, int]] = {
    "note": (60, 110, 230),
    "mended": (240, 150, 20),
    "refused": (220, 30, 30),
}
"""Of facets in the file of faults; what comes later overrules what comes before."""
WHAT_COLOURS_MEAN = "red: refused, orange: mended, blue: worth a look, grey: nothing found"


@dataclass(frozen=True, kw_only=True)
class MeshOptions:
    """How a mesh file is read and what may be done to it."""

    unit: Unit | None = None
    """Of its numbers; None: metres, and a size that no room has is asked about."""
    up: UpAxis | None = None
    """The file's axis that points up; None: y for glTF, else z."""
    sides: Sides = "judged"
    """Which sides of facets are lit."""
    merge_mm: float | None = None
    """Corners of open borders that are nearer become one; None: 1e-5 of the scene's size."""
    faults: Path | None = None
    """PLY file to write: all facets, coloured by what was found."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MeshFile:
    """Facets of a file, cleaned, and how they were read."""

    path: Path
    options: MeshOptions
    up: UpAxis
    soup: TriangleSoup
    """As the reader gave it."""
    file_corners: NDArray[np.float64]
    """(T, 3, 3) triangles as the reader gave them [m]."""
    facets: Facets
    cleaned: tuple[Remark, ...]

    def mend(self, facets: Facets) -> MendedMesh:
        """Return the mesh of the file's facets, or of fewer that stand for them.

        Raises
        ------
        UsageError
            If it cannot be mended; the faulty facets are in the file of faults, if one was asked for.
        """
        unit, given = self.options.unit or "m", self.options.unit is not None
        sides = self.options.sides
        try:
            return mended(self.path.stem, facets, sides=sides, up=self.up, unit=unit, unit_given=given)
        except DamagedMesh as error:
            raise self.refused(error) from error

    def oriented(self, facets: Facets) -> Facets:
        """Return facets with the sides lit that :meth:`mend` lights. Raises UsageError as it does."""
        try:
            return oriented_facets(self.path.stem, facets, self.options.sides)
        except DamagedMesh as error:
            raise self.refused(error) from error

    def summary(self, chosen: SimplifiedPlan) -> MeshSummary:
        """Return what is to be said of the file and its plan; write the file of faults, if one was asked for."""
        remarks = (*self.cleaned, *chosen.mesh.remarks)
        write_faults(self.options.faults, self.file_corners, remarks)
        error = chosen.error
        return MeshSummary(
            file_facets=len(self.file_corners),
            facets=chosen.mesh.mesh.n_patches,
            remarks=as_records(remarks),
            simplified_within_m=None if error is None else error.distance_m,
            faults=self.options.faults,
        )

    def refused(self, error: DamagedMesh) -> UsageError:
        """Return the refusal in the user's words, the faults written where they were asked for."""
        remarks = (*self.cleaned, *error.remarks)
        written = write_faults(self.options.faults, self.file_corners, remarks)
        advice = f"\n{written}" if written else "\n--faults FILE.ply writes the facets in colours, to look at"
        unit = self.options.unit or "m"
        return UsageError(f"{self.path} (read as {unit}): {error}{advice if remarks else ''}")


def open_mesh_file(path: Path, options: MeshOptions, reflectance: float | None, on_step: OnStep) -> MeshFile:
    """Read a file and free it of what no mesh needs.

    Parameters
    ----------
    path
        OBJ, PLY, STL, glTF or GLB.
    options
        How to read it.
    reflectance
        Of facets without a colour; None: each needs one.
    on_step
        Told how far it is.

    Raises
    ------
    UsageError
        If the file cannot be read, or not be mended.
    """
    from rig.files.mesh import read_triangles, reflectances_of_soup, standard_up

    if options.faults is not None and options.faults.suffix.lower() != ".ply":
        raise UsageError(f"--faults {options.faults}: it is written as PLY; give a name that ends in .ply")
    if options.merge_mm is not None and not 0 <= options.merge_mm < np.inf:
        raise UsageError(f"--merge-mm {options.merge_mm:g}; give a distance of 0 or more, and finite")
    on_step("read the mesh", 0, 1)
    up = options.up or standard_up(path)
    soup = read_triangles(path, unit=options.unit or "m", up=up)
    rho = reflectances_of_soup(path, soup, reflectance)
    merge_m = None if options.merge_mm is None else options.merge_mm / 1e3
    try:
        facets = facets_of(soup.points, soup.triangles, rho)
    except SimulationError as error:
        raise UsageError(f"{path}: {error}") from error
    corners = facets.corners
    made = MeshFile(path=path, options=options, up=up, soup=soup, file_corners=corners, facets=facets, cleaned=())
    try:
        left, remarks = cleaned_facets(path.stem, facets, merge_m)
    except DamagedMesh as error:
        raise made.refused(error) from error
    on_step("read the mesh", 1, 1)
    return replace(made, facets=left, cleaned=remarks)


def write_faults(path: Path | None, corners: NDArray[np.float64], remarks: tuple[Remark, ...]) -> str:
    """Write all (T, 3, 3) triangles of a file, coloured by what was found; return a sentence about it."""
    if path is None:
        return ""
    from rig.files.ply_mesh import write_ply_mesh

    colours = np.tile(np.array(SOUND, dtype=np.uint8), (len(corners), 1))
    for outcome, colour in COLOURS.items():
        for remark in remarks:
            if remark.outcome == outcome:
                colours[remark.facets] = colour
    drawn = np.isfinite(corners).all(axis=(1, 2))
    write_ply_mesh(path, corners[drawn], colours[drawn], [WHAT_COLOURS_MEAN, *map(str, remarks)])
    return f"{path}: the facets in colours ({WHAT_COLOURS_MEAN})"


def as_records(remarks: tuple[Remark, ...]) -> tuple[MeshRemark, ...]:
    """Return remarks as they stand in the JSON."""
    return tuple(
        MeshRemark(kind=one.kind, outcome=one.outcome, message=one.message, facets=len(one.facets)) for one in remarks
    )
