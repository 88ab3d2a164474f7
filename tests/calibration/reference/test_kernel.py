"""The native kernel reads photographs as its definitions in numpy do, with every instruction set."""

from collections.abc import Iterator

import numpy as np
import pytest

from calibration import CODES, _kernel
from calibration.geometry.pinhole import distort, undistort
from calibration.reference import lens
from calibration.reference.beats import read_beats
from calibration.reference.words import read_words
from calibration.structured_light.bits import BitPairs
from calibration.structured_light.gray import positions
from calibration.structured_light.phase.beats import BeatAxis, Beats

KINDS = [np.uint8, np.uint16, np.float32]
SHAPE = (37, 173)
ALL = slice(None)


@pytest.fixture(params=_kernel.instruction_sets(), autouse=True)
def instruction_set(request: pytest.FixtureRequest) -> Iterator[None]:
    _kernel.set_instruction_set(request.param)
    yield
    _kernel.set_instruction_set(_kernel.best_instruction_set())


def photographs(kind: type, count: int) -> list[np.ndarray]:
    """Of random light, so that every bit is open somewhere, and some pixels are clipped."""
    random = np.random.default_rng(count)
    scale = 257 if kind is np.uint16 else 1
    return [(random.integers(0, 256, SHAPE) // 8 * 8 * scale).astype(kind) for _ in range(count)]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bits", [3, 8, 9, 14])
@pytest.mark.parametrize("own_light", [False, True])
def test_words_are_read_as_defined(kind: type, bits: int, own_light: bool) -> None:
    frames, scale = photographs(kind, 2 * bits + 1), 257 if kind is np.uint16 else 1
    for saturation, limit in ((None, 9.5 * scale), (240.5 * scale, np.full(SHAPE, 17.0 * scale))):
        pairs = BitPairs.of(
            list(zip(frames[:bits], frames[bits:-1], strict=True)),
            limit,
            positions("long-run", bits),
            black=frames[-1] // 4 if own_light else None,
            wide=4,
            saturation=saturation,
            bounds=(3, 2 ** (bits + 1) - 5),
        )
        twice, reason = np.empty(SHAPE, np.uint16), np.zeros(SHAPE, np.uint8)
        reason[:2] = 1
        expected = read_words(pairs, reason)
        pairs.read(ALL, twice, reason)
        assert np.array_equal(twice, expected[0])
        assert np.array_equal(reason, expected[1])


def test_frames_that_are_views_or_of_several_kinds_are_read_alike() -> None:
    whole = photographs(np.uint8, 12)
    table = positions("gray", 6)
    read = []
    for frames in (whole, [np.asfortranarray(f) for f in whole], [whole[0].astype(np.float64), *whole[1:]]):
        pairs = BitPairs.of(list(zip(frames[:6], frames[6:], strict=True)), 8.0, table)
        twice, reason = np.empty(SHAPE, np.uint16), np.zeros(SHAPE, np.uint8)
        pairs.read(ALL, twice, reason)
        read.append((twice, reason))
    assert all(np.array_equal(one, other) for each in read[1:] for one, other in zip(each, read[0], strict=True))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [96, 1920])
def test_beats_are_read_as_defined(kind: type, size: int) -> None:
    random, beats = np.random.default_rng(4), Beats.of((size, size), "column", 16.0)
    scale = 257 if kind is np.uint16 else 1
    x = random.uniform(-1, size, SHAPE)
    frames = [
        (scale * (60 + 55 * np.cos(2 * np.pi * (x / period - step / 4)) + random.normal(0, 1, SHAPE))).astype(kind)
        for period in beats.periods_px
        for step in range(4)
    ]
    for noise in (np.float32(1.5), np.full(SHAPE, 0.7, np.float32)):
        axis = BeatAxis.of(beats, frames, np.asarray(noise * scale))
        found, expected = axis.read(ALL), read_beats(axis)
        clear = ~expected.ambiguous
        assert np.array_equal(found.ambiguous, expected.ambiguous)
        assert clear.mean() > 0.99
        assert np.allclose(found.position_px[clear], expected.position_px[clear], rtol=0, atol=1e-3)
        assert np.allclose(found.sigma_px, expected.sigma_px, rtol=1e-4)
        assert np.allclose(found.misfit[clear], expected.misfit[clear], rtol=0.02, atol=0.02)


def test_a_pixel_without_light_has_no_coordinate_by_beats() -> None:
    code, flat = CODES["three-frequency"], np.full(SHAPE, 7, np.uint8)
    frames = dict.fromkeys(code.pattern_names((96, 128)), flat)
    found = code.decode(frames, (96, 128), white=flat + np.uint8(100), black=flat, noise_limit=4.0)
    assert not found.valid.any()


@pytest.mark.parametrize("count", [0, 1, 7, 8, 1003])
def test_distortion_is_inverted_as_defined(count: int) -> None:
    """To the bit, also of points that are nowhere, and of such as no lens shows."""
    random = np.random.default_rng(count)
    terms = (-0.12, 0.03, 1e-3, -2e-3, 0.01)
    plane = random.normal(scale=0.4, size=(count, 2))
    plane[::50], plane[3::50] = np.nan, 1e3
    expected = lens.undistort(plane, terms, limit=np.tan(np.radians(80)), rounds=8)
    assert np.array_equal(undistort(plane, terms), expected, equal_nan=True)


def test_distortion_inverted_and_distorted_is_where_it_was() -> None:
    plane = np.random.default_rng(1).uniform(-0.6, 0.6, size=(500, 2))
    terms = (0.1, -0.02, 1e-3, -1e-3, 0.0)
    assert np.allclose(distort(undistort(plane, terms, 40), terms), plane, atol=1e-12)
    assert np.allclose(distort(undistort(plane.T.copy().T, terms), terms), plane, atol=1e-4)
