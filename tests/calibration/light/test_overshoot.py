"""Whether a camera sharpens its pictures, from a checker and its complement."""

import cv2
import numpy as np
import pytest

from calibration.light.overshoot import overshoot_percent, side_px
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import checker

PROJECTOR, CAMERA = (150, 200), (300, 400)
"""A camera pixel sees half a projector pixel."""


def correspondence(share_seen: float = 1.0) -> Correspondence:
    place = np.stack(np.meshgrid(np.arange(CAMERA[1]), np.arange(CAMERA[0])), axis=-1)
    seen = np.arange(CAMERA[1]) < share_seen * CAMERA[1]
    reason = np.broadcast_to(np.where(seen, 0, 1), CAMERA).astype(np.uint8)
    return Correspondence(((place + 0.5) / 2 - 0.5).astype(np.float32), reason, PROJECTOR)


def direct(size_px: int, *, blur_px: float, sharpened: float = 0.0, noise: float = 0.0) -> np.ndarray:
    """A wall that is darker at one end and has a texture, by a camera that sharpens over a pixel."""
    random = np.random.default_rng(3)
    wall = np.linspace(1.0, 0.6, CAMERA[1]) * (1 + 0.1 * random.standard_normal(CAMERA))
    seen = []
    for shift_px in (size_px, 0):
        codes = checker(PROJECTOR, size_px, (0, shift_px)).astype(np.float32) / 255
        large = cv2.resize(codes, CAMERA[::-1], interpolation=cv2.INTER_NEAREST)
        light = cv2.GaussianBlur(large, (0, 0), blur_px) * wall + 0.3 + noise * random.standard_normal(CAMERA)
        seen.append(light + sharpened * (light - cv2.GaussianBlur(light, (0, 0), 1.2)))
    return np.abs(seen[0] - seen[1])


def test_checks_are_wide_enough_in_the_cameras_picture() -> None:
    assert side_px(correspondence()) == 12
    assert side_px(correspondence(share_seen=0.0)) == 2


@pytest.mark.parametrize("blur_px", [0.5, 1.5, 4.0])
@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_no_lens_leaves_more_light_beside_an_edge(blur_px: float, noise: float) -> None:
    found = overshoot_percent(direct(12, blur_px=blur_px, noise=noise), correspondence(), 12)
    assert found is not None
    assert found < 0.5


@pytest.mark.parametrize(("sharpened", "least_percent"), [(0.3, 2.0), (0.6, 4.0)])
@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_a_camera_that_sharpens_leaves_more(sharpened: float, least_percent: float, noise: float) -> None:
    found = overshoot_percent(direct(12, blur_px=0.8, sharpened=sharpened, noise=noise), correspondence(), 12)
    assert found is not None
    assert found > least_percent


@pytest.mark.parametrize("share_seen", [0.0, 0.02])
def test_where_too_little_is_seen_nothing_is_told(share_seen: float) -> None:
    assert overshoot_percent(direct(12, blur_px=0.8), correspondence(share_seen), 12) is None
