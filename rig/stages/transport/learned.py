"""What a session's photographs have taught of its light transport, ready to predict with."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.light.transport.low_rank import low_rank
from calibration.light.transport.posterior import Photographs, TransportPosterior, fitted
from calibration.light.transport.prior import TransportPrior
from rig.stages.maps.uncertainty import SPLIT_BIAS
from rig.stages.scene_model import LearnedLight, MeasuredLight, SceneModel, camera_view
from rig.stages.transport.places import WORTH, SurfacePlaces, places_of
from rig.stages.transport.prior import LitPatches, OpenWalls, prior_of
from sim.light.transport import LightTransport

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_MOST_RANK = 64
"""Pictures in which what was learned is kept."""
_WHOLE = 0.99
"""Of a pixel's direct light, what white makes of it away from the picture's border."""
_EDGES = 0.03
"""Of the light of pictures, what neighbouring patches have not in common."""
_MOST_CHANGE = 0.2
"""Of direct light, relative: more is no error of the split."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BandPrior:
    """What the model alone says of one band's light, in places."""

    scene_model: SceneModel
    transport: LightTransport
    """Of all projector pixels to the camera's."""
    places: SurfacePlaces
    lit: LitPatches
    prior: TransportPrior

    @property
    def pixels(self) -> int:
        """Of the projector."""
        return int(self.transport.shape[1])


def band_prior(
    scene_model: SceneModel, lit_pixels: BoolArray, *, relative_error: float, open_walls: OpenWalls
) -> BandPrior:
    """Return what a fitted scene says of places of its lit pixels (H, W)."""
    every = np.ones(scene_model.projector.lens.n_pixels, dtype=bool)
    transport = camera_view(scene_model, every)
    face = scene_model.camera_hits.hits.face.reshape(lit_pixels.shape)
    gain = scene_model.light.direct_gain
    # Beside the picture's border white lights a part of a pixel only: its direct light is extrapolated, and less sure.
    whole = (transport.direct @ np.ones(transport.shape[1])).reshape(gain.shape) > _WHOLE * gain
    places, lit = places_of(lit_pixels & whole, face), LitPatches.of(transport)
    direct = places.mean_of() @ gain.ravel()
    prior = prior_of(
        scene_model,
        transport,
        places,
        lit,
        relative_error=relative_error,
        own=SPLIT_BIAS * direct,
        open_walls=open_walls,
    )
    return BandPrior(scene_model=scene_model, transport=transport, places=places, lit=lit, prior=prior)


@dataclass(frozen=True, eq=False, kw_only=True)
class LearnedBand:
    """One band's light after the photographs."""

    scene_model: SceneModel
    """That predicts with what was learned."""
    places: SurfacePlaces
    lit: LitPatches
    posterior: TransportPosterior
    where: BoolArray
    """(H, W) lit pixels."""
    uneven: FloatArray
    """(H, W) relative standard deviation of global light within places, which photographs left."""

    def variance(self, light: FloatArray, direct: FloatArray, white_direct: FloatArray) -> FloatArray:
        """Return (H, W) variance of global light that is left.

        Of a picture's light (n pixels,), as a share of white's, and its direct light and white's (H, W).
        """
        means = self.places.mean_of()
        own = (means @ direct.ravel()) / np.maximum(means @ white_direct.ravel(), np.finfo(float).tiny)
        found = self.posterior.variance(self.lit.shares(light[:, None]), own[None])[0]
        return self.places.spread_out(found, self.where)


def learned_band(
    known: BandPrior, photographs: Photographs, where: BoolArray, uneven: FloatArray | None = None
) -> LearnedBand:
    """Return a band with what its photographs say of it, and leave open within places; None: that is not known yet."""
    places = known.places
    found = fitted(known.prior, photographs, places.alike(), WORTH)
    white = np.maximum(known.prior.white, np.finfo(float).tiny)
    kernel = known.prior.kernel
    # Pictures are as alike on neighbouring patches as errors are, but for their edges.
    pictures = kernel @ kernel.T + _EDGES * np.eye(len(kernel))
    few = low_rank(found.change / white[:, None], pictures, _MOST_RANK)
    shape = where.shape
    seen = (known.transport.global_ @ np.ones(known.pixels)).reshape(shape)
    by_pixel = np.stack([seen * places.spread_out(column, where) for column in few.by_place.T], axis=-1)
    learned = LearnedLight(by_pixel=by_pixel, by_patch=known.lit.by_emission(few.by_patch))
    scene_model = _with_direct_change(known, found, seen, where)
    return LearnedBand(
        scene_model=replace(scene_model, learned=learned),
        places=places,
        lit=known.lit,
        posterior=found,
        where=where,
        uneven=np.zeros(shape) if uneven is None else uneven,
    )


def _with_direct_change(
    known: BandPrior, found: TransportPosterior, white_global: FloatArray, where: BoolArray
) -> SceneModel:
    """The scene with direct light as the photographs have it, and so much less global light in white."""
    scene_model, places = known.scene_model, known.places
    direct = places.mean_of() @ scene_model.light.direct_gain.ravel()
    relative = found.direct_change / np.maximum(direct, np.finfo(float).tiny)
    change = places.spread_out(np.clip(relative, -_MOST_CHANGE, _MOST_CHANGE), where)
    gain = scene_model.light.direct_gain
    left = 1 - np.where(white_global > 0, gain * change / np.where(white_global > 0, white_global, 1.0), 0.0)
    # What a pixel sees of global light is told by its direct light: that goes up with the change, and this does not.
    ratio = scene_model.light.global_gain * np.maximum(left, 0.0) / (1 + change)
    measured = {pair: _changed(light, change, ratio) for pair, light in scene_model.measured.items()}
    return replace(scene_model, measured=measured)


def _changed(light: MeasuredLight, change: FloatArray, ratio: FloatArray) -> MeasuredLight:
    return replace(light, direct_gain=light.direct_gain * (1 + change), global_gain=ratio)
