"""Simulated devices: cameras and projectors on one simulated world, in virtual time.

Every random event is drawn from the simulated world's seed and the time at which it happens, so it is a function of
time alone: a session that is killed and resumed at the time of its last frame sees what it would have seen. Only
``exposure_delay_frames`` and ``frozen_s`` depend on when the camera was opened or set.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.mosaic import Mosaic
from rig.devices.protocols import Clock, Codes, ExposureRange, Gain, RawFrame, Shown
from rig.devices.refusals import check_codes, check_exposure, check_gain
from rig.devices.simulated.faults import FrameFaults, end_of, first_in, random_at
from rig.devices.simulated.pair import Float32Array, SeenLight, SimulatedPair
from rig.devices.simulated.settings import Interval, SimulatedCameraSettings
from rig.errors import CaptureTimeout, DeviceLost

FloatArray = NDArray[np.float64]
Bands = tuple[SimulatedPair, ...]
"""One world in each band of a camera."""

_KEPT_PICTURES = 16
"""More than can light one exposure."""
_KEPT_LIGHT = 4
_SHORT_SHARE = 2
"""A short frame has the upper half of the rows."""


@dataclass(frozen=True, slots=True)
class LitPicture:
    """A picture, and from when to when its light was there."""

    codes: Codes
    light_s: float
    dark_s: float = math.inf


class SimulatedProjector:
    """Shows codes on the simulated world at the next refresh, with latency and jitter until the light comes."""

    def __init__(self, world: SimulatedPair, clock: Clock, *, refresh_rate_hz: float):
        self._world = world
        self._clock = clock
        self._period_s = 1.0 / refresh_rate_hz
        self._opened_s: float | None = None
        self._pictures: list[LitPicture] = []
        self._black = np.zeros(self.shape, dtype=np.uint8)

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), in pixels."""
        return self._world.projector.shape

    def open(self) -> None:
        """Switch on; shows black. Raises DeviceLost while unplugged."""
        if self._opened_s is None:
            now_s = self._clock.now_s()
            _refuse_unplugged("projector", self._world.settings.projector.unplugged_s, now_s, now_s)
            self._opened_s = now_s
            self._pictures = [LitPicture(self._black, -math.inf)]

    def close(self) -> None:
        """Go black."""
        self._opened_s = None
        self._pictures = [LitPicture(self._black, -math.inf)]

    def check_on_screen(self) -> None:
        """Raise DeviceLost when closed, or unplugged since it was opened."""
        if self._opened_s is None:
            raise DeviceLost("the simulated projector is closed: open the rig before showing a picture")
        _refuse_unplugged("projector", self._world.settings.projector.unplugged_s, self._opened_s, self._clock.now_s())

    def show(self, codes: Codes, *, name: str) -> Shown:
        """Show codes of exactly its shape, (H, W) or (H, W, 3), at the next refresh."""
        self.check_on_screen()
        check_codes(codes, self.shape)
        on_screen_s = math.ceil(self._clock.now_s() / self._period_s + 1e-9) * self._period_s
        self._clock.wait_until_s(on_screen_s)
        projector = self._world.settings.projector
        random = np.random.default_rng((self._world.settings.seed, 1, round(on_screen_s * 1e6)))
        jitter = random.uniform(0, projector.jitter_s)
        self._pictures.append(LitPicture(codes.copy(), on_screen_s + projector.latency_s + jitter))
        del self._pictures[:-_KEPT_PICTURES]
        return Shown(on_screen_s, name)

    def lit_pictures(self) -> list[LitPicture]:
        """The last pictures, in their order; all is dark from the moment on at which it was unplugged."""
        opened_s = math.inf if self._opened_s is None else self._opened_s
        lost_s = first_in(self._world.settings.projector.unplugged_s, opened_s, math.inf)
        ends = [min(p.light_s, lost_s) for p in self._pictures[1:]] + [lost_s]
        return [LitPicture(p.codes, p.light_s, end_s) for p, end_s in zip(self._pictures, ends, strict=True)]


class _Source:
    """A projector, as a camera sees its light."""

    def __init__(self, bands: Bands, projector: SimulatedProjector):
        self.projector = projector
        self._bands, self._world = bands, bands[0]
        self._seen = [SeenLight(world, _KEPT_LIGHT) for world in bands]
        self._shape = (*self._world.camera.shape, len(bands))

    def light(self, starts_s: FloatArray, exposure_s: float) -> Float32Array:
        """(H, W, C) mean light during exposures that start at (H, 1) times, with the room's own."""
        light = np.zeros(self._shape, dtype=np.float32)
        for picture in self.projector.lit_pictures():
            share = _lit_share(picture, starts_s, starts_s + exposure_s)
            if share.any():
                for band, seen in enumerate(self._seen):
                    light[..., band] += share.astype(np.float32) * seen.of(picture.codes)
        return self._by_lamp(light, starts_s, exposure_s)

    def ambient(self) -> Float32Array:
        """(H, W, C) the room's own light."""
        pairs = zip(self._bands, self._seen, strict=True)
        return np.stack([seen.through_lens(world.ambient) for world, seen in pairs], -1)

    def _by_lamp(self, light: Float32Array, starts_s: FloatArray, exposure_s: float) -> Float32Array:
        """The same light of a lamp that is not warm yet; what is not the projector's stays."""
        if not self._world.settings.projector.lamp_drift:
            return light
        share = self._world.lamp(starts_s, exposure_s).astype(np.float32)[..., None]
        return share * light + (1 - share) * self.ambient()


_MOST_GAIN_DB = 24.0
"""As many industrial cameras have."""
_GAIN_STEP_DB = 0.1


class SimulatedGain:
    """The gain of a simulated camera, in steps of 0.1 dB: after the sensor's noise, before the converter clips."""

    def __init__(self) -> None:
        self.db = 0.0

    @property
    def factor(self) -> float:
        """Of the digital numbers above black."""
        return float(10 ** (self.db / 20))

    def now(self) -> Gain:
        """What it is."""
        return Gain(self.db, 0.0, _MOST_GAIN_DB, "dB")

    def change(self, value: float) -> Gain:
        """Choose the nearest step. Raises SettingRefused."""
        check_gain(value, self.now())
        self.db = round(round(value / _GAIN_STEP_DB) * _GAIN_STEP_DB, 6)
        return self.now()

    def profile_lines(self) -> str:
        """Say that no profile keeps it."""
        return "a simulated camera measures with a gain of 0 dB, always"


class SimulatedCamera:
    """Photographs the world: exposure, lens, shot and read noise, response, quantisation, late or lost frames.

    Parameters
    ----------
    bands
        The world of the camera and its first projector, in each band of the camera.
    projector
        That projector.
    others
        The same of further projectors; room light is the first one's.
    mosaic
        Colour filters: each pixel has one band's number.
    """

    def __init__(
        self,
        bands: Bands,
        projector: SimulatedProjector,
        clock: Clock,
        *,
        bit_depth: int,
        frame_rate_hz: float,
        exposure_range_s: tuple[float, float],
        others: Sequence[tuple[Bands, SimulatedProjector]] = (),
        mosaic: Mosaic | None = None,
    ):
        self.bands = bands
        self.world = bands[0]
        self._clock = clock
        self._mosaic = mosaic
        self._bit_depth = bit_depth
        self._period_s = 1.0 / frame_rate_hz
        self._exposure_range_s = ExposureRange(*exposure_range_s)
        self._exposure_s = self._exposure_range_s.shortest_s
        self._earlier_exposure_s, self._set_s = self._exposure_s, -math.inf
        self._opened_s: float | None = None
        self._sequence = 0
        self._gain = SimulatedGain()
        self._faults = FrameFaults(self.world.settings.camera, self.world.settings.seed, self._period_s)
        self._sources = [_Source(*one) for one in ((bands, projector), *others)]

    @property
    def shape(self) -> tuple[int, int, int]:
        """(height, width, numbers a pixel); three are red, green and blue, one of a mosaic is one of them."""
        return (*self.world.camera.shape, 1 if self._mosaic else len(self.bands))

    @property
    def full_scale_dn(self) -> int:
        """Largest digital number."""
        return int(2**self._bit_depth - 1)

    @property
    def exposure_range_s(self) -> ExposureRange:
        """Shortest and longest exposure."""
        return self._exposure_range_s

    def open(self) -> None:
        """Make ready, with the shortest exposure. Raises DeviceLost while unplugged."""
        if self._opened_s is None:
            now_s = self._clock.now_s()
            _refuse_unplugged("camera", self.world.settings.camera.unplugged_s, now_s, now_s)
            self._opened_s = now_s
            self._exposure_s = self._earlier_exposure_s = self._exposure_range_s.shortest_s
            self._gain = SimulatedGain()

    def close(self) -> None:
        """Let go."""
        self._opened_s = None

    def gain_control(self) -> SimulatedGain | None:
        """Its gain, while it is open."""
        return None if self._opened_s is None else self._gain

    def set_exposure(self, exposure_s: float) -> float:
        """Choose the nearest multiple of 10 µs."""
        self._check_open()
        check_exposure(exposure_s, self._exposure_range_s)
        chosen_s = round(exposure_s * 1e5) / 1e5
        if chosen_s != self._exposure_s:
            self._earlier_exposure_s, self._set_s = self._exposure_s, self._clock.now_s()
        self._exposure_s = chosen_s
        return chosen_s

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        """Next frame on the camera's grid of start times; now and then an old one, as real drivers deliver."""
        opened_s = self._check_open()
        settings = self.world.settings.camera
        now_s = self._clock.now_s()
        index = self._index_from(max(after_s, now_s))
        index = self._index_from(end_of(settings.frozen_s, opened_s, index * self._period_s))
        while self._faults.is_dropped(index) and index * self._period_s < now_s + timeout_s:
            index += 1
        exposure_s = self._exposure_at(index)
        end_s = index * self._period_s + exposure_s + settings.readout_s
        self._wait(min(end_s, now_s + timeout_s), opened_s)
        if end_s - now_s > timeout_s:
            raise CaptureTimeout(f"no frame within {timeout_s:g} s: the exposure would end later; allow more time")
        return self._frame(index, exposure_s)

    def _index_from(self, time_s: float) -> int:
        return math.ceil(time_s / self._period_s - 1e-9)

    def _exposure_at(self, index: int) -> float:
        settled_s = self._set_s + self.world.settings.camera.exposure_delay_frames * self._period_s
        return self._exposure_s if index * self._period_s >= settled_s else self._earlier_exposure_s

    def _wait(self, until_s: float, opened_s: float) -> None:
        """Wait; raises DeviceLost at the moment of an unplugging."""
        unplugged_s = self.world.settings.camera.unplugged_s
        self._clock.wait_until_s(min(until_s, first_in(unplugged_s, opened_s, until_s)))
        _refuse_unplugged("camera", unplugged_s, opened_s, self._clock.now_s())

    def _frame(self, index: int, exposure_s: float) -> RawFrame:
        fault, lost = self._faults.fault_of(index), self._faults.lost_before(index)
        self._sequence = 1 if fault.restarts_count else self._sequence + 1 + lost
        pixels = self._expose(fault.content_index * self._period_s, exposure_s)
        if fault.is_short:
            pixels = pixels[: len(pixels) // _SHORT_SHARE]
        started_s = fault.stamp_index * self._period_s + fault.stamp_error_s
        return RawFrame(
            pixels=pixels,
            exposure_s=exposure_s,
            started_s=started_s,
            sequence=self._sequence,
            lost=lost,
            repeats=fault.repeats and not lost,
        )

    def _expose(self, start_s: float, exposure_s: float) -> NDArray[np.uint16]:
        """Rows are exposed one after the other when the shutter rolls."""
        settings = self.world.settings.camera
        height = self.world.camera.shape[0]
        starts_s = start_s + settings.readout_s * np.arange(height)[:, None] / height
        light = self._sources[0].light(starts_s, exposure_s)
        for source in self._sources[1:]:
            light += source.light(starts_s, exposure_s)
        if self.world.settings.ambient_flicker:
            swell = self.world.ambient_swell(starts_s, exposure_s)
            light += swell.astype(np.float32)[..., None] * self._sources[0].ambient()
        if self._mosaic is not None:
            light = np.asarray(self._mosaic.seen(light), np.float32)
        random = random_at(self.world.settings.seed, 3, start_s)
        noise = random.standard_normal(light.shape, dtype=np.float32)
        gain = self._gain.factor
        levels = sensor_response(settings, light, exposure_s, self.full_scale_dn, noise=noise, gain=gain)
        return levels if settings.jpeg_quality is None else through_jpeg(levels, settings.jpeg_quality)

    def _check_open(self) -> float:
        """When it was opened. Raises DeviceLost when it is closed, or was unplugged since."""
        if self._opened_s is None:
            raise DeviceLost("the simulated camera is closed: open the rig before using it")
        _refuse_unplugged("camera", self.world.settings.camera.unplugged_s, self._opened_s, self._clock.now_s())
        return self._opened_s


def _refuse_unplugged(kind: str, unplugged_s: tuple[Interval, ...], opened_s: float, now_s: float) -> None:
    lost_s = first_in(unplugged_s, opened_s, now_s)
    if lost_s <= now_s:
        raise DeviceLost(f"the simulated {kind} was away at {lost_s:.3f} s, as simulation.{kind}.unplugged_s says")


def _lit_share(picture: LitPicture, starts_s: FloatArray, ends_s: FloatArray) -> FloatArray:
    """Share of each exposure that a picture lit."""
    lit_s = np.minimum(ends_s, picture.dark_s) - np.maximum(starts_s, picture.light_s)
    return np.asarray(np.maximum(lit_s, 0.0) / (ends_s - starts_s))


def sensor_response(
    camera: SimulatedCameraSettings,
    light: Float32Array,
    exposure_s: float,
    full_scale_dn: int,
    *,
    noise: Float32Array,
    gain: float = 1.0,
) -> NDArray[np.uint16]:
    """Digital numbers of a light image: electrons, shot and read noise, gain, compression, black level, clip.

    ``noise`` is standard normal, in the shape of the light. A gain amplifies what the sensor counted, noise and all.
    """
    electrons = light * np.float32(camera.sensitivity_e_per_s * exposure_s)
    electrons += noise * np.sqrt(np.maximum(electrons, 0) + np.float32(camera.read_noise_e**2))
    y = np.clip(electrons * np.float32(gain / camera.full_well_e), -0.05, 1.0)
    y *= (1 + camera.compression) / (1 + camera.compression * y)
    y = toned(y, camera.tone, camera.s_shape)
    digital = camera.black_level_dn + (full_scale_dn - camera.black_level_dn) * y
    return np.asarray(np.clip(np.rint(digital), 0, full_scale_dn), dtype=np.uint16)


def through_jpeg(levels: NDArray[np.uint16], quality: int) -> NDArray[np.uint16]:
    """What is left of 8-bit levels (H, W, C) after JPEG, as cameras that stream MJPEG send them.

    Three channels go as luminance and halved chrominance, as they do there.
    """
    picture = np.ascontiguousarray(levels[..., ::-1].astype(np.uint8))
    _, stream = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    kind = cv2.IMREAD_GRAYSCALE if levels.shape[-1] == 1 else cv2.IMREAD_COLOR
    back = np.asarray(cv2.imdecode(stream, kind)).reshape(levels.shape)
    return np.ascontiguousarray(back[..., ::-1]).astype(np.uint16)


def toned(y: Float32Array, tone: str | float, s_shape: float = 0.0) -> Float32Array:
    """A consumer camera's tone curve over 0 ... 1; it cuts off what is below black, as such cameras do."""
    if tone == "linear" and s_shape == 0:
        return y
    y = np.maximum(y, np.float32(0))
    if tone == "srgb":
        y = np.where(y <= 0.0031308, 12.92 * y, 1.055 * y ** np.float32(1 / 2.4) - 0.055).astype(np.float32)
    elif tone != "linear":
        y = np.asarray(y ** np.float32(1 / float(tone)), dtype=np.float32)
    return np.asarray((1 - s_shape) * y + s_shape * y * y * (3 - 2 * y), dtype=np.float32)
