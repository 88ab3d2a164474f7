"""Whether a pixel of the picture is a pixel of the projector: single-pixel checkers and the picture's edges.

A checker and its complement together light the wall exactly as white and black together, whether or not the lenses and
the camera resolve them: blur mixes light. Whatever scales or sharpens a picture before it is shown mixes *codes*, and
codes are not proportional to light; the sum is then off, more and less in turns where the pixels go in and out of step.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rig.devices.protocols import Codes
from rig.self_check.parts.linearity import Linear
from rig.self_check.rig_under_test import BoolArray, FloatArray, RigUnderTest
from rig.self_check.rows import Measured, Row

_SIZES = (1, 2, 4)
_REPEATS = 2
_PATCH = 9
"""Camera pixels over which light is averaged to see beating: noise down, slow waves kept."""
_EDGE = 3
"""Outermost projector pixels that have to be seen, and how far in they are compared."""
_SIDES = ("left", "right", "top", "bottom")


def checker(shape: tuple[int, int], size_px: int, shift_px: int = 0) -> Codes:
    """Squares of 0 and 255."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.asarray(255 * (((x + shift_px) // size_px + y // size_px) % 2), dtype=np.uint8)


@dataclass(frozen=True, slots=True)
class _Scene:
    """Linear light of white and black, and where it is judged."""

    white: FloatArray
    black: FloatArray
    lit: BoolArray
    """Well inside of what is lit."""
    noise: float
    """Variance of a single photograph of white."""


def check_checker(subject: RigUnderTest, linear: Linear) -> Measured:
    """Sum of complements, its beating, contrast of small squares, edges."""
    scene = _scene(subject, linear)
    pairs = {size: _pair(subject, linear, size) for size in _SIZES}
    total = (sum(pairs[1]) / (scene.white + scene.black))[scene.lit]
    halves = float(np.median((pairs[1][0] / (sum(pairs[1]) / 2))[scene.lit]))
    low, high = np.quantile(_patches(sum(pairs[1]) / (scene.white + scene.black), scene.lit), (0.05, 0.95))
    contrasts = {size: _contrast(pair, scene) for size, pair in pairs.items()}
    edges = _edges(subject, linear, scene)
    limits = subject.limits
    worst = min(edges, key=lambda side: edges[side])
    rows = (
        Row("single-pixel checker + its complement off white + black", 100 * abs(float(np.median(total)) - 1), "%",
            limits.checker_percent,
            advice="native resolution, scaling 100 %, keystone and warping off, sharpness neutral, RGB 4:4:4"),
        Row("beating of that sum over the picture", 100 * float(high - low), "%", limits.beat_percent,
            advice="the picture is scaled: native resolution, overscan and keystone off"),
        Row("single-pixel checker against its complement", 100 * abs(halves - 1), "%"),
        Row("contrast of the single-pixel checker", contrasts[1], "of full"),
        Row("contrast of a checker of 4 pixels", contrasts[4], "of full"),
        Row(f"light of the picture's edge, weakest: {worst}", edges[worst], "of what is next to it",
            limits.edge_share, at_least=True,
            advice="overscan off, or aim the camera so that it sees the whole picture"),
    )  # fmt: skip
    numbers = {
        "sum": float(np.median(total)),
        "sum_5_percent": float(low),
        "sum_95_percent": float(high),
        "contrast": {str(size): value for size, value in contrasts.items()},
        "edges": edges,
    }
    return Measured(rows, {}, numbers)


def _light(subject: RigUnderTest, linear: Linear, picture: int | Codes, name: str) -> FloatArray:
    frames = [subject.photograph(picture, name) for _ in range(_REPEATS)]
    return linear.light(np.mean(frames, axis=0))


def _scene(subject: RigUnderTest, linear: Linear) -> _Scene:
    inside = cv2.erode(subject.lit.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    lit = np.asarray(inside if inside.sum() > 0.2 * subject.lit.sum() else subject.lit)
    white = _light(subject, linear, 255, "white")
    noise = float((white - _light(subject, linear, 255, "white"))[lit].var()) * _REPEATS / 2
    return _Scene(white, _light(subject, linear, 0, "black"), lit, noise)


def _pair(subject: RigUnderTest, linear: Linear, size_px: int) -> tuple[FloatArray, FloatArray]:
    """A checker, and the same shifted by one square: its complement."""
    shape = subject.rig.projector.shape
    first, second = (
        _light(subject, linear, checker(shape, size_px, shift), f"checker-{size_px}-{shift}") for shift in (0, size_px)
    )
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


def _edges(subject: RigUnderTest, linear: Linear, scene: _Scene) -> dict[str, float]:
    """Light of a strip along each side of the picture against that of an equal strip further in."""
    return {side: _edge(subject, linear, scene, side) for side in _SIDES}


def _edge(subject: RigUnderTest, linear: Linear, scene: _Scene, side: str) -> float:
    light = []
    for inset in (0, 2 * _EDGE):
        codes = strip(subject.rig.projector.shape, side, inset)
        light.append(float((_light(subject, linear, codes, f"edge-{side}-{inset}") - scene.black).sum()))
    return light[0] / max(light[1], 1e-9)


def strip(shape: tuple[int, int], side: str, inset_px: int) -> Codes:
    """A few lines of white along a side, some pixels in."""
    codes = np.zeros(shape, np.uint8)
    lines = slice(inset_px, inset_px + _EDGE)
    turned = {"left": codes.T, "right": codes.T[::-1], "top": codes, "bottom": codes[::-1]}[side]
    turned[lines] = 255
    return codes
