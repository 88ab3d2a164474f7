"""Cameras whose pixels are larger than half a period of the finest stripes: moiré, which nothing can be told by."""

import cv2
import numpy as np
import pytest

from calibration.structured_light.consistency.check import check_gray_frames
from calibration.structured_light.gray import gray_code_patterns

SHAPE = (192, 256)
CAMERA = (96, 128)
FINE = 4
"""Samples along a projector pixel."""


def seen_by(frame: np.ndarray, pitch: float, rng: np.random.Generator) -> np.ndarray:
    """A slightly turned wall through camera pixels of so many projector pixels, each the mean of what is before it."""
    fine = np.kron(frame, np.ones((FINE, FINE))).astype(np.float32)
    turn = cv2.getRotationMatrix2D((0.0, 0.0), 2.0, FINE * pitch / 8)
    eighths = cv2.warpAffine(fine, turn, (8 * CAMERA[1], 8 * CAMERA[0]), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
    light = eighths.reshape(CAMERA[0], 8, CAMERA[1], 8).mean(axis=(1, 3))
    return np.asarray((12 + 0.4 * light + rng.normal(0, 1, CAMERA)).clip(0, 255), np.uint8)


def frames_through(pitch: float, *, inverses: bool = True) -> dict[str, np.ndarray]:
    """Photographs of a code."""
    rng = np.random.default_rng(3)
    return {
        pattern.name: seen_by(pattern.codes, pitch, rng)
        for pattern in gray_code_patterns(SHAPE, code="gray")
        if inverses or not pattern.name.endswith("-inverse")
    }


@pytest.mark.parametrize("inverses", [True, False], ids=["with inverses", "without"])
def test_finest_stripes_that_are_moire_do_not_refuse_the_others_and_are_told(inverses: bool) -> None:
    """A bright and a dark stripe are 1.9 camera pixels together: sharp, and near edges not as the code has them."""
    order = check_gray_frames(frames_through(2.1, inverses=inverses), 10)
    assert order.as_named
    assert order.undersampled == ("gray-column-00", "gray-row-00")
    assert order.unresolved == ()


@pytest.mark.parametrize("pitch", [1.0, 1.7, 2.8])
def test_stripes_that_agree_with_the_code_stay_evidence(pitch: float) -> None:
    assert check_gray_frames(frames_through(pitch), 10).undersampled == ()


@pytest.mark.parametrize(("a", "b"), [("column-01", "column-03"), ("row-01", "row-00"), ("column-02", "row-02")])
def test_exchanged_photographs_are_still_found_beside_moire(a: str, b: str) -> None:
    frames = frames_through(2.1)
    exchanged = {f"gray-{a}": frames[f"gray-{b}"], f"gray-{b}": frames[f"gray-{a}"]}
    turned = {f"gray-{a}-inverse": frames[f"gray-{b}-inverse"], f"gray-{b}-inverse": frames[f"gray-{a}-inverse"]}
    order = check_gray_frames({**frames, **exchanged, **turned}, 10)
    assert not order.as_named
    assert any(reading[f"gray-{a}"] == f"gray-{b}" for reading in order.readings)
