"""Small tables that the frame kernel reads instead of computing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.frame_model import CHANNELS, FrameModel
from sim.frame_reference import fractional_code
from sim.scene import FloatArray

OCTAVES, STEPS = 14, 128
TOE = 2.0**-OCTAVES


def response_tables(model: FrameModel) -> NDArray[np.uint32]:
    """(3, 1794), or (1, 1794) for channels alike: code and step to the next entry, 16 bits each, in 256ths of a code.

    Entries lie at shares of the span that, with 2⁻¹⁴ added, part each octave into 128: fine where codes are dark,
    and nowhere further than 1/128 of the light apart.
    """
    octave, step = np.divmod(np.arange(OCTAVES * STEPS + 3), STEPS)
    share = TOE * (2.0**octave * (1 + step / STEPS) - 1)
    alike = bool((model.response == model.response[0]).all())
    return np.stack([_table(model.response[channel], share) for channel in range(1 if alike else CHANNELS)])


def _table(response: FloatArray, share: FloatArray) -> NDArray[np.uint32]:
    code = np.rint(256 * fractional_code(response, share * response[-1])).astype(np.uint32)
    return np.asarray((code[:-1] << 16) | np.diff(code), dtype=np.uint32)


def target_table(model: FrameModel, gain: float) -> NDArray[np.float32]:
    """(3, 256) camera value that each code of a target asks for."""
    return np.asarray(gain * model.target_scale[:, None] * model.eotf, dtype=np.float32)
