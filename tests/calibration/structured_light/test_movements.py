"""Pictures that jump, and stripes that only look so: what tells a touched camera from a tone curve."""

from collections.abc import Sequence

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.structured_light.consistency.still import movements
from calibration.structured_light.gray import gray_code_patterns

Pictures = list[NDArray[np.uint8]]
SHAPE = (96, 128)


def smooth_paint(seed: int, gamma: float, scale: float) -> Pictures:
    """Paint without an edge, lit by turned and blurred stripes; grey levels follow a tone curve."""
    random = np.random.default_rng(seed)
    height, width = (int(side * scale) for side in SHAPE)
    paint = np.clip(1 + 6 * cv2.GaussianBlur(random.normal(0, 1, (height, width)), (0, 0), 12), 0.3, 1.7)
    turn = cv2.getRotationMatrix2D((SHAPE[1] / 2, SHAPE[0] / 2), np.degrees(random.uniform(-0.5, 0.5)), 1)
    frames = []
    for pattern in gray_code_patterns(SHAPE):
        turned = cv2.warpAffine(pattern.codes.astype(np.float32) / 255, turn, SHAPE[::-1])
        stripes = cv2.GaussianBlur(cv2.resize(turned, (width, height)), (0, 0), 1.5)
        levels = 255 * np.clip(paint * (0.02 + 0.5 * stripes), 0, 1) ** (1 / gamma)
        frames.append(np.clip(np.rint(levels + random.normal(0, 2.5, levels.shape)), 0, 255).astype(np.uint8))
    return frames


def pebbles() -> Pictures:
    """A wall with spots of all sizes, lit by stripes, in a camera of straight levels."""
    random = np.random.default_rng(3)
    spots = sum(cv2.GaussianBlur(random.normal(0, s, (192, 256)), (0, 0), s) for s in (1.5, 3.0, 6.0))
    paint = np.clip(1 + 0.4 * spots, 0.3, 1.7)
    lit = [cv2.resize(pattern.codes, (256, 192)) / 255 for pattern in gray_code_patterns(SHAPE)]
    return [
        np.clip(paint * (10 + 120 * one) + random.normal(0, 1, paint.shape), 0, 255).astype(np.uint8) for one in lit
    ]


def paired(frames: Sequence[NDArray[np.uint8]]) -> list[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    """Pairs of the columns."""
    return [(frames[k], frames[k + 1]) for k in range(0, 14, 2)]


def moved(shifts_px: dict[int, int]) -> list[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    """Pairs of the wall with spots; by how much each is moved."""
    return [
        (np.roll(one, shifts_px.get(k, 0), axis=1), np.roll(other, shifts_px.get(k, 0), axis=1))
        for k, (one, other) in enumerate(paired(pebbles()))
    ]


@pytest.mark.parametrize("scale", [1.7, 2.1, 2.8])
@pytest.mark.parametrize("gamma", [1.5, 2.2, 2.8])
@pytest.mark.parametrize("seed", [1, 2])
def test_stripes_under_a_tone_curve_are_not_taken_for_movement(seed: int, gamma: float, scale: float) -> None:
    assert movements(paired(smooth_paint(seed, gamma, scale))) == ()


def test_a_wall_that_stands_still_does_so() -> None:
    assert movements(moved({})) == ()


@pytest.mark.parametrize("first", [1, 3, 6])
@pytest.mark.parametrize("step_px", [4, 9])
def test_a_camera_that_was_touched_is_found_where_it_was(first: int, step_px: int) -> None:
    (found,) = movements(moved(dict.fromkeys(range(first, 7), step_px)))
    assert (found.before, found.after) == (2 * first - 1, 2 * first)
    assert found.step_px == pytest.approx(step_px, abs=0.5)


def test_a_camera_that_came_back_is_found_twice() -> None:
    found = movements(moved({3: 6}))
    assert [(one.before, one.after) for one in found] == [(5, 6), (7, 8)]


def test_a_camera_that_creeps_is_found_in_every_pair() -> None:
    found = movements(moved({k: 3 * k for k in range(7)}))
    assert len(found) == 6
