"""Places and direct light beside the border of the projector's picture, where a pixel sees light from one side only."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from scipy.stats import norm

from calibration.light.outline import beside_border, continued_places
from calibration.light.separation import Separation, separate_by_pattern
from calibration.light.two_level import Footprint
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import checker_patterns

PROJECTOR, CAMERA = (72, 96), (96, 130)
FINE = 6
"""Samples of the world to a projector pixel: its squares are squares there."""
MARGIN_PX = 8
"""Of darkness around the picture, that the camera sees, too."""


@dataclass(frozen=True)
class Wall:
    """A wall that the projector's whole picture is on, seen through a blur; a quarter as much light comes back."""

    blur_px: float
    kink: float = 0.0
    """By how much the picture is foreshortened behind a corner, in the middle."""

    @property
    def xy(self) -> np.ndarray:
        y, x = np.mgrid[: CAMERA[0], : CAMERA[1]].astype(np.float64)
        x, y = -5 + 0.81 * x + 0.03 * y, -5 + 0.84 * y - 0.02 * x
        return np.stack([x, y - self.kink * np.abs(x - PROJECTOR[1] / 2)], axis=-1)

    def direct(self, picture: np.ndarray) -> np.ndarray:
        squares = np.kron(np.pad(picture / 255, MARGIN_PX), np.ones((FINE, FINE)))
        blurred = cv2.GaussianBlur(squares, (0, 0), self.blur_px * FINE)
        at = ((self.xy + MARGIN_PX + 0.5) * FINE - 0.5).astype(np.float32)
        return cv2.remap(blurred, at[..., 0], at[..., 1], cv2.INTER_LINEAR)

    def photograph(self, picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        light = self.direct(picture) + 0.25 * picture.mean() / 255
        return (light + rng.normal(0, 0.004, CAMERA)).astype(np.float32)

    def correspondence(self) -> Correspondence:
        """As codes tell it: the middle of the light that a pixel sees, and none where it sees hardly any."""
        told, white = self.xy.copy(), self.direct(np.full(PROJECTOR, 255))
        for axis, length in enumerate((PROJECTOR[1], PROJECTOR[0])):
            low, high = ((edge - self.xy[..., axis]) / self.blur_px for edge in (-0.5, length - 0.5))
            share = np.maximum(norm.cdf(high) - norm.cdf(low), 1e-9)
            told[..., axis] += self.blur_px * (norm.pdf(low) - norm.pdf(high)) / share
        reason = np.where(white > 0.2, 0, 1).astype(np.uint8)
        return Correspondence(told.astype(np.float32), reason, PROJECTOR)

    def separated(self) -> Separation:
        rng = np.random.default_rng(4)
        codes = [pattern.codes for pattern in checker_patterns(PROJECTOR, 10, 25)]
        white = np.mean([self.photograph(np.full(PROJECTOR, 255), rng) for _ in range(4)], axis=0)
        frames = [self.photograph(picture, rng) for picture in codes]
        return separate_by_pattern(frames, codes, self.correspondence(), white=white.astype(np.float32))

    def beside(self) -> np.ndarray:
        """Pixels that look at the picture, and see less than 98 % of white."""
        height, width = PROJECTOR
        looks = ((self.xy >= -0.5) & (self.xy <= np.array([width, height]) - 0.5)).all(axis=-1)
        return looks & (self.direct(np.full(PROJECTOR, 255)) < 0.98)


@pytest.mark.parametrize("blur_px", [0.8, 1.2, 1.8])
def test_beside_the_border_places_are_right_where_codes_are_half_a_pixel_off(blur_px: float) -> None:
    wall = Wall(blur_px)
    off, told = wall.separated().projector_xy_px - wall.xy, wall.correspondence().projector_xy_px - wall.xy
    beside = wall.beside()
    assert np.abs(told[beside]).max() > 0.5 * blur_px
    assert np.sqrt(np.mean(off[beside] ** 2)) < 0.05
    assert np.abs(off[beside]).max() < 0.2


@pytest.mark.parametrize("blur_px", [0.8, 1.2, 1.8])
def test_beside_the_border_direct_light_is_what_arrives_there(blur_px: float) -> None:
    wall = Wall(blur_px)
    found, true, beside = wall.separated(), wall.direct(np.full(PROJECTOR, 255)), wall.beside()
    assert found.valid[beside].mean() > 0.9
    assert not found.valid[(wall.xy < -1).any(axis=-1)].any()
    beside &= found.valid
    assert found.direct[beside].mean() == pytest.approx(true[beside].mean(), rel=0.01)
    few = beside & (true < 0.7)
    assert found.direct[few].mean() == pytest.approx(true[few].mean(), rel=0.03)


def test_places_are_not_continued_across_a_corner() -> None:
    """Along the rim on top and below the picture goes over a corner of the room in its middle."""
    wall = Wall(1.2, kink=0.6)
    xy, inside = wall.xy, (wall.xy > 3).all(axis=-1) & (wall.xy < np.array([92, 68])).all(axis=-1)
    rim = (wall.xy > -1).all(axis=-1) & (wall.xy[..., 1] < 3)
    continued = continued_places(xy, inside, rim, 4.0)
    off = np.abs(continued.xy_px - xy[rim]).max(axis=1)
    assert 0.2 < continued.told.mean() < 0.98
    assert off[continued.told].max() < 0.6
    assert off[~continued.told].max() > 0.9


def test_a_place_has_the_variance_of_what_tells_it() -> None:
    rng = np.random.default_rng(8)
    y, x = np.mgrid[:80, :80].astype(np.float64)
    xy = np.stack([0.9 * x, 0.9 * y], axis=-1)
    known = x > 10
    continued = continued_places(xy + rng.normal(0, 0.05, xy.shape), known, ~known & (x > 5), 5.0)
    errors = (continued.xy_px - xy[~known & (x > 5)]) / np.sqrt(continued.variance_px2)[:, None]
    assert continued.told.all()
    assert 0.3 < np.sqrt(np.mean(errors**2)) < 1.1


def test_nothing_is_continued_from_next_to_nothing() -> None:
    known = np.zeros((40, 40), dtype=bool)
    known[3:5, 3:5] = True
    continued = continued_places(np.zeros((40, 40, 2)), known, ~known, 4.0)
    assert not continued.told.any()


def test_the_border_reaches_as_far_as_what_a_pixel_sees() -> None:
    places = np.array([[2.0, 30.0], [3.0, 30.0], [50.0, 69.0], [np.nan, np.nan]])
    seen = Footprint(xy_px=places, variance_px2=np.ones((4, 2)))
    assert beside_border(seen, PROJECTOR).tolist() == [True, False, True, False]
