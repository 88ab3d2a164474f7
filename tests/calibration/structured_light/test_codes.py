"""Codes beyond what all of them keep: single axes, missing bits, light from other walls, and what to do about it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.structured_light.binary_code import BinaryCode
from calibration.structured_light.code import CODES
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.decode import decode_gray
from calibration.structured_light.fewer_lights import filled_in, lights_for, with_lights
from calibration.structured_light.gray import gray_code_patterns, words
from calibration.structured_light.patterns import Pattern, flat
from calibration.structured_light.stripe_width import blur_of_stripes, blur_patterns, times_as_wide
from calibration.structured_light.subpixel import refine_subpixel
from calibration.structured_light.wider import widened

PROJECTOR, CAMERA = (96, 128), (90, 120)
BLACK, LIGHT, NOISE_LIMIT = 20.0, 180.0, 8.0
ONE_AXIS = ("gray", "long-run", "xor-04", "gray-phase", "three-frequency", "micro-phase")


def truth() -> np.ndarray:
    y, x = np.mgrid[: CAMERA[0], : CAMERA[1]].astype(np.float32)
    return np.stack([3 + 0.97 * x + 0.02 * y, 2 + 0.98 * y - 0.01 * x], axis=-1)


def photograph(codes: np.ndarray, xy: np.ndarray, blur_px: float = 0.0) -> np.ndarray:
    shown = codes.astype(np.float32)
    shown = cv2.GaussianBlur(shown, (0, 0), blur_px) if blur_px else shown
    return BLACK + LIGHT * cv2.remap(shown, xy[..., 0], xy[..., 1], cv2.INTER_LINEAR) / 255


def read(code: object, xy: np.ndarray) -> Correspondence:
    frames = {pattern.name: photograph(pattern.codes, xy) for pattern in code.patterns(PROJECTOR)}  # type: ignore[attr-defined]
    white, black = (photograph(flat(PROJECTOR, level).codes, xy) for level in (255, 0))
    return code.decode(frames, PROJECTOR, white=white, black=black, noise_limit=NOISE_LIMIT)  # type: ignore[attr-defined, no-any-return]


@pytest.mark.parametrize("name", ONE_AXIS)
@pytest.mark.parametrize(("axis", "k"), [("column", 0), ("row", 1)])
def test_a_code_of_one_axis_has_half_the_pictures_and_gives_one_coordinate(name: str, axis: str, k: int) -> None:
    both, one = CODES[name], replace(CODES[name], axes=(axis,))  # type: ignore[type-var]
    assert set(one.pattern_names(PROJECTOR)) == {n for n in both.pattern_names(PROJECTOR) if f"-{axis}-" in n}
    found = refine_subpixel(read(one, truth()))
    assert found.valid.mean() > 0.7
    assert np.isnan(found.projector_xy_px[..., 1 - k]).all()
    error = np.abs(found.projector_xy_px - truth())[..., k][found.valid]
    of_both = np.abs(refine_subpixel(read(both, truth())).projector_xy_px - truth())[..., k][found.valid]
    assert np.nanmedian(of_both) == pytest.approx(np.median(error), abs=0.02), "refined as those of both axes are"
    assert error.max() < 1.0


@pytest.mark.parametrize("missing", [1, 2, 3])
def test_without_its_finest_bits_gray_code_gives_the_middles_of_wider_stripes(missing: int) -> None:
    code = replace(CODES["gray"], finest_bit=missing)  # type: ignore[type-var]
    assert len(code.pattern_names(PROJECTOR)) == len(CODES["gray"].pattern_names(PROJECTOR)) - 4 * missing
    found = read(code, truth())
    error = (found.projector_xy_px - truth())[found.valid]
    assert found.valid.mean() > 0.9
    assert np.abs(error).max() <= 2**missing / 2 + 0.6
    assert found.sigma_px is not None
    assert 0.5 < error.std() / found.sigma_px[0, 0, 0] < 1.5


def test_only_gray_code_can_do_without_its_finest_bits() -> None:
    code = BinaryCode(name="long-run", words="long-run", finest_bit=2)
    with pytest.raises(CalibrationError, match="only the code 'gray'"):
        read(code, truth())


@pytest.mark.parametrize(("code", "widest"), [("xor-02", 4), ("xor-04", 8)])
def test_xor_codes_have_only_fine_stripes(code: str, widest: int) -> None:
    for bits in (9, 10):
        word = words(code, bits)  # type: ignore[arg-type]
        assert sorted(word.tolist()) == list(range(2**bits))
        for bit in range(bits):
            edges = np.flatnonzero(np.diff((word >> bit) & 1))
            assert np.diff(edges).max() <= widest
            assert np.diff(edges).min() >= 2


# Light from other walls


WIDE = (32, 1024)


def seen_across(codes: np.ndarray) -> np.ndarray:
    """A row of pixels that see each other's half of the picture: what comes back from there exceeds their own light."""
    own = BLACK + LIGHT * codes[:40:4, ::2] / 255.0
    left, right = np.array_split(own, 2, axis=1)
    return own + 1.6 * np.where(np.arange(512) < 256, right.mean() - BLACK, left.mean() - BLACK)


def test_a_wide_bit_that_other_light_decides_is_refused_and_not_misread() -> None:
    truth_px = 2.0 * np.arange(512)
    frames = {pattern.name: seen_across(pattern.codes) for pattern in gray_code_patterns(WIDE)}
    white, black = (seen_across(flat(WIDE, level).codes) for level in (255, 0))
    trusting = decode_gray(frames, WIDE, white=white, black=black, contrast_limit=8, bit_limit=8)
    found = CODES["gray"].decode(frames, WIDE, white=white, black=black, noise_limit=8.0)
    misread = trusting.valid & (np.abs(trusting.projector_xy_px[..., 0] - truth_px) > 2)
    assert misread.mean() > 0.5
    assert (found.reason[misread] == PixelReason.UNCERTAIN_BIT).all()


# Fewer lights


def partly_read(unread: tuple[slice, slice]) -> Correspondence:
    xy, reason = truth().copy(), np.zeros(CAMERA, np.uint8)
    reason[unread] = PixelReason.UNCERTAIN_BIT
    reason[:5] = PixelReason.DARK
    xy[reason > 0] = np.nan
    return Correspondence(xy, reason, PROJECTOR, np.full_like(xy, 0.3))


def test_lights_stay_on_where_nothing_has_been_read() -> None:
    first = partly_read((slice(30, 60), slice(50, 90)))
    (lights,) = lights_for(first)
    column, row = np.rint(truth()[45, 70]).astype(int)
    assert lights[row, column]
    assert not lights[row, 20]
    assert len(lights_for(first, parts=3)) == 3
    assert np.logical_or.reduce(lights_for(first, parts=3))[lights].all()


def test_nothing_is_lit_again_when_all_has_been_read() -> None:
    everything = np.stack(np.meshgrid(np.arange(PROJECTOR[1]), np.arange(PROJECTOR[0])), axis=-1).astype(np.float32)
    assert lights_for(Correspondence(everything, np.zeros(PROJECTOR, np.uint8), PROJECTOR)) == []


def test_what_is_read_with_fewer_lights_fills_in_what_was_spoiled_and_nothing_else() -> None:
    unread = (slice(30, 60), slice(50, 90))
    first, again = partly_read(unread), partly_read((slice(0, 0), slice(0, 0)))
    (lights,) = lights_for(first)
    again.projector_xy_px[70, 10] = again.projector_xy_px[10, 10]
    again.projector_xy_px[31, 51] = (20, 60)  # not lit: cannot be
    joined = filled_in(first, again, lights)
    assert joined.valid[unread].mean() > 0.99
    assert not joined.valid[31, 51]
    assert np.array_equal(joined.projector_xy_px[first.valid], first.projector_xy_px[first.valid])
    assert (joined.reason[:5] == PixelReason.DARK).all()


def test_patterns_are_black_where_lights_are_off() -> None:
    lights = np.zeros(PROJECTOR, bool)
    lights[20:40, 30:60] = True
    (shown,) = with_lights([Pattern("white", np.full(PROJECTOR, 255, np.uint8))], lights)
    assert shown.name == "white"
    assert np.array_equal(shown.codes > 0, lights)


def test_bad_requests_for_fewer_lights_are_refused() -> None:
    columns = read(replace(CODES["gray"], axes=("column",)), truth())  # type: ignore[type-var]
    with pytest.raises(CalibrationError, match="only columns or only rows"):
        lights_for(columns)
    with pytest.raises(CalibrationError, match="0 parts"):
        lights_for(columns, parts=0)
    other = Correspondence(truth()[:-1], np.zeros((CAMERA[0] - 1, CAMERA[1]), np.uint8), PROJECTOR)
    with pytest.raises(CalibrationError, match="one camera and one projector"):
        filled_in(partly_read((slice(0, 1), slice(0, 1))), other, np.ones(PROJECTOR, bool))


# Stripe width


@pytest.mark.parametrize("blur_px", [1.0, 3.0, 5.0])
def test_stripes_of_two_widths_tell_blur_from_light_of_other_walls(blur_px: float) -> None:
    xy = truth()
    flats = [photograph(flat(PROJECTOR, level).codes, xy) for level in (255, 0)]
    frames = {p.name: photograph(p.codes, xy, blur_px) for p in blur_patterns(PROJECTOR)}
    inside = blur_of_stripes(frames, *flats, NOISE_LIMIT)
    assert inside.sigma_px == pytest.approx(blur_px, rel=0.15)
    glow = 300.0  # of other walls: half of it for every picture of stripes, whatever their width
    lit_room = {name: frame + glow / 2 for name, frame in frames.items()}
    bright = blur_of_stripes(lit_room, flats[0] + glow, flats[1], NOISE_LIMIT)
    assert bright.sigma_px == pytest.approx(inside.sigma_px, rel=1e-3)
    assert bright.lit.mean() > 0.95


@pytest.mark.parametrize("name", ["long-run", "gray", "xor-04", "gray-phase", "micro-phase"])
def test_a_code_that_blur_washes_out_is_read_with_wider_stripes(name: str) -> None:
    xy, blur_px = truth(), 5.0
    flats = [photograph(flat(PROJECTOR, level).codes, xy) for level in (255, 0)]
    times = times_as_wide(CODES[name], blur_px)
    assert times > 1
    inside = np.zeros(CAMERA, bool)
    inside[16:-16, 16:-16] = True
    read_share = []
    for code in (CODES[name], widened(CODES[name], times)):
        seen = {p.name: photograph(p.codes, xy, blur_px) for p in code.patterns(PROJECTOR)}
        found = code.decode(seen, PROJECTOR, white=flats[0], black=flats[1], noise_limit=NOISE_LIMIT)
        read_share.append(float(found.valid[inside].mean()))
    assert read_share[1] >= max(0.9, read_share[0])
    assert np.median(np.abs(found.projector_xy_px - xy)[found.valid & inside]) < 0.3


def test_sharp_stripes_stay_as_fine_as_they_are() -> None:
    assert all(times_as_wide(code, 0.6) == 1 for code in CODES.values())
    assert widened(CODES["gray"], 1) is CODES["gray"]


def test_without_lit_pixels_no_blur_is_claimed() -> None:
    dark = np.full(CAMERA, 20.0, np.float32)
    frames = {p.name: dark for p in blur_patterns(PROJECTOR)}
    assert blur_of_stripes(frames, dark, dark, NOISE_LIMIT).sigma_px == 0
    with pytest.raises(CalibrationError, match="blur-row-64-1"):
        blur_of_stripes({name: frame for name, frame in frames.items() if name != "blur-row-64-1"}, dark, dark, 8.0)
