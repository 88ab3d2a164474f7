"""Patterns: what is projected, checked without decoding anything."""

from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.structured_light.gray import bits_for, gray_code_patterns, positions, words
from calibration.structured_light.patterns import (
    checker,
    checker_patterns,
    flat,
    left_half,
    level_patterns,
    primary,
    random_blocks,
    strip,
)


def test_gray_code_has_columns_first_and_the_most_significant_bit_first() -> None:
    names = [p.name for p in gray_code_patterns((5, 9))]
    assert names[:3] == ["gray-column-03", "gray-column-03-inverse", "gray-column-02"]
    assert names[-1] == "gray-row-00-inverse"
    assert len(names) == 2 * (4 + 3)


def test_an_inverse_lights_what_its_pattern_does_not() -> None:
    plain, inverse = list(gray_code_patterns((6, 8)))[:2]
    assert np.all(plain.codes.astype(int) + inverse.codes == 255)


def test_without_inverses_half_as_many_pictures_are_made() -> None:
    assert len(list(gray_code_patterns((600, 800), inverse=False))) == 20


@pytest.mark.parametrize("size", [1, 2, 3, 64, 65, 1000])
def test_columns_are_told_apart_by_reading_their_bits_by_hand(size: int) -> None:
    stripes = [p.codes[0] > 0 for p in gray_code_patterns((2, size), inverse=False) if "column" in p.name]
    column = np.zeros(size, dtype=int)
    bit_before = np.zeros(size, dtype=bool)
    for lit in stripes:
        bit_before = bit_before ^ lit
        column = 2 * column + bit_before
    assert column.tolist() == list(range(size))


@pytest.mark.parametrize("bits", range(1, 15))
@pytest.mark.parametrize("code", ["xor-02", "xor-04"])
def test_xor_codes_have_every_word_once(code: str, bits: int) -> None:
    word = words(code, bits)  # type: ignore[arg-type]
    assert np.array_equal(np.sort(word), np.arange(2**bits))


@pytest.mark.parametrize("code", ["gray", "long-run"])
@pytest.mark.parametrize("bits", [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11])
def test_neighbouring_words_differ_in_one_bit_and_every_word_comes_once(code: str, bits: int) -> None:
    word = words(code, bits)  # type: ignore[arg-type]
    assert sorted(word.tolist()) == list(range(2**bits))
    changes = np.bitwise_count(word ^ np.roll(word, -1))
    assert changes.tolist() == [1] * 2**bits
    assert positions(code, bits)[word].tolist() == list(range(2**bits))  # type: ignore[arg-type]


def test_the_long_run_code_of_a_projector_has_no_stripe_finer_than_five_pixels() -> None:
    word = words("long-run", 10)
    for bit in range(10):
        plane = (word >> bit) & 1
        edges = np.flatnonzero(plane != np.roll(plane, 1))
        assert np.diff(edges).min() >= 5


def test_an_unknown_code_or_too_many_bits_are_refused() -> None:
    with pytest.raises(CalibrationError, match="unknown code"):
        words("hamming", 4)  # type: ignore[arg-type]
    with pytest.raises(CalibrationError, match="15 bits"):
        words("gray", 15)


@pytest.mark.parametrize(("size", "bits"), [(1, 1), (2, 1), (3, 2), (1024, 10), (1025, 11), (1280, 11)])
def test_bits_follow_from_the_size(size: int, bits: int) -> None:
    assert bits_for(size) == bits


def test_checkers_light_half_of_the_picture_and_every_pixel_about_half_the_time() -> None:
    stack = np.array([p.codes for p in checker_patterns((64, 96), size_px=8, shifts=25)])
    assert set(np.unique(stack)) == {0, 255}
    assert np.allclose((stack > 0).mean(axis=(1, 2)), 0.5, atol=0.03)
    lit = (stack > 0).mean(axis=0)
    assert 0.4 <= lit.min() <= lit.max() <= 0.6


def test_every_checker_is_another_one() -> None:
    stack = {p.codes.tobytes() for p in checker_patterns((48, 48), size_px=8, shifts=25)}
    assert len(stack) == 25


def test_a_shift_of_one_square_gives_the_complement() -> None:
    board = checker((20, 30), 3)
    assert np.array_equal(checker((20, 30), 3, (0, 3)), 255 - board)
    assert board[0, 0] == 255


def test_a_strip_lies_along_its_side() -> None:
    lit = {side: np.argwhere(strip((8, 10), side, 1, 2)) for side in ("left", "right", "top", "bottom")}
    assert set(lit["left"][:, 1]) == {1, 2}
    assert set(lit["right"][:, 1]) == {7, 8}
    assert set(lit["top"][:, 0]) == {1, 2}
    assert set(lit["bottom"][:, 0]) == {5, 6}


def test_halves_and_primaries_light_what_they_say() -> None:
    assert left_half((4, 6))[:, :3].min() == 255
    assert left_half((4, 6))[:, 3:].max() == 0
    assert primary((4, 6), 1, "green").codes.reshape(-1, 3).max(axis=0).tolist() == [0, 255, 0]


def test_blocks_are_always_the_same_and_have_edges_everywhere() -> None:
    codes = random_blocks((60, 80), 20)
    assert np.array_equal(codes, random_blocks((60, 80), 20))
    assert set(np.unique(codes)) == {40, 255}
    assert 0.3 < (codes == 255).mean() < 0.7


@pytest.mark.parametrize("shifts", [0, 1, 24, 10000])
def test_shifts_that_cannot_be_made_are_refused(shifts: int) -> None:
    with pytest.raises(CalibrationError, match="square number"):
        next(iter(checker_patterns((8, 8), 8, shifts)))


def test_levels_are_flat_and_named_by_their_code() -> None:
    named = {p.name: p.codes for p in level_patterns((2, 3), [0, 16, 255])}
    assert list(named) == ["level-000", "level-016", "level-255"]
    assert np.array_equal(named["level-016"], np.full((2, 3), 16, dtype=np.uint8))
    assert flat((2, 2), 255, "white").name == "white"


def test_a_code_beyond_eight_bits_is_refused() -> None:
    with pytest.raises(CalibrationError, match="256"):
        flat((2, 2), 256)


def test_pictures_are_made_one_at_a_time() -> None:
    assert isinstance(gray_code_patterns((768, 1024)), Iterator)
    assert isinstance(checker_patterns((768, 1024)), Iterator)


def test_the_pictures_are_those_of_opencv() -> None:
    made, theirs = cv2.structured_light.GrayCodePattern.create(40, 24).generate()
    assert made
    ours = [p.codes for p in gray_code_patterns((24, 40))]
    assert len(ours) == len(theirs)
    assert all(np.array_equal(a, b) for a, b in zip(ours, theirs, strict=True))
