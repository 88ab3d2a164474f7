"""Which surfaces shine, as photographs of known pictures tell: for the report, with what they do not tell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.light.transport.gloss import FoundGloss, GlossSeen, found_gloss
from calibration.light.transport.posterior import Photographs
from rig.stages.transport.learned import BandPrior
from rig.stages.transport.prior import ways_of
from rig.stages.transport.records import SurfaceGloss

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

ROUGHNESSES = (0.05, 0.1, 0.2, 0.3, 0.45)
"""That are tried: a lobe of one is told from the next by its width, twice or half as wide."""
_EACH = 4
"""One of so many places is asked: a thousand say it as well as all."""
_ELSE = 0.02
"""Of white's global light, what the model may have wrong elsewise: patches leave so much in matte rooms."""
_OF_MODEL = 0.25
"""Of a gloss, relative: it is measured in the reflectance of a matte fit, and roughness in steps. In the simulated
glossy room the floor's came to 0.50 +- 0.03 of it where 0.37 was true."""
_SIGMAS, _MOST_OPEN = 3.0, 0.06
"""From how many standard deviations on something shines; and above which it is not known whether: a satin wall of
0.30 was found as 0.16 +- 0.13, and is not to be called matte."""
OTHER = "what stands before the walls"


def surface_gloss(band: BandPrior, photographs: Photographs) -> tuple[SurfaceGloss, ...]:
    """Return what photographs tell of the gloss of each wall, and of all that stands before them."""
    asked = np.arange(0, band.places.count, _EACH)
    prior, seen_of = band.prior.at(asked), photographs.at(asked)
    walls, scene = band.scene_model.walls, band.scene_model.scene
    hits = band.scene_model.camera_hits.hits
    first = np.unique(band.places.of_pixel.ravel(), return_index=True)[1][-band.places.count :]
    of_place, of_patch = (
        np.minimum(scene.region[patch], len(walls)) for patch in (hits.patch[first][asked], band.lit.patch)
    )
    surfaces = np.unique(np.concatenate([of_place, of_patch]))
    ways = ways_of(band.scene_model, band.transport, band.places, band.lit).at_places(asked)
    expected = prior.transport @ photographs.lit.T
    owners = (of_place, of_patch, surfaces)
    each = [
        _of_roughness(both, owners, photographs.lit, expected=expected, white=prior.white)
        for both in ways.shining(ROUGHNESSES)
    ]
    by_surface = np.stack(each, axis=1)
    sigma = np.sqrt(seen_of.variance + (_ELSE * prior.white) ** 2)
    found = found_gloss(GlossSeen(by_surface=by_surface, difference=seen_of.difference, sigma=sigma))
    names = [walls[number] if number < len(walls) else OTHER for number in surfaces]
    return tuple(_words(name, found, r) for r, name in enumerate(names))


def _of_roughness(
    shining: NDArray[np.float32],
    owners: tuple[IntArray, IntArray, IntArray],
    lit: FloatArray,
    *,
    expected: FloatArray,
    white: FloatArray,
) -> NDArray[np.float32]:
    """(R, K, N) what each surface's gloss makes of pictures, beside a model that is scaled to white."""
    of_place, of_patch, surfaces = owners
    mirrored, sent = shining
    share = expected / np.maximum(white, np.finfo(float).tiny)[:, None]
    found = []
    for number in surfaces:
        g = np.where((of_place == number)[:, None], mirrored, np.float32(0)) + np.where(
            (of_patch == number)[None], sent, np.float32(0)
        )
        found.append((g @ lit.T - g.sum(axis=1)[:, None] * share).T)
    return np.stack(found).astype(np.float32)


def _words(name: str, found: FoundGloss, r: int) -> SurfaceGloss:
    """One surface: beyond its own standard deviations it shines; where these are large nobody knows."""
    ratio, chance = float(found.ratio[r]), float(found.sigma[r])
    if not np.isfinite(chance):
        return SurfaceGloss(surface=name, says="not told")
    sigma = float(np.hypot(chance, _OF_MODEL * ratio))
    says = "shines" if ratio > _SIGMAS * chance else "not told" if sigma > _MOST_OPEN else "matte"
    last = len(ROUGHNESSES) - 1
    return SurfaceGloss(
        surface=name,
        says=says,
        ratio=ratio,
        sigma=sigma,
        roughness=ROUGHNESSES[found.roughness[r]],
        least_roughness=ROUGHNESSES[max(int(found.least_roughness[r]) - 1, 0)],
        most_roughness=ROUGHNESSES[min(int(found.most_roughness[r]) + 1, last)],
    )
