"""Names of the arrays that are handed around."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
Codes = NDArray[np.uint8]
"""(H, W), or (H, W, 3) in colour: a picture in projector codes, 0 to 255."""
Frame = NDArray[Any]
"""(H, W) numbers that rise with light: uint8, uint16 or floating. [dn]"""
