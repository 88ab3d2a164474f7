"""Light between patches where a model sums it up: what an open room sends back, and how pixels see their patches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from rig.stages.surface.scene import AnyScene
from sim.form_factors import FormFactors
from sim.geometry.scene import Hits
from sim.light.transport_of_scene import smooth_view

BoolArray = NDArray[np.bool_]


def with_even_return(factors: FormFactors, share: float) -> FormFactors:
    """Return the factors of patches that do not see each other, of whose light so large a share comes back evenly.

    Patch i sends it to all patches by their areas, F_ij = s A_j / ΣA: what arrives is s times the mean radiosity.
    """
    if share == 0:
        return factors
    matrix = np.repeat(share * factors.areas[None] / factors.areas.sum(), len(factors.areas), axis=0)
    return replace(factors, matrix=matrix, row_sums=np.full(len(factors.areas), share), method="even return")


def seen_from(scene: AnyScene, hits: Hits, chosen: BoolArray) -> csr_array:
    """Return (P, P) mean weights with which the chosen pixels of each patch see the irradiance of the patches about."""
    weights = smooth_view(scene, hits, np.where(chosen, scene.reflectance[hits.patch], 0.0))
    pixels = np.flatnonzero(chosen)
    count = np.bincount(hits.patch[pixels], minlength=scene.n_patches)
    shape = (scene.n_patches, len(chosen))
    sums = csr_array((np.ones(len(pixels)), (hits.patch[pixels], pixels)), shape=shape) @ weights
    return csr_array(diags_array(1 / np.maximum(count, 1)) @ sums + diags_array((count == 0).astype(float)))
