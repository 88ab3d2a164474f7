"""Whether camera and scene stood still, and the exposure stayed, from photographs that come in complementary pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from calibration.arrays import Float32Array, FloatArray, Frame

_WIDTH_PX = 432
"""Of the photographs when they are laid over each other: found to a fifth of such a pixel."""
_LEAST_STEP_PX = 1.5
_LEAST_STEP = 0.0008
"""Of the width. On a real scan of 44 photographs of a still object the largest step was 0.3 px of 432."""
_ALONE = 4.0
"""A single photograph, which may be dark but for its edges, is found four times less surely than a pair."""
_LEAST_PEAK = 0.1
"""Of the phase correlation: 0.13 was seen for photographs that are dark on the whole object, 0.00 for noise."""
_LAID = 0.8
"""Of the squared difference that a true shift leaves over at most; of noise alone a half pixel's blur leaves 0.9."""
_ALONG, _LAID_TWICE = 0.75, 0.6
"""So much of a movement that is lasting another pair has gone along with, or more where a camera creeps, and so little
of their squared difference is left. Of 60 still sets of smooth paint and fine stripes under a tone curve 33 have pairs
that look moved: by these none is lasting, by 0.5 and 0.8 five would be."""
_LEAST_PICTURE = 0.02
"""Of the variation of white plus black: what a photograph has to show to be found elsewhere."""
_RESOLVED = 0.4
_DARK = 0.15
"""Of white plus black; half of it is what stripes have on the mean."""
_SHARP, _LEAST_SHARP = 0.75, 5
"""Of white minus black that a pair has as its difference, and pairs of which two that are wrong are no majority."""
_GAINS = (0.3, 3.3)
_FITS = 0.12
"""Of white minus black: what is left of a pair that is a pair up to its exposures."""
_ENOUGH_PLACES = 6_000
_TRIED_GAINS = np.geomspace(*_GAINS, 49)
_NEAR_LEVEL = 0.25
"""Of lit minus dark: what light of other surfaces, and a tone curve, move a level by."""
_BOTH_LEVELS, _TELLS_LEVELS = 0.1, 0.75
"""Shares of places that have each level, and either, in photographs that tell their exposure."""
_NOT_LIT, _BETTER = 0.05, 0.05
"""Of a photograph that was exposed otherwise so few places are as bright as lit ones, and so many more have a level
once it is scaled. Drawn sets at half the exposure had at most 0.021 lit; right photographs of which both levels show
had 0.11 and more (`benchmarks/photographs`, seeds 2000 to 2170)."""
_EVERYWHERE, _BY_TONE = 0.8, 1.5
"""Of the places, where noise leaves the darkest and the brightest photograph what they are; and what a tone curve
raises blurred stripes' sums by at most."""
_CHANGED, _TONE = 0.2, 0.3
"""A tone curve raises both photographs of fine stripes alike, by up to 1.3; one of the two by less than the first."""


@dataclass(frozen=True, slots=True)
class Movement:
    """A place in the sequence at which the picture jumps."""

    before: int
    after: int
    """Indices of photographs: the last at the old place, the first at the new one."""
    step_px: float


def movements(pairs: Sequence[tuple[Frame, Frame]]) -> tuple[Movement, ...]:
    """Find where the camera, or what it sees, moved.

    The sum of a pair is the scene under white light, whatever the stripes; sums are laid over each other by phase
    correlation, and each photograph over what its complement and the neighbouring sum say it should be.

    Parameters
    ----------
    pairs : sequence of ((H, W), (H, W))
        Pattern and inverse in the order in which they were taken, the finest stripes of an axis last. [dn]

    Returns
    -------
    tuple of Movement
        Photograph 2 k is pattern k, 2 k + 1 its inverse; empty when all stood still.
    """
    if len(pairs) < 2:
        return ()
    scale = max(1, pairs[0][0].shape[1] // _WIDTH_PX)
    small = [(_small(a, scale), _small(b, scale)) for a, b in pairs]
    limit_px = max(_LEAST_STEP_PX, _LEAST_STEP * pairs[0][0].shape[1])
    sums = [a + b for a, b in small]
    window = np.asarray(cv2.createHanningWindow(sums[0].shape[::-1], cv2.CV_32F), dtype=np.float32)
    found = []
    for k in range(1, len(sums)):
        step = _shift(sums[k - 1], sums[k], window)
        if step.length * scale > limit_px and _is_lasting(sums, k, step, window):
            found.append(Movement(2 * k - 1, 2 * k, step.length * scale))
    inside = [_within_pair(small, sums, k, window) for k in range(len(sums))]
    alone = [
        Movement(2 * k, 2 * k + 1, step * scale) for k, step in enumerate(inside) if step * scale > _ALONE * limit_px
    ]
    return tuple(sorted(found + alone, key=lambda movement: movement.after))


def _small(frame: Frame, scale: int) -> Float32Array:
    height, width = frame.shape
    size = max(2, width // scale), max(2, height // scale)
    return np.asarray(cv2.resize(frame.astype(np.float32), size, interpolation=cv2.INTER_AREA))


class LaidOver(NamedTuple):
    """A shift that lays one picture over another."""

    right_down: FloatArray
    left: float
    """Of their squared difference."""
    peak: float
    """Of the phase correlation."""

    @property
    def length(self) -> float:
        """0 where it does not lay them over each other."""
        found = self.left < _LAID and self.peak > _LEAST_PEAK
        return float(np.linalg.norm(self.right_down)) if found else 0.0


def laid_over(a: Float32Array, b: Float32Array) -> LaidOver:
    """Find the shift that lays one picture over another of the same size."""
    return _shift(a, b, np.asarray(cv2.createHanningWindow(a.shape[::-1], cv2.CV_32F), dtype=np.float32))


def _is_lasting(sums: Sequence[Float32Array], k: int, step: LaidOver, window: Float32Array) -> bool:
    """Whether the pair after, or the one before, has also moved, as far as there is one.

    Whatever jumps stays where it is, or was there before. Stripes whose sum a tone curve changes look moved in a pair.
    """
    others = [_shift(sums[a], sums[b], window) for a, b in ((k - 1, k + 1), (k - 2, k)) if a >= 0 and b < len(sums)]
    least = _ALONG * step.length**2
    return not others or any(
        other.left < _LAID_TWICE and float(other.right_down @ step.right_down) > least for other in others
    )


def _shift(a: Float32Array, b: Float32Array, window: Float32Array) -> LaidOver:
    """The shift that lays b over a."""
    (right, down), peak = cv2.phaseCorrelate(a.copy(), b.copy(), window)  # it may multiply the window into its inputs
    back = np.array([[1, 0, -right], [0, 1, -down]], dtype=np.float64)
    laid = cv2.warpAffine(b, back, b.shape[::-1], flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    # Of a bare wall the correlation sees noise: a shift that does not lay the pictures over each other is none.
    before, after = (float(((one - a) ** 2 * window).sum()) for one in (b, laid))
    return LaidOver(np.array([right, down]), after / max(before, 1e-12), float(peak))


def _within_pair(
    small: Sequence[tuple[Float32Array, Float32Array]], sums: Sequence[Float32Array], k: int, window: Float32Array
) -> float:
    """Largest shift of a photograph of a pair against what the other and the neighbouring sum say."""
    neighbour = sums[k + 1] if k + 1 < len(sums) else sums[k - 1]
    white = neighbour * (sums[k].sum() / max(float(neighbour.sum()), 1e-6))
    most = 0.0
    for shown, other in (small[k], small[k][::-1]):
        expected = white - other
        if expected.std() < _LEAST_PICTURE * white.std():
            continue
        most = max(most, _shift(expected, shown, window).length)
    return most


def exposure_gains(values: FloatArray | Float32Array, pairs: Sequence[tuple[int, int]]) -> FloatArray:
    """Find photographs that were exposed otherwise than the rest.

    Parameters
    ----------
    values : (N, K)
        All photographs at lit places. [dn]
    pairs : sequence of (photograph, complement)
        Indices, as the photographs are named; pairs that are none get 1.

    Returns
    -------
    (N,) float64
        Exposure relative to the others'; exactly 1 where it differs by less than a fifth.
    """
    gains = np.ones(len(values))
    least, most = values.min(axis=0), values.max(axis=0)
    contrast = float((most.astype(np.float64) - least).mean())
    sharp = _sharp_sums(values, pairs, contrast)
    are_sharp = len(sharp) >= _LEAST_SHARP
    # A tone curve raises the sum of pairs whose stripes are blurred, by up to a half.
    total = np.asarray(np.median(sharp, axis=0) if are_sharp else 2 * values.mean(axis=0, dtype=np.float64))
    for a, b in pairs:
        if not are_sharp and _may_be_ends((values[a], values[b]), (least, most), float(total.mean())):
            continue
        found = _gains_of_pair(values[a].astype(np.float64), values[b].astype(np.float64), total, contrast)
        if np.abs(np.log(found)).max() > _CHANGED:
            gains[[a, b]] = np.where(np.abs(np.log(found)) > _CHANGED, found, 1.0)
    return gains


def exposure_gains_alone(values: FloatArray | Float32Array) -> FloatArray:
    """Find photographs without complements that were exposed otherwise than the rest.

    A place is lit or dark in each photograph, so it has one of two levels in all of them, but for light of other
    surfaces; at another exposure it has neither.

    Parameters
    ----------
    values : (N, K)
        All photographs at lit places. [dn]

    Returns
    -------
    (N,) float64
        Exposure relative to the others'; exactly 1 where it differs by less than a fifth, or is not told.
    """
    seen = values[:, :: 1 + values.shape[1] // _ENOUGH_PLACES].astype(np.float64)
    middle = (seen.max(axis=0) + seen.min(axis=0)) / 2
    dark, lit = (np.nanmedian(np.where(side, seen, np.nan), axis=0) for side in (seen <= middle, seen >= middle))
    reach = _NEAR_LEVEL * np.maximum(lit - dark, 1e-6)

    def explained(gain: float) -> FloatArray:
        """(2, N) shares of the places at which a photograph is dark, and lit, had it been exposed so."""
        return np.stack([(np.abs(seen / gain - level) < reach).mean(axis=1) for level in (dark, lit)])

    shares = np.stack([explained(float(gain)) for gain in _TRIED_GAINS])
    # Blurred fine stripes are grey everywhere: at another exposure they would have one of the levels, and never both.
    either = np.where(shares.min(axis=1) > _BOTH_LEVELS, shares.sum(axis=1), 0.0)
    best, most, plain = np.argmax(either, axis=0), either.max(axis=0), explained(1.0)
    found = (most > _TELLS_LEVELS) & (plain[1] < _NOT_LIT) & (plain.sum(axis=0) < most - _BETTER)
    gains = np.ones(len(seen))
    for k in np.flatnonzero(found):
        at_lit = np.abs(seen[k] / _TRIED_GAINS[best[k]] - lit) < reach
        gain = float(np.median(seen[k, at_lit] / lit[at_lit]))
        gains[k] = gain if abs(np.log(gain)) > _CHANGED else 1.0
    return gains


def _sharp_sums(
    values: FloatArray | Float32Array, pairs: Sequence[tuple[int, int]], contrast: float
) -> list[FloatArray]:
    """(K,) sums of the pairs whose stripes are sharp."""
    return [
        values[a] + values[b].astype(np.float64)
        for a, b in pairs
        if np.abs(np.subtract(values[a], values[b], dtype=np.float64)).mean() > _SHARP * contrast
    ]


def _may_be_ends(
    pair: tuple[FloatArray | Float32Array, FloatArray | Float32Array],
    ends: tuple[FloatArray | Float32Array, FloatArray | Float32Array],
    total: float,
) -> bool:
    """Tell whether a pair adds up to less than blurred ones because one is dark nearly everywhere, the other lit.

    The coarsest stripes of a projector whose rows just exceed a power of two are: other surfaces' light is in none of
    one photograph, and in the other from all of them.
    """
    dark, lit = sorted(pair, key=lambda one: float(one.mean()))
    least, most = ends
    at_ends = float(np.mean((dark <= least) & (lit >= most)))
    missing = total / max(float((lit + dark.astype(np.float64)).mean()), 1e-6)
    return at_ends > _EVERYWHERE and 1.0 <= missing <= _BY_TONE


def _gains_of_pair(a: FloatArray, b: FloatArray, total: FloatArray, contrast: float) -> FloatArray:
    """(2,) exposures of two photographs that add up to the total when divided by them; 1 when none do."""
    if np.abs(a - b).mean() < _RESOLVED * contrast * min(a.mean(), b.mean()) / max(a.mean(), b.mean(), 1e-6):
        return _gains_of_fine(float(a.mean()), float(b.mean()), float(total.mean()) / 2)
    both = np.column_stack([a, b])
    share, *_ = np.linalg.lstsq(both, total, rcond=None)
    left = float(np.sqrt(np.mean((both @ share - total) ** 2)))
    plain = float(np.sqrt(np.mean((a + b - total) ** 2)))
    fits = left < _FITS * contrast and left < 0.5 * plain and (share > 0).all()
    gains = 1 / share if fits else np.ones(2)
    # What is dark tells nothing of its exposure, unless a part of it is lit.
    tells = (both.mean(axis=0) > _DARK * total.mean()) | (_apart(both) * _CHANGED > left)
    gains = np.where(tells, gains, 1.0)
    within = (gains > _GAINS[0]) & (gains < _GAINS[1])
    alike = abs(np.log(gains[0] / gains[1])) < _CHANGED and np.abs(np.log(gains)).max() < _TONE
    return np.asarray(gains if within.all() and not alike else np.ones(2))


def _apart(both: FloatArray) -> FloatArray:
    """(2,) RMS of what each of two columns has that is no multiple of the other."""
    product, square = float(both[:, 0] @ both[:, 1]), (both**2).sum(axis=0)
    own = np.maximum(square - product**2 / np.maximum(square[::-1], 1e-9), 0)
    return np.asarray(np.sqrt(own / len(both)))


def _gains_of_fine(a: float, b: float, usual: float) -> FloatArray:
    """(2,) exposures of a pair whose stripes are fine, so that both are equally bright but for the exposure."""
    ratio = max(a, 1e-6) / max(b, 1e-6)
    a_is_other = abs(np.log(max(a, 1e-6) / usual)) > abs(np.log(max(b, 1e-6) / usual))
    return np.array([ratio, 1.0]) if a_is_other else np.array([1.0, 1 / ratio])
