"""Which of two rooms explains the light better: one with what was seen to stand in it, or one where that goes on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.light.reflectance import ReflectanceFit
from calibration.light.vignetting import Vignetting
from rig.stages.light.fit import (
    BandLight,
    BareRoom,
    direct_gain,
    fit_lenses,
    fit_reflectance,
    pixels_that_tell,
)
from rig.stages.surface.standing import FoundStanding, StandingRecord

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_CLEARLY = 0.9
"""Of the global light that is left unexplained, what may be left at most with parts carried on that nobody saw: in the
simulated `l-room`, where parts go on, 0.3 to 0.7."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SplitLight:
    """The light of white as the camera sees it."""

    bands: list[BandLight]
    lit: BoolArray
    border: NDArray[np.float32]
    projector_xy_px: NDArray[np.float32]


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedRoom:
    """A room with what stands in it, and what its light was found to be."""

    standing: StandingRecord | None
    geometry: BareRoom
    gains: list[FloatArray]
    vignetting: Vignetting
    fits: list[ReflectanceFit]

    @property
    def unexplained(self) -> float:
        """Relative rms of global light."""
        return max(fit.global_rms for fit in self.fits)


def fitted_room(
    light: SplitLight, room: Callable[[StandingRecord | None], BareRoom], standing: StandingRecord | None
) -> FittedRoom:
    """Return what light does in a room with these things in it.

    Parameters
    ----------
    light
        That was measured.
    room
        Makes a room of what stands in it.
    standing
        That.
    """
    bare, lit, bands = room(standing), light.lit, light.bands
    gains = [direct_gain(one, lit, bare.camera_hits, light.border) for one in bands]
    inner = pixels_that_tell(bare, lit, light.projector_xy_px, light.border)
    vignetting = fit_lenses(bare, np.mean(gains, axis=0), inner)
    geometry = bare.with_vignetting(vignetting)
    fits = [fit_reflectance(geometry, gain, one, inner) for gain, one in zip(gains, bands, strict=True)]
    return FittedRoom(standing=standing, geometry=geometry, gains=gains, vignetting=vignetting, fits=fits)


def chosen_room(
    light: SplitLight, room: Callable[[StandingRecord | None], BareRoom], found: FoundStanding | None
) -> tuple[FittedRoom, tuple[FittedRoom, ...]]:
    """Return the room whose guesses of what nobody saw explain the light best, and those with other guesses of backs.

    Parameters
    ----------
    light
        That was measured.
    room
        Makes a room of what stands in it.
    found
        That; None in a box. There are no other guesses there, nor of a known mesh, which has backs of its own.
    """
    fitted = fitted_room(light, room, None if found is None else found.record)
    if found is None:
        return fitted, ()
    if found.carried_on is not None:
        fitted = better_explained(fitted, fitted_room(light, room, found.carried_on))
    standing = fitted.standing or found.record
    guesses = [fitted, *(fitted_room(light, room, other) for other in found.with_other_backs(standing))]
    # That a thing has depth is as likely beforehand as that it has none: the one that explains more is taken.
    taken = min(guesses, key=lambda one: one.unexplained)
    return taken, tuple(one for one in guesses if one is not taken)


def better_explained(seen: FittedRoom, guessed: FittedRoom) -> FittedRoom:
    """Return the room with what was guessed only if that explains the light better: nobody saw it."""
    return guessed if guessed.unexplained < _CLEARLY * seen.unexplained else seen
