"""What pixels see of the light on a mesh: linear within fans of triangles about the patches' centroids.

A corner has the mean of the patches of its region that meet there, weighted by area; the centroid has its patch's own.
It is what :func:`sim.light.transport_of_scene.smooth_view` is for gridded rectangles, as one matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array, eye_array, vstack

from sim.arrays import FloatArray, IntArray
from sim.geometry.mesh import Mesh
from sim.geometry.rays import plane_axes
from sim.geometry.scene import Hits


@dataclass(frozen=True, eq=False)
class NodeView:
    """What pixels see of a mesh in two steps: linear between three nodes, each of which is a mean of patches."""

    weights: csr_array
    """(N, K) of the irradiance at nodes: at most three a pixel, which sum to 1; none where it sees nothing."""
    nodes: csr_array
    """(K, P) of the patches' irradiance: corners first, then the patches' own. Rows sum to 1, or to 0 where all patches
    are black, whose radiosity tells nothing of the light they get."""


def node_view(mesh: Mesh, hits: Hits) -> NodeView:
    """Return the two steps in which :func:`mesh_view` sees a mesh.

    Parameters
    ----------
    mesh : Mesh
    hits : Hits
        Where the N pixels look.

    Returns
    -------
    NodeView
        K nodes, among them corners that no pixel looks at.
    """
    pixels = np.flatnonzero(hits.patch >= 0)
    patch = hits.patch[pixels]
    corner, weights = _places(mesh, patch, hits.uv[pixels])
    number, means = _corner_means(mesh)
    node = np.concatenate([number[patch[:, None], corner], means.shape[0] + patch[:, None]], axis=1)
    tells = diags_array((mesh.reflectance > 0).astype(np.float64))
    nodes = csr_array(vstack([means, eye_array(mesh.n_patches)]) @ tells)
    told = nodes.sum(axis=1)
    # A black patch tells nothing: its neighbours speak for it.
    weights = weights * told[node]
    weights /= np.maximum(weights.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    shape = (len(hits.patch), nodes.shape[0])
    return NodeView(
        weights=csr_array(coo_array((weights.ravel(), (np.repeat(pixels, 3), node.ravel())), shape=shape)),
        nodes=csr_array(diags_array(1 / np.maximum(told, np.finfo(float).tiny)) @ nodes),
    )


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
    view = node_view(mesh, hits)
    per_irradiance = np.divide(1.0, mesh.reflectance, out=np.zeros(mesh.n_patches), where=mesh.reflectance > 0)
    seen = np.where(hits.patch >= 0, reflectance, 0.0)
    return csr_array(diags_array(seen) @ view.weights @ view.nodes @ diags_array(per_irradiance))


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
