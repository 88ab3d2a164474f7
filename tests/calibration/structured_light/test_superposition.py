"""Light adds up: patterns and their inverses make white, and what they do not make up is a device's doing."""

from collections.abc import Callable, Sequence
from functools import partial

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.structured_light.consistency.complements import superposition_error
from calibration.structured_light.gray import gray_code_patterns
from calibration.structured_light.patterns import flat

FloatArray = NDArray[np.float64]
SHAPE, SCALE, ROOM_LIGHT = (64, 64), 4, 12.0
NOISE_LIMIT, SATURATION = 4.0, 1e4
Seen = Callable[[FloatArray, int], FloatArray]


def same(light: FloatArray, _: int) -> FloatArray:
    return light


def photographed(seen: Seen = same, room_light: Callable[[int], float] = lambda _: ROOM_LIGHT) -> list[FloatArray]:
    """White, black, and each pattern before its inverse: a textured wall, blurred, in light that other walls send back.

    `seen` makes of the projector's light what a device does to it; the number is that of the photograph.
    """
    random = np.random.default_rng(3)
    row, column = np.mgrid[: SHAPE[0] * SCALE, : SHAPE[1] * SCALE]
    paint = 1 + 0.3 * np.sin(column / 17) * np.sin(row / 11)
    frames = []
    patterns = (flat(SHAPE, 255, "white"), flat(SHAPE, 0, "black"), *gray_code_patterns(SHAPE))
    for number, pattern in enumerate(patterns):
        shown = seen(pattern.codes / 255, number)
        direct = cv2.GaussianBlur(np.kron(shown, np.ones((SCALE, SCALE))), (0, 0), 1.5)
        light = paint * (400 * direct + 160 * shown.mean() + room_light(number))
        frames.append(light + random.normal(0, 1, light.shape))
    return frames


def error_of(frames: Sequence[FloatArray], swell: float = 0.0) -> float:
    white, black, *others = frames
    pairs = list(zip(others[::2], others[1::2], strict=True))
    error = superposition_error(pairs, white, black, noise_limit=NOISE_LIMIT, saturation=SATURATION, swell=swell)
    assert error is not None
    return error


def test_blur_paint_and_light_of_other_walls_change_no_sum() -> None:
    assert abs(error_of(photographed())) < 5e-4


@pytest.mark.parametrize("dims", [0.15, 0.04, -0.04])
def test_a_projector_that_dims_bright_pictures_takes_from_white_what_it_leaves_their_halves(dims: float) -> None:
    frames = photographed(lambda light, _: light * (1 - dims * light.mean()))
    halves, whole = 1 - dims / 2, 1 - dims
    assert error_of(frames) == pytest.approx(halves / whole - 1, abs=2e-3)


def test_a_lamp_that_warms_up_is_not_taken_for_that() -> None:
    # By 5 % until the last of the patterns, by 0.25 until the first pair.
    assert error_of(photographed(lambda light, number: light * (1 + 0.001 * number))) < 4e-3


def test_light_that_pairs_have_more_or_less_is_none_that_they_have_in_common() -> None:
    dark = photographed(lambda light, number: light * (0.97 if number in (4, 5) else 1.03 if number > 1 else 1.0))
    assert error_of(dark) == 0


def test_room_light_that_swells_from_frame_to_frame_is_not_counted() -> None:
    # White was photographed in its darkest moment, with a fifth less of it, and patterns in brighter ones.
    frames = photographed(room_light=lambda number: 60 * (0.8 if number == 0 else 1.1))
    assert error_of(frames) > 0.03
    assert error_of(frames, swell=0.2) == 0


def test_what_is_dark_or_clipped_tells_nothing() -> None:
    white, black, one, other, *_ = photographed()
    told = partial(superposition_error, white=white, black=black, noise_limit=NOISE_LIMIT, saturation=SATURATION)
    assert told([(one, other)]) is not None
    assert told([]) is None
    assert told([(one, other)], black=white) is None
    assert told([(one, other)], saturation=100.0) is None
