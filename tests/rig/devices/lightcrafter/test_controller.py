"""The LightCrafter's controller does what the rig asks, or the rig says what it did not do."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.devices.clock import VirtualClock
from rig.devices.lightcrafter import protocol
from rig.devices.lightcrafter.controller import LightCrafter
from rig.devices.lightcrafter.protocol import Command, DisplayMode, EntryTrigger, Run, StoredPattern
from rig.errors import DeviceError, DeviceLost, SettingRefused
from tests.rig.devices.lightcrafter.emulated_controller import InProcessTransport, LightCrafterEmulation

FACTORY = (104, 135, 130)


@pytest.fixture
def transport() -> InProcessTransport:
    return InProcessTransport(LightCrafterEmulation(), VirtualClock())


@pytest.fixture
def device(transport: InProcessTransport) -> LightCrafterEmulation:
    return transport.device


@pytest.fixture
def lightcrafter(transport: InProcessTransport) -> LightCrafter:
    return LightCrafter(transport, transport.clock)


def grey_patterns(count: int = 2, bit_depth: int = 8) -> list[StoredPattern]:
    first = EntryTrigger.EXTERNAL_POSITIVE
    return [
        StoredPattern(number=number, bit_depth=bit_depth, trigger=first if number == 0 else EntryTrigger.CONTINUE)
        for number in range(count)
    ]


def test_packets_have_the_layout_of_the_guide() -> None:
    (report,) = protocol.request(Command.GAMMA, b"\0", sequence=1, reading=False)
    assert report == bytes.fromhex("40 01 03 00 0e 1a 00") + bytes(57)
    (question,) = protocol.request(Command.MAIN_STATUS, sequence=7, reading=True)
    assert question == bytes.fromhex("c0 07 02 00 0c 1a") + bytes(58)


def test_long_commands_go_over_several_reports_with_one_head() -> None:
    data = bytes(range(1, 121))
    reports = protocol.request(Command.LUT_DATA, data, sequence=3, reading=False)
    assert [len(report) for report in reports] == [64, 64]
    assert b"".join(reports) == bytes.fromhex("40 03 7a 00 34 1a") + data + bytes(2)


def test_pattern_entries_have_the_bits_of_the_guide() -> None:
    entry = StoredPattern(
        number=2, bit_depth=8, leds=7, trigger=EntryTrigger.CONTINUE, insert_black=True, buffer_swap=True
    )
    assert entry.packed() == bytes([0b000010_11, 0b0111_1000, 0b0110])


def test_version_and_status_are_read(lightcrafter: LightCrafter) -> None:
    assert str(lightcrafter.version()) == "4.0.0"
    status = lightcrafter.main_status()
    assert (status.parked, status.sequencer_running, status.frozen, status.gamma_on) == (False, True, False, True)
    lightcrafter.check_hardware()


def test_a_fault_that_the_hardware_reports_is_named(lightcrafter: LightCrafter, device: LightCrafterEmulation) -> None:
    device.faults.hardware_status = 0x80
    with pytest.raises(DeviceError, match="initialisation failed, sequencer error"):
        lightcrafter.check_hardware()


def test_video_mode_is_made_linear_with_chosen_currents(
    lightcrafter: LightCrafter, device: LightCrafterEmulation
) -> None:
    device.registers.mode, device.registers.running, device.registers.led_enable = 1, 2, 0x07
    lightcrafter.prepare_video((100, 90, 80))
    registers = device.registers
    assert (registers.mode, registers.running, registers.gamma, registers.led_enable) == (0, 0, 0, 8)
    assert registers.led_currents == bytes([155, 165, 175])
    assert lightcrafter.led_currents() == (100, 90, 80)


def test_standby_is_left_and_entered(lightcrafter: LightCrafter, device: LightCrafterEmulation) -> None:
    lightcrafter.standby()
    assert device.registers.power == 1
    assert lightcrafter.main_status().parked
    lightcrafter.wake()
    assert device.registers.power == 0


def test_a_sequence_from_streamed_video_is_set_up_checked_and_started(
    lightcrafter: LightCrafter, device: LightCrafterEmulation
) -> None:
    doubts = lightcrafter.set_up_patterns(grey_patterns(), exposure_us=8333, frame_period_us=8333, refresh_rate_hz=60.0)
    lightcrafter.run(Run.START)
    registers = device.registers
    assert doubts == ()
    assert (registers.mode, registers.running, registers.trigger, registers.pattern_source) == (1, 2, 0, 0)
    assert registers.table[:6] == bytes([0x01, 0x78, 0, 0x07, 0x78, 0])
    lightcrafter.run(Run.PAUSE)
    assert registers.running == 1
    lightcrafter.set_display_mode(DisplayMode.VIDEO)
    assert (registers.mode, registers.running) == (0, 0)


def test_a_long_look_up_table_is_written_and_read_back_whole(
    lightcrafter: LightCrafter, device: LightCrafterEmulation
) -> None:
    patterns = grey_patterns(24, bit_depth=1)
    lightcrafter.set_up_patterns(patterns, exposure_us=400, frame_period_us=690, refresh_rate_hz=60.0)
    assert device.registers.table[: 3 * 24] == b"".join(pattern.packed() for pattern in patterns)
    assert device.registers.mailbox == 0


@pytest.mark.parametrize(
    ("patterns", "exposure_us", "period_us", "complaint"),
    [
        (grey_patterns(1), 8000, 8000, "exposure 8000 µs, at this bit depth at least 8333"),
        (grey_patterns(1), 8400, 8500, "make them equal, or leave 230"),
        (grey_patterns(1), 9000, 8500, "make them equal"),
        (grey_patterns(3), 8333, 8333, "last 24999 µs, a video frame at 60 Hz only 16667"),
        ([], 8333, 8333, "0 patterns"),
        ([StoredPattern(number=3, bit_depth=8)], 8333, 8333, "patterns are 0 … 2"),
        ([StoredPattern(number=0, bit_depth=5)], 8333, 8333, "one of 1, 2, 4, 7, 8"),
        ([StoredPattern(number=0, bit_depth=8, leds=8)], 8333, 8333, "LEDs 0 … 7"),
    ],
)
def test_a_sequence_that_cannot_be_shown_is_refused_before_anything_is_sent(
    lightcrafter: LightCrafter,
    device: LightCrafterEmulation,
    patterns: list[StoredPattern],
    exposure_us: int,
    period_us: int,
    complaint: str,
) -> None:
    with pytest.raises(SettingRefused, match=complaint):
        lightcrafter.set_up_patterns(patterns, exposure_us=exposure_us, frame_period_us=period_us, refresh_rate_hz=60.0)
    assert device.history == []


def test_a_sequence_that_the_controller_finds_invalid_is_refused(
    lightcrafter: LightCrafter, device: LightCrafterEmulation
) -> None:
    lightcrafter.set_up_patterns(grey_patterns(), exposure_us=8333, frame_period_us=8333, refresh_rate_hz=60.0)
    device.registers.times = bytes([0, 1, 0, 0, 0, 1, 0, 0])
    with pytest.raises(SettingRefused, match="invalid: exposure or frame period"):
        lightcrafter.validate()


@pytest.mark.parametrize(
    ("currents", "complaint"),
    [
        ((191, 10, 10), "red LED current 191 is outside 0 … 190"),
        ((10, -1, 10), "green LED current -1"),
        ((10, 10, 256), "blue LED current 256"),
        ((190, 190, 190), "draw about 4.82 A, the limit is 4.3 A"),
    ],
)
def test_currents_that_can_harm_the_board_are_refused_before_anything_is_sent(
    lightcrafter: LightCrafter, device: LightCrafterEmulation, currents: tuple[int, int, int], complaint: str
) -> None:
    with pytest.raises(SettingRefused, match=complaint):
        lightcrafter.set_led_currents(currents)
    assert device.history == []


def test_currents_are_refused_where_the_polarity_was_changed(
    lightcrafter: LightCrafter, device: LightCrafterEmulation
) -> None:
    device.registers.led_polarity = 1
    with pytest.raises(SettingRefused, match="polarity"):
        lightcrafter.set_led_currents(FACTORY)
    assert device.history == []


def test_trigger_outputs_are_moved_in_steps_of_107_ns(
    lightcrafter: LightCrafter, device: LightCrafterEmulation
) -> None:
    lightcrafter.set_trigger_out_1(-20.05e-6, 2.787e-6)
    lightcrafter.set_trigger_out_2(0.0)
    assert device.registers.trigger_out_1 == bytes([0, 0x00, 0xD5])
    assert device.registers.trigger_out_2 == bytes([0, 0xBB])
    with pytest.raises(SettingRefused, match=r"trigger delay 3\.000 µs"):
        lightcrafter.set_trigger_out_1(3e-6)


def test_a_refused_command_is_named(lightcrafter: LightCrafter, device: LightCrafterEmulation) -> None:
    device.faults.refused.add(Command.GAMMA)
    with pytest.raises(SettingRefused, match="refuses the value 00 for GAMMA"):
        lightcrafter.gamma_off()


def test_a_setting_that_does_not_take_is_found_by_reading_back(
    lightcrafter: LightCrafter, device: LightCrafterEmulation
) -> None:
    device.faults.ignored.add(Command.LED_CURRENTS)
    with pytest.raises(SettingRefused, match=r"LED_CURRENTS was set to .*, but reads 97 78 7d"):
        lightcrafter.set_led_currents((50, 50, 50))


def test_a_mode_that_is_never_reached_ends_in_time(
    lightcrafter: LightCrafter, device: LightCrafterEmulation, transport: InProcessTransport
) -> None:
    device.faults.ignored.add(Command.DISPLAY_MODE)
    with pytest.raises(SettingRefused, match="display mode PATTERN not reached within 5 s"):
        lightcrafter.set_display_mode(DisplayMode.PATTERN)
    assert transport.clock.now_s() < 10.0


def test_silence_ends_in_time(
    lightcrafter: LightCrafter, device: LightCrafterEmulation, transport: InProcessTransport
) -> None:
    device.faults.silent = True
    with pytest.raises(DeviceLost, match="no answer to MAIN_STATUS within 1 s"):
        lightcrafter.main_status()
    assert transport.clock.now_s() == pytest.approx(1.0)


def test_an_answer_that_comes_too_late_is_not_taken_for_the_next_one(
    lightcrafter: LightCrafter, device: LightCrafterEmulation, transport: InProcessTransport
) -> None:
    late = b"\xc0\x01\x10\x00" + bytes(60)
    write = transport.write_report

    def write_after_a_late_answer(report: bytes) -> None:
        device._answers.append(late)
        write(report)

    lightcrafter.version()
    transport.write_report = write_after_a_late_answer  # type: ignore[method-assign]
    assert str(lightcrafter.version()) == "4.0.0"


@pytest.mark.parametrize("fault", ["babble", "short_answers"])
def test_wrong_answers_are_named(lightcrafter: LightCrafter, device: LightCrafterEmulation, fault: str) -> None:
    setattr(device.faults, fault, True)
    with pytest.raises(DeviceError, match=r"without being asked|answered with 0 bytes, expected 16"):
        lightcrafter.version()


def test_an_answer_without_a_head_is_named() -> None:
    with pytest.raises(DeviceError, match="an answer of 2 bytes"):
        protocol.parse_reply(b"\x40\x01")


@given(st.binary(max_size=80))
def test_any_bytes_are_an_answer_or_a_named_error(report: bytes) -> None:
    try:
        reply = protocol.parse_reply(report)
    except DeviceError:
        return
    assert reply.length <= 512
    assert len(reply.data) <= reply.length


@given(st.lists(st.binary(min_size=64, max_size=64), max_size=12))
def test_the_emulation_survives_any_reports(reports: list[bytes]) -> None:
    device = LightCrafterEmulation()
    for report in reports:
        device.receive(report)
    while (answer := device.next_report()) is not None:
        assert len(answer) == 64


def test_a_controller_that_went_away_is_lost(lightcrafter: LightCrafter, transport: InProcessTransport) -> None:
    transport.unplugged = True
    with pytest.raises(DeviceLost):
        lightcrafter.led_currents()
