"""The native kernel, sim/kernel: arrays are contiguous, outputs are filled in place."""

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]
_Indices = NDArray[np.intp]


def level() -> str: ...
def best_level() -> str: ...
def set_level(name: str) -> None: ...
def threads() -> int: ...
def set_threads(n: int) -> None: ...

class Device:
    def __init__(
        self, width: int, height: int, lens: _Floats, rotation: _Floats, position: _Floats
    ) -> None: ...

class Tracer:
    def __init__(self, rectangles: _Floats, corners: _Floats, frames: _Floats) -> None: ...
    def trace(
        self,
        origins: _Floats,
        directions: _Floats,
        face: _Indices,
        patch: _Indices,
        distance: _Floats,
        uv: _Floats,
        cosine: _Floats,
    ) -> None: ...
    def blocked(self, start: _Floats, end: _Floats, stopped: NDArray[np.uint8]) -> None: ...
    def light(
        self,
        device: Device,
        picture: _Floats,
        reflectance: _Floats,
        areas: _Floats,
        subsamples: int,
        physical: bool,
        direct: _Floats,
        patch: NDArray[np.int32],
        place: _Floats,
        emission: _Floats,
    ) -> None: ...

def shade_constant(patch: NDArray[np.int32], value: _Floats, indirect: _Floats) -> None: ...
def shade_quadratic(
    patch: NDArray[np.int32], place: _Floats, coefficients: _Floats, indirect: _Floats
) -> None: ...
def shade_fan(
    patch: NDArray[np.int32], place: _Floats, corners: _Floats, values: _Floats, indirect: _Floats
) -> None: ...
def gather(
    tracer: Tracer,
    points: _Floats,
    normals: _Floats,
    vertices: _Floats,
    patch_normals: _Floats,
    radiosity: _Floats,
    shadows: bool,
    received: _Floats,
) -> None: ...
