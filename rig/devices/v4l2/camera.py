"""A V4L2 camera: found by its id, set up and verified, streaming, its frames told by their own time stamps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass

from rig.devices.driver_settings import CameraSettings
from rig.devices.protocols import Clock, ExposureRange, RawFrame
from rig.devices.refusals import check_exposure, check_mosaic
from rig.devices.v4l2 import abi
from rig.devices.v4l2.controls import EXPOSURE_STEP_S, Setting, mismatch, read_control
from rig.devices.v4l2.describe import ControlAbility
from rig.devices.v4l2.find import FoundCamera, find_camera
from rig.devices.v4l2.formats import layout_of, mosaic_of_format, pixel_format
from rig.devices.v4l2.frames import Frames, FrameSearch
from rig.devices.v4l2.gain import V4l2Gain, gain_of
from rig.devices.v4l2.node import STALLED, Node
from rig.devices.v4l2.settling import UNMEASURED_FRAMES, Settling
from rig.devices.v4l2.setup import (
    RequestedSettings,
    check_exposure_range,
    check_identity,
    hold_controls,
    set_controls,
    set_format,
    set_frame_rate,
)
from rig.devices.v4l2.stream import Stream, StreamBroken
from rig.devices.while_open import while_open
from rig.errors import CaptureTimeout, DeviceError, SettingRefused

_FIRST_FRAMES = 2
"""To be seen before a camera counts as open: a first one may be left over from another program."""
_SETTLING_S = 3.0
"""Time limit of waiting for frames that show a new exposure, and of the first frames; periods come on top."""
_SETTLING_PERIODS = 20
"""Of frames, on top of that; chosen: a camera that takes longer to follow its exposure is stuck."""
_LEAST_INTERVAL = 0.85
"""Of the exposure, between frames whose time stamps jitter."""


@dataclass(slots=True, kw_only=True)
class _Opened:
    """Everything that exists while the camera is open."""

    node: Node
    stream: Stream
    frames: Frames
    period_s: float
    settings: list[Setting]
    exposure: ControlAbility | None
    exposure_s: float
    undo: ExitStack
    valid_from_s: float = -math.inf
    """Frames that began earlier have another exposure."""
    is_settled: bool = True
    """The frames were seen to follow the exposure."""
    slowest_frames: int = UNMEASURED_FRAMES
    """How many frames a new exposure took to be seen, at most."""
    darkest_dn: float = math.inf
    """That frames of this gain were: the black level is no higher."""
    gain: V4l2Gain | None = None
    """Once somebody asked for it."""
    proven_exposure_s: float = 0.0
    """The longest one whose frames were seen to come as far apart as it is long."""

    @property
    def steps(self) -> int:
        """The exposure in steps of its control."""
        return round(self.exposure_s / EXPOSURE_STEP_S)


class V4l2Camera:
    """A camera of the Linux kernel. Its automatics are off while it is open.

    Parameters
    ----------
    device_id
        As ``rig devices`` prints it: ``usb-VENDOR:PRODUCT-SERIAL`` or a bus path.
    shape
        (height, width, channels), in pixels.
    pixel_format
        V4L2's four characters.
    bit_depth
        Of its numbers; ``2 ** bit_depth - 1`` is saturated.
    frame_rate_hz
        Has to be one that it offers.
    exposure_range_s
        Shortest and longest exposure; a camera without exposure control has one, its frame period.
    controls
        By name, set after everything automatic is off.
    clock
        Has to count like CLOCK_MONOTONIC, as time stamps of frames do.
    """

    def __init__(
        self,
        device_id: str,
        *,
        shape: tuple[int, int, int],
        pixel_format: str,
        bit_depth: int,
        frame_rate_hz: float,
        exposure_range_s: tuple[float, float],
        controls: Mapping[str, int],
        clock: Clock,
    ):
        self.device_id = device_id
        self._shape = shape
        self._format_name = pixel_format
        self._bit_depth = bit_depth
        self._frame_rate_hz = frame_rate_hz
        self._exposure_range_s = ExposureRange(*exposure_range_s)
        self._controls = dict(controls)
        self._clock = clock
        self._opened: _Opened | None = None

    @property
    def shape(self) -> tuple[int, int, int]:
        """(height, width, channels), in pixels."""
        return self._shape

    @property
    def full_scale_dn(self) -> int:
        """Largest digital number."""
        return int(2**self._bit_depth - 1)

    @property
    def exposure_range_s(self) -> ExposureRange:
        """Shortest and longest exposure."""
        return self._exposure_range_s

    def open(self) -> None:
        """Find the camera under whatever node it has now, set everything and check it, and see first frames come.

        Raises DeviceLost, DeviceBusy, DeviceForbidden, CaptureTimeout (it sends nothing), and SettingRefused, which
        names what it cannot do and what it can.
        """
        if self._opened is not None:
            return
        channels = self._shape[2]
        known_format = pixel_format(self._format_name, channels=channels, bit_depth=self._bit_depth)
        wishes = RequestedSettings(
            shape=self._shape,
            pixel_format=known_format,
            frame_rate_hz=self._frame_rate_hz,
            exposure_range_s=self._exposure_range_s,
            controls=self._controls,
        )
        self._opened = self._set_up(find_camera(self.device_id), wishes)
        with ExitStack() as undo:
            undo.callback(self.close)
            self._see_first_frames(self._opened)
            hold_controls(self._opened.node, self._opened.settings)
            undo.pop_all()

    def _set_up(self, found: FoundCamera, wishes: RequestedSettings) -> _Opened:
        with ExitStack() as undo:
            node = Node(found.node, self._clock)
            undo.callback(node.close)
            check_identity(node, found.bus_path)
            layout = layout_of(set_format(node, wishes))
            period_s = set_frame_rate(node, wishes)
            settings, exposure = set_controls(node, wishes)
            check_exposure_range(node, exposure, wishes, period_s)
            exposure_s = period_s if exposure is None else read_control(node, exposure) * EXPOSURE_STEP_S
            stream = Stream(node, self._clock)
            undo.callback(stream.stop)
            frames = Frames(
                stream,
                wishes.pixel_format,
                layout,
                self._shape[2],
                period_s=period_s,
                exposes_always=exposure is None,
                clock=self._clock,
            )
            stream.start()
            return _Opened(
                node=node,
                stream=stream,
                frames=frames,
                period_s=period_s,
                settings=settings,
                exposure=exposure,
                exposure_s=exposure_s,
                undo=undo.pop_all(),
            )

    def _see_first_frames(self, opened: _Opened) -> None:
        for _ in range(_FIRST_FRAMES):
            self._frame_within(opened, -math.inf, "after it was opened")

    def close(self) -> None:
        """Stop streaming and let the node go; any number of times, from any state."""
        opened, self._opened = self._opened, None
        if opened is not None:
            if opened.gain is not None:
                opened.gain.put_back()
            opened.undo.close()

    def reset(self) -> None:
        """Reset it on its USB port and wait for its return; it is closed then. Raises DeviceError."""
        self.close()
        found = find_camera(self.device_id)
        if found.usb_port is None:
            raise DeviceError(
                f"{self._name} ({found.driver}) is no USB device, so it cannot be reset from here; "
                "unplug it, or switch it off and on"
            )
        from rig.devices.usb.reset import reset_usb_device

        reset_usb_device(found.usb_port)

    def gain_control(self) -> V4l2Gain | None:
        """Its gain, while it is open; closing it puts back what was there."""
        opened = self._opened
        if opened is None:
            return None

        def changed() -> None:
            late_s = opened.slowest_frames * max(opened.period_s, opened.exposure_s)
            opened.valid_from_s = self._clock.now_s() + late_s
            opened.darkest_dn = math.inf

        if opened.gain is None:
            opened.gain = gain_of(opened.node, opened.settings, changed)
        return opened.gain

    def set_exposure(self, exposure_s: float) -> float:
        """Set the nearest exposure, and wait until the frames show it, under the scene that is there.

        A camera without exposure control has its frame period. Raises SettingRefused outside its range, when the
        camera takes another value, and when the frames do not follow; DeviceLost when closed or gone.
        """
        with while_open(self._opened, name=self._name, doing="setting its exposure", close=self.close) as opened:
            check_exposure(exposure_s, self._exposure_range_s)
            if opened.exposure is not None:
                self._set_exposure_control(opened, opened.exposure, round(exposure_s / EXPOSURE_STEP_S))
            return opened.exposure_s

    def _set_exposure_control(self, opened: _Opened, control: ControlAbility, steps: int) -> None:
        steps = min(max(steps, control.minimum), control.maximum)
        steps -= (steps - control.minimum) % max(1, control.step)
        if opened.is_settled and steps == opened.steps == read_control(opened.node, control):
            return
        before = self._frame_within(opened, self._clock.now_s(), "before a new exposure")
        asked = abi.ControlValue(id=control.id, value=steps)
        opened.node.call(abi.S_CTRL, asked, f"setting control {control.name} to {steps}", STALLED)
        got = read_control(opened.node, control)
        opened.valid_from_s = self._clock.now_s()
        ratio = got / opened.steps if opened.is_settled else 1.0
        opened.exposure_s, opened.is_settled = got * EXPOSURE_STEP_S, False
        settling = Settling(
            before=before.pixels,
            ratio=ratio,
            full_scale_dn=self.full_scale_dn,
            unmeasured_frames=opened.slowest_frames,
            black_dn=opened.darkest_dn,
        )
        opened.darkest_dn = settling.black_dn
        if got != steps:
            raise mismatch(control, steps, got)
        self._settle(opened, settling)
        if opened.exposure_s > max(opened.period_s, opened.proven_exposure_s):
            self._check_interval(opened)
            opened.proven_exposure_s = opened.exposure_s
        opened.is_settled = True

    def _settle(self, opened: _Opened, settling: Settling) -> None:
        until_s = self._limit_s(opened)
        while self._clock.now_s() < until_s:
            frame = self._frame_within(opened, opened.valid_from_s, "after a new exposure")
            if settling.add(frame.pixels):
                opened.valid_from_s = frame.started_s
                opened.slowest_frames = max(opened.slowest_frames, settling.frames_it_took)
                return
        raise SettingRefused(
            f"the frames of {self._name} do not follow: {len(settling.means)} frames after the exposure of "
            f"{opened.exposure_s:g} s was acknowledged, {settling.state()}; "
            f"keep the light still, and see that nothing automatic is on"
        )

    def _check_interval(self, opened: _Opened) -> None:
        """Raise SettingRefused when frames follow each other faster than they can have been exposed."""
        first, *_, last = [self._frame_within(opened, opened.valid_from_s, "of a long exposure") for _ in range(3)]
        interval_s = (last.started_s - first.started_s) / (last.sequence - first.sequence)
        if interval_s < _LEAST_INTERVAL * opened.exposure_s:
            raise SettingRefused(
                f"{self._name} says that it exposes {opened.exposure_s:g} s, but its frames come every "
                f"{interval_s:.4g} s; lower camera.frame_rate_hz, or keep exposures below {opened.period_s:.4g} s"
            )

    def _frame_within(self, opened: _Opened, after_s: float, when: str) -> RawFrame:
        seen = FrameSearch()
        frame = self._next_frame(opened, after_s, self._limit_s(opened), seen)
        if frame is None:
            raise CaptureTimeout(f"{self._name}: no frame {when}: {seen}; plug the camera in again")
        return frame

    def _limit_s(self, opened: _Opened) -> float:
        longest_s = max(opened.period_s, opened.exposure_s)
        return self._clock.now_s() + _SETTLING_S + _SETTLING_PERIODS * longest_s

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        """Return the first good frame whose exposure began at or after ``after_s``.

        Frames with the driver's error flag, short and undecodable ones are passed over. Raises CaptureTimeout when
        none comes within ``timeout_s``, DeviceLost when closed or gone, DeviceError when streaming fails twice.
        """
        until_s = self._clock.now_s() + timeout_s
        with while_open(self._opened, name=self._name, doing="capturing", close=self.close) as opened:
            seen = FrameSearch()
            after_s = max(after_s, opened.valid_from_s)
            frame = self._next_frame(opened, after_s, until_s, seen)
            if frame is None:
                raise CaptureTimeout(
                    f"{self._name}: no frame that was exposed after the picture settled came within {timeout_s:g} s: "
                    f"{seen}; check the cable, or give timing.timeout_s more time"
                )
            self._clock.wait_until_s(frame.started_s + frame.exposure_s)  # drivers may stamp a little ahead
            return frame

    @property
    def _name(self) -> str:
        return f"camera {self.device_id}"

    def _next_frame(self, opened: _Opened, after_s: float, until_s: float, seen: FrameSearch) -> RawFrame | None:
        """The next good frame that began after a time; a stream that breaks is started again, once."""
        try:
            return opened.frames.next(after_s, until_s, opened.exposure_s, seen)
        except StreamBroken:
            opened.stream.stop()
            opened.stream.start()
        hold_controls(opened.node, opened.settings)
        return opened.frames.next(after_s, until_s, opened.exposure_s, seen)


def from_profile(settings: CameraSettings, clock: Clock) -> V4l2Camera:
    """Make the camera of a profile's table [[camera]], closed: driver ``v4l2``. Raises ProfileError."""
    pixel_format = settings.pixel_format or ""
    check_mosaic(pixel_format, mosaic_of_format(pixel_format), settings.mosaic)
    return V4l2Camera(
        settings.device_id or "",
        shape=settings.shape,
        pixel_format=pixel_format,
        bit_depth=settings.bit_depth,
        frame_rate_hz=settings.frame_rate_hz,
        exposure_range_s=settings.exposure_range_s,
        controls=settings.controls,
        clock=clock,
    )
