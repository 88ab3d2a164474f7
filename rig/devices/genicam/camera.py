"""A GigE Vision or USB3 Vision camera: opened by serial number or address, set up and read back, triggered.

With a software trigger the exposure cannot begin before the command was sent, whatever time stamps mean: a frame's
`started_s` is that moment. Without one, frames come all the time, and each is taken to have begun one exposure and one
frame period before its time stamp, for cameras stamp begin, end or readout of a frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import ExitStack, suppress

from rig.devices.driver_settings import CameraSettings
from rig.devices.fingerprint import Fingerprint
from rig.devices.genicam.aravis import AravisError, aravis
from rig.devices.genicam.features import Features
from rig.devices.genicam.formats import PIXEL_FORMATS, GenicamFormat, Pixels, pixel_format
from rig.devices.genicam.gain import GAIN, GenicamGain
from rig.devices.genicam.opened import OpenGenicam
from rig.devices.genicam.settings import GenicamOptions, options_of
from rig.devices.genicam.setup import (
    MICROSECONDS,
    GenicamWishes,
    called,
    check_control,
    connected,
    exposure_feature,
    set_packets,
    set_up,
    transport_advice,
)
from rig.devices.genicam.stream import BUFFERS, ORDINARY_SOCKET, FilledBuffer, GenicamSearch, GenicamStream
from rig.devices.genicam.triggers import ANSWER_S, SENT_ONCE_S, SILENCE_S, answer, is_quiet
from rig.devices.genicam.usb import usb_advice
from rig.devices.protocols import Clock, ExposureRange, RawFrame
from rig.devices.refusals import check_exposure, check_mosaic
from rig.devices.while_open import while_open
from rig.errors import CaptureTimeout, DeviceBusy, SettingRefused

_QUEUED_PERIODS = 2
"""Frames that a camera that is not triggered may have begun or queued with the exposure before."""
_STEP = 1e-5
"""Relative: exposures that are nearer than this are one."""


class GenicamCamera:
    """A camera of GigE Vision or USB3 Vision. Its automatics are off while it is open.

    Parameters
    ----------
    device_id
        ``gige-SERIAL`` or ``usb3-SERIAL``, as ``rig devices`` prints it, or an IP address.
    shape
        (height, width, numbers a pixel).
    pixel_format
        As GenICam calls it: ``Mono12``, ``BayerRG12p`` ...
    bit_depth
        Of its numbers; ``2 ** bit_depth - 1`` is saturated.
    frame_rate_hz
        Of a camera that is not triggered; how often a triggered one may be asked.
    exposure_range_s
        Shortest and longest exposure; within the camera's.
    options
        What else the profile says.
    clock
        Has to count like CLOCK_MONOTONIC.
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
        options: GenicamOptions,
        clock: Clock,
    ):
        self.device_id = device_id
        self._shape, self._format_name, self._bit_depth = shape, pixel_format, bit_depth
        self._period_s, self._options, self._clock = 1 / frame_rate_hz, options, clock
        self._exposure_range_s = ExposureRange(*exposure_range_s)
        self._opened: OpenGenicam | None = None
        self._fingerprint = Fingerprint()
        self._last_print: tuple[int, int, bytes] | None = None
        self._counted, self._left_waiting = 0, False

    @property
    def shape(self) -> tuple[int, int, int]:
        """(height, width, numbers a pixel)."""
        return self._shape

    @property
    def full_scale_dn(self) -> int:
        """Largest digital number."""
        return int(2**self._bit_depth - 1)

    @property
    def exposure_range_s(self) -> ExposureRange:
        """Shortest and longest."""
        return self._exposure_range_s

    @property
    def _name(self) -> str:
        return f"camera {self.device_id}"

    @property
    def _is_triggered(self) -> bool:
        return self._options.trigger == "software"

    @property
    def _format(self) -> GenicamFormat:
        return pixel_format(self._format_name, numbers=self._shape[2], bit_depth=self._bit_depth)

    @property
    def stream(self) -> GenicamStream:
        """What its frames come through. Raises DeviceLost when it is closed."""
        with while_open(self._opened, name=self._name, doing="looking at its stream", close=self.close) as opened:
            return opened.stream

    def open(self) -> None:
        """Connect, set everything and read it back, and start the stream.

        Raises
        ------
        DeviceLost
            It does not answer; the message says why that may be.
        DeviceBusy
            Another program controls it.
        SettingRefused
            It cannot do what the profile says; the message says what it can.
        DeviceError
            The library is missing.
        """
        if self._opened is not None:
            return
        wishes = GenicamWishes(
            name=self._name,
            shape=self._shape,
            pixel_format=self._format,
            frame_rate_hz=1 / self._period_s,
            exposure_range_s=self._exposure_range_s,
            options=self._options,
        )
        with ExitStack() as undo:
            camera = connected(self.device_id, self._name)
            undo.callback(aravis().call, "g_object_unref", camera)
            device = aravis().call("arv_camera_get_device", camera)
            is_gige = bool(aravis().call("arv_camera_is_gv_device", camera))
            if is_gige and not aravis().call("arv_gv_device_is_controller", device):
                raise DeviceBusy(f"{self._name} is controlled by another program; close that, and try again")
            features = Features(device, self._name)
            held = set_up(features, wishes)
            packet_bytes = set_packets(camera, wishes) if is_gige else None
            if is_gige and not self._options.packet_socket:
                aravis().call("arv_camera_gv_set_stream_options", camera, ORDINARY_SOCKET)
            stream = GenicamStream(
                camera, called("arv_camera_get_payload", camera, wishes.name), is_gige=is_gige, clock=self._clock
            )
            undo.callback(stream.close)
            exposure = exposure_feature(features, wishes)
            opened = OpenGenicam(
                device=device,
                camera=camera,
                features=features,
                stream=stream,
                exposure=exposure,
                exposure_s=features.number(exposure) / MICROSECONDS,
                held=held,
                packet_bytes=packet_bytes,
                undo=undo,
            )
            if self._left_waiting:  # the trigger may have been understood, and its frame be exposed now
                opened.stay_quiet(self._clock.now_s() + opened.exposure_s + SILENCE_S)
            called("arv_camera_start_acquisition", camera, wishes.name)
            opened.undo, self._opened = undo.pop_all(), opened

    def close(self) -> None:
        """Stop it and let it go; any number of times, from any state."""
        opened, self._opened = self._opened, None
        if opened is not None:
            self._left_waiting = opened.is_waiting
            self._counted += 1 << 20  # frames of the next stream count on
            with suppress(AravisError):
                aravis().call("arv_camera_stop_acquisition", opened.camera)
            opened.undo.close()

    def set_exposure(self, exposure_s: float) -> float:
        """Set the exposure, and return the one that the camera took.

        Raises SettingRefused outside its range or when something automatic is on again, DeviceLost when closed or gone.
        """
        with while_open(self._opened, name=self._name, doing="setting its exposure", close=self.close) as opened:
            check_exposure(exposure_s, self._exposure_range_s)
            self._check_control(opened)
            changed = [one.name for one in opened.held if not opened.features.is_as_set(one)]
            if changed:
                self._check_control(opened)  # a camera that began anew meanwhile has all settings as they were made
                raise SettingRefused(
                    f"{self._name}: {', '.join(changed)} is not as it was set; close other programs that use it"
                )
            chosen_s = opened.features.set_number(opened.exposure, exposure_s * MICROSECONDS) / MICROSECONDS
            if abs(chosen_s - opened.exposure_s) > _STEP * opened.exposure_s:
                self._from_now(opened)
                opened.exposure_s = chosen_s
            return opened.exposure_s

    def _from_now(self, opened: OpenGenicam) -> None:
        """Frames that began before have other settings."""
        queued_s = 0.0 if self._is_triggered else _QUEUED_PERIODS * max(self._period_s, opened.exposure_s)
        opened.valid_from_s = self._clock.now_s() + queued_s

    def gain_control(self) -> GenicamGain | None:
        """Its gain, while it is open; it is opened with the profile's, or the least."""
        opened = self._opened
        if opened is None or not opened.features.has(GAIN):
            return None
        return GenicamGain(opened.features, opened.held, lambda: self._from_now(opened))

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        """Return the first complete frame whose exposure began at or after ``after_s``.

        Raises CaptureTimeout when none comes within ``timeout_s``, DeviceLost when closed or gone.
        """
        until_s = self._clock.now_s() + timeout_s
        with while_open(self._opened, name=self._name, doing="capturing", close=self.close) as opened:
            seen, after_s = GenicamSearch(), max(after_s, opened.valid_from_s)
            take = self._triggered if self._is_triggered else self._running
            frame = take(opened, after_s, until_s, seen)
            if frame is not None:
                self._clock.wait_until_s(frame.started_s + frame.exposure_s)
                return frame
            self._check_control(opened)
            if seen.early:  # or its clock is not what was learned of it
                opened.answers.forget()
                opened.stay_quiet(self._clock.now_s() + opened.exposure_s + ANSWER_S)
            raise CaptureTimeout(
                f"{self._name}: no frame that was exposed after the picture settled came within {timeout_s:g} s: "
                f"{seen}; {self._remedy(opened, seen)}, or raise timing.timeout_s"
            )

    def _remedy(self, opened: OpenGenicam, seen: GenicamSearch) -> str:
        """What to do where no frame came; the camera answers commands, else it would be lost."""
        if not seen.frames and self._options.trigger == "line":
            return f"no pulse came on {self._options.line}: check the wire and the projector's sync output"
        if not seen.frames and opened.packet_bytes is not None:
            return "it answers commands, and no packet of a picture came: a firewall has to let all UDP from it in"
        return "check the cable (where packets are missing, `rig check` says more)"

    def _triggered(self, opened: OpenGenicam, after_s: float, until_s: float, seen: GenicamSearch) -> RawFrame | None:
        """Trigger until a whole frame comes: each trigger has its one frame before the next is sent."""
        while is_quiet(opened, self._clock, (after_s, until_s), seen):
            began_s, opened.is_waiting = self._clock.now_s(), True
            opened.features.do("TriggerSoftware")
            sent_s = self._clock.now_s()
            if sent_s > began_s + SENT_ONCE_S:  # then another frame may follow the first, and pass for the next one
                opened.stay_quiet(sent_s + opened.exposure_s + SILENCE_S)
            limit_s = min(until_s, sent_s + opened.exposure_s + ANSWER_S)
            filled, doubted = answer(opened, self._clock, (began_s, limit_s), seen)
            if doubted is not None:  # it was the answer, the quickest so far
                opened.is_waiting = False
                opened.answers.add(doubted, began_s, opened.exposure_s)
            elif filled is None:
                self._check_control(opened)
                self._restart(opened, sent_s)
            if filled is None:
                continue
            opened.is_waiting = False
            device_s, frame = filled.device_s, self._looked_at(opened, filled, began_s, seen)
            if frame is not None:
                opened.answers.add(device_s, began_s, opened.exposure_s)
                return frame
        return None

    def _restart(self, opened: OpenGenicam, sent_s: float) -> None:
        """A frame that was triggered and did not come may come still, and would pass for the next one.

        Its time stamp tells it where there is one to compare with; where there is none, it is waited for.
        """
        opened.stay_quiet(sent_s + opened.exposure_s + ANSWER_S * (1 if opened.answers.is_known else 2))
        called("arv_camera_stop_acquisition", opened.camera, self._name)
        called("arv_camera_start_acquisition", opened.camera, self._name)
        opened.stream.drop_waiting()
        opened.stream.forget_ids()

    def _running(self, opened: OpenGenicam, after_s: float, until_s: float, seen: GenicamSearch) -> RawFrame | None:
        while (filled := opened.stream.next(until_s)) is not None:
            if not filled.has_leader:
                self._looked_at(opened, filled, -math.inf, seen)
                continue
            opened.clock_map.add(filled.device_s, filled.arrived_s)
            started_s = opened.clock_map.host_s(filled.device_s) - opened.exposure_s - self._period_s
            if started_s >= after_s and opened.clock_map.is_settled:
                frame = self._looked_at(opened, filled, started_s, seen)
                if frame is not None:
                    return frame
                continue
            seen.frames, seen.early = seen.frames + 1, seen.early + 1
            self._last_print = None
            opened.stream.give_back(filled)
        return None

    def _looked_at(
        self, opened: OpenGenicam, filled: FilledBuffer, started_s: float, seen: GenicamSearch
    ) -> RawFrame | None:
        """The frame of a buffer; None when packets are missing."""
        seen.frames += 1
        pixels: Pixels | None = None
        with opened.stream.bytes_of(filled) as data:
            wanted = self._format
            if filled.is_complete and data.size >= wanted.least_bytes(self._shape[1], self._shape[0]):
                pixels = wanted.decode(data, self._shape[:2])
                fingerprint = self._fingerprint.of(data)
        if pixels is None:
            seen.incomplete += 1
            opened.missed += 1
            return None
        repeats, self._last_print = fingerprint == self._last_print, fingerprint
        lost, opened.missed = filled.lost + opened.missed, 0
        return RawFrame(
            pixels=pixels,
            exposure_s=opened.exposure_s,
            started_s=started_s,
            sequence=self._counted + filled.number,
            lost=0 if self._is_triggered else lost,
            repeats=repeats,
        )

    def _check_control(self, opened: OpenGenicam) -> None:
        """Raise DeviceLost when the camera is not ours any more: silence has no other sign."""
        if opened.packet_bytes is not None:
            check_control(opened.device, self._name)
        opened.features.number("Width")

    def advice(self) -> tuple[str, ...]:
        """Return what its transport lacks, a sentence each, with the setting to change; nothing when all is well."""
        opened = self._opened
        if opened is None:
            return ()
        if opened.packet_bytes is None:
            frame_bytes = self._format.least_bytes(self._shape[1], self._shape[0])
            return usb_advice(self.device_id, BUFFERS * frame_bytes)
        return transport_advice(self.device_id, opened.packet_bytes, opened.stream.counters())


def from_profile(settings: CameraSettings, clock: Clock) -> GenicamCamera:
    """Make the camera of a profile's table [[camera]], closed: driver ``genicam``. Raises ProfileError."""
    name = settings.pixel_format or ""
    known = PIXEL_FORMATS.get(name)
    check_mosaic(name, None if known is None else known.mosaic, settings.mosaic)
    options: Mapping[str, object] = settings.options
    return GenicamCamera(
        settings.device_id or "",
        shape=settings.shape,
        pixel_format=name,
        bit_depth=settings.bit_depth,
        frame_rate_hz=settings.frame_rate_hz,
        exposure_range_s=settings.exposure_range_s,
        options=options_of(options),
        clock=clock,
    )
