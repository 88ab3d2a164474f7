"""What a fitted scene expects of global light, patch by patch, and where it may be wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from calibration.light.reflectance import ReflectanceSource
from calibration.light.transport.low_rank import largest_eigenpairs
from calibration.light.transport.prior import TransportPrior
from rig.stages.scene_model import SceneModel
from rig.stages.transport.lobes import Ways, lobes_of
from rig.stages.transport.places import SurfacePlaces
from sim.light.transport import LightTransport

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_NEAR, _FAR = 0.1, 0.3
"""Lengths over which the model is wrong alike, of the room's size: that of a patch, and of a wall's lit part."""
_EVEN = 0.3
"""Share of a place's light that may come from anywhere: a lobe lights where a matte wall hardly does."""
_MOST_KERNEL, _LEAST_KERNEL = 64, 1e-3
"""Columns of the kernel, and of its eigenvalues the least, of the largest."""
_OF_A_WALL = 2
"""Directions in which an unseen wall's reflectance changes the light."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LitPatches:
    """The patches that the projector lights, and how much of a picture's light falls on each."""

    patch: IntArray
    """(L,)"""
    emission: csr_array
    """(L, n pixels) as a share of white's."""
    white: FloatArray
    """(P,) emission of white."""
    owner: IntArray
    """(n pixels,) which of them each pixel falls on; -1 for none."""

    @classmethod
    def of(cls, transport: LightTransport) -> LitPatches:
        """Return those of a transport."""
        white = np.asarray(transport.emission.sum(axis=1))
        patch = np.flatnonzero(white > 0)
        share = csr_array(transport.emission[patch] / white[patch][:, None])
        number = np.full(len(white) + 1, -1, dtype=np.intp)
        number[patch] = np.arange(len(patch))
        return cls(patch=patch, emission=share, white=white, owner=number[transport.pixel_patch])

    def shares(self, pictures: FloatArray) -> FloatArray:
        """Return (J, L) light on each patch of pictures (n pixels, J), as a share of white's."""
        return np.asarray((self.emission @ pictures).T)

    def by_emission(self, by_patch: FloatArray) -> FloatArray:
        """Return (r, P) what is by shares (r, L) as by emission of all patches."""
        every = np.zeros((len(by_patch), len(self.white)))
        every[:, self.patch] = by_patch / self.white[self.patch]
        return every


@dataclass(frozen=True, kw_only=True)
class OpenWalls:
    """What the fit left open: reflectances that nobody saw."""

    source: tuple[int, ...]
    """Of each patch's reflectance."""
    sigma: float
    """Standard deviation of those of unseen patches."""


def prior_of(
    scene_model: SceneModel,
    transport: LightTransport,
    places: SurfacePlaces,
    lit: LitPatches,
    *,
    relative_error: float,
    own: FloatArray,
    open_walls: OpenWalls,
) -> TransportPrior:
    """Return what a scene's transport says of places, and how sure it is.

    Parameters
    ----------
    scene_model
        In one band.
    transport
        Of it, to the camera's pixels.
    places
        N of them.
    lit
        L patches of that transport.
    relative_error
        Of white's global light: where the spread of the errors begins.
    own : (N,)
        Standard deviation of white's direct light that is taken for global light.
    open_walls
        What its fit left open.
    """
    view = csr_array(places.mean_of() @ transport.view)
    unit = np.zeros((transport.radiosity.n_patches, len(lit.patch)))
    unit[lit.patch, np.arange(len(lit.patch))] = lit.white[lit.patch]
    sent = transport.radiosity.solve(unit)
    expected = np.asarray(view @ (sent - unit))
    white = expected.sum(axis=1)
    share = (expected / np.maximum(white, np.finfo(float).tiny)[:, None]).mean(axis=0)
    left, right = _open_directions(scene_model, transport, view, sent, open_walls=open_walls)
    base, kernel = (1 - _EVEN) * expected + _EVEN * white[:, None] * share, _kernel(scene_model, lit.patch)
    # Errors of single patches cancel in white, of which the relative error is known.
    of_white = np.linalg.norm(base @ kernel, axis=1) / np.maximum(white, np.finfo(float).tiny)
    ways = ways_of(scene_model, transport, places, lit)
    surface = np.minimum(scene_model.scene.region[lit.patch], len(scene_model.walls))
    return TransportPrior(
        lobes=lobes_of(ways, surface),
        transport=expected,
        base=base,
        kernel=kernel,
        spread=relative_error / np.maximum(of_white, np.finfo(float).tiny),
        left=left,
        right=right,
        own=own,
    )


def ways_of(scene_model: SceneModel, transport: LightTransport, places: SurfacePlaces, lit: LitPatches) -> Ways:
    """Return the ways of light between places and lit patches."""
    # Of even light a view makes what it shows of all that arrives: its weights are of what is sent back.
    seen = np.asarray(places.mean_of() @ (transport.view @ transport.radiosity.reflectance))
    return Ways.of(scene_model, places, lit.patch, emission=lit.white[lit.patch], gain=seen)


def _kernel(scene_model: SceneModel, patch: IntArray) -> FloatArray:
    """(L, R) factor of a covariance that falls off with the distance of patches, and with the angle between them."""
    scene = scene_model.scene
    centres, normals = scene.centres[patch], scene.normals[patch]
    size_m = float(np.ptp(scene.vertices.reshape(-1, 3), axis=0).max())
    apart = ((centres[:, None] - centres) ** 2).sum(axis=2) / size_m**2
    near, far = (np.exp(-apart / (2 * length**2)) for length in (_NEAR, _FAR))
    covariance = 0.25 * (near + far) * (1 + normals @ normals.T)
    values, vectors = largest_eigenpairs(covariance, _MOST_KERNEL)
    kept = values > _LEAST_KERNEL * values[0]
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


def _open_directions(
    scene_model: SceneModel,
    transport: LightTransport,
    view: csr_array,
    sent: FloatArray,
    *,
    open_walls: OpenWalls,
) -> tuple[FloatArray, FloatArray]:
    """(N, Q), (Q, L) what reflectances that nobody saw change, all of a wall together, by a standard deviation.

    The derivative of B = (I - ρF)⁻¹ E by ρ of a patch is what it sends out of the light that arrives there.
    """
    rho = transport.radiosity.reflectance
    unseen = np.array(open_walls.source) == ReflectanceSource.UNSEEN
    arriving = transport.radiosity.gather(sent) / np.maximum(rho, np.finfo(float).tiny)[:, None]
    left, right = [], []
    for wall in range(len(scene_model.walls)):
        chosen = np.flatnonzero(unseen & (scene_model.scene.region == wall))
        if chosen.size:
            # By light of each of the wall's patches: these are fewer than the lit ones.
            light = np.zeros((len(rho), len(chosen)))
            light[chosen, np.arange(len(chosen))] = 1.0
            seen = view @ transport.radiosity.solve(light)
            _, _, ways = np.linalg.svd(np.linalg.qr(seen, mode="r") @ arriving[chosen], full_matrices=False)
            left.append(open_walls.sigma * np.asarray(seen @ (arriving[chosen] @ ways[:_OF_A_WALL].T)))
            right.append(ways[:_OF_A_WALL])
    n_lit = sent.shape[1]
    return np.concatenate([np.zeros((view.shape[0], 0)), *left], axis=1), np.concatenate(
        [np.zeros((0, n_lit)), *right], axis=0
    )
