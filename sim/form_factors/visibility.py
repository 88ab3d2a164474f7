"""The visible share of two patches by segments between low-discrepancy samples: the readable reference.

``sim.form_factors.occlusion`` finds the same numbers by clipping, thousands of times faster.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import BoolArray, FloatArray, IntArray
from sim.geometry.rays import low_discrepancy
from sim.geometry.surface import Surface

CHUNK = 1 << 16
"""Segments tested at a time: their arrays stay in the processor's cache."""
COPLANAR = 1e-7
"""A patch this close to an occluder's plane, in sizes of the scene, lies on it and is not shaded by it."""


def visible_fraction_by_rays(surface: Surface, candidates: BoolArray, rays_per_pair: int = 64) -> FloatArray:
    """Return the share of the light between two patches that no occluder stops; symmetric and deterministic.

    Parameters
    ----------
    surface : Surface
    candidates : (P, P) bool array
        Pairs worth a look (those with a form factor); the others keep 1.
    rays_per_pair : int
        Segments between two patches.

    Returns
    -------
    (P, P) array
        In [0, 1].
    """
    fraction = np.ones((surface.n_patches, surface.n_patches))
    if len(surface.occluders):
        first, second = np.nonzero(np.triu(candidates, 1))
        share = visible_fraction_of_pairs_by_rays(surface, first, second, rays_per_pair)
        fraction[first, second] = fraction[second, first] = share
    return fraction


def visible_fraction_of_pairs_by_rays(
    surface: Surface, first: IntArray, second: IntArray, rays_per_pair: int = 64
) -> FloatArray:
    """Return (n,) the share of the light between listed pairs: each segment counts cos cos' / r², 0 behind a patch."""
    size = float(np.linalg.norm(np.ptp(surface.vertices.reshape(-1, 3), axis=0)))
    frames = [_Frame.of(surface, corners, COPLANAR * size) for corners in surface.occluders]
    share = np.ones(len(first))
    suspects = np.array([frame.may_block(first, second) for frame in frames]).reshape(len(frames), len(first))
    parted = np.flatnonzero(suspects.any(axis=0))
    samples = low_discrepancy(rays_per_pair)
    step = max(1, CHUNK // rays_per_pair)
    for start in range(0, len(parted), step):
        here = parted[start : start + step]
        begin = _points(surface, first[here], samples[:, :2])
        end = _points(surface, second[here], samples[:, 2:])
        blocked = np.zeros(begin.shape[:2], dtype=bool)
        for frame, some in zip(frames, suspects[:, here], strict=True):
            blocked[some] |= frame.cuts(begin[some], end[some])
        weight = _weight(end - begin, surface.normals[first[here]], surface.normals[second[here]])
        total = weight.sum(axis=1)
        # The ratio is exactly 1 where nothing is blocked: 1 - blocked, never visible / total.
        share[here] = 1 - np.where(blocked, weight, 0.0).sum(axis=1) / np.where(total > 0, total, 1.0)
    return np.clip(share, 0.0, 1.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Frame:
    """An occluder's plane and edges, and where the patches lie to them."""

    normal: FloatArray
    corner: FloatArray
    """(3,) one of its corners [m]."""
    edges: FloatArray
    """(E, 3) normals of its edges in its plane, inwards."""
    edge_offsets: FloatArray
    """(E,) each edge's normal times a point on it."""
    touch: float
    """Heights below this count as none [m]."""
    above: BoolArray
    """(P,) some of the patch lies on the normal's side."""
    below: BoolArray
    outside: BoolArray
    """(E, P) the whole patch lies outside an edge."""

    @classmethod
    def of(cls, surface: Surface, corners: FloatArray, touch: float) -> _Frame:
        following = np.roll(corners, -1, axis=0)
        normal = np.cross(corners[2] - corners[0], corners[3] - corners[1])
        normal = normal / np.linalg.norm(normal)
        edges = np.cross(normal, following - corners)[np.any(following != corners, axis=1)]
        offsets = (edges * corners[np.any(following != corners, axis=1)]).sum(axis=1)
        heights = (surface.vertices - corners[0]) @ normal
        outside = (surface.vertices @ edges.T <= offsets).all(axis=1).T
        above, below = (heights > touch).any(axis=1), (heights < -touch).any(axis=1)
        return cls(
            normal=normal,
            corner=corners[0],
            edges=edges,
            edge_offsets=offsets,
            touch=touch,
            above=above,
            below=below,
            outside=outside,
        )

    def may_block(self, first: IntArray, second: IntArray) -> BoolArray:
        """Pairs on both sides of the plane that no edge leaves outside together."""
        parted = (self.above[first] & self.below[second]) | (self.below[first] & self.above[second])
        return np.asarray(parted & ~(self.outside[:, first] & self.outside[:, second]).any(axis=0))

    def cuts(self, begin: FloatArray, end: FloatArray) -> BoolArray:
        """(pairs, rays) bool: the segment passes through the occluder."""
        before, after = (begin - self.corner) @ self.normal, (end - self.corner) @ self.normal
        crosses = (before * after < 0) & (np.minimum(np.abs(before), np.abs(after)) > self.touch)
        share = before / np.where(crosses, before - after, 1.0)
        place = begin + share[..., None] * (end - begin)
        return np.asarray(crosses & (place @ self.edges.T >= self.edge_offsets).all(axis=-1))


def _weight(along: FloatArray, normals_first: FloatArray, normals_second: FloatArray) -> FloatArray:
    """(pairs, rays) cos cos' / r² of segments (pairs, rays, 3), 0 where an end lies behind the other's plane."""
    leaves = np.einsum("prk,pk->pr", along, normals_first)
    arrives = -np.einsum("prk,pk->pr", along, normals_second)
    squared = np.maximum((along**2).sum(axis=-1), 1e-300)
    return np.asarray(np.maximum(leaves, 0) * np.maximum(arrives, 0) / squared**2)


def _points(surface: Surface, patches: IntArray, uv: FloatArray) -> FloatArray:
    """(pairs, rays, 3) the samples on the patches, evenly spread: over a quad's two halves by their areas [m]."""
    corners = surface.vertices[patches]
    diagonal = corners[:, 2] - corners[:, 0]
    halves = np.stack(
        [np.cross(corners[:, 1] - corners[:, 0], diagonal), np.cross(diagonal, corners[:, 3] - corners[:, 0])]
    )
    areas = np.linalg.norm(halves, axis=-1)
    share = (areas[0] / areas.sum(axis=0))[:, None]
    in_first = uv[:, 0] < share
    stretched = np.where(in_first, uv[:, 0] / share, (uv[:, 0] - share) / np.maximum(1 - share, 1e-300))
    # (root, uv[1]) of a square fills a triangle evenly (Turk 1990).
    root = np.sqrt(stretched)[..., None]
    across = uv[:, 1:]
    apex, base = corners[:, None, 0], np.where(in_first[..., None], corners[:, None, 1], corners[:, None, 2])
    far = np.where(in_first[..., None], corners[:, None, 2], corners[:, None, 3])
    return np.asarray(apex + root * ((1 - across) * (base - apex) + across * (far - apex)))
