"""The kernel's structures and request numbers, against the numbers of linux/videodev2.h on 64-bit machines."""

import ctypes

import pytest

from rig.devices.v4l2 import abi

SIZES = {
    abi.Capability: 104,
    abi.FormatDescription: 64,
    abi.PixFormat: 48,
    abi.Format: 208,
    abi.FrameSize: 44,
    abi.FrameInterval: 52,
    abi.StreamParameters: 204,
    abi.RequestBuffers: 20,
    abi.Buffer: 88,
    abi.ControlValue: 8,
    abi.ControlQuery: 232,
    abi.MenuQuery: 44,
}
REQUESTS = {
    "QUERYCAP": 0x80685600,
    "ENUM_FMT": 0xC0405602,
    "G_FMT": 0xC0D05604,
    "S_FMT": 0xC0D05605,
    "REQBUFS": 0xC0145608,
    "QUERYBUF": 0xC0585609,
    "QBUF": 0xC058560F,
    "DQBUF": 0xC0585611,
    "STREAMON": 0x40045612,
    "STREAMOFF": 0x40045613,
    "G_PARM": 0xC0CC5615,
    "S_PARM": 0xC0CC5616,
    "G_CTRL": 0xC008561B,
    "S_CTRL": 0xC008561C,
    "QUERYMENU": 0xC02C5625,
    "ENUM_FRAMESIZES": 0xC02C564A,
    "ENUM_FRAMEINTERVALS": 0xC034564B,
    "QUERY_EXT_CTRL": 0xC0E85667,
}
OFFSETS = {"timestamp": 24, "timecode": 40, "sequence": 56, "memory": 60, "m": 64, "length": 72, "request_fd": 80}


@pytest.mark.parametrize(("structure", "size"), SIZES.items(), ids=lambda given: getattr(given, "__name__", ""))
def test_structures_have_the_kernel_s_size(structure: type[ctypes.Structure], size: int) -> None:
    assert ctypes.sizeof(structure) == size


@pytest.mark.parametrize(("name", "number"), REQUESTS.items())
def test_requests_have_the_kernel_s_number(name: str, number: int) -> None:
    assert getattr(abi, name) == number


def test_a_buffer_s_fields_are_where_the_kernel_writes_them() -> None:
    assert {name: getattr(abi.Buffer, name).offset for name in OFFSETS} == OFFSETS
    assert (abi.Format.fmt.offset, abi.FrameSize.size.offset, abi.FrameInterval.interval.offset) == (8, 12, 20)


@pytest.mark.parametrize(
    ("name", "code"), [("GREY", 0x59455247), ("Y10", 0x20303159), ("Y16-BE", 0xA0363159), ("MJPG", 0x47504A4D)]
)
def test_pixel_formats_have_a_name_and_a_code(name: str, code: int) -> None:
    assert abi.fourcc_of(name) == code
    assert abi.name_of(code) == name
