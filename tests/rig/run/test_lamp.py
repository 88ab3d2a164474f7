"""A lamp that warms up is seen in the whites of a session, and noise and flicker are not taken for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rig.devices.protocols import RawFrame
from rig.errors import SessionError
from rig.run import lamp
from rig.stages.light.lamp import LampRecord

TIMES_S = {
    ("response", "level-255.e0.r0"): 3.0,
    ("gray", "white.e0.r0"): 5.0,
    **{("separation", f"white.e0.r{k}"): 11 + 0.2 * k for k in range(4)},
}


TIMES_S |= {
    **{("response", f"level-255.e0.r{k}"): 3 + k / 300 for k in (1, 2)},
    **{("separation", f"white.e0.r{k}"): 11.8 + k / 300 for k in (4, 5)},
}
"""And thirds of a period of room light at 100 Hz, which frames of white are averaged over."""


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

        return SimpleNamespace(load_frame=load_frame, has_frame=lambda frame: (name, frame) in TIMES_S)


@pytest.fixture
def straight(monkeypatch: pytest.MonkeyPatch) -> None:
    radiometric = SimpleNamespace(table=lambda: np.arange(4096) / 4095, saturation_dn=3800)
    monkeypatch.setattr(lamp, "load_radiometric_calibration", lambda _: radiometric)
    monkeypatch.setattr(lamp, "load_exposure", lambda _: SimpleNamespace(averaged_hz=None))


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


@pytest.mark.usefixtures("straight")
@pytest.mark.parametrize("share", [0.05, 0.3])
def test_what_changes_white_in_a_part_of_the_picture_is_no_lamp(share: float) -> None:
    """Of 50 columns the brightest, that is those on the right."""

    def light(time_s: float) -> float:
        return np.where(np.arange(50) > 40, 1 - (share if time_s > 10 else 0), 1.0)[:, None]  # type: ignore[return-value]

    assert lamp.lamp_change(Whites(light)).is_uneven  # type: ignore[arg-type]
    assert not lamp.lamp_change(Whites(lambda time_s: 1 - share * (time_s > 10))).is_uneven  # type: ignore[arg-type]


@pytest.mark.usefixtures("straight")
def test_white_behind_the_pictures_is_looked_at_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TIMES_S, ("project", "lamp-after.e0.r0"), 20.0)
    found = lamp.lamp_change(Whites(lambda time_s: 1.0 if time_s < 15 else 1.02))  # type: ignore[arg-type]
    assert found.percent == pytest.approx(2, abs=0.1)


@pytest.mark.usefixtures("straight")
def test_where_photographs_are_averaged_over_a_swell_white_is_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TIMES_S, ("separation", "white.e0.r1"), 11 + 1 / 300)
    monkeypatch.setitem(TIMES_S, ("separation", "white.e0.r2"), 11 + 2 / 300)
    monkeypatch.setitem(TIMES_S, ("separation", "white.e0.r3"), 11.8 + 3 / 300)
    monkeypatch.setattr(lamp, "load_exposure", lambda _: SimpleNamespace(averaged_hz=100.0))
    found = lamp.lamp_change(Whites(lambda time_s: 1 + 0.03 * np.sin(200 * np.pi * time_s)))  # type: ignore[arg-type]
    assert found.percent < 0.05


@dataclass
class Looked:
    """A session whose steps looked at the lamp."""

    shares: dict[str, tuple[float, ...]]

    def finished(self, name: str) -> Any:
        def load_record(_: str, kind: type[LampRecord]) -> LampRecord:
            if name not in self.shares:
                raise SessionError(f"step {name} has no such record")
            return kind(times_s=tuple(range(len(self.shares[name]))), shares=self.shares[name])

        return SimpleNamespace(load_record=load_record)


LOOKED = {"response": (1.0, 1.002, 1.003), "separation": (1.0, 0.994), "compare": (1.01, 1.011)}


def test_what_drift_leaves_is_that_of_the_step_in_which_white_changed_most() -> None:
    assert lamp.drift_left_percent(Looked(LOOKED)) == pytest.approx(0.6)  # type: ignore[arg-type]


@pytest.mark.parametrize("step", list(LOOKED))
def test_a_step_that_did_not_look_leaves_open_what_is_left(step: str) -> None:
    """Of an older version, or replayed from a recording without whites: then the rate is judged."""
    without = {name: shares for name, shares in LOOKED.items() if name != step}
    assert lamp.drift_left_percent(Looked(without)) is None  # type: ignore[arg-type]
    assert lamp.drift_left_percent(Looked(without | {step: (1.0,)})) is None  # type: ignore[arg-type]
