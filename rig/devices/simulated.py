"""The simulated pair: a camera and a projector on one bench, in virtual time.

Every random event is drawn from the bench's seed and the time at which it happens, so the world is a function of
time alone: a session that is killed and resumed at the time of its last frame sees what it would have seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.devices.bench import Bench, Float32Array
from rig.devices.bench_settings import BenchCamera
from rig.devices.clock import VirtualClock
from rig.devices.protocols import Codes, RawFrame, Shown
from rig.errors import CaptureTimeout, DeviceLost, SettingRefused

_KEPT_PICTURES = 4


@dataclass(frozen=True, slots=True)
class _LitPicture:
    """A picture and when its light came."""

    light_s: float
    codes: Codes


class SimulatedProjector:
    """Shows codes on the bench at the next refresh, with latency and jitter until the light comes."""

    def __init__(self, bench: Bench, clock: VirtualClock, *, refresh_rate_hz: float):
        self._bench = bench
        self._clock = clock
        self._period_s = 1.0 / refresh_rate_hz
        self._open = False
        self._pictures: list[_LitPicture] = []
        self._black = np.zeros(self.shape, dtype=np.uint8)

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), in pixels."""
        return self._bench.projector.shape

    def open(self) -> None:
        """Switch on; shows black."""
        if not self._open:
            self._open = True
            self._pictures = [_LitPicture(-math.inf, self._black)]

    def close(self) -> None:
        """Go black."""
        self._open = False
        self._pictures = [_LitPicture(-math.inf, self._black)]

    def show(self, codes: Codes, *, name: str) -> Shown:
        """Show codes of exactly its shape, (H, W) or (H, W, 3), at the next refresh."""
        if not self._open:
            raise DeviceLost("the simulated projector is closed: open the rig before showing a picture")
        if codes.dtype != np.uint8 or codes.shape not in (self.shape, (*self.shape, 3)):
            raise SettingRefused(
                f"the projector shows uint8 codes of shape {self.shape}, not {codes.dtype} of {codes.shape}"
            )
        on_screen_s = math.ceil(self._clock.now_s() / self._period_s + 1e-9) * self._period_s
        self._clock.wait_until_s(on_screen_s)
        projector = self._bench.settings.projector
        jitter = self._bench_random(on_screen_s).uniform(0, projector.jitter_s)
        self._pictures.append(_LitPicture(on_screen_s + projector.latency_s + jitter, codes.copy()))
        del self._pictures[:-_KEPT_PICTURES]
        return Shown(on_screen_s, name)

    def shown_during(self, start_s: float, end_s: float) -> list[tuple[Codes, float]]:
        """Pictures that were lit in an interval, each with its share of it."""
        ends = [p.light_s for p in self._pictures[1:]] + [math.inf]
        parts = []
        for picture, until_s in zip(self._pictures, ends, strict=True):
            overlap_s = min(end_s, until_s) - max(start_s, picture.light_s)
            if overlap_s > 0:
                parts.append((picture.codes, overlap_s / (end_s - start_s)))
        return parts

    def _bench_random(self, time_s: float) -> np.random.Generator:
        return np.random.default_rng((self._bench.settings.seed, 1, round(time_s * 1e6)))


class SimulatedCamera:
    """Photographs the bench: exposure, lens, shot and read noise, response, quantisation, late and lost frames."""

    def __init__(
        self,
        bench: Bench,
        projector: SimulatedProjector,
        clock: VirtualClock,
        *,
        bit_depth: int,
        frame_rate_hz: float,
        exposure_range_s: tuple[float, float],
    ):
        self.bench = bench
        self._projector = projector
        self._clock = clock
        self._bit_depth = bit_depth
        self._period_s = 1.0 / frame_rate_hz
        self._exposure_range_s = exposure_range_s
        self._exposure_s = exposure_range_s[0]
        self._open = False
        self._sequence = 0
        self._vignetting = bench.vignetting
        self._cache: tuple[Codes, Float32Array] | None = None

    @property
    def shape(self) -> tuple[int, int, int]:
        """(height, width, 1), in pixels."""
        return (*self.bench.camera.shape, 1)

    @property
    def full_scale_dn(self) -> int:
        """Largest digital number."""
        return int(2**self._bit_depth - 1)

    @property
    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure."""
        return self._exposure_range_s

    def open(self) -> None:
        """Make ready."""
        self._open = True

    def close(self) -> None:
        """Let go."""
        self._open = False

    def set_exposure(self, exposure_s: float) -> float:
        """Choose the nearest multiple of 10 µs."""
        self._check_open()
        shortest, longest = self._exposure_range_s
        if not shortest <= exposure_s <= longest:
            raise SettingRefused(f"exposure {exposure_s:.6g} s is outside the camera's {shortest:g} … {longest:g} s")
        self._exposure_s = round(exposure_s * 1e5) / 1e5
        return self._exposure_s

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        """Next frame on the camera's grid of start times; now and then an old one, as real drivers deliver."""
        self._check_open()
        camera = self.bench.settings.camera
        start_s = math.ceil(max(after_s, self._clock.now_s()) / self._period_s - 1e-9) * self._period_s
        chance = self._random(start_s, 2).uniform(size=2)
        self._sequence += 1
        if chance[0] < camera.dropped_frame_rate:
            self._sequence += 1
            start_s += self._period_s
        if start_s + self._exposure_s - self._clock.now_s() > timeout_s:
            self._clock.wait_until_s(self._clock.now_s() + timeout_s)
            raise CaptureTimeout(f"no frame within {timeout_s:g} s: the exposure would end later; allow more time")
        self._clock.wait_until_s(start_s + self._exposure_s)
        if chance[1] < camera.stale_frame_rate:
            start_s -= 8 * self._period_s
        return RawFrame(self._expose(start_s)[..., None], self._exposure_s, start_s, self._sequence)

    def _expose(self, start_s: float) -> NDArray[np.uint16]:
        light = np.zeros(self.bench.camera.shape, dtype=np.float32)
        for codes, share in self._projector.shown_during(start_s, start_s + self._exposure_s):
            light += np.float32(share) * self._light(codes)
        random = self._random(start_s, 3)
        return sensor_response(
            self.bench.settings.camera, light * self._vignetting, self._exposure_s, self.full_scale_dn, random
        )

    def _light(self, codes: Codes) -> Float32Array:
        """Radiosity after the lens's blur; the last picture is kept, for repeated exposures."""
        if self._cache is None or not np.array_equal(self._cache[0], codes):
            light = self.bench.light(codes).total
            blur = self.bench.settings.camera.blur_px
            blurred = np.asarray(cv2.GaussianBlur(light, (0, 0), blur) if blur > 0 else light, dtype=np.float32)
            self._cache = (codes, blurred)
            return blurred
        return self._cache[1]

    def _random(self, time_s: float, purpose: int) -> np.random.Generator:
        return np.random.default_rng((self.bench.settings.seed, purpose, max(0, round(time_s * 1e6))))

    def _check_open(self) -> None:
        if not self._open:
            raise DeviceLost("the simulated camera is closed: open the rig before using it")


def sensor_response(
    camera: BenchCamera, light: Float32Array, exposure_s: float, full_scale_dn: int, random: np.random.Generator
) -> NDArray[np.uint16]:
    """Digital numbers of a light image: electrons, shot and read noise, compression, black level, clip."""
    electrons = light * np.float32(camera.sensitivity_e_per_s * exposure_s)
    noise = random.standard_normal(electrons.shape, dtype=np.float32)
    electrons += noise * np.sqrt(electrons + np.float32(camera.read_noise_e**2))
    y = np.clip(electrons / np.float32(camera.full_well_e), -0.05, 1.0)
    y *= (1 + camera.compression) / (1 + camera.compression * y)
    digital = camera.black_level_dn + (full_scale_dn - camera.black_level_dn) * y
    return np.asarray(np.clip(np.rint(digital), 0, full_scale_dn), dtype=np.uint16)
