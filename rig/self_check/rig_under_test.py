"""The rig that is being checked: how its photographs are taken, and what several measurements need of it."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from calibration.arrays import BoolArray, Codes, FloatArray
from calibration.radiometry.black_level import BlackLevel, fit_black_level
from calibration.structured_light.patterns import flat
from rig.capture.rig import Rig
from rig.devices.protocols import RawFrame
from rig.errors import CaptureTimeout
from rig.self_check.compression import is_compressed
from rig.self_check.limits import CheckLimits

_LIT_SHARE = 0.3
"""Of the brightest; darker pixels see little of the projector's own light."""
_BAND = 0.1
"""Relative half width of the levels that count as one level."""
_SPARE_FRAMES = 12
"""Beyond twice a series' length: what a camera may lose and refuse before the series is given up."""
_ODD_REJECTIONS = ("stale", "ahead", "repeated", "malformed")


@dataclass(kw_only=True)
class RigUnderTest:
    """A rig, open, and its working exposure: white at about 80 % of full scale."""

    rig: Rig
    exposure_s: float
    channel: int = 0
    """The brightest one; all but colour is measured in it."""
    limits: CheckLimits = field(default_factory=CheckLimits)
    promised_latency_s: float = 0.0
    """What the profile says, before it is checked."""
    white_levels: list[tuple[float, float]] = field(default_factory=list)
    """(seconds, light of white above black) through the check."""
    taken: int = 0
    """Frames that measurements were given, and broken ones."""
    broken: int = 0
    """Frames of the wrong size, beside those that the rig has refused."""

    @property
    def refresh_rate_hz(self) -> float:
        """Of the display, by the profile."""
        return self.rig.profile.projector.refresh_rate_hz

    @property
    def full_scale_dn(self) -> int:
        """Largest digital number."""
        return self.rig.camera.full_scale_dn

    @property
    def exposure_range_s(self) -> tuple[float, float]:
        """What both the camera and the profile allow."""
        (low, high), (low2, high2) = self.rig.camera.exposure_range_s, self.rig.profile.camera.exposure_range_s
        return max(low, low2), min(high, high2)

    @property
    def picture_shape(self) -> tuple[int, int]:
        """(height, width) of the projector's pictures, in pixels."""
        return self.rig.projector.shape

    def shoot(self, picture: int | Codes, name: str = "", exposure_s: float | None = None) -> RawFrame:
        """Frame of a picture, or of one code everywhere, at the working exposure unless told."""
        if isinstance(picture, int):
            shown = flat(self.picture_shape, picture, name or None)
            picture, name = shown.codes, shown.name
        self.taken += 1
        return self.rig.shoot(picture, name=name, exposure_s=exposure_s or self.exposure_s)

    def photograph(self, picture: int | Codes, name: str = "", exposure_s: float | None = None) -> FloatArray:
        """(H, W) digital numbers of the brightest channel."""
        return self.pixels(self.shoot(picture, name, exposure_s))

    def pixels(self, frame: RawFrame) -> FloatArray:
        """(H, W) digital numbers of the brightest channel."""
        return frame.pixels[..., self.channel].astype(np.float64)

    def series(self, picture: int | Codes, count: int, name: str, exposure_s: float | None = None) -> list[RawFrame]:
        """``count`` frames one after the other while a picture stays; what the camera gives, copies included."""
        frames = [self.shoot(picture, name, exposure_s)]
        for _ in range(2 * count + _SPARE_FRAMES):
            if len(frames) == count:
                break
            frame = self.take(frames[-1].started_s + frames[-1].exposure_s / 2)
            if frame is not None and frame.started_s > frames[-1].started_s:
                frames.append(frame)
        if len(frames) < count:
            raise CaptureTimeout(
                f"only {len(frames)} of {count} frames came one after the other; look at cable and bus load"
            )
        return frames

    def take(self, after_s: float) -> RawFrame | None:
        """Next frame of the camera, whether or not it belongs to the picture; None when it is broken or does not come.

        The rig's own policy would refuse old frames; here they are what is to be seen.
        """
        self.taken += 1
        try:
            frame = self.rig.camera.capture(after_s=after_s, timeout_s=self.rig.profile.timing.timeout_s)
        except CaptureTimeout:
            return None
        if frame.pixels.shape == self.rig.camera.shape:
            return frame
        self.broken += 1
        return None

    @cached_property
    def white(self) -> FloatArray:
        """(H, W) mean of some frames of projector white. [dn]."""
        return np.asarray(np.mean([self.photograph(255, "white") for _ in range(3)], axis=0))

    @cached_property
    def black(self) -> FloatArray:
        """(H, W) mean of some frames of projector black. [dn]."""
        return np.asarray(np.mean([self.photograph(0, "black") for _ in range(3)], axis=0))

    @cached_property
    def is_compressed(self) -> bool:
        """Whether frames come as JPEG."""
        return is_compressed(self.photograph(255, "white"), self.photograph(255, "white"))

    @cached_property
    def offset_dn(self) -> float:
        """Digital number without light: projector black at the shortest exposure."""
        return self.black_level.offset_dn

    @cached_property
    def black_level(self) -> BlackLevel:
        """The same with its error, and whether noise is cut off there."""
        shortest_s = self.exposure_range_s[0]
        frames = [self.photograph(0, "black", shortest_s).ravel() for _ in range(2)]
        return fit_black_level(np.array(frames), [shortest_s, shortest_s])

    @cached_property
    def lit(self) -> BoolArray:
        """(H, W) pixels that see the projector's light and do not clip."""
        signal = self.white - self.black
        lit = (signal > _LIT_SHARE * np.quantile(signal, 0.99)) & (self.white < 0.95 * self.full_scale_dn)
        return np.asarray(lit)

    @cached_property
    def one_level(self) -> BoolArray:
        """(H, W) pixels among the brighter ones that all see about the same light."""
        signal = self.white - self.black
        level = np.quantile(signal[self.lit], 0.75)
        return np.asarray(self.lit & (np.abs(signal / level - 1) < _BAND))

    def note_white(self) -> None:
        """Photograph white, for drift."""
        frame = self.shoot(255, "white")
        light = float(self.pixels(frame)[self.lit].mean()) - float(self.black[self.lit].mean())
        self.white_levels.append((frame.started_s, light))

    @property
    def frames_given(self) -> int:
        """All that the camera has delivered, good or not."""
        return max(self.taken + sum(self.rejected().values()) - self.broken, 1)

    def rejected(self) -> Mapping[str, int]:
        """Frames that the rig has not accepted, by reason."""
        kinds = [event.kind for event in self.rig.events]
        counts = {kind: kinds.count(kind) for kind in _ODD_REJECTIONS}
        return {**counts, "malformed": counts["malformed"] + self.broken}


def fingerprint(frame: RawFrame) -> int:
    """Equal for equal pixels; the noise of two frames is never equal."""
    return zlib.crc32(np.ascontiguousarray(frame.pixels).data)
