"""Whether a pixel of the picture is a pixel of the projector: single-pixel checkers and the picture's edges.

A checker and its complement together light the wall exactly as white and black together, whether or not the lenses and
the camera resolve them: blur mixes light. Whatever scales or sharpens a picture before it is shown mixes *codes*, and
codes are not proportional to light; the sum is then off, more and less in turns where the pixels go in and out of step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import get_args

import cv2
import numpy as np

from calibration.arrays import BoolArray, Codes, FloatArray
from calibration.structured_light.patterns import Side, checker, strip
from rig.records import Record, Verdict
from rig.self_check.parts.linearity import CameraCurve
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest

_SIZES = (1, 2, 4)
_REPEATS = 2
"""Of each picture: halves the noise that the contrast is freed of."""
_PATCH = 9
"""Camera pixels over which light is averaged to see beating: noise down, slow waves kept."""
_EDGE = 3
"""Outermost projector pixels that have to be seen, and how far in they are compared."""
_SEEN = 5.0
"""Standard deviations of noise by which a strip's light has to stand out of black."""
_SIDES: tuple[Side, ...] = get_args(Side)


@dataclass(frozen=True, kw_only=True)
class Checkers(Record):
    """How single pixels of the picture come out."""

    sum: float
    """Single-pixel checker + its complement over white + black, median."""
    sum_5_percent: float
    sum_95_percent: float
    """The same in patches, quantiles."""
    contrast: Mapping[int, float]
    """By side of the squares in pixels, share of full contrast."""
    edges: Mapping[str, float | None]
    """Light of the picture's edge by side, over that a little further in; None of what the camera does not see."""


@dataclass(frozen=True, slots=True)
class _Scene:
    """Linear light of white and black, and where it is judged."""

    white: FloatArray
    black: FloatArray
    lit: BoolArray
    """Well inside of what is lit."""
    noise: float
    """Variance of a single photograph of white."""


def check_checker(tested: RigUnderTest, curve: CameraCurve) -> PartResult[Checkers]:
    """Sum of complements, its beating, contrast of small squares, edges."""
    scene = _scene(tested, curve)
    pairs = {size: _pair(tested, curve, size) for size in _SIZES}
    total = (sum(pairs[1]) / (scene.white + scene.black))[scene.lit]
    halves = float(np.median((pairs[1][0] / (sum(pairs[1]) / 2))[scene.lit]))
    low, high = np.quantile(_patches(sum(pairs[1]) / (scene.white + scene.black), scene.lit), (0.05, 0.95))
    contrasts = {size: _contrast(pair, scene) for size, pair in pairs.items()}
    edges = _edges(tested, curve, scene)
    limits = tested.limits
    seen = {side: light for side, light in edges.items() if light is not None}
    worst = min(seen, key=lambda side: seen[side], default=None)
    verdicts = (
        Verdict(
            what="single-pixel checker + its complement off white + black",
            value=100 * abs(float(np.median(total)) - 1),
            limit=limits.checker_percent,
            unit="%",
            advice="native resolution, scaling 100 %, keystone and warping off, sharpness neutral, RGB 4:4:4",
        ),
        Verdict(
            what="beating of that sum over the picture",
            value=100 * float(high - low),
            limit=None if tested.is_compressed else limits.beat_percent,  # JPEG itself makes 1 to 3 %
            unit="%",
            advice="the picture is scaled: native resolution, overscan and keystone off",
        ),
        Verdict(what="single-pixel checker against its complement", value=100 * abs(halves - 1), unit="%"),
        Verdict(what="contrast of the single-pixel checker", value=contrasts[1], unit="of full"),
        Verdict(what="contrast of a checker of 4 pixels", value=contrasts[4], unit="of full"),
        Verdict(
            what=f"light of the picture's edge, weakest: {worst or 'none is seen'}",
            value=None if worst is None else seen[worst],
            limit=limits.edge_share,
            unit="of what is next to it",
            at_least=True,
            advice="overscan off, or aim the camera so that it sees the whole picture",
        ),
    )
    numbers = Checkers(
        sum=float(np.median(total)),
        sum_5_percent=float(low),
        sum_95_percent=float(high),
        contrast=contrasts,
        edges=edges,
    )
    return PartResult(verdicts=verdicts, numbers=numbers)


def _light(tested: RigUnderTest, curve: CameraCurve, picture: int | Codes, name: str) -> FloatArray:
    frames = [tested.photograph(picture, name) for _ in range(_REPEATS)]
    return curve.light(np.mean(frames, axis=0))


def _scene(tested: RigUnderTest, curve: CameraCurve) -> _Scene:
    inside = cv2.erode(tested.lit.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    lit = np.asarray(inside if inside.sum() > 0.2 * tested.lit.sum() else tested.lit)
    white = _light(tested, curve, 255, "white")
    noise = float((white - _light(tested, curve, 255, "white"))[lit].var()) * _REPEATS / 2
    return _Scene(white, _light(tested, curve, 0, "black"), lit, noise)


def _pair(tested: RigUnderTest, curve: CameraCurve, size_px: int) -> tuple[FloatArray, FloatArray]:
    """A checker, and the same shifted by one square: its complement."""
    boards = (checker(tested.picture_shape, size_px, (0, shift_px)) for shift_px in (size_px, 0))
    first, second = (_light(tested, curve, codes, f"checker-{size_px}-{k}") for k, codes in enumerate(boards))
    return first, second


def _patches(image: FloatArray, lit: BoolArray) -> FloatArray:
    """(N,) mean over patches that are lit all over."""
    mean = np.asarray(cv2.blur(np.where(lit, image, 0.0), (_PATCH, _PATCH)))
    share = np.asarray(cv2.blur(lit.astype(np.float64), (_PATCH, _PATCH)))
    whole = share > 0.999
    return np.asarray(mean[whole] if whole.any() else image[lit])


def _contrast(pair: tuple[FloatArray, FloatArray], scene: _Scene) -> float:
    """Root mean square of the difference against that of full contrast, without the noise's part."""
    full = scene.white - scene.black
    # two photographs of half the light, each the mean of some
    noise = 2 * (scene.noise / 2) / _REPEATS
    squared = float(np.mean((pair[0] - pair[1])[scene.lit] ** 2)) - noise
    return float(np.sqrt(max(squared, 0.0) / np.mean(full[scene.lit] ** 2)))


def _edges(tested: RigUnderTest, curve: CameraCurve, scene: _Scene) -> dict[str, float | None]:
    """Light of a strip along each side of the picture against that of an equal strip further in."""
    return {side: _edge(tested, curve, scene, side) for side in _SIDES}


def _edge(tested: RigUnderTest, curve: CameraCurve, scene: _Scene, side: Side) -> float | None:
    """Light of the outermost pixels over that of those further in; None where the camera does not see these."""
    light = []
    for inset in (0, 2 * _EDGE):
        codes = strip(tested.picture_shape, side, inset, _EDGE)
        light.append(float((_light(tested, curve, codes, f"edge-{side}-{inset}") - scene.black).sum()))
    noise = float(np.sqrt(2 * scene.noise / _REPEATS * scene.black.size))
    return max(light[0], 0.0) / light[1] if light[1] > _SEEN * noise else None
