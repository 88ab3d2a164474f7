"""Glossy reflection: the GGX microfacet lobe, without Fresnel's colour; it never sends back more than arrives.

Directions are in a frame whose third axis is the surface's normal, and point away from the surface.

References
----------
Walter, Marschner, Li, Torrance, "Microfacet models for refraction through rough surfaces", EGSR 2007: distribution
and shadowing (equations 33, 34). Heitz, "Sampling the GGX distribution of visible normals", JCGT 7(4), 2018: sampling.
"""

from __future__ import annotations

import numpy as np

from rig.devices.simulated.mesh.scene import FloatArray


def frames_of(normals: FloatArray) -> FloatArray:
    """(n, 3, 3) right-handed axes, the last of them the normal (Duff et al., JCGT 6(1), 2017)."""
    x, y, z = normals.T
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1)
    second = np.stack([b, sign + y * y * a, -y], axis=1)
    return np.stack([first, second, normals], axis=1)


def lobe(incoming: FloatArray, outgoing: FloatArray, roughness: FloatArray) -> FloatArray:
    """(n,) GGX reflectance distribution of unit gloss, 1/sr, for directions (n, 3) above the surface."""
    half = incoming + outgoing
    half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-12)
    a2 = roughness**2
    cos2 = half[:, 2] ** 2
    distribution = a2 / (np.pi * (cos2 * (a2 - 1) + 1) ** 2)
    shadowing = _unshadowed(incoming[:, 2], roughness) * _unshadowed(outgoing[:, 2], roughness)
    both = incoming[:, 2] * outgoing[:, 2]
    above = (incoming[:, 2] > 0) & (outgoing[:, 2] > 0)
    return np.where(above, distribution * shadowing / np.maximum(4 * both, 1e-9), 0.0)


def sampled(outgoing: FloatArray, roughness: FloatArray, chances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Choose where the lobe sends light that goes along `outgoing`, or where that light came from: it is reciprocal.

    Parameters
    ----------
    outgoing
        (n, 3), above the surface.
    roughness
        (n,) alpha.
    chances
        (n, 2) in 0 ... 1, even.

    Returns
    -------
    directions : (n, 3)
    weight : (n,)
        Share of the gloss that goes on, at most 1; 0 where the direction is below the surface.
    """
    alpha = roughness[:, None]
    stretched = outgoing * np.hstack([alpha, alpha, np.ones_like(alpha)])
    stretched /= np.linalg.norm(stretched, axis=1, keepdims=True)
    normal = _visible_normal(stretched, chances) * np.hstack([alpha, alpha, np.ones_like(alpha)])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    direction = 2 * np.einsum("ij,ij->i", outgoing, normal)[:, None] * normal - outgoing
    weight = np.where(direction[:, 2] > 1e-6, _unshadowed(direction[:, 2], roughness), 0.0)
    return direction, weight


def _visible_normal(stretched: FloatArray, chances: FloatArray) -> FloatArray:
    """(n, 3) normal of a hemisphere as seen along `stretched`, projected areas alike."""
    r, phi = np.sqrt(chances[:, 0]), 2 * np.pi * chances[:, 1]
    x, y = r * np.cos(phi), r * np.sin(phi)
    s = (1 + stretched[:, 2]) / 2
    across = np.cross(np.array([0.0, 0.0, 1.0]), stretched)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    first = np.where(length > 1e-7, across / np.maximum(length, 1e-12), (1.0, 0.0, 0.0))
    second = np.cross(stretched, first)
    y = (1 - s) * np.sqrt(np.maximum(1 - x * x, 0)) + s * y
    z = np.sqrt(np.maximum(1 - x * x - y * y, 0))
    normal = x[:, None] * first + y[:, None] * second + z[:, None] * stretched
    normal[:, 2] = np.maximum(normal[:, 2], 1e-9)
    return np.asarray(normal)


def _unshadowed(cosine: FloatArray, roughness: FloatArray) -> FloatArray:
    """Smith's share of microfacets that are not hidden along a direction."""
    tan2 = np.maximum(1 / np.maximum(cosine, 1e-6) ** 2 - 1, 0)
    return np.asarray(2 / (1 + np.sqrt(1 + roughness**2 * tan2)))
