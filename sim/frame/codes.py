"""Codes of frames: which arrays the kernel takes, and the code that gives a wanted light."""

from __future__ import annotations

import numpy as np

from sim.arrays import CodeArray, FloatArray
from sim.errors import SimulationError
from sim.frame.model import CHANNELS, FrameModel


def checked_frame(model: FrameModel, codes: CodeArray, what: str = "frame") -> CodeArray:
    """Return the frame if the kernel can read, or write, it.

    Raises
    ------
    SimulationError
        If it is not (H, W, 3) uint8 in one piece, with the model's H and W.
    """
    wanted = (*model.shape, CHANNELS)
    if not isinstance(codes, np.ndarray) or codes.dtype != np.uint8:
        kind = getattr(codes, "dtype", type(codes).__name__)
        raise SimulationError(f"{what}: {kind} instead of uint8; give codes 0 ... 255")
    if codes.shape != wanted:
        raise SimulationError(f"{what} of shape {codes.shape}; the model's pictures are {wanted}")
    if not codes.flags.c_contiguous:
        raise SimulationError(f"{what}: strides {codes.strides} are not those of one piece; give a contiguous copy")
    return codes


def fractional_code(response: FloatArray, light: FloatArray) -> FloatArray:
    """Return the code, between two codes, of a wanted light: linear between them, clamped beyond the ends.

    Parameters
    ----------
    response : (256,) array
        Linear light of each code.
    light : array of any shape
        Wanted.

    Returns
    -------
    array
        Shaped as the light, in 0 ... 255.
    """
    highest = np.maximum.accumulate(response)
    rises = np.concatenate([[True], response[1:] > highest[:-1]])
    return np.asarray(np.interp(light, response[rises], np.flatnonzero(rises)))
