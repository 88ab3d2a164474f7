"""The native kernel, sim/kernel: arrays are contiguous, outputs are filled in place."""

from typing import Any

from numpy import bool_, float32, float64, int32, int64, uint8, uint32
from numpy.typing import NDArray

def instruction_set() -> str: ...
def best_instruction_set() -> str: ...
def instruction_sets() -> list[str]: ...
def set_instruction_set(name: str) -> None: ...
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
def occupied_columns(factors: NDArray[Any]) -> tuple[NDArray[int64], NDArray[int64]]: ...
def reciprocal_product(
    factors: NDArray[Any],
    areas: NDArray[float64],
    starts: NDArray[int64],
    ranges: NDArray[int64],
    x: NDArray[float64],
    out: NDArray[float64],
) -> None: ...
def divide_rows(exchange: NDArray[float64], areas: NDArray[float64], row_sums: NDArray[float64]) -> None: ...

class Device:
    def __init__(
        self, width: int, height: int, lens: NDArray[float64], rotation: NDArray[float64], position: NDArray[float64]
    ) -> None: ...

class Tracer:
    def __init__(self, rectangles: NDArray[float64], corners: NDArray[float64], frames: NDArray[float64]) -> None: ...
    def trace(
        self,
        origins: NDArray[float64],
        directions: NDArray[float64],
        face: NDArray[int64],
        patch: NDArray[int64],
        distance: NDArray[float64],
        uv: NDArray[float64],
        cosine: NDArray[float64],
    ) -> None: ...
    def blocked(self, start: NDArray[float64], end: NDArray[float64], stopped: NDArray[uint8]) -> None: ...
    def light(
        self,
        device: Device,
        picture: NDArray[float64],
        reflectance: NDArray[float64],
        areas: NDArray[float64],
        subsamples: int,
        physical: bool,
        direct: NDArray[float64],
        patch: NDArray[int32],
        place: NDArray[float64],
        emission: NDArray[float64],
    ) -> None: ...

def shade_constant(patch: NDArray[int32], value: NDArray[float64], indirect: NDArray[float64]) -> None: ...
def shade_quadratic(
    patch: NDArray[int32], place: NDArray[float64], coefficients: NDArray[float64], indirect: NDArray[float64]
) -> None: ...
def shade_fan(
    patch: NDArray[int32],
    place: NDArray[float64],
    corners: NDArray[float64],
    values: NDArray[float64],
    indirect: NDArray[float64],
) -> None: ...
def gather(
    tracer: Tracer,
    points: NDArray[float64],
    normals: NDArray[float64],
    vertices: NDArray[float64],
    patch_normals: NDArray[float64],
    radiosity: NDArray[float64],
    shadows: bool,
    received: NDArray[float64],
) -> None: ...
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

class RayTree:
    """Which polygon each ray meets first: sim/kernel/sampling/bindings.cpp. Below 0: none, or -2 one from behind."""

    def __init__(self, corners: NDArray[float64]) -> None: ...
    def sample(self, rows: NDArray[int64], stream: int, first: int, met: NDArray[int32]) -> None: ...
    def moments(
        self,
        rows: NDArray[int64],
        stream: int,
        first: int,
        met: NDArray[int32],
        values: NDArray[float64],
        means: NDArray[float64],
    ) -> None: ...
    def gather(
        self,
        pieces: NDArray[float64],
        own: NDArray[int64],
        stream: int,
        count: int,
        light: NDArray[float64],
        means: NDArray[float64],
    ) -> None: ...
    def land(
        self,
        rows: NDArray[int64],
        stream: int,
        places: NDArray[float64],
        values: NDArray[float64],
        met: NDArray[int32],
        landed: NDArray[float64],
        has: NDArray[float64],
    ) -> None: ...
    def trace(
        self, origins: NDArray[float32], directions: NDArray[float32], met: NDArray[int32], at: NDArray[float32]
    ) -> None: ...

def sixteenths(
    vertices: NDArray[float64], corners: NDArray[float64], centres: NDArray[float64], areas: NDArray[float64]
) -> None: ...

class RayCounts:
    """What patches' rays have met, counted from both sides: sim/kernel/sampling/exchange.hpp."""

    def __init__(self, rows: list[NDArray[int64]], met: list[NDArray[int32]], patches: int) -> None: ...
    @property
    def entries(self) -> int: ...
    def weigh(
        self,
        density: NDArray[float64],
        starts: NDArray[int64],
        columns: NDArray[int32],
        values: NDArray[float64],
        by_others: NDArray[float64],
        hits: NDArray[float64],
    ) -> None: ...

def ray_means(met: NDArray[int32], values: NDArray[float64], means: NDArray[float64]) -> None: ...
def sparse_product(
    starts: NDArray[int32],
    columns: NDArray[int32],
    values: NDArray[float64],
    x: NDArray[float64],
    out: NDArray[float64],
) -> None: ...
def scale_both_sides(
    starts: NDArray[int32], columns: NDArray[int32], values: NDArray[float64], scale: NDArray[float64]
) -> None: ...

class CompressedMatrix:
    """Compressed exchange areas: sim/kernel/compressed/matrix.hpp."""

    def __init__(
        self,
        vertices: NDArray[float64],
        normals: NDArray[float64],
        areas: NDArray[float64],
        region: NDArray[int64],
        occluders: NDArray[float64],
        tolerance: float,
        leaf_size: int,
    ) -> None: ...
    def step(self, limit: int) -> float: ...
    def apply(self, x: NDArray[float64], y: NDArray[float64]) -> None: ...
    def exact_rows(self, rows: NDArray[int64], x: NDArray[float64], y: NDArray[float64]) -> None: ...
    def blocks(self) -> tuple[int, int, int, int]: ...
    def numbers(self) -> tuple[int, int, int, int]: ...

class FrameKernel:
    """A frame model's kernel: sim/kernel/frame/frame.cpp."""

    def __init__(
        self, model: object, response: NDArray[uint32], cubics: NDArray[float32], unmixing: NDArray[float64]
    ) -> None: ...
    def exact(self, codes: NDArray[uint8], out: NDArray[uint8], target: NDArray[float32], threads: int) -> int: ...
    def bounded(
        self,
        codes: NDArray[uint8],
        out: NDArray[uint8],
        target: NDArray[float32],
        steps: int,
        first_steps: int,
        fresh: bool,
        threads: int,
    ) -> tuple[int, float, int]: ...
