"""What was found of a mesh and what became of it, in words and by facet."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sim.arrays import BoolArray, FloatArray, IntArray
from sim.errors import SimulationError

Outcome = Literal["mended", "note", "refused"]
NAMED = 5
"""How many facets a message names."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Remark:
    """One kind of thing that was found."""

    kind: str
    outcome: Outcome
    """``mended`` and ``note``: the light is computed; ``refused``: it is not."""
    message: str
    facets: IntArray
    """(N,) numbers of the file's triangles that it is about, as the reader cut them."""

    def __str__(self) -> str:
        return f"{self.kind}: {self.message}"


class DamagedMesh(SimulationError):
    """A mesh that cannot be mended; ``remarks`` hold the facets."""

    def __init__(self, message: str, remarks: tuple[Remark, ...]) -> None:
        super().__init__(message)
        self.remarks = remarks


@dataclass(frozen=True, eq=False, kw_only=True)
class Facets:
    """Triangles and where they came from."""

    points: FloatArray
    """(V, 3) corners [m]."""
    triangles: IntArray
    """(T, 3) into points, counter-clockwise seen from the lit side."""
    reflectance: FloatArray
    """(T,)."""
    source: IntArray
    """(T,) number of the file's triangle that each was."""

    @property
    def n_facets(self) -> int:
        """Number of triangles, T."""
        return len(self.triangles)

    @property
    def corners(self) -> FloatArray:
        """(T, 3, 3) corners [m]."""
        return np.asarray(self.points[self.triangles])

    @property
    def patches(self) -> FloatArray:
        """(T, 4, 3) corners, the last repeated [m]."""
        return np.asarray(self.points[self.triangles[:, [0, 1, 2, 2]]])

    @property
    def finite(self) -> BoolArray:
        """(T,) facets of which all corners are numbers."""
        return np.asarray(np.isfinite(self.corners).all(axis=(1, 2)))

    @property
    def areas(self) -> FloatArray:
        """(T,) areas [m²]."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)

    def chosen(self, which: IntArray) -> Facets:
        """Return some of them, in another order perhaps."""
        return Facets(
            points=self.points,
            triangles=self.triangles[which],
            reflectance=self.reflectance[which],
            source=self.source[which],
        )

    def turned(self, which: IntArray) -> Facets:
        """Return the same with some facets' other side lit."""
        triangles = self.triangles.copy()
        triangles[which] = triangles[which][:, ::-1]
        return Facets(points=self.points, triangles=triangles, reflectance=self.reflectance, source=self.source)


def named(facets: Facets, which: Iterable[int]) -> str:
    """Return number and place of the first of some facets."""
    chosen = np.asarray(list(which), dtype=np.intp)
    words = []
    for i in chosen[:NAMED]:
        place = ", ".join(f"{x:.4g}" for x in facets.points[facets.triangles[i, 0]])
        words.append(f"{facets.source[i]} at ({place}) m")
    more = [f"and {len(chosen) - NAMED:,} more"] if len(chosen) > NAMED else []
    return "; ".join(words + more)


def counted(number: int, word: str = "facet") -> str:
    """Return ``1 facet``, ``2 facets``."""
    return f"{number:,} {word}{'' if number == 1 else 's'}"
