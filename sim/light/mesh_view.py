"""What pixels see of the light on a mesh: linear within fans of triangles about the patches' centroids.

A corner has the mean of the patches of its region that meet there, weighted by area; the centroid has its patch's own.
It is what :func:`sim.light.transport_of_scene.smooth_view` is for gridded rectangles, as one matrix.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from sim.arrays import FloatArray, IntArray
from sim.geometry.mesh import Mesh
from sim.geometry.rays import plane_axes
from sim.geometry.scene import Hits


def mesh_view(mesh: Mesh, hits: Hits, reflectance: FloatArray) -> csr_array:
    """Return V for pixels with these hits: the irradiance (B - E) / rho is linear between centroids and corners.

    Parameters
    ----------
    mesh : Mesh
    hits : Hits
        Where the N pixels look.
    reflectance : (N,) array
        Of the surface point that each pixel sees (camera vignetting may be in it).

    Returns
    -------
    (N, P) csr
    """
    pixels = np.flatnonzero(hits.patch >= 0)
    patch = hits.patch[pixels]
    corner, weights = _places(mesh, patch, hits.uv[pixels])
    number, means = _corner_means(mesh)
    rows = np.repeat(np.arange(len(pixels)), 2)
    shape = (len(pixels), means.shape[0])
    around = csr_array(coo_array((weights[:, :2].ravel(), (rows, number[patch[:, None], corner].ravel())), shape=shape))
    own = csr_array(coo_array((weights[:, 2], (np.arange(len(pixels)), patch)), shape=(len(pixels), mesh.n_patches)))
    view = csr_array(around @ means + own)
    return _of_reflected(mesh, view, pixels=pixels, reflectance=reflectance, n_pixels=len(hits.patch))


def _of_reflected(
    mesh: Mesh, view: csr_array, *, pixels: IntArray, reflectance: FloatArray, n_pixels: int
) -> csr_array:
    """Weights of radiosities for weights of irradiances; a black patch tells nothing, its neighbours speak for it."""
    tells = (mesh.reflectance > 0).astype(np.float64)
    view = csr_array(view @ diags_array(tells))
    total = np.maximum(view.sum(axis=1), np.finfo(float).tiny)
    view = csr_array(diags_array(reflectance[pixels] / total) @ view)
    view = csr_array(view @ diags_array(tells / np.where(tells > 0, mesh.reflectance, 1.0)))
    put = csr_array((np.ones(len(pixels)), (pixels, np.arange(len(pixels)))), shape=(n_pixels, len(pixels)))
    return csr_array(put @ view)


def _places(mesh: Mesh, patch: IntArray, place_m: FloatArray) -> tuple[IntArray, FloatArray]:
    """Two corners (N, 2) between which each point lies, and weights (N, 3) of these and of the centroid."""
    from_centre = mesh.vertices - mesh.centres[:, None]
    corners = np.einsum("pck,pak->pca", from_centre, plane_axes(mesh))[patch]
    following = np.roll(corners, -1, axis=1)
    area = _cross(corners, following)
    safe = np.where(np.abs(area) > 0, area, np.inf)
    first, second = _cross(place_m[:, None], following) / safe, _cross(corners, place_m[:, None]) / safe
    # Of the sector that a point lies in both are 0 or more; rounding may leave it a hair outside of all.
    lowest = np.where(np.abs(area) > 0, np.minimum(first, second), -np.inf)
    sector = lowest.argmax(axis=1)
    one = np.arange(len(patch))
    a, b = (np.clip(values[one, sector], 0.0, None) for values in (first, second))
    over = np.maximum(a + b, 1.0)
    a, b = a / over, b / over
    return np.stack([sector, (sector + 1) % corners.shape[1]], axis=1), np.stack([a, b, 1 - a - b], axis=1)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _corner_means(mesh: Mesh) -> tuple[IntArray, csr_array]:
    """(P, 4) number of each corner within its region, and (C, P) weights with which patches make corners' values."""
    key = np.stack([np.repeat(mesh.region, 4), mesh.topology.corner.ravel()], axis=1)
    _, number = np.unique(key, axis=0, return_inverse=True)
    number = number.reshape(-1, 4)
    patch = np.repeat(np.arange(mesh.n_patches), 4)
    touches = csr_array(
        coo_array((np.ones(len(patch)), (number.ravel(), patch)), shape=(number.max() + 1, mesh.n_patches))
    )
    # A triangle repeats its last corner: it counts once.
    touches.data[:] = 1.0
    weighted = csr_array(touches @ diags_array(mesh.areas))
    return number, csr_array(diags_array(1 / weighted.sum(axis=1)) @ weighted)
