"""What a projector output is set to, without a card: modes, properties, pixels, lateness."""

import numpy as np
import pytest

from rig.devices.kms.buffers import write_codes
from rig.devices.kms.card import Change, Mode, Property
from rig.devices.kms.flips import Flip, FlipLog
from rig.devices.kms.settings import Path, choose_mode, earlier_values, neutral_changes
from rig.errors import SettingRefused

MODES = tuple(
    Mode(width_px=w, height_px=h, refresh_rate_hz=hz, preferred=False, timings=b"")
    for w, h, hz in [(640, 480, 59.94), (640, 480, 60.3), (640, 480, 75), (800, 600, 60)]
)


def path(connector: dict[str, Property], controller: dict[str, Property], plane: dict[str, Property]) -> Path:
    return Path(
        connector=1,
        controller=2,
        plane=3,
        other_planes=(),
        connector_properties=connector,
        controller_properties=controller,
        plane_properties=plane,
    )


class TestMode:
    @pytest.mark.parametrize(("asked_hz", "taken_hz"), [(60.0, 59.94), (60.2, 60.3), (75.4, 75), (59.5, 59.94)])
    def test_the_nearest_rate_within_half_a_hertz_is_taken(self, asked_hz: float, taken_hz: float) -> None:
        assert choose_mode(MODES, (480, 640), asked_hz, "DP-1").refresh_rate_hz == taken_hz

    @pytest.mark.parametrize(
        ("shape", "asked_hz"), [((480, 640), 85), ((480, 640), 59.4), ((640, 480), 60), ((1, 1), 60)]
    )
    def test_another_mode_is_refused_and_all_are_listed(self, shape: tuple[int, int], asked_hz: float) -> None:
        with pytest.raises(SettingRefused, match=r"DP-1 has no mode .* 640 x 480 at 59\.94 Hz, .* 800 x 600 at 60"):
            choose_mode(MODES, shape, asked_hz, "DP-1")

    def test_an_output_without_modes_is_refused(self) -> None:
        with pytest.raises(SettingRefused, match="none"):
            choose_mode((), (480, 640), 60, "DP-1")


class TestNeutral:
    def test_what_changes_a_picture_is_switched_off_where_the_driver_has_it(self) -> None:
        connector = {
            "Broadcast RGB": Property(10, 0, {"Automatic": 0, "Full": 1, "Limited 16:235": 2}),
            "max bpc": Property(11, 12, {}),
            "underscan": Property(12, 1, {"off": 0, "on": 1}),
        }
        controller = {"GAMMA_LUT": Property(20, 77, {}), "ACTIVE": Property(21, 1, {})}
        plane = {"rotation": Property(30, 4, {"rotate-0": 0, "rotate-180": 2}), "alpha": Property(31, 9, {})}
        changes = set(neutral_changes(path(connector, controller, plane)))
        assert changes == {
            *(Change(1, 10, 1), Change(1, 11, 8), Change(1, 12, 0)),
            *(Change(2, 20, 0), Change(3, 30, 1), Change(3, 31, 0xFFFF)),
        }

    def test_a_choice_that_the_driver_lacks_is_left_alone(self) -> None:
        connector = {"scaling mode": Property(10, 1, {"Full": 1, "Center": 2})}
        assert list(neutral_changes(path(connector, {}, {}))) == []

    def test_what_was_altered_is_put_back_but_for_tables(self) -> None:
        connector = {"max bpc": Property(11, 12, {}), "Broadcast RGB": Property(10, 1, {"Full": 1})}
        there = path(connector, {"GAMMA_LUT": Property(20, 77, {})}, {})
        assert earlier_values(there, list(neutral_changes(there))) == [Change(1, 11, 12)]


class TestPixels:
    @pytest.mark.parametrize("spare_px", [0, 3])
    @pytest.mark.parametrize("colour", [False, True])
    def test_codes_arrive_unchanged_in_the_order_of_the_display(self, spare_px: int, colour: bool) -> None:
        codes = np.random.default_rng(1).integers(0, 256, (5, 7, 3) if colour else (5, 7)).astype(np.uint8)
        memory = np.zeros((5, 7 + spare_px, 4), np.uint8)
        write_codes(codes, memory[:, :7])
        expected = codes[..., ::-1] if colour else codes[..., None].repeat(3, axis=2)
        np.testing.assert_array_equal(memory[:, :7, :3], expected)
        assert not memory[:, 7:].any()

    def test_codes_that_do_not_lie_in_order_arrive_too(self) -> None:
        codes = np.arange(70, dtype=np.uint8).reshape(10, 7)[::-2]
        memory = np.zeros((5, 7, 4), np.uint8)
        write_codes(codes, memory)
        np.testing.assert_array_equal(memory[..., 0], codes)


class TestFlips:
    def test_a_flip_that_misses_the_next_refresh_is_counted_late(self) -> None:
        log = FlipLog(1 / 60)
        for sequence, waited_s in enumerate((0.001, 0.0166, 0.024, 0.026, 0.2)):
            log.append(Flip(1.0, 1.0 + waited_s, sequence))
        assert (log.count, log.late, len(log)) == (5, 2, 5)
        assert [flip.sequence for flip in log] == [0, 1, 2, 3, 4]
        assert log[-1].time_s == 1.2
