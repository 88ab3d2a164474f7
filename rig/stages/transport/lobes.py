"""Light that glossy surfaces would send about a room: what a matte model leaves out, as far as geometry tells it.

Two ways lead over gloss: a place that shines mirrors lit patches to the camera, and a lit patch that shines mirrors the
projector to places. How much of either there is, and of which roughness, the photographs have to tell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.stages.scene_model import SceneModel
from rig.stages.transport.places import SurfacePlaces

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_ROUGHNESS = (0.1, 0.25)
"""Of a gloss floor and of a satin wall."""
_SHINE = 0.3
"""Of matte light, what shines for each relative error of the model. Of 0, 0.3 and 1 this was best on four of five
pictures of the simulated glossy room, and the others left up to 16 % more."""
_LEAST_COSINE = 0.1
"""Lobes at grazing angles are cut off there."""


@dataclass(frozen=True, eq=False)
class _Points:
    """Points of surface, their normals, and how large they are."""

    position_m: FloatArray
    normal: FloatArray
    size_m: FloatArray


def lobes_of(
    scene_model: SceneModel, places: SurfacePlaces, patch: IntArray, *, emission: FloatArray, gain: FloatArray
) -> NDArray[np.float32]:
    """Return (N, M, L) light that places would see of lit patches over gloss of the usual strength.

    Parameters
    ----------
    scene_model
        Its geometry.
    places
        N of them.
    patch : (L,)
        Lit patches.
    emission : (L,)
        Of these by white.
    gain : (N,)
        What a place shows of the light that arrives there.
    """
    scene, hits = scene_model.scene, scene_model.camera_hits
    first = np.unique(places.of_pixel.ravel(), return_index=True)[1][-places.count :]
    means = places.mean_of()
    at = _Points(
        np.asarray(means @ np.nan_to_num(hits.points_m)),
        scene.normals[hits.hits.patch[first]],
        np.zeros(places.count),
    )
    lit = _Points(scene.centres[patch], scene.normals[patch], np.sqrt(scene.areas[patch]))
    across = lit.position_m[None] - at.position_m[:, None]
    apart = np.linalg.norm(across, axis=2)
    across /= np.maximum(apart, np.finfo(float).tiny)[..., None]
    arrives, leaves = (np.clip(cosine, 0, None) for cosine in _cosines(across, at, lit))
    near = np.maximum(apart, lit.size_m[None])
    matte = gain[:, None] * emission * arrives * leaves * scene.areas[patch] / (np.pi * near**2)
    wide = (lit.size_m[None] / near) ** 2 / 12
    to_camera = _towards(scene_model.camera.pose.position_m, at.position_m)[:, None]
    to_projector = _towards(scene_model.projector.pose.position_m, lit.position_m)[None]
    mirrored = [matte * _lobe(across, to_camera, at.normal[:, None], width) for width in _widths(wide)]
    sent = [matte * _lobe(-across, to_projector, lit.normal[None], width) for width in _widths(wide)]
    surfaces = np.minimum(scene.region[patch], len(scene_model.walls))
    by_surface = [np.where(surfaces == name, each, 0.0) for name in np.unique(surfaces) for each in sent]
    return (_SHINE * np.stack([*mirrored, *by_surface], axis=1)).astype(np.float32)


def _cosines(across: FloatArray, at: _Points, lit: _Points) -> tuple[FloatArray, FloatArray]:
    return np.einsum("nlc,nc->nl", across, at.normal), -np.einsum("nlc,lc->nl", across, lit.normal)


def _widths(wide: FloatArray) -> list[FloatArray]:
    """Variances of lobes: of half vectors, which turn half as fast as what a patch's size adds."""
    return [roughness**2 + wide / 2 for roughness in _ROUGHNESS]


def _towards(there_m: FloatArray, from_m: FloatArray) -> FloatArray:
    way = there_m - from_m
    return np.asarray(way / np.linalg.norm(way, axis=-1, keepdims=True))


def _lobe(first: FloatArray, second: FloatArray, normal: FloatArray, variance: FloatArray) -> FloatArray:
    """π f of a rough mirror, Beckmann's distribution of half vectors.

    P. Beckmann and A. Spizzichino, The scattering of electromagnetic waves from rough surfaces, Pergamon 1963.
    """
    half = first + second
    half = half / np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), np.finfo(float).tiny)
    square = np.clip((half * normal).sum(axis=-1), _LEAST_COSINE, 1.0) ** 2
    distribution = np.exp(-(1 - square) / (square * variance)) / (variance * square**2)
    one, other = ((way * normal).sum(axis=-1) for way in (first, second))
    grazing = np.maximum(one, _LEAST_COSINE) * np.maximum(other, _LEAST_COSINE)
    return np.asarray(np.where((one > 0) & (other > 0), distribution / (4 * grazing), 0.0))
