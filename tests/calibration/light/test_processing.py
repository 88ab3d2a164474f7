"""What JPEG leaves of pictures of checks is told apart from the noise of a sensor."""

import cv2
import numpy as np
import pytest

from calibration.light.processing import MiddleScatter, scatter_in_middles
from calibration.light.two_level import Footprint
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import checker_patterns

SHAPE = (120, 160)
BLUR_PX, NOISE_DN = 0.7, 1.0
WALL_DN = 130 + 40 * np.sin(np.arange(SHAPE[1]) / 30)[None, :] * np.ones((SHAPE[0], 1))


def frames_dn(quality: int | None) -> list[np.ndarray]:
    """Pictures of checks, 8 bits; of a camera that sends raw frames without a quality."""
    random = np.random.default_rng(6)
    found = []
    for pattern in checker_patterns(SHAPE, 10, 25):
        light = WALL_DN * cv2.GaussianBlur(pattern.codes / 255, (0, 0), BLUR_PX) + 30
        levels = np.clip(np.rint(light + random.normal(0, NOISE_DN, SHAPE)), 0, 255).astype(np.uint8)
        if quality is not None:
            code = cv2.imencode(".jpg", levels, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
            levels = cv2.imdecode(code, cv2.IMREAD_GRAYSCALE)
        found.append(levels.astype(np.float32))
    return found


def scatter(frames: list[np.ndarray], *, usable: bool = True) -> MiddleScatter:
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    xy = np.stack([column, row], axis=-1)
    return scatter_in_middles(
        frames,
        [pattern.codes for pattern in checker_patterns(SHAPE, 10, 25)],
        Correspondence(xy, np.zeros(SHAPE, np.uint8), SHAPE),
        seen=Footprint(xy_px=xy.astype(np.float64), variance_px2=np.full((*SHAPE, 2), BLUR_PX**2)),
        direct=WALL_DN.astype(np.float32),
        usable=np.full(SHAPE, usable),
    )


def added_dn(frames: list[np.ndarray]) -> float:
    found = scatter(frames)
    of_sensor = np.full_like(found.light, NOISE_DN**2 + 1 / 12)
    return found.beyond(of_sensor, np.ones_like(found.light))


def test_raw_frames_have_no_more_than_the_noise_of_their_sensor() -> None:
    found = scatter(frames_dn(None))
    assert len(found.light) > 2000
    assert found.variance.mean() == pytest.approx(NOISE_DN**2 + 1 / 12, rel=0.25)
    assert added_dn(frames_dn(None)) == 0.0


@pytest.mark.parametrize("quality", [75, 85, 95])
def test_what_jpeg_adds_is_what_it_changes(quality: int) -> None:
    frames, raw = frames_dn(quality), frames_dn(None)
    changed = np.stack(frames) - np.stack(raw)
    inside = np.stack(raw) > 0.95 * (WALL_DN + 30)
    true = float(changed[:, 8:-8, 8:-8][inside[:, 8:-8, 8:-8]].std())
    assert added_dn(frames) == pytest.approx(true, rel=0.35)


def test_worse_jpeg_adds_more() -> None:
    assert added_dn(frames_dn(60)) > 1.5 * added_dn(frames_dn(90)) > 0


def test_a_light_that_flickers_is_none_of_the_cameras_processing() -> None:
    frames = [frame * np.float32(1 + 0.03 * np.sin(k)) for k, frame in enumerate(frames_dn(None))]
    assert added_dn(frames) == 0.0


def test_where_no_pixel_may_be_asked_nothing_is_said_to_be_added() -> None:
    found = scatter(frames_dn(75), usable=False)
    assert len(found.light) == 0
    assert found.beyond(np.zeros(0), np.zeros(0)) == 0.0
