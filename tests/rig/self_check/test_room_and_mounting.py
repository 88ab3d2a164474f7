"""What `rig check` says of the room's light, of a lamp that drifts and of what is not fixed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rig.devices.protocols import Codes, RawFrame
from tests.rig.self_check.rig_with_faults import (
    Checked,
    displaced,
)


def flickering(ambient: float) -> tuple[str, str]:
    return ("ambient = 0.0004", f"ambient = {ambient}\nambient_flicker_hz = 100.0\nambient_flicker = 0.5")


def lifted(codes: Codes) -> Codes:
    return np.asarray(codes // 2 + 64 * (codes > 200), dtype=np.uint8)


def test_what_fails_beside_room_light_that_flickers_says_so_first() -> None:
    checked = Checked(flickering(0.5), only=["latency", "flicker", "linearity", "noise", "additivity", "ramp"])
    assert {"latency", "flicker", "additivity"} <= checked.failed
    assert "changes by" in checked.row("latency could not be measured").advice
    assert "room light that flickers" in checked.row("latency could not be measured").advice
    for part, verdict in checked.result.rows:
        if not verdict.met and part not in ("latency", "exposure", "flicker"):
            assert verdict.advice.startswith("the room's light that flickers (above) can do this alone"), verdict.what
    steady = Checked(
        only=["flicker", "additivity"], codes=lambda codes: (codes // 2 + 64 * (codes > 200)).astype(np.uint8)
    )
    assert all("room's light" not in verdict.advice for _, verdict in steady.result.rows)


def test_light_of_edges_is_a_share_even_where_room_light_drowns_it() -> None:
    edges = Checked(flickering(0.08), only=["checker"]).numbers("checker")["edges"]
    assert all(share is None or 0 <= share < 20 for share in edges.values())


def test_edges_that_the_camera_does_not_see_are_not_judged() -> None:
    """A camera that sees the middle of the picture, in steps that the light of edges by way of walls does not reach."""

    def coarse(frame: RawFrame) -> RawFrame:
        return replace(frame, pixels=np.asarray(frame.pixels // 128 * 128 + 64, dtype=np.uint16))

    checked = Checked(("focal_px = 132.925", "focal_px = 265.85"), only=["checker"], pixels=coarse)
    assert None in checked.numbers("checker")["edges"].values()
    assert checked.row("light of the picture's edge").met


def test_a_room_that_is_bright_for_eight_refreshes_is_measured_with_shorter_ones() -> None:
    """Light on black alone fills a camera of white that needs half a refresh."""
    checked = Checked(("ambient = 0.0004", "ambient = 0.2"), ("flux = 10.0", "flux = 40.0"), only=["linearity"])
    assert not checked.numbers("linearity")["whole_refreshes"]
    assert checked.row("nonlinearity that the camera's curve leaves").met


def test_the_noise_of_a_camera_is_told_beside_room_light_that_flickers() -> None:
    still, swelling = (Checked(*changes, only=["noise"]) for changes in ((), (flickering(0.03),)))
    for what in ("gain", "full well, at full scale"):
        assert swelling.row(what).value == pytest.approx(still.row(what).value, rel=0.03)
    assert swelling.row("photon transfer off a straight line").met


def test_room_light_that_flickers_is_found_and_named() -> None:
    checked = Checked(flickering(0.08), only=["exposure", "flicker"])
    numbers = checked.numbers("flicker")
    assert "flicker" in checked.failed
    assert checked.row("strongest ripple").value == pytest.approx(10, abs=0.3)
    assert "100 Hz room light" in numbers["source"]
    assert numbers["where"] == "room"
    assert "darkness" not in checked.failed
    chosen_s = checked.result.suggested["camera.exposure_s"]
    assert chosen_s * 60 == pytest.approx(round(chosen_s * 60), abs=0.01)
    assert chosen_s * 100 == pytest.approx(round(chosen_s * 100), abs=0.03)


def test_the_flicker_of_white_is_as_large_as_that_of_the_simulated_world() -> None:
    swelling = {"rate": 0.03}

    def flicker(frame: RawFrame) -> RawFrame:
        factor = 1 + swelling["rate"] * np.sin(2 * np.pi * 3.3 * frame.started_s)
        return replace(frame, pixels=np.rint(64 + (frame.pixels - 64.0).clip(0) * factor).astype(np.uint16))

    checked = Checked(only=["flicker"], pixels=flicker)
    assert checked.row("flicker of white from frame to frame").value == pytest.approx(3 / np.sqrt(2), rel=0.05)
    assert checked.row("strongest ripple").value == pytest.approx(3.3, abs=0.3)
    assert "unknown" in checked.numbers("flicker")["source"]


def test_bands_of_a_rolling_shutter_are_found() -> None:
    def bands(frame: RawFrame) -> RawFrame:
        rows = np.arange(frame.pixels.shape[0])[:, None, None]
        factor = 1 + 0.02 * np.sin(2 * np.pi * (rows / 60 + 7.1 * frame.started_s))
        return replace(frame, pixels=np.rint(64 + (frame.pixels - 64.0).clip(0) * factor).astype(np.uint16))

    checked = Checked(only=["flicker"], pixels=bands)
    assert checked.row("flicker of white from row to row").value == pytest.approx(2 / np.sqrt(2), rel=0.15)
    assert "flicker" in checked.failed


def test_drift_of_the_lamp_is_measured() -> None:
    def fade(frame: RawFrame) -> RawFrame:
        factor = 1 - 0.06 * frame.started_s / 60
        return replace(frame, pixels=np.rint(64 + (frame.pixels - 64.0).clip(0) * factor).astype(np.uint16))

    checked = Checked(only=["exposure", "linearity", "pixels", "checker", "stability"], pixels=fade)
    assert checked.row("drift of white").value == pytest.approx(6, rel=0.15)
    assert "stability" in checked.failed


def test_vibration_and_a_shift_of_the_camera_are_measured() -> None:
    random = np.random.default_rng(5)

    def shake(frame: RawFrame) -> RawFrame:
        x, y = random.normal(0, 0.2, 2) + (0.6 if frame.started_s > 8 else 0.0)
        moved = displaced(frame.pixels[..., 0].astype(np.float64), x, y)
        return replace(frame, pixels=np.clip(np.rint(moved), 0, 4095).astype(np.uint16)[..., None])

    checked = Checked(only=["exposure", "pixels", "linearity", "stability"], pixels=shake)
    assert checked.row("vibration").value == pytest.approx(0.2 * np.sqrt(2), rel=0.25)
    assert checked.row("shift of the picture").value == pytest.approx(0.6 * np.sqrt(2), abs=0.25)
    assert not checked.row("vibration").met
    assert not checked.row("shift of the picture").met


def test_room_light_is_measured() -> None:
    checked = Checked(("ambient = 0.0004", "ambient = 0.15"), only=["darkness"])
    assert not checked.row("room light").met
    assert checked.row("contrast").value < 6
