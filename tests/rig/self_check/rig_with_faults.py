"""A check of the tiny rig with one thing changed, for the tests of `rig check`."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.capture.rig import Rig
from rig.devices.drivers import make_devices
from rig.devices.protocols import Codes, RawFrame, Shown
from rig.profile.schema import Profile
from rig.records import JsonObject, Verdict
from rig.self_check import PARTS
from rig.self_check.parts.exposure import with_generous_latency
from rig.self_check.run import check_rig
from rig.terminal import silent

ROOT = Path(__file__).parents[3]
TINY = (ROOT / "hw_profiles" / "ci-tiny.toml").read_text(encoding="utf-8")
QUICK = (("cell_size_m = 0.2", "cell_size_m = 0.6"),)
"""Coarse interreflection: a new picture costs milliseconds; nothing that is measured here depends on it."""
REFRESH_S = 1 / 60
Change = tuple[str, str]
Capture = pytest.CaptureFixture[str]


class Through:
    """A device that passes everything on, but for what a test changes."""

    def __init__(self, inner: Any):
        self._inner = inner

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


class ChangedCamera(Through):
    """Frames are changed on their way."""

    def __init__(self, inner: Any, change: Callable[[RawFrame], RawFrame]):
        super().__init__(inner)
        self._change = change

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        return self._change(self._inner.capture(after_s=after_s, timeout_s=timeout_s))


class ChangedProjector(Through):
    """Codes are changed on their way; remembers when light really came."""

    def __init__(self, inner: Any, change: Callable[[Codes], Codes]):
        super().__init__(inner)
        self._change = change
        self.delays_s: list[float] = []

    def show(self, codes: Codes, *, name: str) -> Shown:
        shown = self._inner.show(np.ascontiguousarray(self._change(codes)), name=name)
        if name.startswith("latency-"):
            self.delays_s.append(self._inner.lit_pictures()[-1].light_s - shown.on_screen_s)
        return shown


def profile_of(*changes: Change) -> Profile:
    text = TINY
    for old, new in (*QUICK, *changes):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return Profile.parse(text.encode(), ROOT / "hw_profiles" / "changed.toml")


class Checked:
    """One check of a changed world."""

    def __init__(
        self,
        *changes: Change,
        only: Sequence[str] = (),
        pixels: Callable[[RawFrame], RawFrame] = lambda frame: frame,
        codes: Callable[[Codes], Codes] = lambda codes: codes,
    ):
        profile = profile_of(*changes)
        made = make_devices(profile)
        self.projector = ChangedProjector(made.projector, codes)
        with Rig(with_generous_latency(profile), ChangedCamera(made.camera, pixels), self.projector, made.clock) as rig:
            rig.set_exposure(profile.camera.exposure_s)
            self.result = check_rig(rig, profile, silent, [part for part in PARTS if part in only] or PARTS)
        self.json = json.loads(json.dumps(self.result.as_json(), allow_nan=False))

    def numbers(self, part: str) -> JsonObject:
        """As they are printed."""
        numbers: JsonObject = self.json["numbers"][part]
        return numbers

    def row(self, beginning: str) -> Verdict:
        rows = [verdict for _, verdict in self.result.rows if verdict.what.startswith(beginning)]
        assert len(rows) == 1, (beginning, [verdict.what for _, verdict in self.result.rows])
        return rows[0]

    @property
    def failed(self) -> set[str]:
        return {part for part, verdict in self.result.rows if not verdict.met}


def displaced(scene: np.ndarray, x: float, y: float) -> np.ndarray:
    """Exactly, by the phases of its waves; what leaves on one side comes back on the other."""
    wave_y, wave_x = np.fft.fftfreq(scene.shape[0])[:, None], np.fft.fftfreq(scene.shape[1])[None]
    return np.fft.ifft2(np.fft.fft2(scene) * np.exp(-2j * np.pi * (wave_x * x + wave_y * y))).real
