"""What form factors, solvers and images need to know of a scene: flat patches, whoever made them."""

from __future__ import annotations

from typing import Protocol

from sim.arrays import FloatArray, IntArray


class Surface(Protocol):
    """Flat convex patches of three or four corners with a diffuse reflectance each.

    ``sim.geometry.scene.Scene`` (gridded rectangles) and ``sim.geometry.mesh.Mesh`` (triangles and quads) are surfaces.
    """

    @property
    def name(self) -> str:
        """What messages call it."""
        ...

    @property
    def n_patches(self) -> int:
        """Number of patches, P."""
        ...

    @property
    def vertices(self) -> FloatArray:
        """(P, 4, 3) corners, counter-clockwise seen from the lit side; a triangle repeats its last [m]."""
        ...

    @property
    def centres(self) -> FloatArray:
        """(P, 3) centroids [m]."""
        ...

    @property
    def normals(self) -> FloatArray:
        """(P, 3) unit normals, to the lit side."""
        ...

    @property
    def areas(self) -> FloatArray:
        """(P,) areas [m²]."""
        ...

    @property
    def reflectance(self) -> FloatArray:
        """(P,) share of the light that a patch sends back, in [0, 1]."""
        ...

    @property
    def convex(self) -> bool:
        """True if every two points on the patches' lit sides see each other: nothing can stand between."""
        ...

    @property
    def closed(self) -> bool:
        """True if no light can leave: every patch's form factors sum to 1."""
        ...

    @property
    def occluders(self) -> FloatArray:
        """(M, 4, 3) flat convex polygons that may stand between two patches; both sides stop light [m]."""
        ...

    @property
    def region(self) -> IntArray:
        """(P,) number of the flat region (a scene's face) that each patch lies on: light is smooth within."""
        ...
