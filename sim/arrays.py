"""The array types that annotations name: one alias for each kind of number."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
"""Numbers in double precision: lengths, light, factors."""
IntArray = NDArray[np.intp]
"""Indices of patches, faces, pixels."""
BoolArray = NDArray[np.bool_]
"""Yes or no for each patch, pixel or pair."""
CodeArray = NDArray[np.uint8]
"""Codes 0 ... 255 of pictures."""
