"""What happens to photographs that people take of a code with care, but in a real room."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, Protocol

import cv2
import numpy as np
from drawn_scenes import DrawnSet, photographed
from numpy.typing import NDArray
from set_runs import name_of

Picture = NDArray[np.float64]


class Taken(Protocol):
    """Photographs by their names, in the order of time."""

    frames: dict[str, NDArray[Any]]
    full_scale_dn: int


def _to_all(set_: Taken, change: Callable[[int, Picture], Picture]) -> None:
    """Change each photograph, by its number in time."""
    for k, (name, frame) in enumerate(set_.frames.items()):
        changed = np.clip(np.rint(change(k, frame.astype(np.float64))), 0, set_.full_scale_dn)
        set_.frames[name] = changed.astype(frame.dtype)


def _shifted(picture: Picture, right: float, down: float) -> Picture:
    height, width = picture.shape
    move = np.array([[1.0, 0, right], [0, 1, down]])
    moved = cv2.warpAffine(picture.astype(np.float32), move, (width, height), borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, dtype=np.float64)


def _uneven_exposures(set_: Taken, random: np.random.Generator) -> None:
    """A shutter that repeats to some per cent."""
    size = random.uniform(0.01, 0.05)
    _to_all(set_, lambda _, picture: picture * (1 + random.normal(0, size)))


def _lamp_fades(set_: Taken, random: np.random.Generator) -> None:
    loss, count = random.uniform(0.05, 0.3), len(set_.frames)
    _to_all(set_, lambda k, picture: picture * (1 - loss * k / count))


def _mains_bands(set_: Taken, random: np.random.Generator) -> None:
    """A rolling shutter under a projector or lamp that flickers."""
    size, period = random.uniform(0.02, 0.15), random.uniform(0.2, 1.5)

    def banded(_: int, picture: Picture) -> Picture:
        down = np.arange(len(picture)) / len(picture)
        wave = 1 + size * np.sin(2 * np.pi * (down / period + random.random()))
        return np.asarray(picture * wave[:, None])

    _to_all(set_, banded)


def _clouds(set_: Taken, random: np.random.Generator) -> None:
    """Daylight through a window comes and goes."""
    size = random.uniform(0.02, 0.2) * set_.full_scale_dn
    level = np.abs(np.cumsum(random.normal(0, 0.3, len(set_.frames))))
    side = np.linspace(0, 1, next(iter(set_.frames.values())).shape[1])
    _to_all(set_, lambda k, picture: picture + size * min(level[k], 1) * side)


def _lamp_switched_on(set_: Taken, random: np.random.Generator) -> None:
    start, size = int(random.integers(2, len(set_.frames) - 1)), random.uniform(0.03, 0.3) * set_.full_scale_dn
    _to_all(set_, lambda k, picture: picture + size * (k >= start))


def _shaky(set_: Taken, random: np.random.Generator) -> None:
    size = random.uniform(0.05, 0.5)
    _to_all(set_, lambda _, picture: _shifted(picture, *random.normal(0, size, 2)))


def _creeping(set_: Taken, random: np.random.Generator) -> None:
    """A tripod head that sinks."""
    way, count = random.uniform(0.3, 4.0, 2) * random.choice([-1, 1], 2), len(set_.frames)
    _to_all(set_, lambda k, picture: _shifted(picture, *(way * k / count)))


def _automatic_exposure(set_: Taken, random: np.random.Generator) -> None:
    """Each photograph at the same mean, partly."""
    share = random.uniform(0.3, 1.0)
    middle = float(np.median([frame.mean() for frame in set_.frames.values()]))
    _to_all(set_, lambda _, picture: picture * (middle / max(picture.mean(), 0.2 * middle)) ** share)


def _hand(set_: Taken, random: np.random.Generator) -> None:
    """Somebody walks through a photograph, or a few."""
    names = list(set_.frames)
    start, count = int(random.integers(len(names) - 2)), int(random.integers(1, 4))
    height, width = set_.frames[names[0]].shape
    left, top = random.integers(0, width // 2), random.integers(0, height // 2)
    wide, high = random.integers(width // 8, width // 2), random.integers(height // 8, height // 2)
    for name in names[start : start + count]:
        part = set_.frames[name][top : top + high, left : left + wide]
        part[:] = np.asarray(0.1 * set_.full_scale_dn + 0.2 * part).astype(part.dtype)


def _torn(set_: Taken, random: np.random.Generator) -> None:
    """The projector changed while the camera read its lines: the lower part of one photograph is the next one's."""
    names = list(set_.frames)
    k = int(random.integers(len(names) - 1))
    row = int(len(set_.frames[names[k]]) * random.uniform(0.1, 0.9))
    set_.frames[names[k]] = np.vstack([set_.frames[names[k]][:row], set_.frames[names[k + 1]][row:]])


def _all_torn(set_: Taken, random: np.random.Generator) -> None:
    """As always happens without a trigger: each photograph, at the same line or at any."""
    names, fixed = list(set_.frames), random.uniform(0.1, 0.9)
    wanders = random.random() < 0.5
    before = dict(set_.frames)
    for name, following in pairwise(names):
        row = int(len(before[name]) * (random.uniform(0, 1) if wanders else fixed))
        set_.frames[name] = np.vstack([before[name][:row], before[following][row:]])


def _half_mixed(set_: Taken, random: np.random.Generator) -> None:
    """Exposures that begin before the projector has changed."""
    share, names, before = random.uniform(0.05, 0.45), list(set_.frames), dict(set_.frames)
    for earlier, name in pairwise(names):
        mixed = share * before[earlier].astype(np.float64) + (1 - share) * before[name]
        set_.frames[name] = np.rint(mixed).astype(before[name].dtype)


def _highlights(set_: Taken, random: np.random.Generator) -> None:
    """Spots that are full in every photograph."""
    height, width = next(iter(set_.frames.values())).shape
    row, column = np.mgrid[:height, :width]
    spots = np.zeros((height, width))
    for _ in range(int(random.integers(1, 6))):
        x, y, r = random.uniform(0, width), random.uniform(0, height), random.uniform(3, width / 8)
        spots = np.maximum(spots, 3 * np.exp(-((column - x) ** 2 + (row - y) ** 2) / r**2))
    _to_all(set_, lambda _, picture: picture * (1 + spots))


def _hot_pixels(set_: Taken, random: np.random.Generator) -> None:
    hot = random.random(next(iter(set_.frames.values())).shape) < random.uniform(0.001, 0.01)
    level = random.uniform(0.3, 1.0) * set_.full_scale_dn
    _to_all(set_, lambda _, picture: np.where(hot, level, picture))


def _local_tone(set_: Taken, random: np.random.Generator) -> None:
    """A telephone that brightens what is dark around."""
    share, sigma = random.uniform(0.2, 0.8), random.uniform(10, 60)
    full = set_.full_scale_dn

    def toned(_: int, picture: Picture) -> Picture:
        around = cv2.GaussianBlur(picture, (0, 0), sigma) / full
        return np.asarray(picture * (0.3 / np.maximum(around, 0.02)) ** share)

    _to_all(set_, toned)


def _sharpened(set_: Taken, random: np.random.Generator) -> None:
    """As cameras do to please."""
    much, sigma = random.uniform(0.3, 2.0), random.uniform(0.7, 2.0)
    _to_all(set_, lambda _, picture: picture + much * (picture - cv2.GaussianBlur(picture, (0, 0), sigma)))


def _smoothed(set_: Taken, random: np.random.Generator) -> None:
    """A telephone's noise reduction."""
    size = int(random.choice([3, 5]))
    _to_all(set_, lambda _, picture: cv2.medianBlur(picture.astype(np.float32), size).astype(np.float64))


def _veiled(set_: Taken, random: np.random.Generator) -> None:
    """A greasy lens: bright places glow into dark ones."""
    share, sigma = random.uniform(0.05, 0.3), random.uniform(3, 20)
    _to_all(set_, lambda _, picture: (1 - share) * picture + share * cv2.GaussianBlur(picture, (0, 0), sigma))


ROUGHNESS: tuple[Callable[[Taken, np.random.Generator], None], ...] = (
    _uneven_exposures,
    _lamp_fades,
    _mains_bands,
    _clouds,
    _lamp_switched_on,
    _shaky,
    _creeping,
    _automatic_exposure,
    _hand,
    _torn,
    _all_torn,
    _half_mixed,
    _highlights,
    _hot_pixels,
    _local_tone,
    _sharpened,
    _smoothed,
    _veiled,
)


def rough(seed: int) -> DrawnSet:
    """Photographs that have been taken in the order in which they are listed, with one of these."""
    random = np.random.default_rng([seed, 6089])
    set_ = photographed(random)
    change = ROUGHNESS[seed % len(ROUGHNESS)]
    set_.fault = name_of(change)
    change(set_, random)
    return set_
