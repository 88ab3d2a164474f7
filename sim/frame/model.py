"""What the frame kernel knows of a room: a light transport cut into runs of pixels, and everything around it.

With q = K p the light of the projector in the camera's bands, c_b = D q_b + V H S q_b + black_b
(sim.light.transport, sim.light.interreflection_operator). A frame's wish t asks for
q_b = (t - black_b) / D - (V / D) r_b with r_b = M S D⁻¹ (t - black_b) and M = (I + H S D⁻¹ V)⁻¹ H (Woodbury's identity,
as in sim.compensation.strategies.exact). M is dense and of patch size; the rest is arithmetic a pixel. Two
simplifications make pixels independent of one another: a pixel lights one patch only (its light on the others is moved
there, power kept), and V is bilinear between the same four patches over a run. On a mesh these four, then three, are
nodes, means of the patches about a corner or patches themselves (sim.light.mesh_view): V = W N. M and N are kept, not
N M: there are more nodes than patches, and M is what a frame reads most of beside the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array, eye_array

from sim.arrays import BoolArray, CodeArray, FloatArray, IntArray
from sim.errors import SimulationError
from sim.frame.band import BandOfPixels, band_of_pixels, inverse_of_sums
from sim.frame.packed import Packed, PackedRows, packed, packed_rows
from sim.frame.runs import BilinearCells, CellView, NodeMeans, Runs, cells_of, runs_of
from sim.light.colour import ColourTransport
from sim.light.gloss.transport import GlossyTransport
from sim.light.mesh_view import NodeView
from sim.light.transport import LightTransport

CHANNELS = 3
DITHER_PX = 64
"""Side of the dither pattern, which repeats over the picture. [px]"""
ROWS_OF_A_SUM = 14
"""A patch of mean size has no fewer rows in its sum than this, or all."""
ONE_LAYER = 2e-3
"""Bands whose geometry differs by less than this share use one layer for it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameModel:
    """All that turns a frame's codes into the projector's; bands are 3, layers 1 (for all bands) or 3."""

    shape: tuple[int, int]
    """(H, W) of target and projector [px]."""
    inverse_direct: Packed
    """1 / D; 0 for pixels that stay black."""
    offset: Packed
    """black / D."""
    view_gain: Packed
    """Camera value of unit irradiance from all patches at a pixel, over D."""
    sum_rows: NDArray[np.int32]
    """(R,) rows that sums over patches are taken from: all, or one of each two to four by a fixed pattern, and of
    patches that have none of these."""
    row_scale: FloatArray
    """(L,) emission from all rows over that from these rows, for even light."""
    emission: Packed
    """Emission of a pixel's patch by unit light of the pixel, in the first band: one layer."""
    patch_runs: Runs
    """Pixels of a row that light the same patch."""
    cells: BilinearCells
    """Pixels of a row that see the same four patches, and where between them."""
    nodes: NodeMeans
    """Of the viewed patches' irradiance: what the cells' corners have."""
    inverse: PackedRows
    """(layers, V, L) from S D⁻¹ (t - black), emission as of the first band, to irradiance of the viewed patches."""
    curvature: FloatArray
    """(layers, L) S D⁻² Sᵀ, emission as of the first band."""
    black_emission: FloatArray
    """(3, L) S D⁻¹ black."""
    mixing: FloatArray
    """(3, 3) K[band, channel]."""
    target_scale: FloatArray
    """(3,) camera value of a target's full scale."""
    eotf: FloatArray
    """(256,) linear light of a target's codes; 1 is full scale."""
    response: FloatArray
    """(3, 256) linear light of the projector's codes, a channel each."""
    dither: CodeArray
    """(3, 64, 64) share of a code, in 256ths, that is added before rounding down: 128 rounds to the nearest."""
    learned_left_out: float = 0.0
    """Share, rms, of what photographs taught of the light that patches cannot show."""

    @property
    def n_lit(self) -> int:
        """Patches that the projector lights, L."""
        return int(self.inverse.entries.shape[2])

    @property
    def active(self) -> BoolArray:
        """(H, W) pixels that are steered."""
        return np.asarray(self.inverse_direct.bits[0] > 0)


def frame_model(
    transport: LightTransport | ColourTransport,
    shape: tuple[int, int],
    active: ArrayLike | None = None,
    *,
    target_scale: ArrayLike = 1.0,
    black: ArrayLike = 0.0,
    eotf: ArrayLike | None = None,
    response: ArrayLike | None = None,
    dither_seed: int | None = None,
    node_view: NodeView | None = None,
) -> FrameModel:
    """Return a transport prepared for frames.

    Parameters
    ----------
    transport : LightTransport or ColourTransport
        Of the projector's view: square, D diagonal; its pixels are the active ones, row by row. A grey transport
        serves all three bands.
    shape : (int, int)
        (H, W) of target and projector. [px]
    active : (H, W) bool array, optional
        Pixels of the transport; the others stay at code 0. Default: all.
    target_scale : float or (3,) array
        Camera value that a target's full scale stands for.
    black : float or (n active,) or (n active, 3) array
        Camera value while the projector shows black: ambient light and the projector's own.
    eotf : (256,) array, optional
        Linear light of a target's codes, 1 = full scale. Default: code / 255.
    response : (256,) or (3, 256) array, optional
        Linear light above black of the projector's codes, rising. Default: code / 255.
    dither_seed : int, optional
        Round to one of the two nearest codes by a fixed pattern, so that means are right. Default: to the nearest.
    node_view : NodeView, optional
        Of the transport's pixels on a mesh: what its view is, in two steps. Default: pixels see four patches at most.

    Returns
    -------
    FrameModel

    Raises
    ------
    SimulationError
        For arrays that do not fit one another, a view of more than four patches a pixel, a mixing without inverse.
    """
    bands, mixing = _bands_of(transport)
    places = _places(shape, active, bands[0].shape[1])
    black_of = _black(black, len(places))
    light = [band_of_pixels(band) for band in bands]
    patch, emission, share = _emission(light)
    cells, nodes = _cells(light[0].transport, node_view, places, shape)
    gain, gain_share = _one_layer([band.view_gain for band in light])
    black_over_direct = [light[k % len(light)].inverse * black_of[:, k] for k in range(CHANNELS)]
    lit = np.unique(patch[emission > 0])
    index = np.minimum(np.searchsorted(lit, patch), len(lit) - 1)
    sums = csr_array((emission, (index, np.arange(len(places)))), shape=(len(lit), len(places)))
    viewed = np.unique(np.concatenate([nodes.indices, *(csr_array(band.transport.view).indices for band in light)]))
    inverse = [
        inverse_of_sums(band, sums, lit, viewed, share=share[k][lit], gain_ratio=gain_share[k])
        for k, band in enumerate(light)
    ]
    curvature = np.stack([sums.power(2) @ band.inverse**2 for band in light])
    seen_black = np.stack([sums @ row for row in black_over_direct])
    rows, scale = _sum_rows(shape, places, index, emission, n_lit=len(lit))
    image = _Image(places, shape)
    return FrameModel(
        shape=shape,
        inverse_direct=image.packed([band.inverse for band in light]),
        offset=image.packed(black_over_direct if black_of.any() else [np.zeros(len(places))]),
        view_gain=image.packed(gain),
        sum_rows=rows,
        row_scale=scale,
        emission=image.packed([emission]),
        patch_runs=runs_of(index, places, shape),
        cells=cells.cells,
        nodes=NodeMeans.of_matrix(nodes[:, viewed]),
        inverse=packed_rows(np.stack(inverse)),
        curvature=curvature,
        black_emission=seen_black,
        mixing=mixing,
        target_scale=_scale(target_scale),
        eotf=_table("eotf", eotf, (256,)),
        response=_response(response),
        dither=_dither(dither_seed),
        learned_left_out=max(band.known.left_out for band in light),
    )


@dataclass(frozen=True)
class _Image:
    """Puts values of the active pixels into the whole picture."""

    places: IntArray
    shape: tuple[int, int]

    def packed(self, layers: Sequence[FloatArray]) -> Packed:
        whole = np.zeros((len(layers), self.shape[0] * self.shape[1]))
        whole[:, self.places] = np.stack(layers)
        return packed(whole.reshape(len(layers), *self.shape))


def _cells(
    band: LightTransport, view: NodeView | None, places: IntArray, shape: tuple[int, int]
) -> tuple[CellView, csr_array]:
    """Between what each pixel looks, and (W, P) weights with which patches make that."""
    if view is None:
        cells = cells_of(band.view, band.radiosity.reflectance, places, shape)
        return cells, csr_array(eye_array(band.radiosity.n_patches).tocsr()[cells.viewed])
    if view.weights.shape[0] != len(places) or view.nodes.shape[1] != band.radiosity.n_patches:
        raise SimulationError(
            f"frame model: a view of {view.weights.shape[0]} pixels and {view.nodes.shape[1]} patches for a transport "
            f"of {len(places)} and {band.radiosity.n_patches}; give that of the transport's own pixels"
        )
    cells = cells_of(view.weights, np.ones(view.weights.shape[1]), places, shape)
    return cells, csr_array(view.nodes[cells.viewed])


def _bands_of(transport: LightTransport | ColourTransport) -> tuple[Sequence[LightTransport], FloatArray]:
    bands = (transport,) if isinstance(transport, LightTransport) else transport.bands
    if any(isinstance(band, GlossyTransport) for band in bands):
        raise SimulationError(
            "frame model: frames know matte patches only, this transport has gloss; use compensate for single pictures"
        )
    if isinstance(transport, LightTransport):
        return (transport,), np.eye(CHANNELS)
    mixing = np.asarray(transport.mixing, dtype=np.float64)
    if len(transport.bands) != CHANNELS or mixing.shape != (CHANNELS, CHANNELS):
        raise SimulationError(
            f"frame model: {len(transport.bands)} bands, mixing of shape {mixing.shape}; frames have {CHANNELS} of each"
        )
    condition = float(np.linalg.cond(mixing))
    if not condition < 1e6:
        raise SimulationError(f"frame model: colour mixing of condition {condition:.3g}; below 1e6 it can be undone")
    return transport.bands, mixing


def _places(shape: tuple[int, int], active: ArrayLike | None, n: int) -> IntArray:
    chosen = np.ones(shape, dtype=bool) if active is None else np.asarray(active, dtype=bool)
    if chosen.size != shape[0] * shape[1] or int(chosen.sum()) != n:
        raise SimulationError(
            f"frame model: {int(chosen.sum())} of {chosen.size} pixels active for a picture of {shape[0]} x {shape[1]} "
            f"and a transport of {n} pixels; give the mask that the transport was cut with"
        )
    return np.flatnonzero(chosen.ravel())


def _black(black: ArrayLike, n: int) -> FloatArray:
    values = np.asarray(black, dtype=np.float64)
    if values.ndim == 1 and len(values) == n:
        values = values[:, None]
    try:
        whole = np.broadcast_to(values, (n, CHANNELS))
    except ValueError as error:
        raise SimulationError(
            f"frame model: black of shape {values.shape}; one number, ({n},) or ({n}, {CHANNELS})"
        ) from error
    if not (np.isfinite(whole).all() and whole.min() >= 0):
        raise SimulationError(
            f"frame model: black {whole.min():g} ... {whole.max():g}; it must be finite and 0 or more"
        )
    return whole


def _scale(target_scale: ArrayLike) -> FloatArray:
    scale = np.asarray(target_scale, dtype=np.float64)
    if scale.shape not in ((), (CHANNELS,)) or not (np.isfinite(scale).all() and scale.min() > 0):
        raise SimulationError(f"frame model: target scale {scale}; one number above 0, or one a band")
    return np.broadcast_to(scale, (CHANNELS,)).copy()


def _table(name: str, table: ArrayLike | None, shape: tuple[int, ...]) -> FloatArray:
    values = np.arange(256) / 255 if table is None else np.asarray(table, dtype=np.float64)
    if values.shape not in (shape, (256,)):
        raise SimulationError(f"frame model: {name} of shape {values.shape}; one value a code: {shape}")
    whole = np.broadcast_to(values, shape).copy()
    rising = (np.diff(whole) >= 0).all() and (whole[..., -1] > whole[..., 0]).all()
    if not (np.isfinite(whole).all() and rising and whole.min() >= 0):
        raise SimulationError(f"frame model: {name} must be finite, rise with the code, and not be below 0")
    return whole


def _response(response: ArrayLike | None) -> FloatArray:
    table = _table("response", response, (CHANNELS, 256))
    if table[:, 0].any():
        raise SimulationError(
            f"frame model: response begins at {table[:, 0].max():g}; it counts from the projector's black: begin at 0"
        )
    return table


def _dither(seed: int | None) -> CodeArray:
    """Every 256th share equally often in each channel's tile."""
    shape = (CHANNELS, DITHER_PX, DITHER_PX)
    if seed is None:
        return np.full(shape, 128, dtype=np.uint8)
    generator = np.random.default_rng(seed)
    every = np.arange(DITHER_PX**2) % 256
    tiles = [generator.permutation(every) for _ in range(CHANNELS)]
    return np.stack(tiles).reshape(shape).astype(np.uint8)


def _emission(light: Sequence[BandOfPixels]) -> tuple[IntArray, FloatArray, list[FloatArray]]:
    """The patch that each pixel lights, how much in the first band, and per patch how much in each band."""
    patch, first = _main_patch(light[0])
    n = light[0].transport.radiosity.n_patches
    shares = []
    for band in light:
        per_pixel = _power(band) * _per_power(band)[patch]
        total = np.bincount(patch, per_pixel * first, n)
        shares.append(np.divide(total, np.bincount(patch, first**2, n), out=np.ones(n), where=total > 0))
    return patch, first, shares


def _per_power(band: BandOfPixels) -> FloatArray:
    """(P,) emission of a patch by unit power that arrives there."""
    radiosity = band.transport.radiosity
    return np.asarray(radiosity.reflectance / radiosity.form_factors.areas)


def _power(band: BandOfPixels) -> FloatArray:
    """(n,) power that each pixel sends onto patches that are not black."""
    per_power = _per_power(band)
    weight = np.divide(1.0, per_power, out=np.zeros_like(per_power), where=per_power > 0)
    return np.asarray(band.transport.emission.T @ weight)


def _main_patch(band: BandOfPixels) -> tuple[IntArray, FloatArray]:
    """(n,) patch that takes most of each pixel's power, and its emission if it takes all of it."""
    emission = band.transport.emission.tocsc()
    per_power = _per_power(band)
    entry = emission.data / np.where(per_power[emission.indices] > 0, per_power[emission.indices], np.inf)
    pixel = np.repeat(np.arange(emission.shape[1]), np.diff(emission.indptr))
    most = np.zeros(emission.shape[1])
    np.maximum.at(most, pixel, entry)
    patch = np.zeros(emission.shape[1], dtype=np.intp)
    chosen = entry >= most[pixel]
    patch[pixel[chosen]] = emission.indices[chosen]
    return patch, _power(band) * per_power[patch]


def _sum_rows(
    shape: tuple[int, int], places: IntArray, index: IntArray, emission: FloatArray, *, n_lit: int
) -> tuple[NDArray[np.int32], FloatArray]:
    """Rows for sums over patches, and what the left-out ones are made up for with.

    One row of each group, by the ones in the group's binary number (as Thue and Morse): no picture's stripes repeat
    like that. A patch that has none of these rows, a small one, adds the first of its own: its light would be nowhere.
    """
    step = int(np.clip(np.sqrt(len(places) / n_lit) / ROWS_OF_A_SUM, 1, 4))
    groups = np.arange(shape[0] // step)
    rows = groups * step + np.bitwise_count(groups) % step
    row, some = places // shape[1], np.flatnonzero(emission > 0)
    first_of = np.full(n_lit, shape[0])
    np.minimum.at(first_of, index[some], row[some])
    missed = np.setdiff1d(index[some], index[some[np.isin(row[some], rows)]])
    rows = np.union1d(rows, first_of[missed])
    taken = np.isin(row, rows)
    whole, part = (np.bincount(index[some], emission[some], n_lit) for some in (slice(None), taken))
    scale = np.divide(whole, part, out=np.zeros(n_lit), where=part > 0)
    return rows.astype(np.int32), scale


def _one_layer(layers: Sequence[FloatArray]) -> tuple[list[FloatArray], list[float]]:
    """The layers and (1, 1, 1), or the first and each one's ratio to it if that is nearly the same everywhere."""
    first = layers[0]
    some = first > 0
    ratios = [float(np.median(layer[some] / first[some])) if some.any() else 1.0 for layer in layers]
    for layer, ratio in zip(layers, ratios, strict=True):
        if np.abs(layer - ratio * first).max() > ONE_LAYER * ratio * first.max():
            return list(layers), [1.0] * len(layers)
    return [first], ratios
