"""Decoding of synthetic photographs whose correspondence is known, and its sub-pixel refinement."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.decode import decode_gray
from calibration.structured_light.gray import gray_code_patterns
from calibration.structured_light.neighbours import beside_jumps
from calibration.structured_light.patterns import flat
from calibration.structured_light.subpixel import refine_subpixel

PROJECTOR = (96, 128)
CAMERA = (90, 120)
Frames = dict[str, np.ndarray]


def truth(scale: float = 1.0, angle: float = 0.05, shape: tuple[int, int] = CAMERA) -> np.ndarray:
    """(H, W, 2) projector coordinates of the camera's pixels: a plane seen with some perspective."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    x, y = x - shape[1] / 2, y - shape[0] / 2
    depth = 1 + 0.0004 * x - 0.0003 * y
    column = scale * (np.cos(angle) * x - np.sin(angle) * y) / depth
    row = scale * (np.sin(angle) * x + np.cos(angle) * y) / depth
    return np.stack([column, row], axis=-1)


def photographs(
    xy: np.ndarray, light: float = 200.0, noise: float = 0.0, dtype: type = np.float32, **patterns: object
) -> Frames:
    """What an ideal camera sees: each pixel the code of the projector pixel at its (rounded) coordinate."""
    rng = np.random.default_rng(1)
    shape = patterns.pop("shape", PROJECTOR)
    column, row = np.rint(xy).astype(int)[..., 0], np.rint(xy).astype(int)[..., 1]
    inside = (column >= 0) & (column < shape[1]) & (row >= 0) & (row < shape[0])  # type: ignore[index]
    frames = {}
    for pattern in gray_code_patterns(shape, **patterns):  # type: ignore[arg-type]
        lit = pattern.codes[np.where(inside, row, 0), np.where(inside, column, 0)] / 255.0 * inside
        image = 10 + light * lit + noise * rng.normal(size=lit.shape)
        frames[pattern.name] = np.clip(image, 0, None).astype(dtype)
    return frames


def shifted(xy: np.ndarray, right_px: float, down_px: float) -> np.ndarray:
    return xy + np.array([right_px, down_px])


def centred(xy: np.ndarray) -> np.ndarray:
    return shifted(xy, PROJECTOR[1] / 2, PROJECTOR[0] / 2)


@pytest.mark.parametrize("dtype", [np.float32, np.uint8, np.uint16])
@pytest.mark.parametrize("code", ["gray", "long-run"])
def test_codes_are_the_projector_pixels_that_were_seen(dtype: type, code: str) -> None:
    xy = centred(truth(0.7))
    decoded = decode_gray(
        photographs(xy, dtype=dtype, code=code),
        PROJECTOR,
        contrast_limit=20,
        bit_limit=10,
        code=code,  # type: ignore[arg-type]
    )
    inside = ((xy > -0.49) & (xy < (PROJECTOR[1] - 0.51, PROJECTOR[0] - 0.51))).all(axis=-1)
    assert decoded.valid[inside].mean() > 0.99
    assert np.array_equal(decoded.projector_xy_px[decoded.valid], np.rint(xy)[decoded.valid])
    assert np.isnan(decoded.projector_xy_px[~decoded.valid]).all()


def test_decoding_works_without_inverses() -> None:
    xy = centred(truth(0.7))
    frames = photographs(xy, inverse=False)
    white, black = np.full(CAMERA, 210.0, dtype=np.float32), np.full(CAMERA, 10.0, dtype=np.float32)
    decoded = decode_gray(frames, PROJECTOR, white=white, black=black, contrast_limit=20, bit_limit=10)
    assert decoded.valid.mean() > 0.95
    assert np.array_equal(decoded.projector_xy_px[decoded.valid], np.rint(xy)[decoded.valid])


@pytest.mark.parametrize("dtype", [np.float32, np.uint8])
@pytest.mark.parametrize("tone", [0.5, 1.0, 2.2])
@pytest.mark.parametrize("axes", [("column", "row"), ("row",)])
def test_a_tone_curve_makes_no_stripes_narrower_where_they_are_blurred(
    dtype: type, tone: float, axes: tuple[str, ...]
) -> None:
    """Half the light is 73 % of white by gamma 2.2: compared with the half, edges move and finest dark stripes vanish.

    Before, 30 % of a drawn set's points were off by more than three of their sigmas (seed 881017 of
    `benchmarks/photographs/drawn_photographs.py`).
    """
    shape, scale = (48, 64), 4
    rng = np.random.default_rng(3)
    frames: Frames = {}
    flat_ones = [flat(shape, 255, name="white"), flat(shape, 0, name="black")]
    for pattern in [*gray_code_patterns(shape, inverse=False, axes=axes), *flat_ones]:  # type: ignore[arg-type]
        light = cv2.GaussianBlur(np.kron(pattern.codes / 255.0, np.ones((scale, scale))), (0, 0), 0.9 * scale)
        seen = 255 * (0.02 + 0.9 * light) ** (1 / tone) + rng.normal(0, 0.5, light.shape)
        frames[pattern.name] = np.rint(seen.clip(0, 255)).astype(dtype)
    plain = {name: frame for name, frame in frames.items() if name.startswith("gray")}
    flats = {"white": frames["white"], "black": frames["black"]}
    found = decode_gray(plain, shape, **flats, contrast_limit=10, bit_limit=5, axes=axes)  # type: ignore[arg-type]
    inner = np.s_[4 * scale : -4 * scale, 4 * scale : -4 * scale]
    height, width = (size * scale for size in shape)
    true = (np.mgrid[:height, :width] + 0.5) / scale - 0.5
    read = found.valid[inner]
    assert read.mean() > 0.9
    for axis in axes:
        coded = 0 if axis == "column" else 1
        error = found.projector_xy_px[..., coded][inner][read] - true[1 - coded][inner][read]
        assert abs(error.mean()) < 0.02
        assert np.abs(error).max() < 0.8


@pytest.mark.parametrize("tone", [1.0, 2.2])
def test_pixels_that_only_other_surfaces_light_have_no_code_without_inverses(tone: float) -> None:
    """A tone curve lifts the half of white that each picture of stripes puts there: all bits would be 1."""
    height, width = 96, 128
    frames, lit = {}, np.s_[:, : width // 2]
    for pattern in [flat((48, 64), 255, "white"), flat((48, 64), 0, "black"), *gray_code_patterns((48, 64))]:
        shown = np.kron(pattern.codes / 255, np.ones((2, 2)))
        light = np.full((height, width), 0.02 + 0.3 * shown.mean())
        light[lit] += 0.6 * shown[lit]
        frames[pattern.name] = np.rint(255 * light ** (1 / tone)).astype(np.uint8)
    plain = {name: frame for name, frame in frames.items() if "gray" in name and "inverse" not in name}
    limits = {"contrast_limit": 9.0, "bit_limit": 4.5}
    found = decode_gray(plain, (48, 64), white=frames["white"], black=frames["black"], **limits)
    assert found.valid[lit].mean() > 0.9
    assert not found.valid[:, width // 2 + 1 :].any()


def test_no_point_is_taken_beside_the_end_of_a_surface() -> None:
    coordinate = np.tile(np.arange(40, dtype=np.float32), (20, 1))
    coordinate[:, 25:] += 9
    coordinate[5, 5] = np.nan
    found = beside_jumps(coordinate, 3.0)
    assert np.flatnonzero(found.any(axis=0)).tolist() == [24, 25]
    assert not beside_jumps(4 * coordinate[:, :25], 3.0).any(), "steps of four are usual here"
    assert not beside_jumps(np.full((4, 4), np.nan, np.float32), 3.0).any()


def test_more_bits_than_the_projector_needs_are_used() -> None:
    xy = centred(truth(0.7))
    wide = photographs(xy, shape=(PROJECTOR[0], 300))
    decoded = decode_gray(wide, PROJECTOR, contrast_limit=20, bit_limit=10)
    assert np.array_equal(decoded.projector_xy_px[decoded.valid], np.rint(xy)[decoded.valid])


def test_codes_that_begin_elsewhere_are_shifted_back() -> None:
    xy = centred(truth(0.6))
    frames = photographs(shifted(xy, 20, 5), shape=(128, 256))
    decoded = decode_gray(frames, PROJECTOR, contrast_limit=20, bit_limit=10, first_code=(20, 5))
    assert decoded.valid.mean() > 0.95
    assert np.array_equal(decoded.projector_xy_px[decoded.valid], np.rint(xy)[decoded.valid])


def test_a_pixel_on_the_border_of_two_codes_gets_the_border() -> None:
    xy = centred(truth(0.47, angle=0))
    frames = photographs(xy)
    border = photographs(shifted(xy, 1, 0))
    mixed = {name: (frames[name] + border[name]) / 2 for name in frames}
    decoded = decode_gray(mixed, PROJECTOR, contrast_limit=20, bit_limit=10)
    inside = (slice(5, -5), slice(5, -5))
    assert decoded.valid[inside].all()
    assert np.array_equal(decoded.projector_xy_px[inside][..., 0], np.rint(xy)[inside][..., 0] + 0.5)


def test_every_pixel_without_a_code_says_why() -> None:
    xy = centred(truth(0.7))
    frames = {name: image.copy() for name, image in photographs(xy).items()}
    for name, image in frames.items():
        image[10:20, 10:20] = 10  # no light arrives
        image[10:20, 40:50] = 255 if not name.endswith("inverse") else image[10:20, 40:50]
    for name in ("gray-column-05", "gray-column-05-inverse", "gray-column-04", "gray-column-04-inverse"):
        frames[name][40:50, 10:20] = 110  # two coarse bits say nothing
    swapped = {}
    for name in ("gray-column-06", "gray-column-06-inverse"):
        other = name.removesuffix("-inverse") if name.endswith("inverse") else f"{name}-inverse"
        swapped[name] = frames[other][60, 90]
    for name, value in swapped.items():
        frames[name][60, 90] = value  # one wrong bit
    reason = decode_gray(frames, PROJECTOR, contrast_limit=20, bit_limit=10, saturation=250).reason
    assert (reason[10:20, 10:20] == PixelReason.DARK).all()
    assert (reason[10:20, 40:50] == PixelReason.SATURATED).all()
    assert (reason[42:48, 12:18] == PixelReason.UNCERTAIN_BIT).all()
    assert reason[60, 90] == PixelReason.ISOLATED
    assert reason[30, 30] == PixelReason.VALID


def test_codes_outside_the_projector_are_out_of_range() -> None:
    xy = centred(truth(0.7))
    reason = decode_gray(photographs(xy, shape=(128, 128)), (96, 100), contrast_limit=20, bit_limit=10).reason
    assert (reason[xy[..., 0] > 100.5] == PixelReason.OUT_OF_RANGE).all()


def test_noise_leaves_few_wrong_codes() -> None:
    xy = centred(truth(0.7))
    frames = photographs(xy, light=100, noise=8.0)
    decoded = decode_gray(frames, PROJECTOR, contrast_limit=30, bit_limit=4 * 2**0.5 * 8)
    error = np.abs(decoded.projector_xy_px - np.rint(xy)).max(axis=-1)
    assert decoded.valid.mean() > 0.5
    assert np.mean(error[decoded.valid] > 1) < 1e-3


def test_missing_frames_are_named() -> None:
    frames = photographs(centred(truth()))
    del frames["gray-row-03"]
    with pytest.raises(CalibrationError, match=r"1 of 7 bits have no frame \(gray-row-03\)"):
        decode_gray(frames, PROJECTOR, contrast_limit=20, bit_limit=10)


def test_a_code_without_inverses_whose_finest_pictures_are_missing_is_refused_by_their_names() -> None:
    frames = photographs(centred(truth()), inverse=False)
    rest = {name: frame for name, frame in frames.items() if not name.endswith("-00")}
    with pytest.raises(CalibrationError, match="gray-column-00"):
        decode_gray(rest, PROJECTOR, contrast_limit=20, bit_limit=10)


def test_a_missing_inverse_among_others_is_named() -> None:
    frames = photographs(centred(truth()))
    del frames["gray-row-03-inverse"]
    with pytest.raises(CalibrationError, match="gray-row-03-inverse"):
        decode_gray(frames, PROJECTOR, contrast_limit=20, bit_limit=10)


def rounded(xy: np.ndarray) -> Correspondence:
    return Correspondence(np.rint(xy).astype(np.float32), np.zeros(xy.shape[:2], dtype=np.uint8), (1000, 1000))


@pytest.mark.parametrize("scale", [0.7, 0.9, 1.1, 1.5])
@pytest.mark.parametrize("angle", [0.03, 0.4, -1.2])
def test_refinement_recovers_the_coordinates_of_a_plane(scale: float, angle: float) -> None:
    xy = truth(scale, angle, (200, 240)) + 300
    error = refine_subpixel(rounded(xy)).projector_xy_px[8:-8, 8:-8] - xy[8:-8, 8:-8]
    assert np.sqrt((error**2).mean()) < 0.1
    assert np.abs(error.mean(axis=(0, 1))).max() < 0.02


def test_refinement_does_not_smear_over_the_edge_of_a_step() -> None:
    xy = truth(0.9, 0.1, (120, 160)) + 300
    xy[:, 80:] += (25, 3)
    refined = refine_subpixel(rounded(xy)).projector_xy_px
    error = np.abs(refined - xy).max(axis=-1)
    assert error.max() < 1.0
    near, whole = error[8:-8, 74:86], np.abs(np.rint(xy) - xy).max(axis=-1)[8:-8, 74:86]
    assert np.sqrt((near**2).mean()) <= np.sqrt((whole**2).mean())


def two_walls(shape: tuple[int, int]) -> np.ndarray:
    """Two planes that meet: the slope of the columns changes at x = 80."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    column = np.where(x < 80, 0.7 * (x - 80), 1.4 * (x - 80)) + 0.07 * y
    return np.stack([column, 0.9 * y + 0.04 * x], axis=-1) + 300


def test_refinement_at_the_edge_of_two_walls_is_no_worse_than_whole_codes() -> None:
    xy = two_walls((120, 160))
    error = refine_subpixel(rounded(xy)).projector_xy_px - xy
    edge = (slice(8, -8), slice(76, 85))
    whole = np.rint(xy) - xy
    assert np.sqrt((error[edge] ** 2).mean()) <= np.sqrt((whole[edge] ** 2).mean())


@pytest.mark.parametrize("spoil", [lambda v: v[20:30, 20:30].fill(True), lambda v: v[:, 50].fill(True)])
def test_invalid_pixels_stay_invalid_and_do_not_harm_their_neighbours(
    spoil: Callable[[np.ndarray], None],
) -> None:
    xy = truth(0.9, 0.2, (80, 90)) + 300
    invalid = np.zeros(xy.shape[:2], dtype=bool)
    spoil(invalid)
    reason = np.where(invalid, PixelReason.DARK, PixelReason.VALID).astype(np.uint8)
    codes = np.where(invalid[..., None], np.nan, np.rint(xy)).astype(np.float32)
    refined = refine_subpixel(Correspondence(codes, reason, (1000, 1000)))
    assert np.isnan(refined.projector_xy_px[invalid]).all()
    beside = cv2.dilate(invalid.astype(np.uint8), np.ones((5, 5))).astype(bool) & ~invalid
    assert np.abs(refined.projector_xy_px - xy)[beside].max() < 0.75


def test_a_bit_limit_may_differ_from_pixel_to_pixel() -> None:
    frames = photographs(centred(truth(0.7)))
    limit = np.full(CAMERA, 10.0, dtype=np.float32)
    limit[:, 60:] = 300
    reason = decode_gray(frames, PROJECTOR, contrast_limit=20, bit_limit=limit).reason
    assert (reason[10:-10, 10:59] == PixelReason.VALID).all()
    assert (reason[10:-10, 61:-10] == PixelReason.UNCERTAIN_BIT).all()


def test_scattered_pixels_keep_a_standard_deviation() -> None:
    """A window of a few pixels in one line has no plane; rounding once made their standard deviation no number."""
    valid = np.random.default_rng(1).random((600, 1200)) < 0.1
    y, x = np.mgrid[:600, :1200]
    codes = np.where(valid[..., None], np.round(np.stack([0.7 * x + 3, 0.8 * y], axis=-1)), np.nan).astype(np.float32)
    reason = np.where(valid, PixelReason.VALID, PixelReason.DARK).astype(np.uint8)
    refined = refine_subpixel(Correspondence(codes, reason, (1080, 1920)))
    assert refined.sigma_px is not None
    assert np.isfinite(refined.sigma_px).all()
    assert np.isfinite(refined.projector_xy_px[valid]).all()
