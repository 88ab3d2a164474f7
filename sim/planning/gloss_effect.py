"""Whether matte patches are enough where surfaces are glossy: by how much they would be wrong.

Matte patches that send back as much of even light as the glossy ones, ρ + ρ_s ā(α), are the best that a matte model can
be told. By how much it would be wrong shows in three figures, each an RMS over the surface in parts of white: what
other surfaces send (between), how it is seen from anywhere in the room (seen), and the lamp's own highlights
(highlight); the latter two also over all directions from which a place can be seen, as many as their cosine.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.light.gloss.walks import GlossySurface
from sim.light.lighting import Lighting
from sim.planning.gloss import GlossySimulation
from sim.planning.gloss_places import places_on

ALL_POINTS, FEWEST_POINTS = 1 << 16, 4
"""On all glossy patches together, and on each where these are many; each with a direction from which it is seen."""


@dataclass(frozen=True, kw_only=True)
class GlossEffect:
    """What matte patches would be wrong by; RMS, 1 = white."""

    area_share: float
    """Of the surface, that is glossy."""
    between: float
    """Of what patches send back of each other's light, in all."""
    seen: float
    """Of that as it is seen: gloss shows an image of the room."""
    highlight: float
    """Of the lamp's light that is reflected once."""

    @property
    def largest(self) -> float:
        """The largest of the three."""
        return max(self.between, self.seen, self.highlight)


def gloss_effect(glossy: GlossySimulation, light: Lighting, *, seed: int = 0) -> GlossEffect:
    """Return by how much matte patches would be wrong, in the brightest colour.

    Parameters
    ----------
    glossy : GlossySimulation
    light : Lighting
        That it was made for.
    seed : int
        Another one for other rays.

    Returns
    -------
    GlossEffect
    """
    cells, gloss = glossy.matte.cells, glossy.gloss
    difference = glossy.irradiance[:, 0] - glossy.matte.irradiance[:, 0]
    seen = (glossy.reflectance[:, 0] * difference) ** 2
    highlight = np.zeros(cells.n_patches)
    on = np.flatnonzero(gloss.glossy)
    if len(on):
        places = places_on(
            GlossySurface.of(replace(cells, reflectance=glossy.reflectance[:, 0]), gloss),
            max(FEWEST_POINTS, ALL_POINTS // len(on)),
            seed,
        )
        seen[on] = np.maximum(places.seen_error(*_known(glossy), light), 0.0)
        highlight[on] = places.highlight_error(light)
    return GlossEffect(
        area_share=float(cells.areas[on].sum() / cells.areas.sum()),
        between=_rms(cells, (glossy.matte.reflectance[:, 0] * difference) ** 2),
        seen=_rms(cells, seen),
        highlight=_rms(cells, highlight),
    )


def _rms(cells: AdaptivePatches, squared: FloatArray) -> float:
    return float(np.sqrt(cells.areas @ squared / cells.areas.sum()))


def _known(glossy: GlossySimulation) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(P,) of the brightest colour: what patches send back of others' light, if all are matte, and of the lamp's."""
    rho, everything = glossy.reflectance[:, 0], glossy.matte.reflectance[:, 0]
    return rho * glossy.irradiance[:, 0], everything * glossy.matte.irradiance[:, 0], everything
