"""The emulated camera's words: descriptors add up, negotiation offers only what exists, controls keep their limits."""

import struct
from collections import Counter

import pytest

from rig.devices.usb.extension_unit import Query
from rig.emulated.usbip.device import Stall
from rig.emulated.uvc.controls import (
    AUTO_EXPOSURE,
    CAMERA_TERMINAL,
    EXTENSION_UNIT,
    MANUAL_EXPOSURE,
    PROCESSING_UNIT,
    ControlBank,
    Info,
    RequestError,
    camera_controls,
    processing_controls,
)
from rig.emulated.uvc.descriptors import (
    PROBE_BYTES,
    Transport,
    camera_descriptors,
    negotiate,
    video_formats,
)
from rig.emulated.uvc.formats import FOURCCS

CONTROLS = (*camera_controls((0.0001, 0.5), 0.01), *processing_controls())
FORMATS = video_formats(FOURCCS, ((640, 480), (320, 240)), (30, 15, 7.5))
EXPOSURE_MODE, EXPOSURE, GAIN, BRIGHTNESS = (1, 2), (1, 4), (2, 4), (2, 2)


def configuration(transport: Transport = Transport.ISOCHRONOUS) -> bytes:
    described = camera_descriptors(FORMATS, CONTROLS, transport, name="a", serial="b", vendor_id=0x1209, product_id=1)
    return described.configuration


def walk(body: bytes) -> list[bytes]:
    """Descriptors one after the other, by the length that each says it has."""
    found = []
    while body:
        assert 2 <= body[0] <= len(body)
        found.append(body[: body[0]])
        body = body[body[0] :]
    return found


def class_descriptors(interface: int) -> list[bytes]:
    """Those of one interface."""
    found, current = [], -1
    for each in walk(configuration()):
        current = each[2] if each[1] == 4 else current
        if each[1] == 0x24 and current == interface:
            found.append(each)
    return found


@pytest.fixture
def bank() -> ControlBank:
    return ControlBank(CONTROLS)


@pytest.mark.parametrize("transport", Transport)
def test_lengths_of_all_descriptors_add_up_to_the_whole(transport: Transport) -> None:
    body = configuration(transport)
    assert struct.unpack_from("<H", body, 2)[0] == len(body) == sum(map(len, walk(body)))


@pytest.mark.parametrize("transport", Transport)
def test_class_headers_count_exactly_their_own_interface(transport: Transport) -> None:
    totals: dict[int, int] = Counter()
    stated = {}
    interface = -1
    for each in walk(configuration(transport)):
        if each[1] == 4:
            interface = each[2]
        if each[1] == 0x24:
            totals[interface] += len(each)
            if each[2] == 1:
                stated[interface] = struct.unpack_from("<H", each, 5 if interface == 0 else 4)[0]
    assert stated == dict(totals)


def test_every_format_lists_its_sizes_and_each_size_its_intervals() -> None:
    formats = [
        each for each in walk(configuration()) if each[1] == 0x24 and each[2] in (4, 6) and len(each) in (27, 11)
    ]
    sizes = [each for each in walk(configuration()) if each[1] == 0x24 and each[2] in (5, 7) and len(each) == 26 + 12]
    assert [each[4] for each in formats] == [2] * len(FORMATS)
    assert len(sizes) == 2 * len(FORMATS)
    for each in sizes:
        assert struct.unpack_from("<3I", each, 26) == (333_333, 666_667, 1_333_333)


def test_units_form_a_chain_from_the_sensor_to_the_stream() -> None:
    units = {each[3]: each for each in class_descriptors(0)[1:]}
    assert units[PROCESSING_UNIT][4] == CAMERA_TERMINAL
    assert units[EXTENSION_UNIT][22] == PROCESSING_UNIT
    assert units[3][7] == EXTENSION_UNIT


def test_maps_of_controls_name_those_that_answer() -> None:
    units = {each[3]: each for each in class_descriptors(0)[1:]}
    camera = int.from_bytes(units[CAMERA_TERMINAL][15:18], "little")
    picture = int.from_bytes(units[PROCESSING_UNIT][8:10], "little")
    assert camera.bit_count() == sum(control.unit == CAMERA_TERMINAL for control in CONTROLS)
    assert picture.bit_count() == sum(control.unit == PROCESSING_UNIT for control in CONTROLS)
    assert camera & 1 << 3
    assert picture & 1 << 9


def test_a_serial_number_that_is_not_there_is_not_promised() -> None:
    described = camera_descriptors(
        FORMATS, CONTROLS, Transport.ISOCHRONOUS, name="a", serial="", vendor_id=1, product_id=2
    )
    assert described.device[16] == 0


def test_an_unknown_format_names_those_that_there_are() -> None:
    with pytest.raises(ValueError, match=r"'H264'.*GREY"):
        video_formats(("H264",))


@pytest.mark.parametrize(
    ("wish", "granted"),
    [
        ((1, 1, 333_333), (1, 1, 333_333)),
        ((2, 2, 700_000), (2, 2, 666_667)),
        ((0, 0, 0), (1, 1, 333_333)),
        ((99, 99, 9_999_999), (len(FORMATS), 2, 1_333_333)),
    ],
)
def test_negotiation_grants_the_nearest_that_exists(wish: tuple[int, ...], granted: tuple[int, ...]) -> None:
    offer = negotiate(FORMATS, Transport.ISOCHRONOUS, struct.pack("<HBBI", 1, *wish))
    assert (offer.format_index, offer.size_index, offer.interval) == granted
    packed = offer.pack()
    assert len(packed) == PROBE_BYTES == 34
    assert struct.unpack_from("<BBI", packed, 2) == granted
    assert negotiate(FORMATS, Transport.ISOCHRONOUS, packed) == offer


def test_a_short_wish_gets_the_default() -> None:
    assert negotiate(FORMATS, Transport.BULK, b"\1") == negotiate(FORMATS, Transport.BULK)


def test_frame_sizes_follow_format_and_size() -> None:
    grey = negotiate(FORMATS, Transport.BULK, struct.pack("<HBBI", 1, 1, 2, 0))
    deep = negotiate(FORMATS, Transport.BULK, struct.pack("<HBBI", 1, 4, 2, 0))
    assert (grey.frame_bytes, deep.frame_bytes) == (320 * 240, 2 * 320 * 240)
    assert grey.payload_bytes == grey.frame_bytes + 2


def number(bank: ControlBank, control: tuple[int, int], request: Query, *, signed: bool = False) -> int:
    return int.from_bytes(bank.request(*control, request, b""), "little", signed=signed)


@pytest.mark.parametrize("control", CONTROLS, ids=lambda control: control.name)
def test_every_control_says_limits_that_hold(control, bank: ControlBank) -> None:
    def ask(request: Query) -> int:
        return number(bank, (control.unit, control.selector), request, signed=control.signed)

    assert ask(Query.GET_LEN) == control.length
    assert control.allows(ask(Query.GET_DEF))
    assert ask(Query.GET_CUR) == ask(Query.GET_DEF)
    if not control.choices:
        assert ask(Query.GET_MIN) <= ask(Query.GET_DEF) <= ask(Query.GET_MAX)
        assert not control.allows(control.minimum - 1)
        assert not control.allows(control.maximum + 1)


def test_a_value_that_was_set_is_read_back(bank: ControlBank) -> None:
    bank.request(*BRIGHTNESS, Query.SET_CUR, (-5).to_bytes(2, "little", signed=True))
    assert number(bank, BRIGHTNESS, Query.GET_CUR, signed=True) == -5
    bank.reset()
    assert number(bank, BRIGHTNESS, Query.GET_CUR) == 0


@pytest.mark.parametrize(
    ("control", "data", "reason"),
    [
        (GAIN, struct.pack("<H", 1601), RequestError.OUT_OF_RANGE),
        (GAIN, b"\1", RequestError.INVALID_VALUE),
        (EXPOSURE_MODE, b"\4", RequestError.INVALID_VALUE),
        (EXPOSURE, struct.pack("<I", 100), RequestError.WRONG_STATE),
        ((2, 0x7F), b"\0", RequestError.INVALID_CONTROL),
        ((9, 1), b"\0", RequestError.INVALID_UNIT),
        ((EXTENSION_UNIT, 2), b"9.99", RequestError.INVALID_REQUEST),
        ((EXTENSION_UNIT, 1), b"short", RequestError.INVALID_VALUE),
        ((EXTENSION_UNIT, 9), b"", RequestError.INVALID_CONTROL),
    ],
)
def test_a_refused_value_changes_nothing_and_the_reason_can_be_asked(
    bank: ControlBank, control: tuple[int, int], data: bytes, reason: RequestError
) -> None:
    before = bank.value("gain"), bank.value("exposure"), bank.value("exposure_mode")
    with pytest.raises(Stall):
        bank.request(*control, Query.SET_CUR, data)
    assert bank.request(0, 2, Query.GET_CUR, b"") == bytes([reason])
    assert before == (bank.value("gain"), bank.value("exposure"), bank.value("exposure_mode"))


def test_an_unknown_request_is_refused(bank: ControlBank) -> None:
    for control in (GAIN, (EXTENSION_UNIT, 1)):
        with pytest.raises(Stall):
            bank.request(*control, 0x44, b"")
        assert bank.last_error == RequestError.INVALID_REQUEST


def test_exposure_obeys_only_in_manual_mode_and_says_so(bank: ControlBank) -> None:
    assert bank.value("exposure_mode") == AUTO_EXPOSURE
    assert number(bank, EXPOSURE, Query.GET_INFO) & Info.DISABLED_BY_AUTOMATIC
    bank.request(*EXPOSURE_MODE, Query.SET_CUR, bytes([MANUAL_EXPOSURE]))
    assert not number(bank, EXPOSURE, Query.GET_INFO) & Info.DISABLED_BY_AUTOMATIC
    bank.request(*EXPOSURE, Query.SET_CUR, struct.pack("<I", 5000))
    assert bank.value("exposure") == 5000


def test_the_vendors_register_keeps_bytes_and_its_firmware_is_read_only(bank: ControlBank) -> None:
    register = (EXTENSION_UNIT, 1)
    length = number(bank, register, Query.GET_LEN)
    bank.request(*register, Query.SET_CUR, bytes(range(length)))
    assert bank.request(*register, Query.GET_CUR, b"") == bytes(range(32))
    assert number(bank, (EXTENSION_UNIT, 2), Query.GET_INFO) == Info.GET
    assert bank.request(EXTENSION_UNIT, 2, Query.GET_CUR, b"") == b"1.04"
