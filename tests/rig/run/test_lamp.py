"""A lamp that warms up is seen in the whites of a session, and noise and flicker are not taken for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rig.devices.protocols import RawFrame
from rig.run import lamp

TIMES_S = {
    ("response", "level-255.e0.r0"): 3.0,
    ("gray", "white.e0.r0"): 5.0,
    **{("separation", f"white.e0.r{k}"): 11 + 0.2 * k for k in range(4)},
}


@dataclass
class Whites:
    """A session that has nothing but its frames of white."""

    light: Callable[[float], float]
    """Of time."""

    def finished(self, name: str) -> Any:
        def load_frame(frame: str) -> RawFrame:
            time_s = TIMES_S[name, frame]
            random = np.random.default_rng(round(1000 * time_s))
            even = np.linspace(100, 3000, 2000).reshape(40, 50, 1) * self.light(time_s)
            pixels = np.rint(even + random.normal(0, 3, even.shape)).astype(np.uint16)
            return RawFrame(pixels=pixels, exposure_s=0.01, started_s=time_s, sequence=1)

        return SimpleNamespace(load_frame=load_frame)


@pytest.fixture
def straight(monkeypatch: pytest.MonkeyPatch) -> None:
    radiometric = SimpleNamespace(table=lambda: np.arange(4096) / 4095, saturation_dn=3800)
    monkeypatch.setattr(lamp, "load_radiometric_calibration", lambda _: radiometric)


@pytest.mark.usefixtures("straight")
@pytest.mark.parametrize("per_minute", [3.0, -2.0])
def test_a_lamp_that_drifts_is_measured_with_its_sign(per_minute: float) -> None:
    found = lamp.lamp_change(Whites(lambda time_s: 1 + per_minute / 100 * time_s / 60))  # type: ignore[arg-type]
    assert found.percent_per_minute == pytest.approx(per_minute, rel=0.1)
    assert found.percent == pytest.approx(abs(per_minute) * 8.6 / 60, rel=0.1)


@pytest.mark.usefixtures("straight")
def test_light_that_only_flickers_does_not_drift() -> None:
    found = lamp.lamp_change(Whites(lambda time_s: 1 + 0.003 * np.sin(40 * time_s)))  # type: ignore[arg-type]
    assert found.percent > 0.2
    assert found.percent_per_minute == pytest.approx(0, abs=1.0)
