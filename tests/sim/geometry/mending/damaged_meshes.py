"""Meshes damaged as files are: by seed, with what the answer to each must say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.scenes.cluttered import random_corner
from sim.scenes.meshes import icosphere

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Rng = np.random.Generator


@dataclass(frozen=True, eq=False)
class Damaged:
    name: str
    points: Floats
    triangles: Ints
    says: frozenset[str]
    """Kinds of which the answer must name one; empty: it may say nothing."""


def soup_of(triangles: Floats) -> tuple[Floats, Ints]:
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def box(size: tuple[float, float, float], place: tuple[float, float, float] = (0, 0, 0), cuts: int = 1) -> Floats:
    """(12 cuts², 3, 3) triangles of a box, lit on the inside."""
    found = []
    steps = np.arange(cuts) / cuts
    for axis in range(3):
        u, v = np.eye(3)[(axis + 1) % 3] / cuts, np.eye(3)[(axis + 2) % 3] / cuts
        for s in steps:
            for t in steps:
                corner = np.eye(3)[(axis + 1) % 3] * s + np.eye(3)[(axis + 2) % 3] * t
                a, b, c, d = corner, corner + u, corner + u + v, corner + v
                found += [(a, b, c), (a, c, d)]
                found += [np.add((a, c, b), np.eye(3)[axis]), np.add((a, d, c), np.eye(3)[axis])]
    return np.array(found) * size + place


def ball(rng: Rng, level: int = 2) -> Floats:
    return icosphere(level)[:, :3] * rng.uniform(0.3, 0.8) + rng.uniform(1, 2, 3)


def furnished(rng: Rng) -> Floats:
    return np.concatenate([box((4, 3, 2.5), cuts=int(rng.integers(1, 4))), ball(rng, int(rng.integers(1, 3)))])


def dome(rng: Rng) -> Floats:
    """Half a ball on a disc, its coordinates rounded to 4 decimals."""
    sphere = icosphere(2)[:, [0, 2, 1]]
    upper = sphere[sphere.mean(axis=1)[:, 2] > 0]
    return np.round(upper * 2.0 + rng.uniform(0, 1, 3), 4)


def corner(rng: Rng) -> Floats:
    patches = random_corner(int(rng.integers(1000)), 600).vertices
    three = (patches[:, 2] == patches[:, 3]).all(axis=1)
    return np.concatenate([patches[:, :3], patches[~three][:, [2, 3, 0]]])


def random_soup(rng: Rng) -> Floats:
    centres = rng.uniform(0, 3, (int(rng.integers(50, 600)), 1, 3))
    return centres + rng.normal(size=(len(centres), 3, 3)) * 10 ** rng.uniform(-2, 0)


def twisted_strip(rng: Rng) -> Floats:
    n = 40
    angle = np.linspace(0, 2 * np.pi, n + 1)
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    across = np.stack([np.cos(angle) * np.cos(angle / 2), np.sin(angle) * np.cos(angle / 2), np.sin(angle / 2)], axis=1)
    low, high = rim - 0.2 * across, rim + 0.2 * across
    low[-1], high[-1] = high[0], low[0]
    quads = np.stack([low[:-1], high[:-1], high[1:], low[1:]], axis=1) + rng.uniform(0, 1, 3)
    return np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


def fan(rng: Rng) -> Floats:
    """Pages of a book: many facets on one edge, within a room."""
    angle = np.sort(rng.uniform(0, np.pi, 30))
    tip = np.stack([2 + np.cos(angle), 1.5 + np.sin(angle), 1 + 0 * angle], axis=1)
    low, high = np.broadcast_to((2, 1.5, 0.5), tip.shape), np.broadcast_to((2, 1.5, 1.5), tip.shape)
    return np.concatenate([box((4, 3, 2.5)), np.stack([low, high, tip], axis=1)])


BASES: dict[str, Callable[[Rng], Floats]] = {
    "furnished": furnished,
    "dome": dome,
    "corner": corner,
    "soup": random_soup,
    "strip": twisted_strip,
    "fan": fan,
}
BASE_SAYS = {"strip": {"one-sided", "non-manifold"}, "fan": {"non-manifold"}, "soup": {"open"}, "dome": {"open"}}


def _some(rng: Rng, triangles: Floats, share: float = 0.05) -> Ints:
    return rng.choice(len(triangles), max(1, int(share * len(triangles))), replace=False)


def cracked(rng: Rng, t: Floats) -> Floats:
    """Each triangle's corners a few micrometres off its neighbours'."""
    return t + rng.uniform(-1, 1, t.shape) * 10 ** rng.uniform(-6.3, -5.3)


def torn(rng: Rng, t: Floats) -> Floats:
    """Gaps that no tolerance closes."""
    return t + rng.uniform(-1, 1, t.shape) * 1e-3


def holed(rng: Rng, t: Floats) -> Floats:
    return np.delete(t, _some(rng, t, 0.1), axis=0)


def flipped(rng: Rng, t: Floats) -> Floats:
    t = t.copy()
    which = _some(rng, t, 0.2)
    t[which] = t[which][:, ::-1]
    return t


def doubled(rng: Rng, t: Floats) -> Floats:
    return np.concatenate([t, t[_some(rng, t)]])


def second_sides(rng: Rng, t: Floats) -> Floats:
    return np.concatenate([t, t[_some(rng, t)][:, ::-1]])


def without_area(rng: Rng, t: Floats) -> Floats:
    a, b = t[_some(rng, t)][:, 0], t[_some(rng, t)][:, 1]
    return np.concatenate([t, np.stack([a, b, (a + b) / 2], axis=1), np.stack([a, a, b], axis=1)])


def needles(rng: Rng, t: Floats) -> Floats:
    """Slivers 1 : 1000 somewhere in the scene."""
    a = rng.uniform(0.5, 1.5, (5, 3))
    along, across = rng.normal(size=(2, 5, 3))
    return np.concatenate([t, np.stack([a, a + along, a + along / 2 + 1e-3 * across], axis=1)])


def dust(rng: Rng, t: Floats) -> Floats:
    """Facets of a square millimetre beside ones of square metres, and some smaller than a corner."""
    a = rng.uniform(0.5, 1.5, (6, 1, 3))
    size = np.array([1e-3, 1e-3, 1e-3, 1e-9, 1e-8, 1e-9]).reshape(-1, 1, 1)
    return np.concatenate([t, a + size * rng.normal(size=(6, 3, 3))])


def nowhere(rng: Rng, t: Floats) -> Floats:
    t = t.copy()
    t[rng.integers(len(t)), 1, 2] = rng.choice([np.nan, np.inf, -np.inf])
    return t


def astray(rng: Rng, t: Floats) -> Floats:
    t = t.copy()
    t[rng.integers(len(t)), 0] = 10 ** rng.uniform(4, 30, 3)
    return t


def pierced(rng: Rng, t: Floats) -> Floats:
    return np.concatenate([t, box((1, 1, 1), (1.2, 1.1, -0.3))[:, ::-1], box((1, 1, 1), (1.7, 1.5, 0.1))[:, ::-1]])


def covered(rng: Rng, t: Floats) -> Floats:
    """A second, other cut of a large facet's plane."""
    sound = t[np.isfinite(t).all(axis=(1, 2))]
    a, b, c = sound[np.argmax(np.linalg.norm(np.cross(sound[:, 1] - sound[:, 0], sound[:, 2] - sound[:, 0]), axis=1))]
    return np.concatenate([t, [[a, b, (a + 3 * c) / 4]]])


def inside_out(rng: Rng, t: Floats) -> Floats:
    return t[:, ::-1]


def huge(rng: Rng, t: Floats) -> Floats:
    return t * 1e4


def minute(rng: Rng, t: Floats) -> Floats:
    return t * 1e-4


def rounded(rng: Rng, t: Floats) -> Floats:
    return np.round(t, 2)


DAMAGES: dict[Callable[[Rng, Floats], Floats], set[str]] = {
    cracked: {"near miss", "open"},
    torn: {"open"},
    holed: {"open"},
    flipped: {"inverted", "inside out", "open", "non-manifold"},
    doubled: {"duplicate"},
    second_sides: set(),
    without_area: {"degenerate"},
    needles: {"open"},
    dust: {"tiny", "degenerate"},
    nowhere: {"not finite"},
    astray: {"astray"},
    pierced: {"intersecting", "overlapping"},
    covered: {"overlapping"},
    inside_out: set(),
    huge: {"scale"},
    minute: {"scale"},
    rounded: set(),
}


def damaged(seed: int) -> Damaged:
    """Return the mesh of a seed: a base, and up to three damages."""
    rng = np.random.default_rng(seed)
    base = list(BASES)[seed % len(BASES)]
    kinds = list(DAMAGES)
    chosen = [kinds[(seed // len(BASES)) % len(kinds)]]
    chosen += [kinds[i] for i in rng.choice(len(kinds), int(rng.integers(0, 3)), replace=False)]
    triangles = BASES[base](rng)
    for damage in sorted(set(chosen), key=kinds.index):
        triangles = damage(rng, triangles)
    says = set(BASE_SAYS.get(base, set())) | set().union(*(DAMAGES[damage] for damage in chosen))
    points, corners = soup_of(triangles)
    return Damaged("-".join([base, *(one.__name__ for one in chosen)]), points, corners, frozenset(says))
