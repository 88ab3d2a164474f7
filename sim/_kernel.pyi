"""The native kernel, sim/kernel: arrays are contiguous, outputs are filled in place."""

from typing import Any

from numpy import bool_, float64, int64
from numpy.typing import NDArray

def level() -> str: ...
def best_level() -> str: ...
def set_level(name: str) -> None: ...
def threads() -> int: ...
def set_threads(n: int) -> None: ...
def grid_form_factors(
    frames: NDArray[float64],
    counts: NDArray[int64],
    facing: NDArray[bool_],
    factors: NDArray[float64],
    row_sums: NDArray[float64],
) -> None: ...
def rectangle_exchange_areas(
    low: NDArray[float64],
    high: NDArray[float64],
    axis: NDArray[int64],
    sign: NDArray[float64],
    exchange: NDArray[float64],
) -> None: ...
def paper_exchange_areas(
    points: NDArray[float64],
    normals: NDArray[float64],
    offsets: NDArray[float64],
    areas: NDArray[float64],
    exchange: NDArray[float64],
) -> None: ...
def reciprocal_product(
    factors: NDArray[Any], areas: NDArray[float64], x: NDArray[float64], out: NDArray[float64]
) -> None: ...
def divide_rows(exchange: NDArray[float64], areas: NDArray[float64], row_sums: NDArray[float64]) -> None: ...
def polygon_exchange_areas(
    vertices: NDArray[float64], tolerance: float, highest_order: int, exchange: NDArray[float64]
) -> None: ...
def polygon_exchange_areas_of_pairs(
    vertices: NDArray[float64],
    first: NDArray[int64],
    second: NDArray[int64],
    tolerance: float,
    highest_order: int,
    exchange: NDArray[float64],
) -> None: ...
def visible_of_matrix(
    vertices: NDArray[float64],
    occluders: NDArray[float64],
    exchange: NDArray[float64],
    nodes: NDArray[float64],
    weights: NDArray[float64],
) -> tuple[NDArray[int64], NDArray[int64], NDArray[float64], int]: ...
def visible_of_pairs(
    vertices: NDArray[float64],
    occluders: NDArray[float64],
    first: NDArray[int64],
    second: NDArray[int64],
    nodes: NDArray[float64],
    weights: NDArray[float64],
    visible: NDArray[float64],
) -> int: ...
def segments_blocked(
    occluders: NDArray[float64], size: float, begin: NDArray[float64], end: NDArray[float64], blocked: NDArray[bool_]
) -> None: ...
