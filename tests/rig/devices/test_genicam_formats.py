"""Pixel formats of GenICam, against bytes that were written by hand from the conventions' drawings."""

import numpy as np
import pytest

from rig.devices.genicam.clock_map import ClockMap, TriggerAnswers
from rig.devices.genicam.formats import PIXEL_FORMATS, pixel_format
from rig.emulated.gige.camera import encoded
from rig.errors import SettingRefused

BYTES = {
    "Mono8": ([0x12, 0xFF], [0x12, 0xFF]),
    "Mono12": ([0x34, 0x02, 0xFF, 0x0F], [0x234, 0xFFF]),
    "Mono16": ([0x34, 0x12, 0xFE, 0xFF], [0x1234, 0xFFFE]),
    "Mono12Packed": ([0xAB, 0x5C, 0x34], [0xABC, 0x345]),
    "Mono12p": ([0xBC, 0x5A, 0x34], [0xABC, 0x345]),
    "Mono10Packed": ([0xFF, 0x21, 0x01], [0x3FD, 0x006]),
    "Mono10p": ([0x01, 0x08, 0x30, 0x00, 0x01], [0x001, 0x002, 0x003, 0x004]),
    "RGB8": ([1, 2, 3], [1, 2, 3]),
    "BGR8": ([1, 2, 3], [3, 2, 1]),
}


@pytest.mark.parametrize("name", BYTES)
def test_bytes_mean_what_the_conventions_say(name: str) -> None:
    data, numbers = BYTES[name]
    known = PIXEL_FORMATS[name]
    pixels = known.decode(np.array(data, np.uint8), (1, len(numbers) // known.numbers))
    assert pixels.ravel().tolist() == numbers
    assert known.least_bytes(len(numbers) // known.numbers, 1) == len(data)


@pytest.mark.parametrize("name", [name for name in PIXEL_FORMATS if name != "BGR8"])
@pytest.mark.parametrize("shape", [(3, 5), (4, 8)])
def test_every_format_comes_back_from_the_emulated_cameras_bits(name: str, shape: tuple[int, int]) -> None:
    known = PIXEL_FORMATS[name]
    numbers = np.random.default_rng(5).integers(0, 2**known.depth, (*shape, known.numbers)).astype(np.uint16)
    data = np.frombuffer(encoded(numbers, name), np.uint8)
    np.testing.assert_array_equal(known.decode(data, shape), numbers)


def test_colour_filters_are_those_of_the_name() -> None:
    assert {one.mosaic for name, one in PIXEL_FORMATS.items() if name.startswith("BayerRG")} == {"RGGB"}
    assert {one.mosaic for name, one in PIXEL_FORMATS.items() if name.startswith("Mono")} == {None}


@pytest.mark.parametrize(
    ("name", "numbers", "bit_depth", "message"),
    [("Mono9", 1, 9, "not understood"), ("Mono12", 3, 12, "channels"), ("Mono12", 1, 10, "bit depth of 12")],
)
def test_what_a_format_cannot_be_is_refused(name: str, numbers: int, bit_depth: int, message: str) -> None:
    with pytest.raises(SettingRefused, match=message):
        pixel_format(name, numbers=numbers, bit_depth=bit_depth)


def test_the_quickest_frames_tie_the_two_clocks() -> None:
    found, rng = ClockMap(), np.random.default_rng(2)
    for device_s in np.arange(0, 5, 0.03):
        found.add(device_s, 1000.0 + device_s + 0.004 + rng.exponential(0.002))
    assert abs(found.host_s(2.0) - 1002.004) < 2e-4
    with pytest.raises(ValueError, match="before its first frame"):
        ClockMap().host_s(0.0)


@pytest.mark.parametrize("stamped_at_end", [False, True])
def test_a_frame_that_was_begun_before_its_trigger_is_told_by_its_stamp(stamped_at_end: bool) -> None:
    answers, rng = TriggerAnswers(), np.random.default_rng(7)

    def stamp(began_s: float, exposure_s: float, late_s: float | None = None) -> float:
        late_s = rng.uniform(0.001, 0.01) if late_s is None else late_s
        return 1e6 + began_s * (1 + 5e-5) + late_s + exposure_s * stamped_at_end

    assert answers.early_s(stamp(0.0, 0.1), 5.0, 0.1) == 0.0  # nothing is known yet
    for began_s, exposure_s in [
        (1.0, 0.1),
        (1.3, 0.1),
        (400.0, 0.8),
        (402.0, 0.1),
        (500.0, 0.1),
        (502.0, 0.8),
        (503.0, 0.8),
    ]:
        answers.add(stamp(began_s, exposure_s), began_s, exposure_s)
    assert answers.early_s(stamp(503.0, 0.1, 0.0), 504.2, 0.1) == pytest.approx(1.2, abs=0.15)
    assert 0.01 < answers.early_s(stamp(504.0, 0.8, 0.0), 504.02, 0.8) < 0.04
    assert answers.early_s(stamp(504.2, 0.1, 0.03), 504.2, 0.1) == 0.0
    assert answers.early_s(stamp(504.2, 0.2, 0.03), 504.2, 0.2) == 0.0  # of an exposure that was never seen
    answers.forget()
    assert not answers.is_known


def test_a_camera_whose_stamps_stand_still_is_believed() -> None:
    answers = TriggerAnswers()
    for began_s in (1.0, 5.0, 9.0):
        assert answers.early_s(0.0, began_s, 0.01) == 0.0
        answers.add(0.0, began_s, 0.01)
