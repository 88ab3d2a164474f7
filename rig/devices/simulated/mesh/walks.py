"""Light's way from mirror to mirror: rays that go on where they meet something glossy."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rig.devices.simulated.mesh.gloss import frames_of, sampled
from rig.devices.simulated.mesh.scene import FloatArray, IntArray
from rig.devices.simulated.mesh.tracer import RayHits, Tracer

_MOST_LEGS = 24
"""Of a walk; chosen: with a gloss of 0.7 a ten-thousandth is left."""
_LEAST_SHARE = 1e-3
"""Of a ray's light: what is less is not followed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """One leg of n walks that go on: where it lands, and how much of the walk's light goes this way."""

    walk: IntArray
    """(n,) the walk's number."""
    hits: RayHits
    directions: FloatArray
    """(n, 3) of the leg, unit vectors."""
    share: FloatArray
    """(n,) of the walk's light: what glossy reflections before it left."""


def walks(
    tracer: Tracer,
    origins_m: FloatArray,
    directions: FloatArray,
    *,
    share: FloatArray,
    random: np.random.Generator,
) -> Iterator[Leg]:
    """Follow n rays, and on from every glossy facet that they meet; rays that escape are left out.

    Parameters
    ----------
    origins_m, directions
        (n, 3) or (3,); (n, 3) unit vectors.
    share
        (n,) of light at the beginning.
    random
        Chooses where a lobe sends each ray.
    """
    walk = np.arange(len(directions))
    gloss = tracer.scene.gloss
    for _ in range(_MOST_LEGS):
        hits = tracer.hits(origins_m, directions)
        met = ~hits.escaped
        walk, hits, directions, share = walk[met], hits[met], directions[met], share[met]
        yield Leg(walk=walk, hits=hits, directions=directions, share=share)
        going = np.flatnonzero(share * gloss[hits.facet] > _LEAST_SHARE)
        if not len(going):
            return
        walk, hits, share = walk[going], hits[going], share[going]
        directions, weight = reflected(tracer, hits, directions[going], random.uniform(size=(len(going), 2)))
        share = share * gloss[hits.facet] * weight
        origins_m = tracer.lifted_m(hits)
        left = share > 0
        walk, directions, share, origins_m = walk[left], directions[left], share[left], origins_m[left]


def reflected(
    tracer: Tracer, hits: RayHits, directions: FloatArray, chances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where n rays go on from glossy facets, (n, 3), and which share of the gloss goes with them, (n,)."""
    axes = frames_of(tracer.normals_towards(hits))
    outgoing = -np.einsum("nij,nj->ni", axes, directions)
    outgoing[:, 2] = np.maximum(outgoing[:, 2], 1e-6)
    local, weight = sampled(outgoing, tracer.scene.roughness[hits.facet], chances)
    return np.einsum("nij,ni->nj", axes, local), weight
