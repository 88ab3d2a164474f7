"""Small tables that the frame kernel reads instead of computing."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.frame.codes import fractional_code
from sim.frame.model import CHANNELS, FrameModel

OCTAVES, STEPS = 15, 128
"""Octaves of light that the table covers, and entries in each."""
TOE = 2.0**-OCTAVES
"""Added to a share of the span, so that black has an octave too."""
HALVES = 32
"""Halves of octaves that cubics are for, 31 of them in use."""
CUBICS_OFF_CODES = 0.1
"""Cubics may be off the response by this much, in codes ..."""
DARKEST_OFF_CODES = 0.5
"""... and in the first half of an octave, within 2⁻¹⁶ of the span from black, by this much."""

_NODES = (1 - np.cos(np.pi * np.arange(65) / 64)) / 2
"""Places in a half of an octave, its ends among them."""
_HIGHEST = 255.0


def response_tables(model: FrameModel) -> NDArray[np.uint32]:
    """Return (3, 1922), or (1, 1922) for channels alike: code and step to the next, 16 bits each, in 256ths.

    Entries lie at shares of the span that, with 2⁻¹⁵ added, part each octave into 128: fine where codes are dark,
    and nowhere further than 1/128 of the light apart.
    """
    octave, step = np.divmod(np.arange(OCTAVES * STEPS + 3), STEPS)
    share = TOE * (2.0**octave * (1 + step / STEPS) - 1)
    return np.stack([_table(response, share) for response in _responses(model)])


def response_cubics(model: FrameModel) -> NDArray[np.float32]:
    """Return (3, 4, 32), or (1, 4, 32) for channels alike: coefficients of powers of share + 2⁻¹⁵ by half octave.

    They give the code by four look-ups within registers where the table takes one in memory. No layers, (0, 4, 32),
    where a response is too uneven for them.
    """
    cubics = [_cubics(response) for response in _responses(model)]
    found = [each for each in cubics if each is not None]
    return np.asarray(found if len(found) == len(cubics) else np.zeros((0, 4, HALVES)), dtype=np.float32)


def _responses(model: FrameModel) -> FloatArray:
    alike = bool((model.response == model.response[0]).all())
    return model.response[: 1 if alike else CHANNELS]


def _cubics(response: FloatArray) -> FloatArray | None:
    """(4, 32) coefficients, or None if they are not near enough."""
    cubics = np.zeros((4, HALVES))
    octave, half = np.divmod(np.arange(2 * OCTAVES + 2), 2)
    bounds = TOE * 2.0**octave * (1 + half / 2)
    for part, (low, high) in enumerate(pairwise(bounds[:-1])):
        x = low + (high - low) * _NODES
        code = fractional_code(response, (x - TOE) * response[-1])
        fitted = Chebyshev.fit(x, code, 3, domain=[low, high])
        # Black is code 0 whatever dither adds, and no code is above the highest.
        fitted -= fitted(low) if part == 0 else max(0.0, float(fitted(x).max()) - _HIGHEST)
        off = float(np.abs(fitted(x) - code).max())
        if off > (DARKEST_OFF_CODES if part == 0 else CUBICS_OFF_CODES):
            return None
        powers = fitted.convert(kind=Polynomial).coef
        cubics[: len(powers), part] = powers
    cubics[0, 2 * OCTAVES] = _HIGHEST
    return cubics


def _table(response: FloatArray, share: FloatArray) -> NDArray[np.uint32]:
    code = np.rint(256 * fractional_code(response, share * response[-1])).astype(np.uint32)
    return np.asarray((code[:-1] << 16) | np.diff(code), dtype=np.uint32)


def target_table(model: FrameModel, gain: float) -> NDArray[np.float32]:
    """Return (3, 256) camera value that each code of a target asks for."""
    return np.asarray(gain * model.target_scale[:, None] * model.eotf, dtype=np.float32)
