"""The kernel's V4L2 interface as ctypes: structures and request numbers of 64-bit Linux, no behaviour.

Names and order are those of ``linux/videodev2.h``; sizes are checked by tests, since a request number holds the size.
"""

from __future__ import annotations

import ctypes
from ctypes import c_char, c_int32, c_int64, c_long, c_uint8, c_uint32, c_uint64, c_ulong

READ, WRITE = 2, 1


class Fraction(ctypes.Structure):
    """v4l2_fract."""

    _fields_ = (("numerator", c_uint32), ("denominator", c_uint32))


class Capability(ctypes.Structure):
    """v4l2_capability."""

    _fields_ = (
        ("driver", c_char * 16),
        ("card", c_char * 32),
        ("bus_info", c_char * 32),
        ("version", c_uint32),
        ("capabilities", c_uint32),
        ("device_caps", c_uint32),
        ("reserved", c_uint32 * 3),
    )


class FormatDescription(ctypes.Structure):
    """v4l2_fmtdesc."""

    _fields_ = (
        ("index", c_uint32),
        ("type", c_uint32),
        ("flags", c_uint32),
        ("description", c_char * 32),
        ("pixelformat", c_uint32),
        ("mbus_code", c_uint32),
        ("reserved", c_uint32 * 3),
    )


class PixFormat(ctypes.Structure):
    """v4l2_pix_format."""

    _fields_ = (
        ("width", c_uint32),
        ("height", c_uint32),
        ("pixelformat", c_uint32),
        ("field", c_uint32),
        ("bytesperline", c_uint32),
        ("sizeimage", c_uint32),
        ("colorspace", c_uint32),
        ("priv", c_uint32),
        ("flags", c_uint32),
        ("ycbcr_enc", c_uint32),
        ("quantization", c_uint32),
        ("xfer_func", c_uint32),
    )


class _FormatUnion(ctypes.Union):
    _fields_ = (("pix", PixFormat), ("raw_data", c_uint8 * 200), ("aligned", c_uint64))


class Format(ctypes.Structure):
    """v4l2_format."""

    _fields_ = (("type", c_uint32), ("fmt", _FormatUnion))


class _Discrete(ctypes.Structure):
    _fields_ = (("width", c_uint32), ("height", c_uint32))


class Stepwise(ctypes.Structure):
    """v4l2_frmsize_stepwise."""

    _fields_ = (
        ("min_width", c_uint32),
        ("max_width", c_uint32),
        ("step_width", c_uint32),
        ("min_height", c_uint32),
        ("max_height", c_uint32),
        ("step_height", c_uint32),
    )


class _SizeUnion(ctypes.Union):
    _fields_ = (("discrete", _Discrete), ("stepwise", Stepwise))


class FrameSize(ctypes.Structure):
    """v4l2_frmsizeenum."""

    _fields_ = (
        ("index", c_uint32),
        ("pixel_format", c_uint32),
        ("type", c_uint32),
        ("size", _SizeUnion),
        ("reserved", c_uint32 * 2),
    )


class _IntervalStepwise(ctypes.Structure):
    _fields_ = (("min", Fraction), ("max", Fraction), ("step", Fraction))


class _IntervalUnion(ctypes.Union):
    _fields_ = (("discrete", Fraction), ("stepwise", _IntervalStepwise))


class FrameInterval(ctypes.Structure):
    """v4l2_frmivalenum."""

    _fields_ = (
        ("index", c_uint32),
        ("pixel_format", c_uint32),
        ("width", c_uint32),
        ("height", c_uint32),
        ("type", c_uint32),
        ("interval", _IntervalUnion),
        ("reserved", c_uint32 * 2),
    )


class StreamParameters(ctypes.Structure):
    """v4l2_streamparm with a v4l2_captureparm."""

    _fields_ = (
        ("type", c_uint32),
        ("capability", c_uint32),
        ("capturemode", c_uint32),
        ("timeperframe", Fraction),
        ("extendedmode", c_uint32),
        ("readbuffers", c_uint32),
        ("reserved", c_uint8 * 176),
    )


class RequestBuffers(ctypes.Structure):
    """v4l2_requestbuffers."""

    _fields_ = (
        ("count", c_uint32),
        ("type", c_uint32),
        ("memory", c_uint32),
        ("capabilities", c_uint32),
        ("flags", c_uint8),
        ("reserved", c_uint8 * 3),
    )


class _Timeval(ctypes.Structure):
    _fields_ = (("seconds", c_long), ("microseconds", c_long))


class _BufferPlace(ctypes.Union):
    _fields_ = (("offset", c_uint32), ("userptr", c_ulong), ("fd", c_int32))


class Buffer(ctypes.Structure):
    """v4l2_buffer."""

    _fields_ = (
        ("index", c_uint32),
        ("type", c_uint32),
        ("bytesused", c_uint32),
        ("flags", c_uint32),
        ("field", c_uint32),
        ("timestamp", _Timeval),
        ("timecode", c_uint8 * 16),
        ("sequence", c_uint32),
        ("memory", c_uint32),
        ("m", _BufferPlace),
        ("length", c_uint32),
        ("reserved2", c_uint32),
        ("request_fd", c_int32),
    )


class Integer(ctypes.Structure):
    """The plain int of STREAMON, STREAMOFF and S_INPUT."""

    _fields_ = (("value", c_int32),)


class ControlValue(ctypes.Structure):
    """v4l2_control."""

    _fields_ = (("id", c_uint32), ("value", c_int32))


class ControlQuery(ctypes.Structure):
    """v4l2_query_ext_ctrl."""

    _fields_ = (
        ("id", c_uint32),
        ("type", c_uint32),
        ("name", c_char * 32),
        ("minimum", c_int64),
        ("maximum", c_int64),
        ("step", c_uint64),
        ("default_value", c_int64),
        ("flags", c_uint32),
        ("elem_size", c_uint32),
        ("elems", c_uint32),
        ("nr_of_dims", c_uint32),
        ("dims", c_uint32 * 4),
        ("reserved", c_uint32 * 32),
    )


class _MenuUnion(ctypes.Union):
    _pack_ = 1
    _fields_ = (("name", c_char * 32), ("value", c_int64))


class MenuQuery(ctypes.Structure):
    """v4l2_querymenu, which is packed."""

    _pack_ = 1
    _fields_ = (("id", c_uint32), ("index", c_uint32), ("item", _MenuUnion), ("reserved", c_uint32))


def request(direction: int, number: int, structure: type[ctypes.Structure]) -> int:
    """The ioctl request number of a V4L2 command."""
    return direction << 30 | ctypes.sizeof(structure) << 16 | ord("V") << 8 | number


QUERYCAP = request(READ, 0, Capability)
ENUM_FMT = request(READ | WRITE, 2, FormatDescription)
G_FMT = request(READ | WRITE, 4, Format)
S_FMT = request(READ | WRITE, 5, Format)
REQBUFS = request(READ | WRITE, 8, RequestBuffers)
QUERYBUF = request(READ | WRITE, 9, Buffer)
QBUF = request(READ | WRITE, 15, Buffer)
DQBUF = request(READ | WRITE, 17, Buffer)
STREAMON = request(WRITE, 18, Integer)
STREAMOFF = request(WRITE, 19, Integer)
G_PARM = request(READ | WRITE, 21, StreamParameters)
S_PARM = request(READ | WRITE, 22, StreamParameters)
G_CTRL = request(READ | WRITE, 27, ControlValue)
S_CTRL = request(READ | WRITE, 28, ControlValue)
QUERYMENU = request(READ | WRITE, 37, MenuQuery)
S_INPUT = request(READ | WRITE, 39, Integer)
ENUM_FRAMESIZES = request(READ | WRITE, 74, FrameSize)
ENUM_FRAMEINTERVALS = request(READ | WRITE, 75, FrameInterval)
QUERY_EXT_CTRL = request(READ | WRITE, 103, ControlQuery)

VIDEO_CAPTURE = 1
"""Buffer type, and the bit of the same name in ``device_caps``."""
MEMORY_MMAP = 1
FIELD_ANY, FIELD_NONE = 0, 1
DISCRETE = 1
"""Type of frame sizes and intervals that are listed one by one."""
CAP_STREAMING = 0x04000000
CAP_TIMEPERFRAME = 0x1000

BUFFER_ERROR = 0x40
TIMESTAMP_MASK, TIMESTAMP_MONOTONIC = 0xE000, 0x2000
TIMESTAMP_SOURCE_MASK, TIMESTAMP_START_OF_EXPOSURE = 0x70000, 0x10000

NEXT_CONTROL = 0x80000000
CONTROL_FLAGS = {
    0x01: "disabled",
    0x02: "grabbed",
    0x04: "read-only",
    0x08: "update",
    0x10: "inactive",
    0x20: "slider",
    0x40: "write-only",
    0x80: "volatile",
    0x100: "has-payload",
    0x200: "execute-on-write",
}
CONTROL_KINDS = {
    1: "integer",
    2: "boolean",
    3: "menu",
    4: "button",
    5: "integer64",
    6: "class",
    7: "string",
    8: "bitmask",
    9: "integer menu",
}

COLORSPACE_REC709, COLORSPACE_BT2020, COLORSPACE_JPEG = 3, 10, 7
YCBCR_DEFAULT, YCBCR_601, YCBCR_709, YCBCR_BT2020 = 0, 1, 2, 6
QUANTIZATION_DEFAULT, QUANTIZATION_FULL, QUANTIZATION_LIMITED = 0, 1, 2


def fourcc_of(name: str) -> int:
    """The code of a pixel format's name: up to four characters, ``-BE`` behind them for big-endian."""
    characters = name.removesuffix("-BE").ljust(4).encode("ascii")
    return int.from_bytes(characters, "little") | (0x80000000 if name.endswith("-BE") else 0)


def name_of(fourcc: int) -> str:
    """The name of a pixel format's code, without trailing spaces."""
    characters = (fourcc & 0x7FFFFFFF).to_bytes(4, "little").decode("ascii", "replace").rstrip()
    return characters + ("-BE" if fourcc & 0x80000000 else "")
