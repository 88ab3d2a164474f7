"""The kernel's display interface (DRM/KMS) as data: structures, request numbers, constants.

Layouts are those of the kernel's public headers `drm.h` and `drm_mode.h`; they are the same on every 64-bit machine.
"""

from __future__ import annotations

import ctypes
from ctypes import c_char, c_uint16, c_uint32, c_uint64


class ClientCapability(ctypes.Structure):
    """What a program says that it can handle."""

    _fields_ = (("capability", c_uint64), ("value", c_uint64))


class Resources(ctypes.Structure):
    """Which controllers, connectors and encoders a card has."""

    _fields_ = (
        *((name, c_uint64) for name in ("framebuffers", "controllers", "connectors", "encoders")),
        *((f"{name}_count", c_uint32) for name in ("framebuffers", "controllers", "connectors", "encoders")),
        *((name, c_uint32) for name in ("width_min", "width_max", "height_min", "height_max")),
    )


class ModeInfo(ctypes.Structure):
    """A video mode's timings."""

    _fields_ = (
        ("clock_khz", c_uint32),
        *((name, c_uint16) for name in ("width", "hsync_start", "hsync_end", "htotal", "hskew")),
        *((name, c_uint16) for name in ("height", "vsync_start", "vsync_end", "vtotal", "vscan")),
        ("refresh_hz", c_uint32),
        ("flags", c_uint32),
        ("type", c_uint32),
        ("name", c_char * 32),
    )


class ControllerInfo(ctypes.Structure):
    """A display controller (CRTC): what it scans out, and in which mode."""

    _fields_ = (
        ("connectors", c_uint64),
        ("connectors_count", c_uint32),
        ("id", c_uint32),
        ("framebuffer", c_uint32),
        ("x", c_uint32),
        ("y", c_uint32),
        ("gamma_size", c_uint32),
        ("mode_valid", c_uint32),
        ("mode", ModeInfo),
    )


class ConnectorInfo(ctypes.Structure):
    """A connector: its kind, whether something is plugged in, and its modes."""

    _fields_ = (
        *((name, c_uint64) for name in ("encoders", "modes", "properties", "values")),
        *((name, c_uint32) for name in ("modes_count", "properties_count", "encoders_count", "encoder")),
        *((name, c_uint32) for name in ("id", "type", "type_number", "connection")),
        *((name, c_uint32) for name in ("width_mm", "height_mm", "subpixel", "padding")),
    )


class EncoderInfo(ctypes.Structure):
    """An encoder: bit i of `possible_controllers` stands for the card's i-th controller."""

    _fields_ = tuple(
        (name, c_uint32) for name in ("id", "type", "controller", "possible_controllers", "possible_clones")
    )


class PlaneResources(ctypes.Structure):
    """Which planes a card has."""

    _fields_ = (("planes", c_uint64), ("planes_count", c_uint32))


class PlaneInfo(ctypes.Structure):
    """A plane: a layer that a controller mixes into its picture."""

    _fields_ = (
        *((name, c_uint32) for name in ("id", "controller", "framebuffer", "possible_controllers", "gamma_size")),
        ("formats_count", c_uint32),
        ("formats", c_uint64),
    )


class ObjectProperties(ctypes.Structure):
    """Ids and values of an object's properties."""

    _fields_ = (
        ("properties", c_uint64),
        ("values", c_uint64),
        ("properties_count", c_uint32),
        ("id", c_uint32),
        ("type", c_uint32),
    )


class PropertyInfo(ctypes.Structure):
    """A property's name and the values that it may have."""

    _fields_ = (
        ("values", c_uint64),
        ("choices", c_uint64),
        ("id", c_uint32),
        ("flags", c_uint32),
        ("name", c_char * 32),
        ("values_count", c_uint32),
        ("choices_count", c_uint32),
    )


class PropertyChoice(ctypes.Structure):
    """One named value of a property."""

    _fields_ = (("value", c_uint64), ("name", c_char * 32))


class NewBlob(ctypes.Structure):
    """Bytes that become a property's value."""

    _fields_ = (("data", c_uint64), ("length", c_uint32), ("id", c_uint32))


class NewBuffer(ctypes.Structure):
    """A plain ("dumb") pixel buffer."""

    _fields_ = (
        *((name, c_uint32) for name in ("height", "width", "bits_per_pixel", "flags", "handle", "pitch")),
        ("size", c_uint64),
    )


class BufferOffset(ctypes.Structure):
    """Where in the card's address space a buffer is mapped from."""

    _fields_ = (("handle", c_uint32), ("padding", c_uint32), ("offset", c_uint64))


class Handle(ctypes.Structure):
    """One number: the handle of a buffer, or the id of a framebuffer or blob."""

    _fields_ = (("value", c_uint32),)


class BufferHandle(ctypes.Structure):
    """A buffer that is let go."""

    _fields_ = (("handle", c_uint32), ("padding", c_uint32))


class Framebuffer(ctypes.Structure):
    """Buffers as a picture: size, pixel format, and how the pixels lie in memory."""

    _fields_ = (
        *((name, c_uint32) for name in ("id", "width", "height", "pixel_format", "flags")),
        *((name, c_uint32 * 4) for name in ("handles", "pitches", "offsets")),
        ("modifiers", c_uint64 * 4),
    )


class AtomicRequest(ctypes.Structure):
    """Properties of several objects, changed together or not at all."""

    _fields_ = (
        ("flags", c_uint32),
        ("objects_count", c_uint32),
        *((name, c_uint64) for name in ("objects", "property_counts", "properties", "values", "reserved", "user_data")),
    )


class FlipEvent(ctypes.Structure):
    """What the kernel says when a picture came on screen."""

    _fields_ = (
        ("type", c_uint32),
        ("length", c_uint32),
        ("user_data", c_uint64),
        *((name, c_uint32) for name in ("seconds", "microseconds", "sequence", "controller")),
    )


_WRITE, _READ_AND_WRITE = 1, 3


def _request(number: int, structure: type[ctypes.Structure] | None, direction: int = _READ_AND_WRITE) -> int:
    """A request number: direction, size of the structure, the letter of this interface, number."""
    if structure is None:
        return ord("d") << 8 | number
    return direction << 30 | ctypes.sizeof(structure) << 16 | ord("d") << 8 | number


CLOSE_BUFFER = _request(0x09, BufferHandle, _WRITE)
SET_CLIENT_CAPABILITY = _request(0x0D, ClientCapability, _WRITE)
SET_MASTER = _request(0x1E, None)
DROP_MASTER = _request(0x1F, None)
GET_RESOURCES = _request(0xA0, Resources)
GET_CONTROLLER = _request(0xA1, ControllerInfo)
GET_ENCODER = _request(0xA6, EncoderInfo)
GET_CONNECTOR = _request(0xA7, ConnectorInfo)
GET_PROPERTY = _request(0xAA, PropertyInfo)
REMOVE_FRAMEBUFFER = _request(0xAF, Handle)
CREATE_BUFFER = _request(0xB2, NewBuffer)
MAP_BUFFER = _request(0xB3, BufferOffset)
DESTROY_BUFFER = _request(0xB4, Handle)
GET_PLANES = _request(0xB5, PlaneResources)
GET_PLANE = _request(0xB6, PlaneInfo)
ADD_FRAMEBUFFER = _request(0xB8, Framebuffer)
GET_OBJECT_PROPERTIES = _request(0xB9, ObjectProperties)
ATOMIC = _request(0xBC, AtomicRequest)
CREATE_BLOB = _request(0xBD, NewBlob)
GET_FRAMEBUFFER = _request(0xCE, Framebuffer)

UNIVERSAL_PLANES, ATOMIC_CLIENT, CURSOR_HOTSPOT = 2, 3, 6
"""Client capabilities: see all planes; change properties together; see cursors of virtual displays too."""

PRIMARY_PLANE = 1
INTERLACED, DOUBLE_SCAN = 1 << 4, 1 << 5
"""Flags of a mode."""
PREFERRED = 1 << 3
"""Bit of a mode's type."""
WITH_EVENT, TEST_ONLY, NONBLOCKING, ALLOW_MODESET = 0x1, 0x100, 0x200, 0x400
"""Flags of an atomic request."""
FLIP_COMPLETE = 2
"""Type of an event."""

XRGB8888 = int.from_bytes(b"XR24", "little")
ARGB8888 = int.from_bytes(b"AR24", "little")
XBGR8888 = int.from_bytes(b"XB24", "little")
ABGR8888 = int.from_bytes(b"AB24", "little")
HAS_MODIFIERS = 1 << 1
"""Flag of a framebuffer."""
LINEAR = 0
"""Modifier: rows of pixels one after the other."""

CONNECTOR_TYPES = (
    *("Unknown", "VGA", "DVI-I", "DVI-D", "DVI-A", "Composite", "SVIDEO", "LVDS", "Component", "DIN", "DP"),
    *("HDMI-A", "HDMI-B", "TV", "eDP", "Virtual", "DSI", "DPI", "Writeback", "SPI", "USB"),
)
"""The kernel's names of connector types, by number."""
