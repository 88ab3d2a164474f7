"""A USB video camera that is not there: :func:`rig.emulated.usbip.attach.attach` plugs it in for any program.

It exposes one frame after the other while a program streams. What a frame shows comes from a source, which is told
the exposure and the gain that the frame is taken with.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import Protocol

from rig.devices.usb.extension_unit import Query
from rig.emulated.faults import Faults
from rig.emulated.usbip.device import Descriptors, Setup, Stall, Transfer, UsbSpeed
from rig.emulated.uvc.controls import (
    AUTO_EXPOSURE,
    EXPOSURE_UNIT_S,
    UNITY_GAIN,
    ControlBank,
    Info,
    RequestError,
    camera_controls,
    processing_controls,
)
from rig.emulated.uvc.descriptors import (
    INTERVAL_UNITS_PER_S,
    PROBE_BYTES,
    STREAMING_INTERFACE,
    NegotiatedStream,
    Transport,
    VideoFormat,
    camera_descriptors,
    negotiate,
    video_formats,
)
from rig.emulated.uvc.formats import mean_share
from rig.emulated.uvc.stream import Sender

_CLASS_TO_INTERFACE, _KIND_MASK = 0x21, 0x7F
_PROBE, _COMMIT = 1, 2
_LATE_S = 0.01
"""An exposure may begin so much after its time; later, the grid of start times moves."""
_AUTOMATIC_LEVEL = 0.45
"""Mean of a picture that the automatic exposure aims at, of full scale."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRequest:
    """One exposure, as the camera asks its source for it."""

    fourcc: str
    """V4L2's code, four characters: "GREY", "Y16 ", "YUYV", …"""
    width_px: int
    height_px: int
    started_s: float
    """Start of the exposure on the monotonic clock; may have passed a few milliseconds ago."""
    exposure_s: float
    gain: float
    """Linear; 1 does nothing."""
    number: int
    """Counts exposures since the camera was plugged in, lost ones too."""


class FrameSource(Protocol):
    """What the camera sees."""

    def expose(self, request: FrameRequest) -> bytes | None:
        """Return the frame's bytes at the end of the exposure, having waited for it; None: this frame is lost."""
        ...


class UvcCamera:
    """An emulated UVC camera; a :class:`rig.emulated.usbip.device.UsbDevice`.

    Parameters
    ----------
    formats
        The first size of the first format is the default; see :func:`rig.emulated.uvc.descriptors.video_formats`.
    source
        What it sees.
    exposure_range_s, exposure_s
        Limits of the manual exposure, and the one it begins with; steps of 0.1 ms. It begins in automatic mode.
    control_delay_frames
        So many frames after the change of exposure or gain are still exposed with the old one.
    longest_delay_s
        A frame that is not on its way so long after its exposure is lost: its host, which times it by its arrival,
        would take it for younger than it is. A rig's ``projector.latency_s`` has to cover it.
    """

    speed = UsbSpeed.HIGH

    def __init__(
        self,
        *,
        source: FrameSource,
        formats: tuple[VideoFormat, ...] = video_formats(),
        name: str = "Emulated camera",
        serial: str = "EMULATED1",
        vendor_id: int = 0x1209,
        product_id: int = 0x0001,
        faults: Faults | None = None,
        exposure_range_s: tuple[float, float] = (0.0001, 0.5),
        exposure_s: float = 0.0156,
        control_delay_frames: int = 1,
        longest_delay_s: float = 0.1,
        transport: Transport = Transport.ISOCHRONOUS,
    ):
        self.faults = faults or Faults()
        self.controls = ControlBank((*camera_controls(exposure_range_s, exposure_s), *processing_controls()))
        self.descriptors: Descriptors = camera_descriptors(
            formats,
            self.controls.controls,
            transport,
            name=name,
            serial=serial,
            vendor_id=vendor_id,
            product_id=product_id,
        )
        self.frames_sent = 0
        self._formats, self._transport, self._source = formats, transport, source
        self._exposure_range_s = exposure_range_s
        self._longest_delay_s = longest_delay_s
        self._settings: deque[tuple[float, float]] = deque(maxlen=control_delay_frames + 1)
        self._probed = self._committed = negotiate(formats, transport)
        self._sender = Sender(transport)
        self._change = threading.Condition()
        self._stream: NegotiatedStream | None = None
        self._plugged = False
        self._sensor: threading.Thread | None = None

    def plugged(self) -> None:
        """Begin, as if power came on."""
        self._plugged = True
        self._sensor = threading.Thread(target=self._expose_frames, name="emulated camera")
        self._sensor.start()

    def unplugged(self) -> None:
        """End; waits for the exposure that runs."""
        with self._change:
            self._plugged = False
        self._start(None)
        if self._sensor is not None:
            self._sensor.join()
            self._sensor = None

    def select(self, interface: int, alternate: int) -> None:
        """Alternate setting 1 of the video interface is how a host starts an isochronous stream."""
        if interface < 0:
            self.faults.frozen_until_reset = False
            self.controls.reset()
            self._start(None)
        elif interface == STREAMING_INTERFACE:
            runs = alternate > 0 and self._transport is Transport.ISOCHRONOUS
            self._start(self._committed if runs else None)

    def submit(self, transfer: Transfer) -> None:
        """A transfer of the video endpoint; filled as soon as there is a frame."""
        self._sender.submit(transfer)

    def control(self, setup: Setup, data: bytes) -> bytes:
        """Answer a request of the video class. Raises Stall."""
        if setup.request_type & _KIND_MASK != _CLASS_TO_INTERFACE:
            raise Stall
        self._delay()
        unit, interface, selector = setup.index >> 8, setup.index & 0xFF, setup.value >> 8
        if interface == STREAMING_INTERFACE:
            return self._negotiate(selector, setup.request, data)
        if (unit, selector) in self.faults.stalled_controls:
            raise self.controls.refuse(RequestError(self.faults.stall_error))
        return self.controls.request(unit, selector, setup.request, data)

    def _delay(self) -> None:
        until_s = time.monotonic() + self.faults.control_delay_s
        with self._change:
            self._change.wait_for(lambda: not self._plugged, until_s - time.monotonic())

    def _negotiate(self, selector: int, request: int, data: bytes) -> bytes:
        if selector not in (_PROBE, _COMMIT):
            raise Stall
        if request == Query.SET_CUR:
            agreed = negotiate(self._formats, self._transport, data)
            if selector == _PROBE:
                self._probed = agreed
            else:
                self._commit(agreed)
            return b""
        if request == Query.GET_LEN:
            return PROBE_BYTES.to_bytes(2, "little")
        if request == Query.GET_INFO:
            return bytes([Info.GET | Info.SET])
        if request == Query.GET_DEF:
            return negotiate(self._formats, self._transport).pack()
        return (self._probed if selector == _PROBE else self._committed).pack()

    def _commit(self, agreed: NegotiatedStream) -> None:
        self._committed = agreed
        if self._transport is Transport.BULK:
            self._start(agreed)

    def _start(self, stream: NegotiatedStream | None) -> None:
        with self._change:
            self._stream = stream
            self._sender.clear()
            self._change.notify_all()

    def _expose_frames(self) -> None:
        self._settings.clear()
        number, next_s = 0, 0.0
        while (stream := self._wait_until(next_s)) is not None:
            request = self._request(stream, _begin(next_s), number)
            frame = self._source.expose(request)
            number += 1
            if frame is not None:
                until_s = request.started_s + request.exposure_s + self._longest_delay_s
                self._send(stream, frame, until_s)
                self._adjust(request, frame)
            period_s = max(stream.interval / INTERVAL_UNITS_PER_S, request.exposure_s)
            next_s = request.started_s + period_s

    def _wait_until(self, time_s: float) -> NegotiatedStream | None:
        """What to stream at a time; waits for a stream to be wanted, and gives None when unplugged."""
        with self._change:
            self._change.wait_for(lambda: not self._plugged, max(0.0, time_s - time.monotonic()))
            self._change.wait_for(lambda: not self._plugged or self._stream is not None)
            return self._stream if self._plugged else None

    def _request(self, stream: NegotiatedStream, started_s: float, number: int) -> FrameRequest:
        wanted = self.controls.value("exposure") * EXPOSURE_UNIT_S, self.controls.value("gain") / UNITY_GAIN
        self._settings.append(wanted)
        exposure_s, gain = self._settings[0]
        chosen = self._formats[stream.format_index - 1]
        size = chosen.sizes[stream.size_index - 1]
        return FrameRequest(
            fourcc=chosen.fourcc,
            width_px=size.width_px,
            height_px=size.height_px,
            started_s=started_s,
            exposure_s=exposure_s,
            gain=gain,
            number=number,
        )

    def _send(self, stream: NegotiatedStream, picture: bytes, until_s: float) -> None:
        """Send a frame, with the next fault if there is one."""
        faults, sender = self.faults, self._sender
        if faults.frozen or faults.frozen_until_reset or faults.take("dropped_frames"):
            return
        if sender.last_picture and faults.take("duplicate_frames"):
            picture = sender.last_picture
        error = faults.take("error_frames")
        torn = not error and faults.take("short_frames")
        with self._change:
            if self._stream is stream:
                self.frames_sent += sender.send(
                    picture, stream.payload_bytes, begin_until_s=until_s, error=error, torn=torn
                )

    def _adjust(self, request: FrameRequest, frame: bytes) -> None:
        """In automatic mode: bring the next exposures half the way to a picture of medium brightness."""
        if self.controls.value("exposure_mode") != AUTO_EXPOSURE or request.fourcc == "MJPG":
            return
        wanted_s = request.exposure_s * min(
            max(_AUTOMATIC_LEVEL / max(mean_share(frame, request.fourcc), 0.01), 0.5), 2.0
        )
        shortest_s, longest_s = self._exposure_range_s
        chosen_s = min(max((wanted_s + request.exposure_s) / 2, shortest_s), longest_s)
        self.controls.put("exposure", round(chosen_s / EXPOSURE_UNIT_S))


def _begin(planned_s: float) -> float:
    """When an exposure begins: as planned, or now, when whatever came before took too long."""
    now_s = time.monotonic()
    return planned_s if now_s - planned_s < _LATE_S else now_s
