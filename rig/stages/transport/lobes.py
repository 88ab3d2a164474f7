"""Light that glossy surfaces would send about a room: what a matte model leaves out, as far as geometry tells it.

Two ways lead over gloss: a place that shines mirrors lit patches to the camera, and a lit patch that shines mirrors the
projector to places. How much of either there is, and of which roughness, the photographs have to tell.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from rig.stages.scene_model import SceneModel
from rig.stages.transport.places import SurfacePlaces
from sim.light.gloss.lobe import lobe_of_cosines

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.intp]

ROUGHNESS = (0.1, 0.3)
"""Of a gloss floor and of a satin wall."""
_SHINE = 0.3
"""Of matte light, what shines for each relative error of the model. Of 0, 0.3 and 1 this was best on four of five
pictures of the simulated glossy room, and the others left up to 16 % more."""
_NEAR, _PARTS = 3.0, 4
"""Patches nearer than so many of their sizes are cut into as many parts along each side: a lobe changes within them."""
_AT_ONCE = 1 << 18
"""Pairs that are worked on together: some hundred megabytes."""


@dataclass(frozen=True, eq=False)
class _Points:
    """Points of surface, their normals, and how large they are."""

    position_m: FloatArray
    normal: FloatArray
    size_m: FloatArray

    def at(self, index: IntArray) -> _Points:
        return _Points(self.position_m[index], self.normal[index], self.size_m[index])


@dataclass(frozen=True, eq=False, kw_only=True)
class Ways:
    """The ways between places and lit patches, and what would go there if they were matte."""

    at: _Points
    """N places."""
    lit: _Points
    """L patches."""
    corners_m: FloatArray
    """(L, 4, 3) of these."""
    power: FloatArray
    """(L,) what they send out by white."""
    gain: FloatArray
    """(N,) what a place shows of the light that arrives there."""
    camera_m: FloatArray
    projector_m: FloatArray

    @classmethod
    def of(
        cls,
        scene_model: SceneModel,
        places: SurfacePlaces,
        patch: IntArray,
        *,
        emission: FloatArray,
        gain: FloatArray,
    ) -> Ways:
        """Return those between N places and lit patches (L,), of emission (L,) by white; for gain (N,)."""
        scene, hits = scene_model.scene, scene_model.camera_hits
        first = np.unique(places.of_pixel.ravel(), return_index=True)[1][-places.count :]
        position_m = np.asarray(places.mean_of() @ np.nan_to_num(hits.points_m))
        return cls(
            at=_Points(position_m, scene.normals[hits.hits.patch[first]], np.zeros(places.count)),
            lit=_Points(scene.centres[patch], scene.normals[patch], np.sqrt(scene.areas[patch])),
            corners_m=scene.vertices[patch],
            power=emission * scene.areas[patch],
            gain=gain,
            camera_m=np.asarray(scene_model.camera.pose.position_m),
            projector_m=np.asarray(scene_model.projector.pose.position_m),
        )

    def at_places(self, chosen: IntArray) -> Ways:
        """Return those of some places."""
        return replace(self, at=self.at.at(chosen), gain=self.gain[chosen])

    def shining(self, roughnesses: Sequence[float]) -> Float32Array:
        """Return (K, 2, N, L) light of each roughness that places mirror of patches, and that patches mirror to places.

        Of a gloss as large as the matte reflectance.
        """
        places, patches = np.arange(len(self.at.size_m))[:, None], np.arange(len(self.lit.size_m))[None]
        found = np.zeros((len(roughnesses), 2, places.size, patches.size), dtype=np.float32)
        for some in _some(places, patches.size):
            found[:, :, some[:, 0]] = self._of(some, patches, self.lit.at(patches), roughnesses)
        place, patch = np.nonzero(self._near())
        for some in _some(np.arange(len(place)), 1):
            each = (self._of(place[some], patch[some], part, roughnesses) for part in self._parts(patch[some]))
            found[:, :, place[some], patch[some]] = sum(each) / _PARTS**2
        return found

    def _near(self) -> NDArray[np.bool_]:
        """(N, L) pairs between which a lobe changes within the patch."""
        return np.asarray(cdist(self.at.position_m, self.lit.position_m) < _NEAR * self.lit.size_m)

    def _parts(self, patch: IntArray) -> Iterator[_Points]:
        """The middles of equal parts of patches."""
        a, b, c, d = np.moveaxis(self.corners_m[patch], 1, 0)
        whole = self.lit.at(patch)
        shares = (np.arange(_PARTS) + 0.5) / _PARTS
        for s in shares:
            for t in shares:
                middle = (1 - s) * ((1 - t) * a + t * d) + s * ((1 - t) * b + t * c)
                yield replace(whole, position_m=middle, size_m=whole.size_m / _PARTS)

    def _of(self, place: IntArray, patch: IntArray, lit: _Points, roughnesses: Sequence[float]) -> FloatArray:
        """(K, 2, ...) the light of pairs, of which the patch is a point."""
        at = self.at.at(place)
        across = lit.position_m - at.position_m
        apart = np.sqrt(_along(across, across))
        across /= np.maximum(apart, np.finfo(float).tiny)[..., None]
        near = np.maximum(apart, lit.size_m)
        arrives, leaves = (np.clip(each, 0, None) for each in (_along(across, at.normal), -_along(across, lit.normal)))
        matte = self.gain[place] * self.power[patch] * arrives * leaves / near**2
        to_camera, to_projector = _towards(self.camera_m, at.position_m), _towards(self.projector_m, lit.position_m)
        mirrored = arrives, _along(at.normal, to_camera), _along(across, to_camera)
        sent = leaves, _along(lit.normal, to_projector), -_along(across, to_projector)
        # Half vectors turn half as fast as what a patch's size adds.
        added = (lit.size_m / near) ** 2 / 24
        wide = [np.minimum(np.sqrt(roughness**2 + added), 1.0) for roughness in roughnesses]
        return np.stack([[matte * lobe_of_cosines(*way, each) for way in (mirrored, sent)] for each in wide])


def lobes_of(ways: Ways, surface: IntArray) -> Float32Array:
    """Return (N, M, L) light that places would see of lit patches over gloss of the usual strength.

    Parameters
    ----------
    ways
        Between N places and L patches.
    surface : (L,)
        Of each patch: what shines there has a strength for each.
    """
    pairs = ways.shining(ROUGHNESS)
    pairs *= np.float32(_SHINE)
    by_surface = [np.where(surface == name, sent, np.float32(0)) for name in np.unique(surface) for _, sent in pairs]
    return np.stack([*(mirrored for mirrored, _ in pairs), *by_surface], axis=1)


def _some(places: IntArray, each: int) -> Iterator[IntArray]:
    """Some places at a time, of so many pairs each."""
    step = max(1, _AT_ONCE // each)
    for first in range(0, len(places), step):
        yield places[first : first + step]


def _along(ways: FloatArray, normal: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...c,...c->...", ways, normal))


def _towards(there_m: FloatArray, from_m: FloatArray) -> FloatArray:
    way = there_m - from_m
    return np.asarray(way / np.linalg.norm(way, axis=-1, keepdims=True))
