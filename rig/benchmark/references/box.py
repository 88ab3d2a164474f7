"""Visible shares in the room with a box: many quasi-random segments a pair, each pair once up to symmetry.

The box is convex and stands in the middle of the room's square floor, so eight symmetries map the scene onto
itself and eight times fewer pairs need segments. A segment is stopped where it runs inside the box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from sim.arrays import BoolArray, FloatArray, IntArray
from sim.geometry.scene import Scene

_CLASSIFYING = 1 << 8
"""Segments that tell pairs that the box parts from those that it does not touch."""
_AT_ONCE = 1 << 19
_SEED = 20140501


@dataclass(frozen=True, eq=False)
class VisibleShares:
    """Of the pairs that the box occludes partly."""

    first: IntArray
    """(pairs,) patch; below ``second``."""
    second: IntArray
    share: FloatArray
    """(pairs,) light that passes over the light that would pass without the box."""
    change_rms: float
    """Relative change of the light that passes by the last doubling of the segments: the reference's own error."""


def partly_occluded(scene: Scene, free: FloatArray, segments: int) -> VisibleShares:
    """Visible share of every pair that the box of ``sim.scenes.gridded.room_with_box`` occludes partly.

    Parameters
    ----------
    free : (P, P)
        Form factors without the box in the way.
    segments : int
        A pair, a power of 2.
    """
    first, second = np.nonzero(np.triu(free, 1) > 0)
    key = _orbit(scene, first, second)
    _, representative, member = np.unique(key, return_index=True, return_inverse=True)
    i, j = first[representative], second[representative]
    box = _box(scene)
    share = _shares(scene, box, i, second=j, samples=_samples(_CLASSIFYING))[0]
    parted = np.flatnonzero((share > 0) & (share < 1))
    half, whole = _shares(scene, box, i[parted], second=j[parted], samples=_samples(segments))
    share[parted] = whole
    partly = np.zeros(len(share), dtype=bool)
    partly[parted] = (whole > 0) & (whole < 1)
    weight = free[i[parted], j[parted]]
    change = float(np.linalg.norm((whole - half) * weight) / np.linalg.norm(whole * weight))
    chosen = partly[member]
    return VisibleShares(first[chosen], second[chosen], share[member][chosen], change)


def uncovered_share(scene: Scene) -> FloatArray:
    """(P,) exact share of each patch that the box does not stand on: what its row sum must be."""
    low, high = _box(scene)
    corners = scene.vertices
    below = np.minimum(corners.max(axis=1), high)[:, :2] - np.maximum(corners.min(axis=1), low)[:, :2]
    covered = np.prod(np.maximum(below, 0), axis=1) / scene.areas
    on_the_floor = (np.abs(corners[:, :, 2]).max(axis=1) == 0) & (scene.normals[:, 2] > 0)
    return np.where(on_the_floor, 1 - covered, 1.0)


def _box(scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest corner of the box [m]."""
    corners = np.concatenate([scene.vertices[face.patches] for face in scene.faces if face.name.startswith("box ")])
    return corners.min(axis=(0, 1)), corners.max(axis=(0, 1))


def _orbit(scene: Scene, first: IntArray, second: IntArray) -> IntArray:
    """(pairs,) the same number for pairs that a symmetry of the room maps onto each other."""
    middle = np.array([*(np.ptp(scene.vertices, axis=(0, 1)) / 2)[:2], 0.0])
    place = np.column_stack([scene.centres - middle, scene.normals])
    known = {tuple(row): index for index, row in enumerate(_rounded(place))}
    keys = []
    for swap in (False, True):
        for sign_x in (1, -1):
            for sign_y in (1, -1):
                image = place[:, [1, 0, 2, 4, 3, 5]] if swap else place.copy()
                image = image * np.array([sign_x, sign_y, 1, sign_x, sign_y, 1])
                index = np.array([known[tuple(row)] for row in _rounded(image)])
                a, b = index[first], index[second]
                keys.append(np.minimum(a, b) * scene.n_patches + np.maximum(a, b))
    return np.asarray(np.min(keys, axis=0))


def _rounded(place: FloatArray) -> IntArray:
    return np.rint(place * 1e6).astype(np.intp)


def _samples(count: int) -> FloatArray:
    """(count, 4) places on two patches."""
    sobol = qmc.Sobol(4, scramble=True, rng=np.random.default_rng(_SEED))
    return np.asarray(sobol.random_base2(int(np.log2(count))))


def _shares(
    scene: Scene, box: tuple[FloatArray, FloatArray], first: IntArray, second: IntArray, samples: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(pairs,) visible shares by the first half of the segments, and by all of them."""
    halves = np.zeros((2, 2, len(first)))
    half = len(samples) // 2
    for number, part in enumerate((samples[:half], samples[half:])):
        for some in range(0, len(part), _AT_ONCE):
            block = part[some : some + _AT_ONCE]
            step = max(1, _AT_ONCE // len(block))
            for start in range(0, len(first), step):
                here = slice(start, start + step)
                halves[number, :, here] += _light(scene, box, first[here], second=second[here], samples=block)
    coarse, whole = halves[0], halves.sum(axis=0)
    return coarse[0] / np.maximum(coarse[1], 1e-300), whole[0] / np.maximum(whole[1], 1e-300)


def _light(
    scene: Scene, box: tuple[FloatArray, FloatArray], first: IntArray, second: IntArray, samples: FloatArray
) -> FloatArray:
    """(2, pairs) light along the free segments, and along all."""
    begin, end = _points(scene, first, samples[:, :2]), _points(scene, second, samples[:, 2:])
    along = [b - a for a, b in zip(begin, end, strict=True)]
    squared = along[0] ** 2 + along[1] ** 2 + along[2] ** 2
    leaving = sum(along[k] * scene.normals[first, k, None] for k in range(3))
    arriving = -sum(along[k] * scene.normals[second, k, None] for k in range(3))
    light = np.maximum(leaving, 0) * np.maximum(arriving, 0) / squared**2
    free = ~_enters(begin, along, box)
    return np.stack([(light * free).sum(axis=1), light.sum(axis=1)])


def _points(scene: Scene, patches: IntArray, uv: FloatArray) -> list[FloatArray]:
    corners = scene.vertices[patches]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    return [corners[:, 0, k, None] + u[:, k, None] * uv[:, 0] + v[:, k, None] * uv[:, 1] for k in range(3)]


def _enters(begin: list[FloatArray], along: list[FloatArray], box: tuple[FloatArray, FloatArray]) -> BoolArray:
    """(pairs, segments) whether a segment runs inside the box."""
    enter, leave = np.zeros_like(begin[0]), np.ones_like(begin[0])
    for k in range(3):
        with np.errstate(divide="ignore", invalid="ignore"):
            low, high = (box[0][k] - begin[k]) / along[k], (box[1][k] - begin[k]) / along[k]
        enter = np.maximum(enter, np.minimum(low, high))
        leave = np.minimum(leave, np.maximum(low, high))
    return np.asarray(leave > enter + 1e-9)
