"""The kernel's display interface: sizes and request numbers as its headers give them."""

import ctypes

import pytest

from rig.devices.kms import abi

SIZES = {
    abi.ClientCapability: 16,
    abi.Resources: 64,
    abi.ModeInfo: 68,
    abi.ControllerInfo: 104,
    abi.ConnectorInfo: 80,
    abi.EncoderInfo: 20,
    abi.PlaneResources: 16,
    abi.PlaneInfo: 32,
    abi.ObjectProperties: 32,
    abi.PropertyInfo: 64,
    abi.PropertyChoice: 40,
    abi.NewBlob: 16,
    abi.NewBuffer: 32,
    abi.BufferOffset: 16,
    abi.Handle: 4,
    abi.BufferHandle: 8,
    abi.Framebuffer: 104,
    abi.AtomicRequest: 56,
    abi.FlipEvent: 32,
}
REQUESTS = {
    "CLOSE_BUFFER": 0x40086409,
    "SET_CLIENT_CAPABILITY": 0x4010640D,
    "SET_MASTER": 0x641E,
    "DROP_MASTER": 0x641F,
    "GET_RESOURCES": 0xC04064A0,
    "GET_CONTROLLER": 0xC06864A1,
    "GET_ENCODER": 0xC01464A6,
    "GET_CONNECTOR": 0xC05064A7,
    "GET_PROPERTY": 0xC04064AA,
    "REMOVE_FRAMEBUFFER": 0xC00464AF,
    "CREATE_BUFFER": 0xC02064B2,
    "MAP_BUFFER": 0xC01064B3,
    "DESTROY_BUFFER": 0xC00464B4,
    "GET_PLANES": 0xC01064B5,
    "GET_PLANE": 0xC02064B6,
    "ADD_FRAMEBUFFER": 0xC06864B8,
    "GET_OBJECT_PROPERTIES": 0xC02064B9,
    "ATOMIC": 0xC03864BC,
    "CREATE_BLOB": 0xC01064BD,
    "GET_FRAMEBUFFER": 0xC06864CE,
}
OFFSETS = [
    (abi.ModeInfo, "name", 36),
    (abi.ControllerInfo, "mode", 36),
    (abi.ConnectorInfo, "id", 48),
    (abi.ConnectorInfo, "connection", 60),
    (abi.PlaneInfo, "formats", 24),
    (abi.Framebuffer, "handles", 20),
    (abi.Framebuffer, "modifiers", 72),
    (abi.AtomicRequest, "user_data", 48),
    (abi.FlipEvent, "seconds", 16),
    (abi.FlipEvent, "sequence", 24),
    (abi.NewBuffer, "handle", 16),
]


@pytest.mark.parametrize("structure", SIZES, ids=lambda structure: structure.__name__)
def test_a_structure_is_as_long_as_the_kernels(structure: type[ctypes.Structure]) -> None:
    assert ctypes.sizeof(structure) == SIZES[structure]


@pytest.mark.parametrize(("structure", "field", "offset"), OFFSETS)
def test_a_field_lies_where_the_kernel_looks_for_it(structure: type[ctypes.Structure], field: str, offset: int) -> None:
    assert getattr(structure, field).offset == offset


@pytest.mark.parametrize("name", REQUESTS)
def test_a_request_has_the_kernels_number(name: str) -> None:
    assert getattr(abi, name) == REQUESTS[name]


def test_connectors_have_the_kernels_names() -> None:
    named = dict(enumerate(abi.CONNECTOR_TYPES))
    assert {number: named[number] for number in (1, 10, 11, 14, 15, 18, 20)} == {
        **{1: "VGA", 10: "DP", 11: "HDMI-A", 14: "eDP", 15: "Virtual"},
        **{18: "Writeback", 20: "USB"},
    }
