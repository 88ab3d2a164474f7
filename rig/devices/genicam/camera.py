"""A GigE Vision or USB3 Vision camera: opened by serial number or address, set up and read back, triggered.

With a software trigger the exposure cannot begin before the command was sent, whatever time stamps mean: a frame's
`started_s` is that moment. Without one, frames come all the time, and each is taken to have begun one exposure and one
frame period before its time stamp, for cameras stamp begin, end or readout of a frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field

from rig.devices.driver_settings import CameraSettings
from rig.devices.fingerprint import Fingerprint
from rig.devices.genicam.clock_map import ClockMap
from rig.devices.genicam.features import EXPOSURES, Features, Setting, manual
from rig.devices.genicam.find import is_address, opened_by, why_silent
from rig.devices.genicam.formats import PIXEL_FORMATS, PixelFormat, Pixels, pixel_format
from rig.devices.genicam.library import AravisError, aravis
from rig.devices.genicam.settings import GenicamOptions, options_of
from rig.devices.genicam.stream import SOCKET_BUFFER_BYTES, Filled, Stream, socket_buffer_limit
from rig.devices.protocols import Clock, ExposureRange, RawFrame
from rig.devices.refusals import check_exposure, check_mosaic
from rig.errors import CaptureTimeout, DeviceBusy, DeviceError, DeviceLost, SettingRefused

_TRIES = 3
"""To connect: a first answer may be lost, or come too late."""
_MICROSECONDS = 1e6
_ANSWER_S = 1.0
"""From a trigger to the frame, on top of its exposure: readout and transfer of any camera that this is for."""
_EARLY_SHARE = 0.9
"""Of the exposure: a frame that arrives sooner after the trigger was exposed before it."""
_SMALL_PACKET = 1500
"""Bytes: what a network without jumbo frames carries."""
_STEP = 1e-5
"""Relative: exposures that are nearer than this are one."""


@dataclass(slots=True, kw_only=True)
class _Search:
    """What came while a frame was searched for."""

    frames: int = 0
    incomplete: int = 0
    early: int = 0

    def __str__(self) -> str:
        if not self.frames:
            return "no frame came at all"
        return f"{self.frames} frames came, {self.incomplete} with packets missing, {self.early} exposed too early"


@dataclass(slots=True, kw_only=True)
class _Opened:
    """Everything that exists while the camera is open."""

    device: int
    camera: int
    features: Features
    stream: Stream
    exposure: str
    """The feature's name."""
    exposure_s: float
    held: list[Setting]
    packet_bytes: int | None
    """None of a USB camera."""
    undo: ExitStack
    clock_map: ClockMap = field(default_factory=ClockMap)
    valid_from_s: float = 0.0
    """Frames that began earlier have another exposure."""
    missed: int = 0
    """Frames that came incomplete since the last good one."""


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
        self._opened: _Opened | None = None
        self._fingerprint = Fingerprint()
        self._last_print: tuple[int, int, bytes] | None = None
        self._counted = 0

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
        """Shortest and longest exposure."""
        return self._exposure_range_s

    @property
    def _name(self) -> str:
        return f"camera {self.device_id}"

    @property
    def _is_triggered(self) -> bool:
        return self._options.trigger == "software"

    @property
    def _format(self) -> PixelFormat:
        return pixel_format(self._format_name, numbers=self._shape[2], bit_depth=self._bit_depth)

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
        wanted = self._format
        with ExitStack() as undo:
            camera = self._connected(opened_by(self.device_id))
            undo.callback(aravis().call, "g_object_unref", camera)
            device = aravis().call("arv_camera_get_device", camera)
            is_gige = bool(aravis().call("arv_camera_is_gv_device", camera))
            if is_gige and not aravis().call("arv_gv_device_is_controller", device):
                raise DeviceBusy(f"{self._name} is controlled by another program; close that, and try again")
            features = Features(device, self._name)
            held = self._set_up(features, wanted)
            packet_bytes = self._packets(camera) if is_gige else None
            payload = self._called("arv_camera_get_payload", camera, "size of a frame")
            stream = Stream(camera, payload, is_gige=is_gige, clock=self._clock)
            undo.callback(stream.close)
            exposure = self._exposure_feature(features)
            self._opened = _Opened(
                device=device,
                camera=camera,
                features=features,
                stream=stream,
                exposure=exposure,
                exposure_s=features.number(exposure) / _MICROSECONDS,
                held=held,
                packet_bytes=packet_bytes,
                undo=undo,
            )
            self._called("arv_camera_start_acquisition", camera, "starting")
            self._opened.undo = undo.pop_all()

    def _connected(self, address: str) -> int:
        """Return Aravis' camera at an address or of a name; asks again when the first answer is lost."""
        last: AravisError | None = None
        for _ in range(_TRIES):
            try:
                found = aravis().call("arv_camera_new", address.encode())
            except AravisError as error:
                last = error
                if error.means_taken:
                    raise DeviceBusy(f"{self._name} is controlled by another program ({error}); close that") from error
                continue
            if found:
                return int(found)
        why = why_silent(address) if is_address(address) else "plug it in again, and see `rig devices`"
        raise DeviceLost(f"{self._name} does not answer ({last}): {why}") from last

    def _set_up(self, features: Features, wanted: PixelFormat) -> list[Setting]:
        """Set format, size, rate, trigger, automatics and the profile's features; returns what has to stay so."""
        if features.has("TriggerMode"):
            features.hold(Setting("TriggerMode", "Off"))
        for name in ("OffsetX", "OffsetY"):
            if features.has(name):
                features.hold(Setting(name, 0))
        height_px, width_px, _ = self._shape
        picture = [Setting("PixelFormat", wanted.name), Setting("Width", width_px), Setting("Height", height_px)]
        others = [Setting(name, value) for name, value in self._options.features.items()]
        given = {name for name, _ in others}
        held = [*picture, *(one for one in manual(features) if one.name not in given), *self._trigger(features), *others]
        for setting in held:
            features.hold(setting)
        if features.has("AcquisitionFrameRate") and not self._is_triggered:
            if features.has("AcquisitionFrameRateEnable"):
                features.hold(Setting("AcquisitionFrameRateEnable", True))
            features.hold(Setting("AcquisitionFrameRate", 1 / self._period_s))
        if features.has("AcquisitionMode"):
            features.hold(Setting("AcquisitionMode", "Continuous"))
        return held

    def _trigger(self, features: Features) -> list[Setting]:
        if self._options.trigger == "free":
            return []
        source = "Software" if self._is_triggered else self._options.line
        wanted = [Setting("TriggerSelector", "FrameStart")] if features.has("TriggerSelector") else []
        wanted.append(Setting("TriggerSource", source))
        if not self._is_triggered:
            wanted.append(Setting("TriggerActivation", self._options.activation))
        if not features.has("TriggerMode"):
            raise SettingRefused(f'{self._name} has no trigger; give camera.options.trigger = "free"')
        return [*wanted, Setting("TriggerMode", "On")]

    def _exposure_feature(self, features: Features) -> str:
        found = features.first_of(EXPOSURES)
        if found is None:
            raise SettingRefused(f"{self._name} has no exposure time that can be set; is it an industrial camera?")
        range_s = ExposureRange(*(one / _MICROSECONDS for one in features.bounds(found)))
        if not (range_s.holds(self._exposure_range_s.shortest_s) and range_s.holds(self._exposure_range_s.longest_s)):
            raise SettingRefused(
                f"camera.exposure_range_s {self._exposure_range_s} is outside what {self._name} can do, {range_s} s; "
                "give a range within it"
            )
        return found

    def _packets(self, camera: int) -> int:
        """Set the size of packets, and return it."""
        if self._options.packet_size is not None:
            size = self._options.packet_size
            try:
                aravis().call("arv_camera_gv_set_packet_size", camera, size)
            except AravisError as error:
                raise SettingRefused(f"{self._name}: packets of {size} bytes: {error}; leave packet_size out") from error
        else:
            with suppress(AravisError):  # then it stays what it was
                aravis().call("arv_camera_gv_auto_packet_size", camera)
        return int(self._called("arv_camera_gv_get_packet_size", camera, "size of packets"))

    def _called(self, function: str, pointer: int, doing: str) -> int:
        try:
            return int(aravis().call(function, pointer) or 0)
        except AravisError as error:
            kind = DeviceLost if error.means_gone else DeviceError
            raise kind(f"{self._name}: {doing}: {error}; check cable and power") from error

    def close(self) -> None:
        """Stop it and let it go; any number of times, from any state."""
        opened, self._opened = self._opened, None
        if opened is not None:
            self._counted += 1 << 20  # frames of the next stream count on
            with suppress(AravisError):
                aravis().call("arv_camera_stop_acquisition", opened.camera)
            opened.undo.close()

    def set_exposure(self, exposure_s: float) -> float:
        """Set the exposure, and return the one that the camera took.

        Raises SettingRefused outside its range or when something automatic is on again, DeviceLost when closed or gone.
        """
        with self._opened_for("setting its exposure") as opened:
            check_exposure(exposure_s, self._exposure_range_s)
            changed = [one.name for one in opened.held if not opened.features.is_as_set(one)]
            if changed:
                raise SettingRefused(
                    f"{self._name}: {', '.join(changed)} is not as it was set any more; close other programs that use it"
                )
            chosen_s = opened.features.set_number(opened.exposure, exposure_s * _MICROSECONDS) / _MICROSECONDS
            if abs(chosen_s - opened.exposure_s) > _STEP * opened.exposure_s:
                opened.exposure_s, opened.valid_from_s = chosen_s, self._clock.now_s()
            return opened.exposure_s

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        """Return the first complete frame whose exposure began at or after ``after_s``.

        Raises CaptureTimeout when none comes within ``timeout_s``, DeviceLost when closed or gone.
        """
        until_s = self._clock.now_s() + timeout_s
        with self._opened_for("capturing") as opened:
            seen, after_s = _Search(), max(after_s, opened.valid_from_s)
            take = self._triggered if self._is_triggered else self._running
            frame = take(opened, after_s, until_s, seen)
            if frame is not None:
                self._clock.wait_until_s(frame.started_s + frame.exposure_s)
                return frame
            self._check_control(opened)
            raise CaptureTimeout(
                f"{self._name}: no frame that was exposed after the picture settled came within {timeout_s:g} s: {seen}; "
                "check the cable (packets missing: larger socket buffer, see `rig check`), or raise timing.timeout_s"
            )

    def _triggered(self, opened: _Opened, after_s: float, until_s: float, seen: _Search) -> RawFrame | None:
        self._clock.wait_until_s(min(after_s, until_s))
        while self._clock.now_s() < until_s:
            opened.stream.drop_waiting()
            began_s = self._clock.now_s()
            opened.features.do("TriggerSoftware")
            limit_s = min(until_s, began_s + opened.exposure_s + _ANSWER_S)
            filled = opened.stream.next(limit_s)
            while filled is not None and filled.arrived_s < began_s + _EARLY_SHARE * opened.exposure_s:
                seen.frames, seen.early = seen.frames + 1, seen.early + 1
                opened.stream.give_back(filled)
                filled = opened.stream.next(limit_s)
            frame = None if filled is None else self._looked_at(opened, filled, began_s, seen)
            if frame is not None:
                return frame
            if filled is None:
                self._check_control(opened)
                self._restart(opened)
        return None

    def _restart(self, opened: _Opened) -> None:
        """A frame that was triggered and did not come may come still, and would pass for the next one."""
        self._called("arv_camera_stop_acquisition", opened.camera, "stopping")
        self._called("arv_camera_start_acquisition", opened.camera, "starting again")
        opened.stream.drop_waiting()
        opened.stream.forget_ids()

    def _running(self, opened: _Opened, after_s: float, until_s: float, seen: _Search) -> RawFrame | None:
        while (filled := opened.stream.next(until_s)) is not None:
            opened.clock_map.add(filled.device_s, filled.arrived_s)
            started_s = opened.clock_map.host_s(filled.device_s) - opened.exposure_s - self._period_s
            if started_s >= after_s:
                frame = self._looked_at(opened, filled, started_s, seen)
                if frame is not None:
                    return frame
                continue
            seen.frames, seen.early = seen.frames + 1, seen.early + 1
            self._last_print = None
            opened.stream.give_back(filled)
        return None

    def _looked_at(self, opened: _Opened, filled: Filled, started_s: float, seen: _Search) -> RawFrame | None:
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

    def _check_control(self, opened: _Opened) -> None:
        """Raise DeviceLost when the camera is not ours any more: silence has no other sign."""
        if opened.packet_bytes is None:
            return
        if not aravis().call("arv_gv_device_is_controller", opened.device):
            raise DeviceLost(f"{self._name} has let this program go: its heartbeat was lost; check the network")
        opened.features.number("Width")

    @contextmanager
    def _opened_for(self, doing: str) -> Iterator[_Opened]:
        """The open state; a camera that is lost meanwhile is let go at once."""
        if self._opened is None:
            raise DeviceLost(f"{self._name} is closed: open it before {doing}")
        try:
            yield self._opened
        except DeviceLost:
            self.close()
            raise

    def advice(self) -> tuple[str, ...]:
        """Return what its transport lacks, a sentence each, with the setting to change; nothing when all is well."""
        opened = self._opened
        if opened is None or opened.packet_bytes is None:
            return ()
        counters, limit = opened.stream.counters(), socket_buffer_limit()
        found = []
        if opened.packet_bytes <= _SMALL_PACKET:
            found.append(
                f"{self._name}: packets of {opened.packet_bytes} bytes; larger ones cost less: ip link set DEVICE mtu 9000"
            )
        if limit is not None and limit < SOCKET_BUFFER_BYTES:
            found.append(
                f"{self._name}: sockets may keep {limit} bytes, {SOCKET_BUFFER_BYTES} are wanted: "
                f"sysctl -w net.core.rmem_max={SOCKET_BUFFER_BYTES}"
            )
        if counters.failed or counters.missing_packets:
            found.append(
                f"{self._name}: {counters.failed} of {counters.complete + counters.failed} frames came incomplete, "
                f"{counters.missing_packets} packets were missing, {counters.resent_packets} were sent again; use a cable "
                "and a card of its own"
            )
        return tuple(found)


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
