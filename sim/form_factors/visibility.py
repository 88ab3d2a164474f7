"""Which share of two patches sees each other past the occluders: segments between low-discrepancy samples."""

from __future__ import annotations

import numpy as np

from sim.scene import BoolArray, Face, FloatArray, IntArray, Scene

CHUNK = 1 << 19
"""Segments tested at a time, to bound the memory."""


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
    first, second = np.nonzero(np.triu(candidates, 1))
    blocked = np.zeros((len(first), rays_per_pair), dtype=bool)
    samples = _low_discrepancy(rays_per_pair)
    step = max(1, CHUNK // rays_per_pair)
    for occluder in occluders(scene):
        suspects = np.flatnonzero(_may_block(scene, occluder, first, second))
        for start in range(0, len(suspects), step):
            pairs = suspects[start : start + step]
            blocked[pairs] |= _cut(scene, occluder, first[pairs], second[pairs], samples)
    cut = np.flatnonzero(blocked.any(axis=1))
    for start in range(0, len(cut), step):
        pairs = cut[start : start + step]
        facing = _facing(scene, first[pairs], second[pairs], samples)
        share = (facing & ~blocked[pairs]).sum(axis=1) / np.maximum(facing.sum(axis=1), 1)
        fraction[first[pairs], second[pairs]] = fraction[second[pairs], first[pairs]] = share
    return fraction


def occluders(scene: Scene) -> list[Face]:
    """Faces that something of the scene lies behind; the others cannot stand between two patches."""
    corners = scene.vertices.reshape(-1, 3)
    size = float(np.ptp(corners, axis=0).max())
    behind = [(corners - face.origin_m) @ face.normal < -1e-9 * size for face in scene.faces]
    return [face for face, some in zip(scene.faces, behind, strict=True) if some.any()]


def _may_block(scene: Scene, face: Face, first: IntArray, second: IntArray) -> BoolArray:
    """Pairs on both sides of the face's plane whose common bounding box meets the face's."""
    height = (scene.vertices - face.origin_m) @ face.normal
    above, below = height.max(axis=1) > 1e-9, height.min(axis=1) < -1e-9
    parted = (above[first] & below[second]) | (below[first] & above[second])
    low, high = scene.vertices.min(axis=1), scene.vertices.max(axis=1)
    corners = face.points([0, 1, 1, 0], [0, 0, 1, 1])
    near = (np.minimum(low[first], low[second]) <= corners.max(axis=0)).all(axis=1)
    near &= (np.maximum(high[first], high[second]) >= corners.min(axis=0)).all(axis=1)
    return np.asarray(parted & near)


def _cut(scene: Scene, face: Face, first: IntArray, second: IntArray, samples: FloatArray) -> BoolArray:
    """(pairs, rays) bool: the segment passes through the face."""
    begin, end = _points(scene, first, samples[:, :2]), _points(scene, second, samples[:, 2:])
    height_begin, height_end = ((p - face.origin_m) @ face.normal for p in (begin, end))
    crosses = height_begin * height_end < 0
    at = height_begin / np.where(crosses, height_begin - height_end, 1.0)
    meets = begin + at[..., None] * (end - begin) - face.origin_m
    u, v = (meets @ face.axes[axis] / face.size_m[axis] for axis in (0, 1))
    return np.asarray(crosses & (u > 0) & (u < 1) & (v > 0) & (v < 1))


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
