"""Which share of two patches sees each other past the occluders: segments between low-discrepancy samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.scene import BoolArray, Face, FloatArray, IntArray, Scene

CHUNK = 1 << 16
"""Segments tested at a time: their arrays stay in the processor's cache."""


def visible_fraction(scene: Scene, candidates: BoolArray, rays_per_pair: int = 64) -> FloatArray:
    """Share of the segments between two patches that no face cuts; symmetric and deterministic.

    Parameters
    ----------
    scene : Scene
    candidates : (P, P) bool
        Pairs worth a look (those with a form factor); the others keep 1.
    rays_per_pair : int

    Returns
    -------
    (P, P) in [0, 1].
    """
    fraction = np.ones((scene.n_patches, scene.n_patches))
    samples = _low_discrepancy(rays_per_pair)
    frames = [_Frame.of(scene, occluder) for occluder in occluders(scene)]
    first, second = np.nonzero(np.triu(candidates, 1))
    suspects = [frame.may_block(first, second) for frame in frames]
    if not frames:
        return fraction
    parted = np.flatnonzero(np.logical_or.reduce(suspects))
    first, second = first[parted], second[parted]
    suspects = [some[parted] for some in suspects]
    step = max(1, CHUNK // rays_per_pair)
    for start in range(0, len(first), step):
        here = slice(start, start + step)
        share = _share(scene, frames, [some[here] for some in suspects], first[here], second[here], samples)
        fraction[first[here], second[here]] = fraction[second[here], first[here]] = share
    return fraction


def _share(
    scene: Scene,
    frames: list[_Frame],
    suspects: list[BoolArray],
    first: IntArray,
    second: IntArray,
    samples: FloatArray,
) -> FloatArray:
    """(pairs,) visible share of the segments whose ends lie before each other's plane."""
    blocked = np.zeros((len(first), len(samples)), dtype=bool)
    for frame, some in zip(frames, suspects, strict=True):
        pairs = np.flatnonzero(some)
        blocked[pairs] |= frame.cuts(first[pairs], second[pairs], samples)
    share = np.ones(len(first))
    cut = np.flatnonzero(blocked.any(axis=1))
    facing = _facing(scene, first[cut], second[cut], samples)
    share[cut] = (facing & ~blocked[cut]).sum(axis=1) / np.maximum(facing.sum(axis=1), 1)
    return share


def occluders(scene: Scene) -> list[Face]:
    """Faces that something of the scene lies behind; the others cannot stand between two patches."""
    corners = scene.vertices.reshape(-1, 3)
    size = float(np.ptp(corners, axis=0).max())
    behind = [(corners - face.origin_m) @ face.normal < -1e-9 * size for face in scene.faces]
    return [face for face, some in zip(scene.faces, behind, strict=True) if some.any()]


@dataclass(frozen=True, eq=False)
class _Frame:
    """All patches in an occluder's coordinates: height over its plane, and its u and v in [0, 1]."""

    height: FloatArray
    """(3, P): at the patch's first corner, and how much more along its u and its v edge."""
    u: FloatArray
    v: FloatArray

    @classmethod
    def of(cls, scene: Scene, face: Face) -> _Frame:
        corner = scene.vertices[:, 0] - face.origin_m
        edges = [scene.vertices[:, k] - scene.vertices[:, 0] for k in (1, 3)]
        along = [face.normal, face.axes[0] / face.size_m[0], face.axes[1] / face.size_m[1]]
        return cls(*(np.stack([part @ axis for part in (corner, *edges)]) for axis in along))

    def may_block(self, first: IntArray, second: IntArray) -> BoolArray:
        """Pairs on both sides of the plane whose common extent along u and v meets the face."""
        low, high = _extent(self.height)
        above, below = high > 1e-9, low < -1e-9
        possible = (above[first] & below[second]) | (below[first] & above[second])
        for axis in (self.u, self.v):
            low, high = _extent(axis)
            possible &= np.minimum(low[first], low[second]) < 1
            possible &= np.maximum(high[first], high[second]) > 0
        return np.asarray(possible)

    def cuts(self, first: IntArray, second: IntArray, samples: FloatArray) -> BoolArray:
        """(pairs, rays) bool: the segment passes through the face."""
        begin, end = (_at(self.height, *side) for side in ((first, samples[:, :2]), (second, samples[:, 2:])))
        crosses = begin * end < 0
        share = begin / np.where(crosses, begin - end, 1.0)
        for axis in (self.u, self.v):
            begin, end = _at(axis, first, samples[:, :2]), _at(axis, second, samples[:, 2:])
            place = begin + share * (end - begin)
            crosses &= (place > 0) & (place < 1)
        return np.asarray(crosses)


def _at(coordinate: FloatArray, patches: IntArray, uv: FloatArray) -> FloatArray:
    """(pairs, rays) a coordinate, linear on each patch, at samples of the patches."""
    corner, along_u, along_v = coordinate[:, patches, None]
    return np.asarray(corner + along_u * uv[:, 0] + along_v * uv[:, 1])


def _extent(coordinate: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest value of a coordinate on each patch."""
    corner, along_u, along_v = coordinate
    low = corner + np.minimum(along_u, 0) + np.minimum(along_v, 0)
    return low, corner + np.maximum(along_u, 0) + np.maximum(along_v, 0)


def _facing(scene: Scene, first: IntArray, second: IntArray, samples: FloatArray) -> BoolArray:
    """(pairs, rays) bool: both ends lie before the other's plane; the form factor counts no other light."""
    begin, end = _points(scene, first, samples[:, :2]), _points(scene, second, samples[:, 2:])
    along = end - begin
    leaves = np.einsum("prk,pk->pr", along, scene.normals[first]) > 0
    return np.asarray(leaves & (np.einsum("prk,pk->pr", along, scene.normals[second]) < 0))


def _points(scene: Scene, patches: IntArray, uv: FloatArray) -> FloatArray:
    """(pairs, rays, 3) the samples on the patches [m]."""
    corners = scene.vertices[patches]
    edge_u, edge_v = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    return np.asarray(corners[:, None, 0] + uv[:, :1] * edge_u[:, None] + uv[:, 1:] * edge_v[:, None])


def _low_discrepancy(n: int) -> FloatArray:
    """(n, 4) points of the additive sequence of the generalised golden ratio of four dimensions."""
    ratio = 1.0
    for _ in range(64):
        ratio = (1 + ratio) ** (1 / 5)
    steps = ratio ** -np.arange(1.0, 5.0)
    return np.asarray((0.5 + np.outer(np.arange(1, n + 1), steps)) % 1.0)
