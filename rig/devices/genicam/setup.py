"""Making a camera do what a profile says: connected, features set and read back, packets as large as they go."""

from __future__ import annotations

from contextlib import suppress
from ctypes import byref, c_uint32
from dataclasses import dataclass

from rig.devices.genicam.aravis import AravisError, aravis
from rig.devices.genicam.features import EXPOSURES, Feature, Features, manual
from rig.devices.genicam.find import is_address, is_loopback, opened_by, why_silent
from rig.devices.genicam.formats import GenicamFormat
from rig.devices.genicam.settings import GenicamOptions
from rig.devices.genicam.stream import SOCKET_BUFFER_BYTES, StreamCounters, socket_buffer_limit
from rig.devices.genicam.usb import why_usb_silent
from rig.devices.protocols import ExposureRange
from rig.errors import DeviceBusy, DeviceError, DeviceLost, SettingRefused

MICROSECONDS = 1e6
"""In a second: the unit of exposures."""
_TRIES = 3
"""To connect: a first answer may be lost, or come too late."""
_SMALL_PACKET = 1500
"""Bytes: what a network without jumbo frames carries."""


_CONTROL_REGISTER, _CONTROLLED = 0x0A00, 0b11
"""GigE Vision: control channel privilege, and its bits of exclusive and of plain control."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GenicamWishes:
    """What a profile asks of a camera."""

    name: str
    """How messages call it."""
    shape: tuple[int, int, int]
    pixel_format: GenicamFormat
    frame_rate_hz: float
    exposure_range_s: ExposureRange
    options: GenicamOptions


def connected(device_id: str, name: str) -> int:
    """Return Aravis' camera of an id; asks again when the first answer is lost.

    Raises
    ------
    DeviceLost
        It does not answer; the message says why that may be.
    DeviceBusy
        Another program controls it.
    DeviceForbidden
        It is on USB, and this user may not open it; the message holds the rule that allows it.
    """
    address = opened_by(device_id)
    last: AravisError | None = None
    for _ in range(_TRIES):
        try:
            found = aravis().call("arv_camera_new", address.encode())
        except AravisError as error:
            last = error
            if error.means_taken:
                raise DeviceBusy(f"{name} is controlled by another program ({error}); close that") from error
            continue
        if found:
            return int(found)
    why = why_silent(address) if is_address(address) else why_usb_silent(device_id)
    raise DeviceLost(f"{name} does not answer ({last}): {why}") from last


def called(function: str, camera: int, name: str) -> int:
    """Call a function of a camera that gives a number or nothing. Raises DeviceLost, DeviceError."""
    try:
        return int(aravis().call(function, camera) or 0)
    except AravisError as error:
        kind = DeviceLost if error.means_gone else DeviceError
        raise kind(f"{name}: {error} ({function}); check cable and power") from error


def set_up(features: Features, wishes: GenicamWishes) -> list[Feature]:
    """Set format, size, rate, trigger, automatics and the profile's features; returns what has to stay so.

    Raises
    ------
    SettingRefused
        The camera cannot do it; the message says what it can.
    """
    for first in (Feature("TriggerMode", "Off"), Feature("OffsetX", 0), Feature("OffsetY", 0)):
        if features.has(first.name):
            features.hold(first)
    height_px, width_px, _ = wishes.shape
    picture = [
        Feature("PixelFormat", wishes.pixel_format.name),
        Feature("Width", width_px),
        Feature("Height", height_px),
    ]
    given = wishes.options.features
    usual = [one for one in manual(features) if one.name not in given]
    held = [*picture, *usual, *_trigger(features, wishes), *(Feature(name, value) for name, value in given.items())]
    for setting in held:
        features.hold(setting)
    _set_rate(features, wishes)
    if features.has("AcquisitionMode"):
        features.hold(Feature("AcquisitionMode", "Continuous"))
    return held


def _set_rate(features: Features, wishes: GenicamWishes) -> None:
    """A triggered camera has the rate at which it is triggered: with a limit it would be late, or ignore triggers."""
    switch, rate, given = "AcquisitionFrameRateEnable", "AcquisitionFrameRate", wishes.options.features
    if wishes.options.trigger == "free":
        if features.has(rate):
            if features.has(switch):
                features.hold(Feature(switch, True))
            features.hold(Feature(rate, wishes.frame_rate_hz))
        return
    with suppress(SettingRefused):  # many take neither while they are triggered, and need none
        if switch not in given and features.has(switch):
            features.hold(Feature(switch, False))
        if rate not in given and features.has(rate):
            features.set_number(rate, features.bounds(rate)[1])


def _trigger(features: Features, wishes: GenicamWishes) -> list[Feature]:
    options = wishes.options
    if options.trigger == "free":
        return []
    if not features.has("TriggerMode"):
        raise SettingRefused(f'{wishes.name} has no trigger; give camera.options.trigger = "free"')
    wanted = [Feature("TriggerSelector", "FrameStart")] if features.has("TriggerSelector") else []
    wanted.append(Feature("TriggerSource", "Software" if options.trigger == "software" else options.line))
    if options.trigger == "line":
        wanted.append(Feature("TriggerActivation", options.activation))
    return [*wanted, Feature("TriggerMode", "On")]


def exposure_feature(features: Features, wishes: GenicamWishes) -> str:
    """Return the name of the exposure's feature. Raises SettingRefused when it cannot do the profile's range."""
    found = features.first_of(EXPOSURES)
    if found is None:
        raise SettingRefused(f"{wishes.name} has no exposure time that can be set; is it an industrial camera?")
    range_s = ExposureRange(*(one / MICROSECONDS for one in features.bounds(found)))
    wanted = wishes.exposure_range_s
    if not (range_s.holds(wanted.shortest_s) and range_s.holds(wanted.longest_s)):
        raise SettingRefused(
            f"camera.exposure_range_s {wanted} is outside what {wishes.name} can do, "
            f"{range_s} s; give a range within it"
        )
    return found


def check_control(device: int, name: str) -> None:
    """Raise DeviceLost unless a GigE camera is there and still ours: one that was off and on again is nobody's."""
    privilege = c_uint32()
    try:
        aravis().call("arv_device_read_register", device, _CONTROL_REGISTER, byref(privilege))
    except AravisError as error:
        raise DeviceLost(f"{name} does not answer ({error}); check cable and power") from error
    if not privilege.value & _CONTROLLED:
        raise DeviceLost(
            f"{name} is not controlled by this program any more: it was off, or heartbeats were lost; check cable and "
            "power, then run the same command again"
        )


def set_packets(camera: int, wishes: GenicamWishes) -> int:
    """Set the size of a GigE camera's packets, and return it in bytes. Raises SettingRefused."""
    size = wishes.options.packet_size
    try:
        if size is not None:
            aravis().call("arv_camera_gv_set_packet_size", camera, size)
        else:
            with suppress(AravisError):  # then it stays what it was
                aravis().call("arv_camera_gv_auto_packet_size", camera)
    except AravisError as error:
        raise SettingRefused(f"{wishes.name}: packets of {size} bytes: {error}; leave packet_size out") from error
    return called("arv_camera_gv_get_packet_size", camera, wishes.name)


def transport_advice(device_id: str, packet_bytes: int, counters: StreamCounters) -> tuple[str, ...]:
    """Return what the network lacks, a sentence each, with the setting to change."""
    found, limit = [], socket_buffer_limit()
    if packet_bytes <= _SMALL_PACKET and not is_loopback(device_id):
        found.append(f"packets have {packet_bytes} bytes, larger ones cost less: ip link set DEVICE mtu 9000")
    if limit is not None and limit < SOCKET_BUFFER_BYTES:
        found.append(
            f"sockets may keep {limit} bytes, {SOCKET_BUFFER_BYTES} are wanted: "
            f"sysctl -w net.core.rmem_max={SOCKET_BUFFER_BYTES}"
        )
    if counters.failed or counters.missing_packets:
        found.append(
            f"{counters.failed} of {counters.complete + counters.failed} frames came incomplete, "
            f"{counters.missing_packets} packets were missing, {counters.resent_packets} were sent again: "
            "give it a network card and a cable of its own"
        )
    return tuple(f"camera {device_id}: {line}" for line in found)
