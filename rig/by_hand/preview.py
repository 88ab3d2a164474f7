"""The camera's view as it is now: frame after frame, made small for a screen, with figures a few times a second."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.by_hand.photograph import PhotographFigures, figures_of
from rig.by_hand.pictures import picture_named
from rig.capture.events import Event
from rig.capture.rig import Rig
from rig.devices.drivers import make_devices
from rig.devices.protocols import Codes, RawFrame, gain_control_of
from rig.errors import CaptureTimeout, DeviceLost, UsageError
from rig.files.colour.srgb import srgb_of_linear
from rig.profile.schema import Profile
from rig.records import Record

WIDTH_PX = 960
"""Of the pictures: what a page shows beside its controls."""
_QUALITY = 80
"""Of the JPEG: 60 to 90 kB a picture, and no blocks that are seen while one focuses."""
_FIGURES_S, _FIGURES_PX = 0.4, 1 << 19
"""Between two sets of figures, of so many pixels or fewer, larger ones in proportion: faster ones are not read, and
sharpness of a megapixel takes 40 ms."""
_OLDEST_FRAMES = 2.0
"""Camera frames that may have begun before somebody asks: the next one counts though the last one is still coded."""
_OVERLAY_WIDTH_PX = 320
_OVER, _UNDER = 255, 128
"""In the overlay: some pixel of the block is clipped; all of them are at 0."""
_MOST_ZOOM = 32.0
_NOISE_SCALE = float(np.sqrt(np.pi) / 2)
"""Standard deviation of one frame from the mean absolute difference of two of the same scene."""


@dataclass(frozen=True, kw_only=True)
class PreviewSettings:
    """What a view begins with."""

    picture: str = "grid"
    """On the projector, as for :func:`rig.by_hand.pictures.picture_named`."""
    exposure_s: float | None = None
    """None: the profile's."""


@dataclass(frozen=True, kw_only=True)
class Region:
    """The part of the frame that is shown: all of it, or a part about a point."""

    x: float = 0.5
    """Middle, share of the width ..."""
    y: float = 0.5
    """... and of the height."""
    zoom: float = 1.0

    def window(self, shape: tuple[int, ...]) -> tuple[slice, slice]:
        """Rows and columns of a frame of a shape."""
        zoom = min(max(self.zoom, 1.0), _MOST_ZOOM)
        found = []
        for middle, size in ((self.y, shape[0]), (self.x, shape[1])):
            part = max(8, round(size / zoom))
            first = min(max(round(middle * size - part / 2), 0), max(size - part, 0))
            found.append(slice(first, first + part))
        return found[0], found[1]


@dataclass(frozen=True, kw_only=True)
class CameraGain(Record):
    """The camera's gain, as it says itself."""

    value: float
    least: float
    most: float
    unit: str
    """dB, ISO, or steps of the camera's own."""
    profile_lines: str
    """With which sessions have it: they go by their profile."""


@dataclass(frozen=True, kw_only=True)
class PreviewState(Record):
    """What the devices really do."""

    picture: str
    exposure_s: float
    exposure_range_s: tuple[float, float]
    width_px: int
    height_px: int
    full_scale_dn: int
    frame_rate_hz: float
    gain: CameraGain | None = None
    """None where the camera has none that could be set."""


@dataclass(frozen=True, kw_only=True)
class FrameFacts(Record):
    """What is known of a frame that is shown."""

    number: int
    taken_s: float
    """Middle of its exposure, seconds since 1970 by this machine's clock."""
    exposure_s: float
    """What the camera did."""
    lost: int
    """Frames that never came, since the view was opened."""
    rate_hz: float
    """Of the last frames."""
    window: tuple[int, int, int, int]
    """x, y, width and height of what is shown. [px]"""
    flicker_percent: float | None = None
    """Change of the mean from frame to frame, standard deviation over the mean of the last second."""
    noise_dn: float | None = None
    """Standard deviation of a pixel from frame to frame, the median over the picture."""
    figures: PhotographFigures | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenFrame:
    """A frame as a page shows it."""

    jpeg: bytes
    """Empty while nobody watches."""
    overlay: bytes
    """PNG of clipped and black places; empty but for a few times a second."""
    facts: FrameFacts


class Preview:
    """A rig whose camera runs freely while its projector holds a picture; use it in a ``with`` statement.

    Simulated rigs go by the machine's clock here. A device that goes away is waited for, as in a session.

    Parameters
    ----------
    profile
        Of the rig. Raises UsageError for a recording, which has no view of now.
    settings
        What it begins with.
    """

    def __init__(self, profile: Profile, settings: PreviewSettings, rig: Rig | None = None):
        if profile.camera.driver == "replay":
            raise UsageError(f"{profile.path}: a recording has no view of now; give a rig's profile")
        self._rig = rig or Rig(profile, *make_devices(profile, real_time=True))
        self._settings = settings
        self._codes: Codes = picture_named(settings.picture, profile, fit=True).codes
        self._picture = settings.picture
        self._exposure_s = 0.0
        self._gain: CameraGain | None = None
        self.region = Region()
        """What is shown; may be changed between two frames."""
        self.is_watched = True
        """While nobody watches, frames are taken and not coded."""
        self.frames = 0
        """Taken since it was opened."""
        self._lost, self._sequence = 0, -1
        self._previous: RawFrame | None = None
        self._times_s: list[float] = []
        self._means: list[float] = []
        self._figures_at_s = 0.0
        self._table = _codes_of_numbers(1)

    def __enter__(self) -> Preview:
        self._rig.open()
        try:
            self._table = _codes_of_numbers(self._rig.camera.full_scale_dn)
            self._gain = self._gain_now()
            self.expose(self._settings.exposure_s or self._rig.profile.camera.exposure_s)
            self._first()
        except BaseException:
            self._rig.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._rig.close()

    @property
    def events(self) -> Sequence[Event]:
        """What went wrong so far and was put right."""
        return self._rig.events

    @property
    def state(self) -> PreviewState:
        """What the devices do now."""
        camera = self._rig.camera
        height, width, _ = camera.shape
        return PreviewState(
            picture=self._picture,
            exposure_s=self._exposure_s,
            exposure_range_s=(camera.exposure_range_s[0], camera.exposure_range_s[1]),
            width_px=width,
            height_px=height,
            full_scale_dn=camera.full_scale_dn,
            frame_rate_hz=self._rig.profile.camera.frame_rate_hz,
            gain=self._gain,
        )

    def show(self, picture: str) -> None:
        """Hold another picture. Raises UsageError when there is none of that name."""
        self._codes = picture_named(picture, self._rig.profile, fit=True).codes
        self._picture = picture
        self._first()

    def expose(self, exposure_s: float) -> None:
        """Set the exposure; :attr:`state` tells what the camera made of it. Raises SettingRefused."""
        self._exposure_s = self._rig.set_exposure(exposure_s)
        self._means.clear()

    def amplify(self, value: float) -> None:
        """Set the gain; :attr:`state` tells what the camera made of it. Raises SettingRefused."""
        self._rig.set_gain(value)
        self._gain = self._gain_now()
        self._means.clear()
        self._previous = None

    def _gain_now(self) -> CameraGain | None:
        control = gain_control_of(self._rig.camera)
        if control is None:
            return None
        return CameraGain(**control.now()._asdict(), profile_lines=control.profile_lines())

    def next_frame(self) -> SeenFrame:
        """Wait for the camera's next frame, and make it small. Raises DeviceError when the camera stays away."""
        frame = self._frame()
        now_s = self._rig.clock.now_s()
        self.frames += 1
        self._count(frame, now_s)
        rows, columns = self.region.window(frame.pixels.shape)
        pause_s = _FIGURES_S * max(1.0, frame.pixels.size / _FIGURES_PX)
        has_figures = now_s >= self._figures_at_s + pause_s and self._previous is not None
        facts = self._facts(frame, now_s, (rows, columns), has_figures=has_figures)
        shown = frame.pixels[rows, columns]
        full_scale = self._rig.camera.full_scale_dn
        watched = self.is_watched
        seen = SeenFrame(
            jpeg=jpeg_of(shown, self._table) if watched else b"",
            overlay=overlay_of(shown, full_scale) if has_figures and watched else b"",
            facts=facts,
        )
        self._previous = frame
        return seen

    def _first(self) -> None:
        """Show the picture and wait until its light is there."""
        self._rig.shoot(self._codes, name="preview")

    def _frame(self) -> RawFrame:
        """The next frame; a camera that went away is waited for as in a session."""
        try:
            return self._rig.camera.capture(after_s=self._next_s, timeout_s=self._rig.profile.timing.timeout_s)
        except (DeviceLost, CaptureTimeout):
            return self._rig.shoot(self._codes, name="preview")

    @property
    def _next_s(self) -> float:
        """When the next frame begins at the earliest: the one after the last, unless that is too long ago."""
        profile, now_s = self._rig.profile, self._rig.clock.now_s()
        period_s = 1 / profile.camera.frame_rate_hz
        begun_s = now_s if self._previous is None else self._previous.started_s + period_s / 2
        return min(now_s, max(begun_s, now_s - self._exposure_s - _OLDEST_FRAMES * period_s))

    def _count(self, frame: RawFrame, now_s: float) -> None:
        self._lost += frame.lost
        self._times_s = [*self._times_s[-29:], now_s]
        step = max(1, frame.pixels.shape[1] // WIDTH_PX * 4)
        self._means = [*self._means[-29:], float(frame.pixels[::step, ::step].mean())]

    def _facts(self, frame: RawFrame, now_s: float, window: tuple[slice, slice], *, has_figures: bool) -> FrameFacts:
        rows, columns = window
        age_s = now_s - frame.started_s - frame.exposure_s / 2
        elapsed_s = self._times_s[-1] - self._times_s[0]
        figures = noise = None
        if has_figures and self._previous is not None:
            self._figures_at_s = now_s
            figures = figures_of(frame, self._previous, self._rig.camera.full_scale_dn)
            noise = noise_between(frame.pixels, self._previous.pixels)
        return FrameFacts(
            number=self.frames,
            taken_s=time.time() - age_s,
            exposure_s=frame.exposure_s,
            lost=self._lost,
            rate_hz=(len(self._times_s) - 1) / elapsed_s if elapsed_s > 0 else 0.0,
            window=(columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start),
            flicker_percent=self._flicker_percent if has_figures else None,
            noise_dn=noise,
            figures=figures,
        )

    @property
    def _flicker_percent(self) -> float | None:
        mean = float(np.mean(self._means))
        return 100 * float(np.std(self._means)) / mean if len(self._means) > 3 and mean > 0 else None


def noise_between(first: NDArray[np.uint16], second: NDArray[np.uint16]) -> float:
    """Return the standard deviation of a pixel between two frames of the same scene, the mean over a coarse grid."""
    step = max(1, first.shape[0] // 120)
    a, b = (one[::step, ::step].astype(np.float64) for one in (first, second))
    return float(np.abs(a - b).mean() * _NOISE_SCALE)


def _codes_of_numbers(full_scale_dn: int) -> NDArray[np.uint8]:
    """(full scale + 1,) what a screen shows of digital numbers: 8 bits as they are, more bits as linear light."""
    share = np.arange(full_scale_dn + 1) / max(full_scale_dn, 1)
    return np.asarray(np.rint(255 * (share if full_scale_dn <= 255 else srgb_of_linear(share))), np.uint8)


def jpeg_of(pixels: NDArray[np.uint16], table: NDArray[np.uint8]) -> bytes:
    """Return a frame, or a part of one, as a JPEG at most :data:`WIDTH_PX` wide; few pixels are shown as blocks.

    Parameters
    ----------
    pixels
        (H, W, C) digital numbers.
    table
        Codes of each digital number.
    """
    height, width = pixels.shape[:2]
    if width > WIDTH_PX:
        size = (WIDTH_PX, max(1, round(height * WIDTH_PX / width)))
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_LINEAR), np.uint16).reshape(
            size[1], size[0], -1
        )
    codes = np.take(table, pixels, mode="clip")
    shown = codes[..., 0] if codes.shape[2] == 1 else cv2.cvtColor(codes, cv2.COLOR_RGB2BGR)
    coded, data = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not coded:
        raise ValueError(f"a frame of shape {pixels.shape} could not be coded as JPEG")
    return data.tobytes()


def overlay_of(pixels: NDArray[np.uint16], full_scale_dn: int) -> bytes:
    """Return a small grey PNG that says where a frame is clipped or black: no such pixel is lost by its smallness."""
    bands = [pixels[..., band] for band in range(pixels.shape[2])]
    over, under = np.maximum.reduce(bands) >= full_scale_dn, np.maximum.reduce(bands) == 0
    factor = max(1, -(-pixels.shape[1] // _OVERLAY_WIDTH_PX))
    marks = np.where(_means(under, factor) == _OVER, _UNDER, 0).astype(np.uint8)
    marks[_means(over, factor) > 0] = _OVER
    return cv2.imencode(".png", marks, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()


def _means(mask: NDArray[np.bool_], factor: int) -> NDArray[np.uint8]:
    """(rows, columns) mean of blocks, 255 where all are marked, above 0 where any is; the last ones are filled up."""
    height, width = (-(-n // factor) for n in mask.shape)
    codes = _OVER * mask.astype(np.uint8)
    padded = np.pad(codes, [(0, height * factor - mask.shape[0]), (0, width * factor - mask.shape[1])], mode="edge")
    return np.asarray(cv2.resize(padded, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
