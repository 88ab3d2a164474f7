"""The projector on real display drivers: vkms, which has page flips, and virtio-gpu, which has none.

Runs in a device lab machine with displays: `python tests/device_lab/machine.py --display 'python -m pytest THIS'`.
"""

import atexit
import signal
import subprocess
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from rig.devices.kms.find import choose_output, find_outputs, list_outputs
from rig.devices.kms.flips import Flip
from rig.devices.kms.readback import Readback
from rig.errors import DeviceBusy, DeviceForbidden, DeviceLost, SettingRefused
from tests.contract.lab import display_output
from tests.device_lab.guest.kms_outputs import (
    CLOCK,
    SHAPE,
    Child,
    as_colour,
    checksums,
    child,
    fail_while_white_is_shown,
    interrupted,
    make,
    noise,
    opened,
    plug,
    read_back,
    show_many,
    show_white_forever,
)
from tests.device_lab.guest.rights import become_nobody
from tests.device_lab.waiting import GENEROUS_S, wait_until


@pytest.fixture(scope="module")
def vkms() -> str:
    return display_output("vkms")


@pytest.fixture(scope="module")
def virtio(vkms: str) -> str:
    return display_output("virtio_gpu")


class TestPicture:
    @pytest.mark.parametrize("shape", [(480, 640), (768, 1024)])
    def test_what_is_shown_is_what_the_display_gets(self, vkms: str, shape: tuple[int, int]) -> None:
        with opened(make(vkms, shape)) as projector, opened(Readback(vkms)) as readback:
            assert not readback.picture().any()
            for codes in (noise(1, shape), noise(2, (*shape, 3)), noise(3, shape), noise(4, (*shape, 3))):
                projector.show(codes, name="noise")
                np.testing.assert_array_equal(readback.picture(), as_colour(codes))

    def test_another_program_reads_the_same(self, vkms: str) -> None:
        codes = noise(5, (*SHAPE, 3))

        def compare(say: Callable[[str], None]) -> None:
            say("same" if np.array_equal(read_back(vkms), codes) else "different")

        with opened(make(vkms)) as projector:
            projector.show(codes, name="noise")
            with child(compare) as other:
                assert other.said() == "same"

    def test_each_picture_has_another_number_than_the_one_before(self, vkms: str) -> None:
        with opened(make(vkms)) as projector, opened(Readback(vkms)) as readback:
            numbers = [projector.show(noise(i), name="noise") and readback.frame_id() for i in range(4)]
        assert 0 not in numbers
        assert all(earlier != later for earlier, later in pairwise(numbers))

    def test_virtio_shows_what_it_was_given_too(self, virtio: str) -> None:
        with opened(make(virtio)) as projector, opened(Readback(virtio)) as readback:
            for codes in (noise(6), noise(7, (*SHAPE, 3))):
                before_s = CLOCK.now_s()
                shown = projector.show(codes, name="noise")
                np.testing.assert_array_equal(readback.picture(), as_colour(codes))
                assert before_s - 1e-6 <= shown.on_screen_s <= CLOCK.now_s()


class TestFlips:
    def test_120_flips_at_60_hz_are_none_late(self, vkms: str) -> None:
        codes = [noise(1), noise(2)]
        with opened(make(vkms)) as projector:
            until_s = CLOCK.now_s() + GENEROUS_S  # the machine's one emulated processor has other work too
            in_a_row: list[Flip] = []
            while len(in_a_row) < 120 and CLOCK.now_s() < until_s:
                late = projector.flips.late
                flip = projector.flip(codes[projector.flips.count % 2])
                if projector.flips.late > late or (in_a_row and flip.sequence != in_a_row[-1].sequence + 1):
                    in_a_row.clear()
                in_a_row.append(flip)
            print(f"{projector.flips.count} flips, {projector.flips.late} late")
        assert len(in_a_row) == 120
        periods_s = [later.time_s - earlier.time_s for earlier, later in pairwise(in_a_row)]
        assert min(periods_s) == pytest.approx(1 / 60, rel=0.01)
        assert max(periods_s) == pytest.approx(1 / 60, rel=0.01)

    def test_the_sequence_says_in_which_refreshes_each_picture_was_shown(self, vkms: str) -> None:
        """The driver's checksum of every frame that it sends changes when, and only when, a flip says so."""
        codes = [noise(1), noise(2)]
        with opened(make(vkms)) as projector, checksums(vkms) as read:
            for number in range(40):
                projector.flip(codes[number % 2])
                read()
            flips = list(projector.flips)
            wait_until(lambda: max(read(), default=0) > flips[-1].sequence)
            sent = read()
        shown: list[set[str]] = [set(), set()]
        for number, (flip, following) in enumerate(pairwise(flips)):
            shown[number % 2] |= {sent[frame] for frame in range(flip.sequence, following.sequence) if frame in sent}
        assert [len(each) for each in shown] == [1, 1], (sent, flips)
        assert not shown[0] & shown[1]

    def test_a_flip_that_was_not_waited_for_does_not_disturb_the_next(
        self, vkms: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with opened(make(vkms)) as projector, opened(Readback(vkms)) as readback:
            screen = projector._screen
            with monkeypatch.context() as patch:
                patch.setattr(screen, "_wait_for_flip", interrupted)
                with pytest.raises(KeyboardInterrupt):
                    projector.show(noise(1), name="interrupted")
            projector.show(noise(2), name="noise")
            np.testing.assert_array_equal(readback.picture(), as_colour(noise(2)))


class TestOutput:
    def test_outputs_are_found_with_modes_and_rates(self, vkms: str, virtio: str) -> None:
        outputs = {output.full_name: output for output in find_outputs()}
        sizes = {(mode.width_px, mode.height_px) for mode in outputs[vkms].modes}
        assert {(640, 480), (1024, 768), (1920, 1080)} <= sizes
        assert [mode.preferred for mode in outputs[vkms].modes].count(True) == 1
        assert all(50 < (mode.refresh_rate_hz or 0) < 100 for mode in outputs[vkms].modes)
        assert outputs[virtio].edid_id == "RHT-1234-0"
        assert outputs[virtio].monitor_name == "QEMU Monitor"

    def test_only_the_chosen_one_of_two_cards_shows_it(self, vkms: str, virtio: str) -> None:
        with opened(Readback(vkms)) as one, opened(Readback(virtio)) as other:
            with opened(make(virtio)) as projector:
                projector.show(noise(1), name="noise")
                np.testing.assert_array_equal(other.picture(), as_colour(noise(1)))
                assert not one.frame_id() or one.picture().shape != (*SHAPE, 3)
            with opened(make(vkms)) as projector:
                projector.show(noise(2), name="noise")
                np.testing.assert_array_equal(one.picture(), as_colour(noise(2)))
                assert other.frame_id() == 0

    def test_a_display_is_found_by_its_identity(self, virtio: str) -> None:
        with opened(make("edid:RHT-1234-0")) as projector, opened(Readback("edid:RHT-1234-0")) as readback:
            projector.show(noise(3), name="noise")
            np.testing.assert_array_equal(readback.picture(), as_colour(noise(3)))
            np.testing.assert_array_equal(read_back(virtio), as_colour(noise(3)))

    def test_the_second_connector_of_a_card_can_be_chosen(self, virtio: str) -> None:
        card = virtio.split(":")[0]
        second = next(each.full_name for each in list_outputs() if each.card.name == card and each.full_name != virtio)
        plug(second, "on")
        try:
            with opened(make(second)) as projector, opened(Readback(second)) as readback:
                projector.show(noise(4), name="noise")
                np.testing.assert_array_equal(readback.picture(), as_colour(noise(4)))
        finally:
            plug(second, "detect")

    @pytest.mark.parametrize(("shape", "rate_hz"), [((480, 641), 60.0), (SHAPE, 72.0)])
    def test_a_mode_that_it_lacks_is_refused_with_those_it_has(
        self, vkms: str, shape: tuple[int, int], rate_hz: float
    ) -> None:
        with pytest.raises(SettingRefused, match=r"1024 x 768 at 60\.00 Hz"):
            make(vkms, shape, rate_hz).open()
        with opened(make(vkms)) as projector:
            assert projector.show(noise(1), name="noise").name == "noise"

    def test_an_output_that_is_not_there_is_lost_with_a_list(self, vkms: str) -> None:
        with pytest.raises(DeviceLost, match=f"no output 'HDMI-A-9'; outputs: .*{vkms}"):
            make("HDMI-A-9").open()


class TestUnplug:
    def test_a_pulled_cable_is_named_and_everything_goes_on_when_it_is_back(self, vkms: str) -> None:
        connector = vkms.split(":")[1]
        with opened(make(vkms)) as projector, opened(Readback(vkms)) as readback:
            projector.show(noise(1), name="noise")
            plug(vkms, "off")
            try:
                assert readback.frame_id() == 0
                with pytest.raises(DeviceLost, match=f"{connector} is disconnected"):
                    projector.show(noise(2), name="noise")
                with pytest.raises(DeviceLost, match=f"{connector} is disconnected"):
                    projector.check_on_screen()
                projector.close()
                with pytest.raises(DeviceLost, match=f"{connector} is disconnected"):
                    projector.open()
            finally:
                plug(vkms, "on")
            projector.open()
            projector.check_on_screen()
            projector.show(noise(3), name="noise")
            np.testing.assert_array_equal(readback.picture(), as_colour(noise(3)))

    def test_a_cable_that_is_pulled_while_pictures_run_is_noticed_at_once(self, vkms: str) -> None:
        def pull(say: Callable[[str], None]) -> None:
            CLOCK.wait_until_s(CLOCK.now_s() + 0.3)
            plug(vkms, "off")

        try:
            with opened(make(vkms)) as projector, child(pull):
                with pytest.raises(DeviceLost, match="is disconnected"):
                    show_many(projector, 600)
            assert 0 < projector.flips.count < 300
        finally:
            plug(vkms, "on")

    def test_a_mode_that_disappears_is_named(self, vkms: str, tmp_path: Path) -> None:
        modes = choose_output(vkms, list_outputs()).folder / "modes"
        (tmp_path / "modes").write_text("1920x1080\n")
        with opened(make(vkms)) as projector:
            projector.show(noise(1), name="noise")
            subprocess.run(["mount", "--bind", tmp_path / "modes", modes], check=True)
            try:
                with pytest.raises(DeviceLost, match="no longer offers 640 x 480 px"):
                    projector.show(noise(2), name="noise")
            finally:
                subprocess.run(["umount", modes], check=True)
            assert projector.show(noise(2), name="noise").name == "noise"

    def test_a_failed_link_is_named(self, vkms: str, monkeypatch: pytest.MonkeyPatch) -> None:
        """No driver here has links that fail: the property's value is forged."""
        with opened(make(vkms)) as projector:
            screen = projector._screen
            assert screen is not None
            assert screen._link is not None
            values = {screen._link.id: 1}
            monkeypatch.setattr(screen._card, "values", lambda object_id: values)
            with pytest.raises(DeviceLost, match="link has failed"):
                projector.show(noise(1), name="noise")


class TestOthers:
    def test_a_card_that_another_program_holds_is_busy_but_can_be_looked_at(self, vkms: str) -> None:
        with child(show_white_forever(vkms)) as other:
            assert other.said() == "shown"
            asked_s = CLOCK.now_s()
            with pytest.raises(DeviceBusy, match=r"another program \(a desktop\?\) holds card"):
                make(vkms).open()
            assert CLOCK.now_s() - asked_s < 5.0
            assert any(each.modes and each.modes[0].refresh_rate_hz for each in find_outputs())
            assert read_back(vkms).min() == 255

    def test_reading_back_does_not_take_the_card(self, vkms: str) -> None:
        with opened(Readback(vkms)), opened(make(vkms)) as projector:
            assert projector.show(noise(1), name="noise").name == "noise"

    @pytest.mark.parametrize("device", [make, Readback])
    def test_who_may_not_open_the_card_is_told_how_to(self, vkms: str, device: Callable) -> None:
        def open_as_nobody(say: Callable[[str], None]) -> None:
            become_nobody()
            device(vkms).open()

        with child(open_as_nobody) as other:
            said = other.said()
        assert said.startswith(DeviceForbidden.__name__)
        assert "group 'video'" in said

    def test_pictures_of_others_are_for_root_alone(self, vkms: str) -> None:
        card = choose_output(vkms, list_outputs()).card

        def read_as_nobody(say: Callable[[str], None]) -> None:
            become_nobody()
            read_back(vkms)

        with opened(make(vkms)):
            card.chmod(0o666)
            try:
                with child(read_as_nobody) as other:
                    assert "only root may read" in other.said()
            finally:
                card.chmod(0o600)


class TestEnd:
    def test_it_is_closed_from_any_state(self, vkms: str) -> None:
        projector = make(vkms)
        projector.close()
        with opened(Readback(vkms)) as readback:
            for _ in range(2):
                projector.open()
                projector.open()
                projector.show(noise(1), name="noise")
                projector.close()
                projector.close()
                assert readback.frame_id() == 0
            with pytest.raises(DeviceLost, match="closed"):
                projector.show(noise(1), name="noise")
            with pytest.raises(DeviceLost, match="closed"):
                projector.check_on_screen()
        with pytest.raises(DeviceLost, match="closed"):
            readback.frame_id()

    @pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
    def test_nothing_stays_of_a_program_that_is_killed(self, vkms: str, number: int) -> None:
        with opened(Readback(vkms)) as readback:
            other = Child(show_white_forever(vkms))
            assert other.said() == "shown"
            assert readback.picture().min() == 255
            other.end(number)
            wait_until(lambda: readback.frame_id() == 0)
            with pytest.raises(DeviceLost, match="dark"):
                readback.picture()
        with opened(make(vkms)) as projector, opened(Readback(vkms)) as readback:
            assert not readback.picture().any()
            projector.show(noise(1), name="noise")

    def test_a_program_that_just_ends_leaves_black(self, vkms: str) -> None:
        def end_without_closing(say: Callable[[str], None]) -> None:
            atexit._clear()
            projector = make(vkms)
            projector.open()
            projector.show(np.full(SHAPE, 255, np.uint8), name="white")
            atexit._run_exitfuncs()
            say("open" if projector._screen else "closed")

        with child(end_without_closing) as other:
            assert other.said() == "closed"
        with opened(Readback(vkms)) as readback:
            assert not readback.frame_id() or readback.picture().mean() < 10

    def test_an_error_of_the_program_leaves_black(self, vkms: str) -> None:
        with opened(Readback(vkms)) as readback:
            with pytest.raises(ZeroDivisionError):
                fail_while_white_is_shown(make(vkms))
            assert readback.frame_id() == 0
