"""Light of white, pixel by pixel, as measured and as the patches make it: what its two parts are taken to be."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, FloatArray
from calibration.light import faces as walls
from rig.stages.light.fit import WHOLE_WHITE, BandLight
from rig.stages.maps.uncertainty import SMOOTHING_SHARE
from rig.stages.scene_model import SceneModel, camera_view, face_of_pixels

_MOST_RESCALED = 3.0
"""Factor by which light beside an edge may differ from what its neighbours let expect."""
_MOST_OWN = 10.0
"""The same of global light beside an edge of a thing, of which a pixel may see a side that gets other light, and is too
narrow for a surface of its own."""


class WhiteLight(NamedTuple):
    """What one band's model is told of each pixel, (H, W) each."""

    gain: FloatArray
    """Direct light of a white without borders; 0 where not lit."""
    ratio: FloatArray
    """Global light of white as measured over as modelled; 1 where not lit."""
    apart: FloatArray
    """Relative deviation, 1 at most, of global light beside the edges of things from what is around: no patch is what
    they see."""


def light_of_white(scene_model: SceneModel) -> tuple[FloatArray, FloatArray]:
    """Return direct and global light of white, (H, W) each, as the patches make it."""
    n_pixels, shape = scene_model.projector.lens.n_pixels, scene_model.camera.lens.shape
    transport = camera_view(scene_model.with_global_gain(1.0), np.ones(n_pixels, dtype=bool))
    white = np.ones(n_pixels)
    return (transport.direct @ white).reshape(shape), (transport.global_ @ white).reshape(shape)


def as_measured(scene_model: SceneModel, light: BandLight, lit: BoolArray, border: NDArray[np.float32]) -> WhiteLight:
    """Return a band's light of white such that the model gives what was measured.

    Along walls the ratio is smooth. Beside their edges and the picture's border, shares of neighbours tell little of a
    pixel, and what the blur makes of a place is uncertain: there both parts of its light are such that white comes out
    as it was measured. Beside the edges of things light differs from pixel to pixel: there each has its own two parts.

    Parameters
    ----------
    scene_model : SceneModel
        With the smoothed direct gain.
    light : BandLight
        As it was measured.
    lit : (H, W)
    border : (H, W)
        Share of white that a pixel sees, above 0.
    """
    direct, modelled = light_of_white(scene_model)
    face, gain = face_of_pixels(scene_model.camera_hits, lit.shape), scene_model.light.direct_gain
    known = lit & (modelled > 0)
    ratio = np.where(known, (light.white - direct) / np.where(known, modelled, 1.0), 1.0)
    # Beside the border what is missing of direct light is known to some of its per cent, which are all of global light.
    inside = border > WHOLE_WHITE
    ratio = np.where(lit, walls.smoothed_along_faces(ratio, lit, face, SMOOTHING_SHARE, told=inside), 1.0)
    whole = direct + ratio * modelled
    beside = known & (whole > 0) & walls.beside_edges(face, lit & inside)
    kept = np.where(
        beside, np.clip(light.white / np.where(beside, whole, 1.0), 1 / _MOST_RESCALED, _MOST_RESCALED), 1.0
    )
    own = beside & walls.beside_things(face, len(scene_model.walls)) & (light.direct > 0) & (direct > 0)
    more = np.where(own, light.direct / np.where(own, direct, 1.0), 1.0)
    own_ratio = np.where(own, (light.white - light.direct) / np.where(own, more * modelled, 1.0), ratio)
    own &= (own_ratio > 1 / _MOST_OWN) & (own_ratio < _MOST_OWN)
    return WhiteLight(
        gain=gain * np.where(own, more, kept),
        ratio=np.where(own, own_ratio, ratio),
        apart=np.where(own, np.minimum(np.abs(own_ratio / np.where(own, ratio, 1.0) - 1), 1.0), 0.0),
    )
