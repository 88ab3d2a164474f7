"""What patches reflect as a whole that are lit or decoded in part only: by all that the camera sees of them in white.

The light exchange knows one reflectance a patch. Where the border of the projector's picture, or a dark poster that no
code was read on, runs through a patch, its lit part alone tells little of the rest. But the rest is seen, too: in the
light of the other walls, whose share the model knows once the reflectances of all patches are known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.light import faces as walls
from calibration.light.reflectance import LEAST_REFLECTANCE, MOST_REFLECTANCE, ReflectanceFit, ReflectanceSource
from rig.stages.scene_model import PixelHits, PosedLens
from sim.geometry.optics import solid_angles
from sim.geometry.scene import Scene
from sim.light.transport_of_scene import smooth_view

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_SPLIT_AS_MODELLED = 0.15
"""Share of white by which direct light may differ from the model's where no code was read: dark paint splits white as
its neighbours do, a shadow does not. Noise of the brightest and darkest frames is 0.02 to 0.1 of white there."""
_BORDER_PX = 9
"""Camera pixels beside the border of the projector's picture whose light tells neither: blur and error of the place."""
_LEAST_SPREAD = 0.03
"""By which the unseen part of a patch differs from its seen part on a wall of one paint: texture is some percent."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SeenPatches:
    """Pixels and light of one band that tell of patches; N camera pixels."""

    scene: Scene
    camera: PosedLens
    hits: PixelHits
    told: BoolArray
    """(N,) pixels whose direct light told their patch's reflectance."""
    direct: FloatArray
    """(N,) their ρκ. [camera unit]"""
    share: FloatArray
    """(N,) of white, direct light as measured."""
    white: FloatArray
    """(N,) light of white without the camera's vignetting."""
    irradiance: FloatArray
    """(N,) e by unit white; 0 outside of the projector's picture."""


@dataclass(frozen=True, eq=False, kw_only=True)
class WholePatches:
    """Reflectances of whole patches, ρκ, and of their lit parts."""

    whole: FloatArray
    """(P,) NaN of patches that are not lit and seen. [camera unit]"""
    lit_part: FloatArray
    """(P,) reflectance of the lit part over the whole patch's."""
    unseen_share: FloatArray
    """(P,) of its area."""


def whole_patches(seen: SeenPatches, per_lit: FloatArray, fit: ReflectanceFit, arriving: FloatArray) -> WholePatches:
    """Complete the reflectances of patches by those of their parts that direct light does not tell.

    Parameters
    ----------
    seen
        What the camera saw.
    per_lit : (P,)
        ρκ by direct light, NaN where there is none. [camera unit]
    fit
        To these.
    arriving : (P,)
        Indirect irradiance of white on each patch by that fit. [camera unit]

    Returns
    -------
    WholePatches
        Means by area on the wall.
    """
    scene, patch = seen.scene, seen.hits.hits.patch
    weights = smooth_view(scene, seen.hits.hits, np.ones(len(patch)))
    from_walls = np.asarray(weights @ (arriving * scene.reflectance))
    by_projector = fit.flux * seen.irradiance
    light = by_projector + from_walls
    other = _others(seen) & (light > 0)
    other &= np.abs(seen.share - by_projector / np.where(light > 0, light, 1.0)) < _SPLIT_AS_MODELLED
    own = fit.flux * np.clip(seen.white / np.where(light > 0, light, 1.0), LEAST_REFLECTANCE, MOST_REFLECTANCE)
    area = _areas(seen)
    (lit_sum, lit_area), (other_sum, other_area) = (
        _sums(values, area, patch, chosen=chosen, n_patches=scene.n_patches)
        for values, chosen in ((seen.direct, seen.told), (own, other))
    )
    known = np.isfinite(per_lit)
    # A pixel's area on a wall at a glancing angle is not exact: together they cover no more than the patch.
    rest = np.minimum(other_area, np.maximum(scene.areas - lit_area, 0.0))
    mean_of_rest = other_sum / np.maximum(other_area, np.finfo(float).tiny)
    covered = np.maximum(lit_area + rest, np.finfo(float).tiny)
    whole = np.where(known, (lit_sum + rest * mean_of_rest) / covered, np.nan)
    return WholePatches(
        whole=whole,
        lit_part=np.where(known, per_lit / np.where(known, whole, 1.0), 1.0),
        unseen_share=np.clip(1 - covered / scene.areas, 0.0, 1.0),
    )


def with_unseen_parts(fit: ReflectanceFit, found: WholePatches, wall: NDArray[np.integer]) -> ReflectanceFit:
    """Return the fit whose standard deviations count what nobody saw of a patch: it varies as the wall's patches do."""
    lit = fit.source == ReflectanceSource.DIRECT
    spread = np.array([fit.reflectance[lit & (wall == k)].std() if (lit & (wall == k)).any() else 0.0 for k in wall])
    of_unseen = np.where(lit, found.unseen_share * np.maximum(spread, _LEAST_SPREAD), 0.0)
    return replace(fit, sigma=np.hypot(fit.sigma, of_unseen), lit_part=found.lit_part)


def _others(seen: SeenPatches) -> BoolArray:
    """(N,) pixels away from edges of walls and from the border of the projector's picture that did not tell."""
    shape, patch = seen.camera.lens.shape, seen.hits.hits.patch
    reached = (seen.irradiance > 0).reshape(shape).astype(np.uint8)
    window = np.ones((_BORDER_PX, _BORDER_PX), np.uint8)
    inside = cv2.dilate(reached, window) == cv2.erode(reached, window)
    away = walls.away_from_edges(seen.hits.hits.face.reshape(shape))
    return np.asarray((inside & away).ravel() & (patch >= 0) & ~seen.told)


def _areas(seen: SeenPatches) -> FloatArray:
    """(N,) area on the wall that each pixel sees, in m²."""
    rays = seen.hits.points_m - seen.camera.pose.position_m
    distance = np.linalg.norm(rays, axis=1)
    normals = seen.scene.normals[np.maximum(seen.hits.hits.patch, 0)]
    cosine = np.abs(np.einsum("nk,nk->n", rays, normals)) / distance
    solid = solid_angles(seen.camera.lens, seen.camera.lens.pixel_grid())
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.nan_to_num(solid * distance**2 / cosine, nan=0.0, posinf=0.0))


def _sums(
    values: FloatArray, area: FloatArray, patch: NDArray[np.integer], *, chosen: BoolArray, n_patches: int
) -> tuple[FloatArray, FloatArray]:
    """(P,) sums over each patch's chosen pixels of values by area, and of the area."""
    index, weight = patch[chosen], area[chosen]
    total = np.bincount(index, values[chosen] * weight, minlength=n_patches)
    return np.asarray(total, np.float64), np.asarray(np.bincount(index, weight, minlength=n_patches), np.float64)
