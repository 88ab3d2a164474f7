"""Every fault of a display that `rig check` promises to find, planted."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rig.devices.protocols import Codes
from tests.rig.self_check.rig_with_faults import Checked


def test_a_white_segment_is_found_on_a_grey_camera() -> None:
    checked = Checked(("contrast = 1500.0", "contrast = 1500.0\nwhite_boost = 0.3"), only=["additivity"])
    assert checked.row("white against").value == pytest.approx(30, abs=1)
    assert checked.failed == {"additivity"}
    assert checked.row("superposition").met


def test_dynamic_contrast_breaks_superposition() -> None:
    def lift(codes: Codes) -> Codes:
        return np.where(codes.mean() < 200, (codes * 0.93), codes).astype(np.uint8)

    checked = Checked(only=["additivity"], codes=lift)
    assert not checked.row("superposition").met


def test_limited_range_is_found_at_both_ends() -> None:
    def limited(codes: Codes) -> Codes:
        return np.clip((codes.astype(np.float64) - 16) * 255 / 219, 0, 255).astype(np.uint8)

    checked = Checked(only=["ramp"], codes=limited)
    assert [checked.row(f"light of code {code}").met for code in ("15", "255")] == [False, False]
    assert not checked.row("codes 236 to 255").met
    assert "full RGB" in checked.row("light of code 15").advice


def test_a_six_bit_path_is_found() -> None:
    checked = Checked(only=["ramp"], codes=lambda codes: codes & 0xFC)
    assert checked.row("codes 112 to 128").value == pytest.approx(0.25)
    assert checked.row("light of code 15").met
    assert checked.failed == {"ramp"}


def test_a_scaled_picture_is_found() -> None:
    def scaled(codes: Codes) -> Codes:
        small = cv2.resize(codes, (250, 188), interpolation=cv2.INTER_LINEAR)
        return np.asarray(cv2.resize(small, (256, 192), interpolation=cv2.INTER_LINEAR))

    checked = Checked(only=["checker"], codes=scaled)
    assert not checked.row("single-pixel checker + its complement").met
    assert not checked.row("beating").met
    assert checked.row("light of the picture's edge").met


def test_sharpening_is_found() -> None:
    def sharpened(codes: Codes) -> Codes:
        soft = cv2.GaussianBlur(codes.astype(np.float32), (0, 0), 1.0)
        return np.clip(0.7 * codes + 0.3 * soft, 0, 255).astype(np.uint8)

    checked = Checked(only=["checker"], codes=sharpened)
    assert not checked.row("single-pixel checker + its complement").met


def test_overscan_is_found() -> None:
    def overscanned(codes: Codes) -> Codes:
        return np.asarray(cv2.resize(codes[6:-6, 8:-8], (256, 192), interpolation=cv2.INTER_NEAREST))

    checked = Checked(only=["checker"], codes=overscanned)
    assert checked.row("light of the picture's edge").value < 0.2
    assert all(share < 0.2 for share in checked.numbers("checker")["edges"].values())
