"""The network control of projectors, against an emulated one on this machine."""

import socket
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from rig.devices.clock import VirtualClock
from rig.devices.drivers import make_devices
from rig.devices.network.pjlink import Mute, Pjlink, Power
from rig.devices.network.powered_projector import PoweredProjector
from rig.devices.protocols import Codes, Projector, Shown, check_on_screen
from rig.errors import DeviceBusy, DeviceError, DeviceForbidden, DeviceLost, ProfileError, SettingRefused
from rig.profile.schema import Profile
from tests.rig.devices.network.pjlink_emulator import CLASS_1, FAULTS, EmulatedProjector, served


@pytest.fixture
def emulated() -> Iterator[EmulatedProjector]:
    with served(EmulatedProjector()) as projector:
        yield projector


@pytest.fixture
def control(emulated: EmulatedProjector) -> Pjlink:
    return Pjlink("127.0.0.1", emulated.port)


class TestClass1:
    @pytest.fixture(autouse=True)
    def _only_class_1(self, emulated: EmulatedProjector) -> None:
        emulated.state = CLASS_1 | {"1POWR": "1"}

    def test_power_is_told_in_all_its_states(self, emulated: EmulatedProjector, control: Pjlink) -> None:
        for code, power in zip("0123", (Power.STANDBY, Power.ON, Power.COOLING, Power.WARMING_UP), strict=True):
            emulated.state["1POWR"] = code
            assert control.power() is power

    def test_it_is_switched_on_and_off(self, emulated: EmulatedProjector, control: Pjlink) -> None:
        control.switch_off()
        control.switch_on()
        assert emulated.commands == ["1POWR 0", "1POWR 1"]

    def test_inputs_are_listed_and_chosen(self, emulated: EmulatedProjector, control: Pjlink) -> None:
        assert control.inputs() == ["11", "21", "31", "32"]
        control.select_input("32")
        assert control.input() == "32"
        assert emulated.state["1INPT"] == "32"

    @pytest.mark.parametrize(
        ("code", "mute"),
        [
            ("11", Mute(picture=True, sound=False)),
            ("21", Mute(picture=False, sound=True)),
            ("31", Mute(picture=True, sound=True)),
            ("30", Mute(picture=False, sound=False)),
            ("10", Mute(picture=False, sound=False)),
        ],
    )
    def test_mute_is_told(self, emulated: EmulatedProjector, control: Pjlink, code: str, mute: Mute) -> None:
        emulated.state["1AVMT"] = code
        assert control.mute() == mute

    def test_picture_and_sound_are_muted(self, emulated: EmulatedProjector, control: Pjlink) -> None:
        control.set_mute(True)
        assert emulated.state["1AVMT"] == "31"
        control.set_mute(False)
        assert emulated.state["1AVMT"] == "30"

    def test_one_that_has_no_sound_mutes_its_picture(self, emulated: EmulatedProjector, control: Pjlink) -> None:
        emulated.answers = {"1AVMT 31": "%1AVMT=ERR2"}
        control.set_mute(True)
        assert emulated.state["1AVMT"] == "11"

    def test_whatever_else_it_tells_can_be_asked_for(self, control: Pjlink) -> None:
        assert control.ask("1NAME ?", "1INF1 ?", "1INF2 ?") == ["Wall", "Maker", "Model 5"]
        assert control.pjlink_class() == 1

    def test_commands_of_class_2_are_refused(self, control: Pjlink) -> None:
        with pytest.raises(SettingRefused, match=r"ERR1 to '2SNUM \?'.*class 2"):
            control.ask("2SNUM ?")


class TestClass2:
    @pytest.fixture(autouse=True)
    def _switched_on(self, emulated: EmulatedProjector) -> None:
        emulated.state["1POWR"] = "1"

    def test_inputs_have_letters(self, emulated: EmulatedProjector, control: Pjlink) -> None:
        assert control.inputs() == ["11", "31", "3A", "61"]
        control.select_input("3A")
        assert control.input() == "3A"
        assert emulated.state["1INPT"] == "11"


class TestConversation:
    def test_several_commands_share_one_connection(self, emulated: EmulatedProjector, control: Pjlink) -> None:
        emulated.password = "secret"
        control = Pjlink("127.0.0.1", emulated.port, "secret")
        assert control.ask("1NAME ?", "1CLSS ?", "1POWR ?") == ["Wall", "2", "0"]
        assert emulated.connections == 1

    def test_names_may_hold_any_letters(self, emulated: EmulatedProjector, control: Pjlink) -> None:
        emulated.state["1NAME"] = "Wohnzimmer = groß, 居間"
        assert control.ask("1NAME ?") == ["Wohnzimmer = groß, 居間"]

    def test_lower_case_answers_are_understood(self, emulated: EmulatedProjector, control: Pjlink) -> None:
        emulated.answers = {"1POWR 0": "%1powr=ok"}
        control.switch_off()

    def test_the_right_password_opens(self, emulated: EmulatedProjector) -> None:
        emulated.password = "JBMIAProjectorLink"
        assert Pjlink("127.0.0.1", emulated.port, "JBMIAProjectorLink").ask("1NAME ?") == ["Wall"]

    def test_a_password_that_nobody_asks_for_does_no_harm(self, emulated: EmulatedProjector) -> None:
        assert Pjlink("127.0.0.1", emulated.port, "needless").ask("1NAME ?") == ["Wall"]

    def test_a_wrong_password_is_forbidden(self, emulated: EmulatedProjector) -> None:
        emulated.password = "right"
        with pytest.raises(DeviceForbidden, match="does not accept the password"):
            Pjlink("127.0.0.1", emulated.port, "wrong").ask("1NAME ?")
        assert emulated.commands == []

    def test_a_missing_password_is_asked_for(self, emulated: EmulatedProjector, control: Pjlink) -> None:
        emulated.password = "right"
        with pytest.raises(DeviceForbidden, match=r"wants a password.*pjlink\.password_variable"):
            control.ask("1NAME ?")

    @pytest.mark.parametrize(
        ("code", "error", "words"),
        [
            ("ERR1", SettingRefused, "does not know this command"),
            ("ERR2", SettingRefused, "choose another parameter"),
            ("ERR3", DeviceBusy, "cannot do this now"),
            ("ERR4", DeviceError, "reports a failure"),
        ],
    )
    def test_each_error_has_a_name(
        self, emulated: EmulatedProjector, control: Pjlink, code: str, error: type[DeviceError], words: str
    ) -> None:
        emulated.answers = {"1POWR ?": f"%1POWR={code}", "1POWR 1": f"%1POWR={code}"}
        for call in (control.power, control.switch_on):
            with pytest.raises(error, match=words) as raised:
                call()
            assert raised.type is error


class TestFaults:
    @pytest.mark.parametrize("fault", [*FAULTS, "hang up in an answer"])
    def test_what_is_no_pjlink_is_named(self, emulated: EmulatedProjector, control: Pjlink, fault: str) -> None:
        emulated.fault = fault
        with pytest.raises(DeviceError, match=r"127\.0\.0\.1:\d+ (hung up|greets with|sends lines of over 1024)"):
            control.ask("1NAME ?")

    @pytest.mark.parametrize("fault", ["silence", "slow letters"])
    def test_an_answer_is_waited_for_within_a_limit(self, emulated: EmulatedProjector, fault: str) -> None:
        emulated.fault = fault
        with pytest.raises(DeviceLost, match=r"did not answer within 0\.3 s"):
            Pjlink("127.0.0.1", emulated.port, timeout_s=0.3).ask("1NAME ?")

    @pytest.mark.parametrize("answer", ["%1POWR=7", "%1POWR=", "%1INPT=11", "%1POWR 1", "", "%2POWR=1"])
    def test_answers_that_make_no_sense_are_named(
        self, emulated: EmulatedProjector, control: Pjlink, answer: str
    ) -> None:
        emulated.answers = {"1POWR ?": answer}
        with pytest.raises(DeviceError, match="answers"):
            control.power()

    def test_a_setting_that_is_not_confirmed_is_an_error(self, emulated: EmulatedProjector, control: Pjlink) -> None:
        emulated.answers = {"1POWR 1": "%1POWR=1"}
        with pytest.raises(DeviceError, match="instead of OK"):
            control.switch_on()

    def test_nobody_there_is_lost(self) -> None:
        with socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            port = taken.getsockname()[1]
        with pytest.raises(DeviceLost, match=rf"127\.0\.0\.1:{port} cannot be reached"):
            Pjlink("127.0.0.1", port).power()


class Output:
    """A display output that notes what happens to it, and may have no signal at first."""

    shape = (3, 4)

    def __init__(self, emulated: EmulatedProjector):
        self.emulated = emulated
        self.is_open = False
        self.missing = 0
        """How many times it is not there when it is opened."""

    def open(self) -> None:
        if self.missing or self.emulated.state["1POWR"] != "1":
            self.missing -= 1
            raise DeviceLost("no monitor 'HDMI-1'")
        self.is_open = True

    def close(self) -> None:
        self.is_open = False

    def show(self, codes: Codes, *, name: str) -> Shown:
        return Shown(float(codes.max()), name)


Make = Callable[..., PoweredProjector]


class TestPoweredProjector:
    @pytest.fixture
    def output(self, emulated: EmulatedProjector) -> Output:
        return Output(emulated)

    @pytest.fixture
    def make(self, output: Output, control: Pjlink) -> Make:
        def make(input_code: str | None = "31", warm_up_timeout_s: float = 120.0) -> PoweredProjector:
            return PoweredProjector(
                output,
                control,
                input_code=input_code,
                warm_up_timeout_s=warm_up_timeout_s,
                clock=VirtualClock(),
            )

        return make

    def test_it_is_a_projector(self, make: Make) -> None:
        assert isinstance(make(), Projector)
        assert make().shape == (3, 4)
        assert make().show(np.full((3, 4), 9, np.uint8), name="nine") == Shown(9.0, "nine")

    @pytest.mark.parametrize("before", ["0", "1", "2", "3"])
    def test_it_is_lit_on_its_input_and_visible_whatever_it_did_before(
        self, emulated: EmulatedProjector, output: Output, make: Make, before: str
    ) -> None:
        emulated.state |= {"1POWR": before, "1AVMT": "31"}
        emulated.power_changes = {"2": ["2", "2", "2", "0"], "3": ["3", "3", "3", "1"]}.get(before, [])
        make().open()
        assert output.is_open
        assert (emulated.state["1POWR"], emulated.state["2INPT"], emulated.state["1AVMT"]) == ("1", "31", "30")
        assert emulated.commands.count("1POWR 1") == (before in "02")

    def test_its_monitor_may_come_later_than_its_light(self, output: Output, make: Make) -> None:
        output.missing = 3
        make().open()
        assert output.is_open

    def test_a_monitor_that_is_missing_while_it_is_lit_is_not_waited_for(
        self, emulated: EmulatedProjector, output: Output, make: Make
    ) -> None:
        emulated.state["1POWR"] = "1"
        output.missing = 1
        with pytest.raises(DeviceLost, match="no monitor 'HDMI-1'"):
            make().open()
        make().open()
        assert output.is_open

    def test_its_input_is_left_alone_when_none_is_named(self, emulated: EmulatedProjector, make: Make) -> None:
        make(input_code=None).open()
        assert emulated.state["2INPT"] == "11"

    def test_an_input_that_it_has_not_is_answered_with_those_that_it_has(
        self, emulated: EmulatedProjector, make: Make
    ) -> None:
        with pytest.raises(SettingRefused, match=r"ERR2 to '2INPT 32'.*pjlink\.input may be one of 11, 31, 3A, 61"):
            make(input_code="32").open()
        assert emulated.state["1AVMT"] == "31"

    def test_one_that_never_warms_up_is_given_up(self, emulated: EmulatedProjector, make: Make) -> None:
        emulated.state["1POWR"] = "3"
        with pytest.raises(DeviceError, match=r"not ready within 20 s .*warm_up_timeout_s"):
            make(warm_up_timeout_s=20.0).open()
        assert 15 < emulated.commands.count("1POWR ?") < 25

    def test_one_that_cannot_be_reached_is_not_waited_for(self, output: Output) -> None:
        with socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            control = Pjlink("127.0.0.1", taken.getsockname()[1])
        projector = PoweredProjector(output, control, input_code=None, warm_up_timeout_s=1e6, clock=VirtualClock())
        with pytest.raises(DeviceLost, match="cannot be reached"):
            projector.open()
        projector.close()

    def test_closing_makes_it_dark_and_leaves_the_lamp_lit(
        self, emulated: EmulatedProjector, output: Output, make: Make
    ) -> None:
        projector = make()
        projector.close()
        assert emulated.commands == []
        for _ in range(2):
            projector.open()
            projector.open()
            assert emulated.state["1AVMT"] == "30"
            for _ in range(2):
                projector.close()
            assert not output.is_open
            assert (emulated.state["1POWR"], emulated.state["1AVMT"]) == ("1", "31")

    def test_closing_works_without_the_network(self, emulated: EmulatedProjector, output: Output, make: Make) -> None:
        projector = make()
        projector.open()
        emulated.fault = "hang up"
        projector.close()
        assert not output.is_open

    def test_a_display_that_lost_its_picture_is_heard_through_it(
        self, output: Output, make: Make, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        make().check_on_screen()

        def unplugged(_: Output) -> None:
            raise DeviceLost("HDMI-A-1 was unplugged")

        monkeypatch.setattr(Output, "check_on_screen", unplugged, raising=False)
        with pytest.raises(DeviceLost, match="HDMI-A-1 was unplugged"):
            check_on_screen(make())


class TestProfile:
    @pytest.fixture
    def profile(self, tiny_profile: Profile, emulated: EmulatedProjector) -> Profile:
        """A rig whose projector hangs on a desktop and has a network control with a password."""
        camera, projector = tiny_profile.raw.decode().split("[simulation]")[0].split("[[projector]]")
        camera = camera.replace('"simulated"', '"v4l2"\ndevice_id = "any"\npixel_format = "GREY"')
        projector = projector.replace('"simulated"', '"window"\noutput = "HDMI-1"')
        control = (
            f'[projector.pjlink]\nhost = "127.0.0.1"\nport = {emulated.port}\ninput = "31"\n'
            'password_variable = "WALL_PASSWORD"\n'
        )
        return Profile.parse(f"{camera}[[projector]]{projector}\n{control}".encode(), tiny_profile.path)

    def test_its_table_puts_the_network_control_before_the_display(
        self, profile: Profile, emulated: EmulatedProjector, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        emulated.password, emulated.state["1POWR"] = "secret", "1"
        monkeypatch.setenv("WALL_PASSWORD", "secret")
        monkeypatch.delenv("DISPLAY", raising=False)
        monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
        with pytest.raises(DeviceError, match="no desktop"):
            make_devices(profile).projector.open()
        assert emulated.state["2INPT"] == "31"

    def test_a_password_that_is_not_set_is_a_mistake_of_the_profile(
        self, profile: Profile, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.delenv("WALL_PASSWORD", raising=False)
        with pytest.raises(ProfileError, match=r"pjlink\.password_variable: the variable WALL_PASSWORD is not set"):
            make_devices(profile)
