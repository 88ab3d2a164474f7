"""Coverage, pixel density, brightness and contrast of a lit room, by surface and in all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.plan.light import LitRoom
from rig.plan.records import ContrastSteps, PlanTotals, SurfaceLight

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LEAST = 0.05
"""Share of the area whose value is called the least: single pixels at a rim do not decide."""
FIELDS = 4
"""Of the checker, along each side, as in ANSI/NAPM IT7.228's contrast."""


def quantile(values: FloatArray, weights: FloatArray, share: float) -> float:
    """Return the value below which a share of the weight lies; 0 for none."""
    if not values.size or weights.sum() <= 0:
        return 0.0
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][min(np.searchsorted(below, share * below[-1]), len(values) - 1)])


def weighted_mean(values: FloatArray, weights: FloatArray) -> float:
    """Return the weighted mean; 0 for no weight."""
    total = float(weights.sum())
    return float((values * weights).sum()) / total if total > 0 else 0.0


def px_per_m(lit: LitRoom) -> FloatArray:
    """Return (n,) the projector's own pixels a metre at each computed pixel; 0 where it meets no surface."""
    finer = lit.joined.spread([one.finer for one in lit.views])
    area = np.concatenate([one.footprints_m2 for one in lit.views])
    return np.asarray(np.sqrt(np.divide(finer, area, out=np.zeros_like(area), where=area > 0)))


def surface_lights(lit: LitRoom) -> tuple[SurfaceLight, ...]:
    """Return each surface's light while the projector shows white."""
    room = lit.room
    n = lit.n_pixels
    direct, indirect = (room.mean(lux) for lux in lit.patch_lux(1.0))
    own = room.own_exitance
    ambient = room.mean((lit.ambient_exitance - own) / room.surface.reflectance)
    of_patch = white_of_patches(lit), black_of_patches(lit)
    seen = np.stack([lit.luminance(np.ones(n)), lit.luminance(np.full(n, lit.black)), px_per_m(lit)])
    global_ = lit.from_units(np.asarray(lit.transport.global_ @ lit.even(1.0)))
    of_pixel = np.where(lit.lit, room.shape.surface_of[lit.hits.patch], -1)
    lights = []
    for k, name in enumerate(room.shape.names):
        inside = of_pixel == k
        area = lit.footprints_m2[inside]
        white, black, density = seen[:, inside]
        whole = [float(room.mean(values)[k]) for values in of_patch]
        mean_white, mean_black = (weighted_mean(white, area), weighted_mean(black, area)) if inside.any() else whole
        lights.append(
            SurfaceLight(
                name=name,
                area_m2=float(room.areas_m2[k]),
                paint=room.paints[k],
                coverage=min(1.0, float(area.sum() / room.areas_m2[k])),
                direct_lux=float(direct[k]),
                indirect_lux=float(indirect[k]),
                ambient_lux=float(ambient[k]),
                white_cdm2=mean_white,
                white_min_cdm2=quantile(white, area, LEAST) if inside.any() else whole[0],
                black_cdm2=mean_black,
                contrast=mean_white / max(mean_black, 1e-12),
                global_share=_share(global_[inside], (white - lit.ambient_cdm2[inside]), area) if inside.any() else 1.0,
                px_per_m=quantile(density, area, 0.5) if inside.any() else None,
                px_per_m_least=quantile(density, area, LEAST) if inside.any() else None,
            )
        )
    return tuple(lights)


def _share(part: FloatArray, whole: FloatArray, area: FloatArray) -> float:
    total = float((whole * area).sum())
    return float((part * area).sum()) / total if total > 0 else 0.0


def white_of_patches(lit: LitRoom) -> FloatArray:
    """Return (P,) luminance of the patches with the projector white, room light included [cd/m²]."""
    return _of_patches(lit, 1.0)


def black_of_patches(lit: LitRoom) -> FloatArray:
    """Return (P,) the same with the projector black."""
    return _of_patches(lit, lit.black)


def _of_patches(lit: LitRoom, level: float) -> FloatArray:
    B = lit.transport.radiosity_of(lit.even(level))[1]
    return np.asarray((B * lit.lux_per_unit + lit.ambient_exitance) / np.pi)


def contrast_steps(lit: LitRoom) -> ContrastSteps:
    """Return what interreflection, the projector's black and the room's light leave of its contrast."""
    n, seen = lit.n_pixels, lit.lit
    share = lit.pictures(lambda shape: checker(shape).astype(np.float64))
    white, black = (share > 0.5) & seen, (share <= 0.5) & seen
    area = lit.footprints_m2
    full = [weighted_mean(lit.luminance(np.full(n, level)), area) for level in (1.0, lit.black)]
    shown = lit.luminance(lit.black + (1 - lit.black) * share)
    dark = shown - lit.ambient_cdm2
    return ContrastSteps(
        projector=min(one.numbers.contrast for one in lit.views),
        full_in_room=full[0] / max(full[1], 1e-12),
        checker_dark_room=_ratio(dark, white * area, black * area),
        checker_in_room=_ratio(shown, white * area, black * area),
    )


def _ratio(shown: FloatArray, white: FloatArray, black: FloatArray) -> float:
    """Mean over white fields' area (n,) over that over black ones'; 0 where one kind meets no surface."""
    return weighted_mean(shown, white) / max(weighted_mean(shown, black), 1e-12) if black.any() else 0.0


def checker(shape: tuple[int, int]) -> BoolArray:
    """Return (H, W) bool: the white fields of a checker of 4 x 4."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return np.asarray((rows * FIELDS // shape[0] + columns * FIELDS // shape[1]) % 2 == 0)


def totals(lit: LitRoom, wanted_white_cdm2: float) -> PlanTotals:
    """Return the whole room in few numbers."""
    n, seen = lit.n_pixels, lit.lit
    area = lit.footprints_m2[seen]
    white = lit.luminance(np.ones(n))[seen]
    global_ = lit.from_units(np.asarray(lit.transport.global_ @ lit.even(1.0)))[seen]
    projected = white - lit.ambient_cdm2[seen]
    surface = lit.room.surface
    mean = weighted_mean(white, area)
    walls = [k for k, name in enumerate(lit.room.shape.names) if name not in lit.room.openings]
    return PlanTotals(
        coverage=min(1.0, float(area.sum() / surface.areas.sum())),
        lit_m2=float(area.sum()),
        white_cdm2=mean,
        wanted_white_cdm2=wanted_white_cdm2,
        reached_share=float(area[white >= wanted_white_cdm2].sum() / area.sum()),
        uniformity=quantile(white, area, LEAST) / max(mean, 1e-12),
        global_share=_share(global_, projected, area),
        indirect_lux=weighted_mean(lit.patch_lux(1.0)[1], surface.areas),
        px_per_m=quantile(px_per_m(lit)[seen], area, 0.5),
        paint_cost=float(sum(lit.room.areas_m2[k] * lit.room.paints[k].cost for k in walls)),
        projector_cost=sum(one.numbers.cost for one in lit.views),
    )
