"""Flat pictures are as bright a share of white everywhere, unless something stood in the light."""

import numpy as np
import pytest

from calibration.light.evenness import disturbed, part_shares, unevenness

SHAPE = (96, 128)
CURVE = (0.0, 0.05, 0.2, 0.45, 0.7, 1.0)


def pictures(noise: float = 0.003, uneven_share: float = 0.0) -> tuple[list[np.ndarray], np.ndarray]:
    """Levels of a projector on walls that a lens darkens towards its corners, and white."""
    random = np.random.default_rng(5)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] / np.array(SHAPE).reshape(2, 1, 1)
    white = 0.3 + 0.7 * np.exp(-3 * ((y - 0.5) ** 2 + (x - 0.4) ** 2))
    tilt = 1 + uneven_share * (x - 0.5)
    levels = [white * level * (tilt if 0 < level < 1 else 1) + random.normal(0, noise, SHAPE) for level in CURVE]
    return [level.astype(np.float32) for level in levels], white.astype(np.float32)


def found(levels: list[np.ndarray], white: np.ndarray) -> np.ndarray:
    lit = np.ones(SHAPE, dtype=bool)
    return unevenness(np.stack([part_shares(level, white, lit) for level in levels]))


def test_levels_on_uneven_walls_are_as_bright_a_share_of_white_everywhere() -> None:
    uneven = found(*pictures())
    assert np.abs(uneven).max() < 0.5
    assert not len(disturbed(uneven))


@pytest.mark.parametrize("level", [2, 3, 4])
@pytest.mark.parametrize(("factor", "sign"), [(0.3, -1), (1.6, 1)])
def test_what_stands_in_the_light_of_one_picture_is_found_with_its_sign(level: int, factor: float, sign: int) -> None:
    levels, white = pictures()
    levels[level][30:70, 40:60] *= np.float32(factor)
    uneven = found(levels, white)
    assert disturbed(uneven).tolist() == [level]
    assert np.sign(uneven[level]) == sign


def test_light_that_comes_on_is_found_where_walls_are_dark() -> None:
    levels, white = pictures()
    levels[2] += np.float32(0.2)
    assert disturbed(found(levels, white)).tolist() == [2]


def test_a_projector_that_is_uneven_by_itself_is_not_called_disturbed() -> None:
    uneven = found(*pictures(uneven_share=1.0))
    assert np.count_nonzero(np.abs(uneven) > 1) >= 3
    assert not len(disturbed(uneven))


def test_pixels_that_do_not_count_do_not_disturb() -> None:
    levels, white = pictures()
    levels[3][30:70, 40:60] = 0
    lit = np.ones(SHAPE, dtype=bool)
    lit[28:72, 38:62] = False
    assert not len(disturbed(unevenness(np.stack([part_shares(level, white, lit) for level in levels]))))
