"""The glossy lobe: GGX microfacets without colour, its value, its directions, and the share of light that it keeps.

Directions are in a frame whose third axis is the surface's normal, and point away from the surface. f_s(ω, ω') is
reciprocal, and ∫ f_s(ω, ω') cos θ' dω' = a(cos θ) ≤ 1: light that microfacets would send on to each other is lost.

References
----------
Walter, Marschner, Li and Torrance, Microfacet models for refraction through rough surfaces, EGSR 2007; equations 20,
23, 33 and 34: the lobe.
Dupuy and Benyoub, Sampling visible GGX normals with spherical caps, Computer Graphics Forum 42(8), 2023: where it
sends light.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from sim.arrays import FloatArray

LEAST_ROUGHNESS = 1e-3
"""Of a lobe; below, a highlight is narrower than a tenth of a degree and is a mirror image to every camera."""
_COSINES, _ROUGHNESSES, _POINTS = 65, 33, 1024
"""Of the table of albedos: nodes, and directions at each of them."""
_GOLDEN = (np.sqrt(5) - 1) / 2
_LEAST_COSINE = 1e-6


def lobe(incoming: FloatArray, outgoing: FloatArray, roughness: FloatArray) -> FloatArray:
    """Return the lobe f_s of unit gloss.

    Parameters
    ----------
    incoming, outgoing : (N, 3) array
        Unit directions.
    roughness : (N,) array
        The distribution's alpha.

    Returns
    -------
    (N,) array
        0 where either direction is below the surface. [1/sr]
    """
    half = incoming + outgoing
    half = half / np.maximum(np.linalg.norm(half, axis=1, keepdims=True), np.finfo(float).tiny)
    density = _density(half[:, 0] ** 2 + half[:, 1] ** 2, half[:, 2] ** 2, roughness)
    return density * _open_share(incoming[:, 2], outgoing[:, 2], roughness)


def lobe_of_cosines(into: FloatArray, out: FloatArray, between: FloatArray, roughness: FloatArray) -> FloatArray:
    """Return the lobe f_s of unit gloss, of cosines alone: faster, and true to a millionth above a roughness of 0.01.

    Parameters
    ----------
    into, out, between : array
        Cosines of the incoming and of the outgoing direction to the normal, and of the two to each other; of shapes
        that broadcast.
    roughness : array
        The distribution's alpha.

    Returns
    -------
    array
        0 where either direction is below the surface. [1/sr]
    """
    cosine2 = (into + out) ** 2 / np.maximum(2 + 2 * between, np.finfo(float).tiny)
    return _density(np.clip(1 - cosine2, 0, None), cosine2, roughness) * _open_share(into, out, roughness)


def _density(sine2: FloatArray, cosine2: FloatArray, roughness: FloatArray) -> FloatArray:
    """Microfacets along a half vector, by its angle to the normal."""
    squared = roughness**2
    # cos² (a² - 1) + 1 without the cancellation at narrow lobes.
    return squared / (np.pi * (sine2 + squared * cosine2) ** 2)


def _open_share(into: FloatArray, out: FloatArray, roughness: FloatArray) -> FloatArray:
    """G / (4 cos θ cos θ') of both directions: finite at grazing light, 0 below the surface."""
    shares = _unshadowed_over_cosine(into, roughness) * _unshadowed_over_cosine(out, roughness)
    return np.where((into > 0) & (out > 0), shares / 4, 0.0)


def lobe_directions(outgoing: FloatArray, roughness: FloatArray, chances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Choose where light that leaves along ``outgoing`` came from; by reciprocity also where it goes.

    Parameters
    ----------
    outgoing : (N, 3) array
        Unit directions above the surface.
    roughness : (N,) array
        The distribution's alpha.
    chances : (N, 2) array
        Even in 0 ... 1.

    Returns
    -------
    directions : (N, 3) array
    weight : (N,) array
        Of each in the mean that is ∫ f_s L cos θ dω: at most 1, and 0 where the direction is below the surface.
    """
    wide = np.stack([roughness, roughness, np.ones_like(roughness)], axis=1)
    view = outgoing * wide
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    angle = 2 * np.pi * chances[:, 0]
    height = (1 - chances[:, 1]) * (1 + view[:, 2]) - view[:, 2]
    radius = np.sqrt(np.clip(1 - height**2, 0, 1))
    normal = (np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1) + view) * wide
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    directions = 2 * np.einsum("nk,nk->n", outgoing, normal)[:, None] * normal - outgoing
    cosine = directions[:, 2]
    weight = np.where(cosine > _LEAST_COSINE, cosine * _unshadowed_over_cosine(cosine, roughness), 0.0)
    return directions, weight


def _unshadowed_over_cosine(cosine: FloatArray, roughness: FloatArray) -> FloatArray:
    """Smith's share of microfacets seen along a direction, over its cosine."""
    mu2 = np.clip(cosine, _LEAST_COSINE, 1) ** 2
    return np.asarray(2 / (np.sqrt(mu2) + np.sqrt(mu2 + roughness**2 * (1 - mu2))))


def albedo(cosine: FloatArray, roughness: FloatArray) -> FloatArray:
    """Return a(cos θ): the share of the light from one direction that a lobe of unit gloss sends back.

    Parameters
    ----------
    cosine, roughness : (N,) array
        In 0 ... 1.

    Returns
    -------
    (N,) array
        From a table, linear between its nodes, within 0.002; at most 1.
    """
    table = _table()
    x = np.sqrt(np.clip(cosine, 0, 1)) * (_COSINES - 1)
    y = np.clip(roughness, 0, 1) * (_ROUGHNESSES - 1)
    i, j = np.minimum(x.astype(np.intp), _COSINES - 2), np.minimum(y.astype(np.intp), _ROUGHNESSES - 2)
    s, t = x - i, y - j
    near, far = table[j, i] * (1 - s) + table[j, i + 1] * s, table[j + 1, i] * (1 - s) + table[j + 1, i + 1] * s
    return np.asarray(near * (1 - t) + far * t)


def mean_albedo(roughness: FloatArray) -> FloatArray:
    """Return (N,) 2 ∫ a(μ) μ dμ: the share of even light from all directions that the lobe sends back."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    cosines, weights = (nodes + 1) / 2, weights / 2
    values = [2 * w * c * albedo(np.full(len(roughness), c), roughness) for c, w in zip(cosines, weights, strict=True)]
    return np.asarray(np.sum(values, axis=0))


@cache
def _table() -> FloatArray:
    """(roughness, square root of the cosine) albedos; the table is finer in grazing light, where they change."""
    cosine = np.maximum(np.linspace(0, 1, _COSINES) ** 2, 1e-4)
    number = np.arange(_POINTS)
    chances = np.stack([(number + 0.5) / _POINTS, number * _GOLDEN % 1.0], axis=1)
    outgoing = np.stack([np.sqrt(1 - cosine**2), np.zeros(_COSINES), cosine], axis=1)
    rows = []
    for roughness in np.maximum(np.linspace(0, 1, _ROUGHNESSES), LEAST_ROUGHNESS):
        each = np.repeat(outgoing, len(chances), axis=0)
        _, weight = lobe_directions(each, np.full(len(each), roughness), np.tile(chances, (_COSINES, 1)))
        rows.append(weight.reshape(_COSINES, -1).mean(axis=1))
    return np.array(rows)


def frames_of(normals: FloatArray) -> FloatArray:
    """Return (N, 3, 3) right-handed axes, a row each, the last of them the normal."""
    least = np.abs(normals).argmin(axis=1)
    across = np.cross(normals, np.eye(3)[least])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.stack([across, np.cross(normals, across), normals], axis=1)
