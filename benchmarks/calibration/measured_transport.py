"""Transport by photographs alone, by the model alone, by both, and by brute force, against a simulated world.

    rig model FOLDER -p sim-room          # a session of a simulated rig, up to its model
    python benchmarks/calibration/measured_transport.py FOLDER

Pictures are lit in the session's own simulated world, with twice the standard deviation of its camera's white, which
has more frames than a photograph. Errors are of means over places, on 24 pictures as people show them, in grey levels
of 255, noise-free. *Alone* knows how bright the global light of white is and what is lit, but not where light goes:
all patches count by the light that they send out. Brute force lights each of 48 blocks.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from calibration.light.transport.posterior import Photographs, TransportPosterior, fitted
from calibration.light.transport.prior import TransportPrior
from rig.devices.simulated.pair import SimulatedPair
from rig.devices.simulated.rigs import simulated_worlds_of
from rig.profile.schema import Profile
from rig.session import Session
from rig.stages.model import FittedScene, load_prior_model, transport_priors
from rig.stages.transport.learned import BandPrior
from rig.stages.transport.pictures import fixed_pictures, usual_pictures
from rig.stages.transport.places import WORTH

FloatArray = NDArray[np.float64]
Images = FloatArray
"""(n pixels, J) linear light, 1 is white."""

_NO_MODEL = 0.5
"""Relative error of light that is taken to go everywhere alike, to begin with."""
_ON_TOP = 32
_NOISE = 2.0
"""Standard deviations of white's mean that a photograph has."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Looked:
    """What pictures make at places: their light on patches, their direct light, and what the world makes of them."""

    lit: FloatArray
    """(J, L)"""
    own: FloatArray
    """(J, N) direct light as a share of white's."""
    direct: FloatArray
    """(J, N)"""
    total: FloatArray
    """(J, N) of the world, without noise."""


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("session", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tiles", type=int, default=1, help="only one of so many tiles of 8 x 8 places: quicker")
    wanted = parser.parse_args()
    profile = Profile.parse((wanted.session / "profile.toml").read_bytes(), wanted.session / "profile.toml")
    session = Session.read(wanted.session, profile)
    model, (band, *_), (world, *_) = load_prior_model(session), transport_priors(session), simulated_worlds_of(profile)
    shape, random = world.projector.shape, np.random.default_rng(wanted.seed)
    fixed = [each.image for each in fixed_pictures(shape)]
    blocks = sum(each.kind == "block" for each in fixed_pictures(shape))
    look = _eye(model, band, world)
    shown = look(np.stack([image.ravel() for image in fixed], axis=1).astype(np.float64))
    usual = look(usual_pictures(shape))
    sigma = _NOISE * np.sqrt(band.places.mean_of().power(2) @ model.white_variance[..., 0].ravel())
    photographed = replace(shown, total=shown.total + random.normal(size=shown.total.shape) * sigma)
    some = np.concatenate([np.arange(blocks, len(fixed)), np.linspace(0, blocks - 1, _ON_TOP + blocks - len(fixed))])
    nothing = _without_model(band)
    fits = {
        "the model alone": (band.prior, np.zeros(0, dtype=int)),
        f"{_ON_TOP} photographs on top of it": (band.prior, some.astype(int)),
        f"{len(fixed)} photographs alone": (nothing, np.arange(len(fixed))),
        "nothing but white": (nothing, np.zeros(0, dtype=int)),
    }
    to_levels = 255 / model.level
    print(f"{band.places.count} places, {shown.lit.shape[1]} lit patches; noise of a photograph at a place: "
          f"{to_levels * float(np.sqrt((sigma**2).mean())):.3f}")  # fmt: skip
    print(f"{'':36}{'usual pictures':>16}{'blocks':>10}")
    tile = (band.places.centre[:, :2] // 8).astype(int) @ np.array([1, 3])
    some_places = np.flatnonzero(tile % wanted.tiles == 0)
    alike = band.places.alike()[some_places][:, some_places]
    alike = csr_array(diags_array(1 / alike.sum(axis=1)) @ alike)
    usual, shown_blocks = (_of_places(each, some_places) for each in (usual, _at(shown, np.arange(blocks))))
    for name, (prior, chosen) in fits.items():
        evidence = _evidence(prior, photographed, chosen, sigma)
        found = fitted(prior.at(some_places), evidence.at(some_places), alike, WORTH)
        errors = [to_levels * _rms(found, each) for each in (usual, shown_blocks)]
        print(f"{name:36}{errors[0]:16.3f}{errors[1]:10.3f}", flush=True)
    return 0


def _eye(model: FittedScene, band: BandPrior, world: SimulatedPair) -> Callable[[Images], Looked]:
    """What looks at pictures in the world; of direct light it knows all, for that is measured elsewhere."""
    means, shape = band.places.mean_of(), world.projector.shape

    def in_world(image: FloatArray) -> tuple[FloatArray, FloatArray]:
        """All light, and the direct part of it."""
        light = world.light_of(image.reshape(shape).astype(np.float32))
        parts = (np.asarray(one * world.vignetting, dtype=np.float64) for one in (light.direct, light.global_))
        direct, global_ = parts
        return direct + global_, direct

    white, white_direct = in_world(np.ones(shape[0] * shape[1]))
    unit = float(model.white[..., 0][model.lit].mean() / white[model.lit].mean())
    # White is what the model is scaled to, noise and all: what it is off by at a pixel is no error of transport.
    own_white = np.asarray(means @ model.white[..., 0].ravel()) / np.asarray(means @ (unit * white).ravel())
    scale = unit * own_white
    of_white = scale * (means @ white_direct.ravel())

    def look(images: Images) -> Looked:
        both = np.stack([[scale * (means @ one.ravel()) for one in in_world(image)] for image in images.T])
        total, direct = both[:, 0], both[:, 1]
        own = direct / np.maximum(of_white, np.finfo(float).tiny)
        return Looked(lit=band.lit.shares(images), own=own, direct=direct, total=total)

    return look


def _without_model(band: BandPrior) -> TransportPrior:
    """White's global light, from all patches by what they send out."""
    prior, patch = band.prior, band.lit.patch
    power = band.lit.white[patch] * band.scene_model.scene.areas[patch]
    even = prior.white[:, None] * power / power.sum()
    places, patches = even.shape
    # Without lobes, and without anything that a fit of the room left open.
    return replace(
        prior,
        transport=even,
        base=even,
        spread=np.full(places, _NO_MODEL),
        lobes=np.zeros((places, 0, patches)),
        left=np.zeros((places, 0)),
        right=np.zeros((0, patches)),
    )


def _at(looked: Looked, chosen: NDArray[np.intp]) -> Looked:
    return Looked(**{name: getattr(looked, name)[chosen] for name in ("lit", "own", "direct", "total")})


def _of_places(looked: Looked, places: NDArray[np.intp]) -> Looked:
    parts = {name: getattr(looked, name)[:, places] for name in ("own", "direct", "total")}
    return replace(looked, **parts)


def _evidence(prior: TransportPrior, shown: Looked, chosen: NDArray[np.intp], sigma: FloatArray) -> Photographs:
    some = _at(shown, chosen)
    return Photographs(
        lit=some.lit,
        own=some.own,
        difference=some.total - some.direct - some.lit @ prior.transport.T,
        variance=np.repeat(sigma[None] ** 2, len(chosen), axis=0) + (1e-3 * some.total) ** 2,
    )


def _rms(found: TransportPosterior, seen: Looked) -> float:
    expected = seen.direct + seen.lit @ found.prior.transport.T + found.expected(seen.lit, seen.own)
    return float(np.sqrt(((seen.total - expected) ** 2).mean()))


if __name__ == "__main__":
    sys.exit(main())
