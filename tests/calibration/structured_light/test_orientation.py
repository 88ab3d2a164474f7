"""Left and right of two pictures: kept by every surface, exchanged only by a mirror."""

import re

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.orientation import without_mirrored

SHAPE = (60, 80)


def map_of(xy: np.ndarray, noise_px: float = 0.0) -> Correspondence:
    xy = xy + np.random.default_rng(1).normal(0, noise_px, xy.shape)
    valid = np.isfinite(xy).any(axis=-1)
    reason = np.where(valid, PixelReason.VALID, PixelReason.DARK).astype(np.uint8)
    return Correspondence(xy.astype(np.float32), reason, (96, 128))


def picture(turned_deg: float = 0.0, scale: float = 0.7) -> np.ndarray:
    """(H, W, 2) a projector that is turned about its axis, on two walls that meet in a corner."""
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    x, y = column - 40 + 0.4 * np.abs(column - 40), row - 30
    angle = np.radians(turned_deg)
    turned = np.stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y], axis=-1)
    return np.asarray(64 + scale * turned)


@pytest.mark.parametrize("turned_deg", [0, 90, 180, 37])
def test_a_projector_on_its_side_or_upside_down_is_not_mirrored(turned_deg: float) -> None:
    without_mirrored(map_of(picture(turned_deg), noise_px=0.2))


@pytest.mark.parametrize("turned_deg", [0, 90, 180, 37])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_mirrored_picture_is_refused_however_the_projector_stands(turned_deg: float, axis: int) -> None:
    with pytest.raises(CalibrationError, match="one of the pictures is mirrored") as refused:
        without_mirrored(map_of(np.flip(picture(turned_deg), axis), noise_px=0.2))
    share = re.search(r"in (\d+) % of the \d+ pixels", str(refused.value))
    assert share is not None
    assert int(share[1]) > 80


def test_whole_projector_pixels_tell_as_well() -> None:
    without_mirrored(map_of(np.rint(picture())))
    with pytest.raises(CalibrationError, match="mirrored"):
        without_mirrored(map_of(np.rint(picture()[:, ::-1])))


@pytest.mark.parametrize("seed", range(5))
def test_a_camera_far_finer_than_the_noise_of_its_places_tells_too(seed: int) -> None:
    row, column = np.mgrid[:480, :640].astype(float)
    xy = np.stack([0.1 * column, 0.1 * row], axis=-1) + np.random.default_rng(seed).normal(0, 0.3, (480, 640, 2))
    without_mirrored(map_of(xy))
    with pytest.raises(CalibrationError, match=r"in (9.|100) % of"):
        without_mirrored(map_of(xy[:, ::-1]))


def test_columns_alone_tell_nothing() -> None:
    xy = picture()[:, ::-1].copy()
    xy[..., 1] = np.nan
    without_mirrored(map_of(xy))


@pytest.mark.parametrize("scale", [0.3, 0.7, 2.5])
@pytest.mark.parametrize("seed", range(3))
def test_a_mirror_on_one_wall_is_taken_away_and_nothing_else(scale: float, seed: int) -> None:
    row, column = np.mgrid[:240, :320].astype(float)
    xy = scale * np.stack([column + 0.4 * np.abs(column - 160), row], axis=-1)
    xy[60:140, 200:280] = xy[60:140, 120:40:-1]
    xy += np.random.default_rng(seed).normal(0, 0.1, xy.shape)
    found = without_mirrored(map_of(xy)).reason == PixelReason.MIRRORED
    mirror = np.zeros(found.shape, dtype=bool)
    mirror[60:140, 200:280] = True
    assert found[mirror].mean() > 0.95
    border = 12 if scale < 0.5 else 8
    assert not found[: 60 - border].any()
    assert not found[:, : 200 - border].any()


def test_a_map_without_mirrors_is_given_back_as_it_is() -> None:
    given = map_of(picture(), noise_px=0.2)
    assert without_mirrored(given) is given


def test_a_few_wrong_codes_tell_nothing() -> None:
    xy = picture()[:, ::-1]
    xy[8:] = np.nan
    xy[:, 12:] = np.nan
    without_mirrored(map_of(xy))
