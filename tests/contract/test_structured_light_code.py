"""What every structured-light code has to keep: its pictures, seen ideally, decode to the truth."""

import re

import cv2
import numpy as np
import pytest

from calibration import CODES, CalibrationError, Correspondence, PixelReason, StructuredLightCode, flat, refine_subpixel

SHAPES = ((24, 40), (50, 33), (1, 7))
BLACK, LIGHT, NOISE_LIMIT = 20.0, 180.0, 10.0
Frames = dict[str, np.ndarray]


@pytest.fixture(params=sorted(CODES))
def code(request: pytest.FixtureRequest) -> StructuredLightCode:
    return CODES[request.param]


def seen(shape: tuple[int, int]) -> np.ndarray:
    """(H, W, 2) the projector pixel that each camera pixel looks at: twice as fine, turned upside down."""
    row, column = np.mgrid[: 2 * shape[0], : 2 * shape[1]] // 2
    return np.stack([column, row], axis=-1)[::-1, ::-1]


def photograph(codes: np.ndarray, xy: np.ndarray) -> np.ndarray:
    return BLACK + LIGHT * codes[xy[..., 1], xy[..., 0]] / 255.0


def photographs(code: StructuredLightCode, shape: tuple[int, int]) -> Frames:
    return {pattern.name: photograph(pattern.codes, seen(shape)) for pattern in code.patterns(shape)}


def decoded(code: StructuredLightCode, frames: Frames, shape: tuple[int, int]) -> Correspondence:
    white, black = (photograph(flat(shape, level).codes, seen(shape)) for level in (255, 0))
    return code.decode(frames, shape, white=white, black=black, noise_limit=NOISE_LIMIT, saturation=250)


def test_a_code_has_a_name_and_a_version(code: StructuredLightCode) -> None:
    assert re.fullmatch(r"[a-z][a-z0-9-]*", code.name)
    assert CODES[code.name] is code
    assert code.version


@pytest.mark.parametrize("shape", SHAPES)
def test_its_pictures_are_named_as_it_says_and_fill_the_projector(
    code: StructuredLightCode, shape: tuple[int, int]
) -> None:
    patterns = list(code.patterns(shape))
    names = [pattern.name for pattern in patterns]
    assert tuple(names) == code.pattern_names(shape)
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(rf"{code.name}-[a-z0-9-]+", name) for name in names)
    assert {(pattern.codes.shape, pattern.codes.dtype) for pattern in patterns} == {(shape, np.dtype(np.uint8))}


def test_the_same_pictures_come_again(code: StructuredLightCode) -> None:
    once, again = ([pattern.codes for pattern in code.patterns(SHAPES[0])] for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(once, again, strict=True))


@pytest.mark.parametrize("shape", SHAPES[:2])
@pytest.mark.parametrize("dtype", [np.float32, np.uint8, np.uint16])
def test_ideal_photographs_decode_to_the_truth(
    code: StructuredLightCode, shape: tuple[int, int], dtype: type[np.generic]
) -> None:
    frames = {name: frame.astype(dtype) for name, frame in photographs(code, shape).items()}
    found = decoded(code, frames, shape)
    assert found.projector_shape == shape
    assert found.valid.mean() > 0.99
    assert np.abs(found.projector_xy_px - seen(shape))[found.valid].max() <= 0.5
    assert np.isnan(found.projector_xy_px[~found.valid]).all()


def test_the_order_of_the_frames_does_not_matter(code: StructuredLightCode) -> None:
    frames = photographs(code, SHAPES[0])
    turned = dict(reversed(frames.items()))
    once, again = (decoded(code, each, SHAPES[0]).projector_xy_px for each in (frames, turned))
    np.testing.assert_array_equal(once, again)


def test_frames_are_left_as_they_were(code: StructuredLightCode) -> None:
    frames = photographs(code, SHAPES[0])
    before = {name: frame.copy() for name, frame in frames.items()}
    decoded(code, frames, SHAPES[0])
    assert all(np.array_equal(frames[name], before[name]) for name in frames)


def test_where_no_light_arrives_there_is_no_pixel_and_a_reason(code: StructuredLightCode) -> None:
    shape = SHAPES[0]
    white, black = (photograph(flat(shape, level).codes, seen(shape)) for level in (255, 0))
    frames = photographs(code, shape)
    for frame in (*frames.values(), white):
        frame[10:20, 10:30] = BLACK
    found = code.decode(frames, shape, white=white, black=black, noise_limit=NOISE_LIMIT)
    assert not found.valid[10:20, 10:30].any()
    assert (found.reason[10:20, 10:30] > 0).all()
    assert found.valid[30:, 40:].all()


def test_a_missing_frame_is_refused_by_name(code: StructuredLightCode) -> None:
    frames = photographs(code, SHAPES[0])
    missing = code.pattern_names(SHAPES[0])[2]
    del frames[missing]
    with pytest.raises(CalibrationError, match=missing):
        decoded(code, frames, SHAPES[0])


def test_no_frames_are_refused(code: StructuredLightCode) -> None:
    with pytest.raises(CalibrationError, match="photograph"):
        decoded(code, {}, SHAPES[0])


def test_a_frame_of_another_size_is_refused_by_name(code: StructuredLightCode) -> None:
    frames = photographs(code, SHAPES[0])
    other = code.pattern_names(SHAPES[0])[3]
    frames[other] = frames[other][:-1]
    with pytest.raises(CalibrationError, match=f"{other}.*shape"):
        decoded(code, frames, SHAPES[0])


PLANE = (96, 128)
NOISE_DN = 1.5


def plane_xy(camera: tuple[int, int] = (110, 150)) -> np.ndarray:
    """(H, W, 2) projector coordinates of a slanted plane that fills the picture but for its edges."""
    y, x = np.mgrid[: camera[0], : camera[1]].astype(np.float32)
    return np.stack([4 + 0.79 * x + 0.03 * y, 3 + 0.81 * y - 0.02 * x], axis=-1)


def noisy(codes: np.ndarray, xy: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    light = cv2.remap(codes.astype(np.float32), xy[..., 0], xy[..., 1], cv2.INTER_LINEAR)
    return np.rint(BLACK + LIGHT * light / 255 + NOISE_DN * rng.standard_normal(light.shape)).astype(np.uint16)


def read_plane(code: StructuredLightCode, xy: np.ndarray) -> Correspondence:
    rng = np.random.default_rng(4)
    frames = {pattern.name: noisy(pattern.codes, xy, rng) for pattern in code.patterns(PLANE)}
    white, black = (noisy(flat(PLANE, level).codes, xy, rng) for level in (255, 0))
    limit = 2 * 2**0.5 * NOISE_DN
    return refine_subpixel(code.decode(frames, PLANE, white=white, black=black, noise_limit=limit))


def test_noise_moves_coordinates_by_what_their_sigmas_say(code: StructuredLightCode) -> None:
    xy = plane_xy()
    found = read_plane(code, xy)
    inner = found.valid & ((xy > 6) & (xy < (PLANE[1] - 7, PLANE[0] - 7))).all(axis=-1)
    assert inner.mean() > 0.4
    assert found.sigma_px is not None
    error = (found.projector_xy_px - xy)[inner]
    assert np.mean(np.abs(error) > 1.0) < 1e-3
    assert 0.5 < 1.4826 * np.median(np.abs(error / found.sigma_px[inner])) < 2


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_frames_of_any_kind_are_read_alike(code: StructuredLightCode, dtype: type[np.generic]) -> None:
    rng, xy = np.random.default_rng(9), plane_xy()
    xy[80:, 120:] += 60.0  # beyond the picture, and an edge
    shown = [*code.patterns(PLANE), flat(PLANE, 255, "white"), flat(PLANE, 0, "black")]
    frames = {pattern.name: noisy(pattern.codes, xy, rng) for pattern in shown}
    for frame in frames.values():
        frame[5:12, 5:12] += 40
    one, other = (
        code.decode(
            {name: frame.astype(kind) for name, frame in frames.items() if name not in ("white", "black")},
            PLANE,
            white=frames["white"].astype(kind),
            black=frames["black"].astype(kind),
            noise_limit=5.0,
            saturation=230,
        )
        for kind in (np.uint16, dtype)
    )
    assert set(np.unique(one.reason)) >= {PixelReason.VALID, PixelReason.DARK, PixelReason.SATURATED}
    assert (one.reason != other.reason).mean() < 0.005
    apart_px = np.abs(one.projector_xy_px - other.projector_xy_px)[one.valid & other.valid]
    assert (apart_px > 1e-3).mean() < 0.01  # the mean of white and black is a whole number, or a half more
    assert apart_px.max() <= 0.5


def test_two_codes_agree_on_one_scene(code: StructuredLightCode) -> None:
    xy = plane_xy()
    one, other = read_plane(code, xy), read_plane(CODES["long-run"], xy)
    apart = np.abs(one.projector_xy_px - other.projector_xy_px)[one.valid & other.valid]
    assert np.median(apart) <= 0.3


def test_clipped_pixels_say_so(code: StructuredLightCode) -> None:
    shape = SHAPES[0]
    frames = photographs(code, shape)
    for frame in frames.values():
        frame[10:20, 10:30] = np.minimum(3 * frame[10:20, 10:30], 255)
    found = decoded(code, frames, shape)
    clipped = np.max([frame[10:20, 10:30] for frame in frames.values()], axis=0) >= 250
    assert clipped.mean() > 0.9
    assert (found.reason[10:20, 10:30][clipped] == PixelReason.SATURATED).all()


def test_frames_of_colour_are_refused_by_name(code: StructuredLightCode) -> None:
    frames = photographs(code, SHAPES[0])
    name = code.pattern_names(SHAPES[0])[1]
    frames[name] = np.repeat(frames[name][..., None], 3, axis=2)
    with pytest.raises(CalibrationError, match=f"{name}.*shape"):
        decoded(code, frames, SHAPES[0])
