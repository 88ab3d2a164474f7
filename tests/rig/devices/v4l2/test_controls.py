"""Controls: what is set, in which order, and what is refused, on a camera made of a table."""

import errno
from pathlib import Path

import pytest

from rig.devices.clock import VirtualClock
from rig.devices.v4l2 import abi
from rig.devices.v4l2.controls import Setting, apply_settings, changed_settings, offer_settings, plan_settings
from rig.devices.v4l2.describe import ControlAbility, control_name, list_controls
from rig.devices.v4l2.gain import gain_of
from rig.devices.v4l2.node import Node
from rig.devices.v4l2.setup import hold_controls
from rig.errors import DeviceError, SettingRefused

EXPOSURE_AUTO, EXPOSURE, PRIORITY, WHITE_AUTO, WHITE, GAMMA, GAIN = (
    0x009A0901,
    0x009A0902,
    0x009A0903,
    0x0098090C,
    0x0098091A,
    0x00980910,
    0x00980913,
)
INTEGER, BOOLEAN, MENU = 1, 2, 3
INACTIVE = 0x10
CAMERA = {
    GAMMA: ("Gamma", INTEGER, 72, 500, 1, 300),
    WHITE_AUTO: ("White Balance, Automatic", BOOLEAN, 0, 1, 1, 1),
    WHITE: ("White Balance Temperature", INTEGER, 2800, 6500, 10, 4600),
    GAIN: ("Gain", INTEGER, 0, 100, 1, 0),
    EXPOSURE_AUTO: ("Auto Exposure", MENU, 0, 3, 1, 3),
    EXPOSURE: ("Exposure Time, Absolute", INTEGER, 3, 2047, 1, 250),
    PRIORITY: ("Exposure, Dynamic Framerate", BOOLEAN, 0, 1, 1, 1),
}
MODES = {1: b"Manual Mode", 3: b"Aperture Priority Mode"}


class TableNode(Node):
    """A node whose ioctls are answered from a table; `set_ids` are the controls in the order of their setting."""

    def __init__(self, tmp_path: Path):
        (tmp_path / "video0").touch()
        super().__init__(tmp_path / "video0", VirtualClock())
        self.table = dict(CAMERA)
        self.modes = dict(MODES)
        self.values = {control_id: fields[-1] for control_id, fields in CAMERA.items()}
        self.set_ids: list[int] = []
        self.failures: list[int] = []
        self.deaf: set[int] = set()

    def ioctl(self, request, argument):
        answer = {
            abi.QUERY_EXT_CTRL: self._query,
            abi.QUERYMENU: self._entry,
            abi.G_CTRL: self._get,
            abi.S_CTRL: self._set,
        }[request](argument)
        if answer:
            raise OSError(answer, "refused")
        return argument

    def _query(self, query) -> int:
        after = query.id & ~abi.NEXT_CONTROL
        later = [known for known in sorted(self.table) if known > after] if query.id & abi.NEXT_CONTROL else [after]
        if not later or later[0] not in self.table:
            return errno.EINVAL
        name, query.type, query.minimum, query.maximum, query.step, query.default_value = self.table[later[0]]
        query.id, query.name = later[0], name.encode()
        needs_manual = {WHITE: self.values.get(WHITE_AUTO) == 1, EXPOSURE: self.values.get(EXPOSURE_AUTO) == 3}
        query.flags = INACTIVE if needs_manual.get(query.id) else 0
        return 0

    def _entry(self, entry) -> int:
        if entry.index not in self.modes:
            return errno.EINVAL
        entry.item.name = self.modes[entry.index]
        return 0

    def _get(self, control) -> int:
        control.value = self.values[control.id]
        return 0

    def _set(self, control) -> int:
        if self.failures:
            return self.failures.pop(0)
        self.set_ids.append(control.id)
        if control.id not in self.deaf:
            self.values[control.id] = control.value
        return 0


@pytest.fixture
def node(tmp_path: Path):
    with TableNode(tmp_path) as node:
        yield node


def settings(node: Node, **wanted: int) -> list[Setting]:
    return plan_settings(list_controls(node), wanted)


def named(settings: list[Setting]) -> dict[str, int]:
    return {setting.control.name: setting.value for setting in settings}


def test_names_are_those_that_other_programs_use() -> None:
    assert control_name("White Balance, Automatic") == "white_balance_automatic"
    assert control_name("Exposure (Absolute)") == "exposure_absolute"


def test_automatics_come_first_then_the_profile_s_controls_in_its_order(node: TableNode) -> None:
    planned = settings(node, white_balance_temperature=5000, gain=20)
    assert list(named(planned).items()) == [
        ("auto_exposure", 1),
        ("exposure_dynamic_framerate", 0),
        ("white_balance_automatic", 0),
        ("gamma", 100),
        ("white_balance_temperature", 5000),
        ("gain", 20),
    ]
    apply_settings(node, planned)
    assert node.set_ids == [EXPOSURE_AUTO, PRIORITY, WHITE_AUTO, GAMMA, WHITE, GAIN]
    assert changed_settings(node, planned) == []


def test_the_profile_has_the_last_word(node: TableNode) -> None:
    assert named(settings(node, gamma=220)) == {
        "auto_exposure": 1, "exposure_dynamic_framerate": 0, "white_balance_automatic": 0, "gamma": 220,
    }  # fmt: skip


def test_gamma_is_left_alone_where_it_has_no_100(node: TableNode) -> None:
    node.table[GAMMA] = ("Gamma", INTEGER, 1, 10, 1, 5)
    assert "gamma" not in named(settings(node))


def test_shutter_priority_does_where_there_is_no_manual_mode(node: TableNode) -> None:
    node.modes = {0: b"Auto Mode", 2: b"Shutter Priority Mode"}
    assert named(settings(node))["auto_exposure"] == 2


def test_a_camera_that_only_exposes_as_it_likes_is_refused(node: TableNode) -> None:
    node.modes = {3: b"Aperture Priority Mode"}
    with pytest.raises(SettingRefused, match=r"auto_exposure cannot be made manual: it is one of 3 \(Aperture"):
        settings(node)


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"gian": 3}, "no control 'gian'; did you mean gain"),
        ({"zoom": 3}, "no control 'zoom'; it has auto_exposure, "),
        ({"gain": 101}, "gain: asked for 101, but its range is 0 … 100; change camera.controls.gain"),
        ({"white_balance_temperature": 5003}, "it goes from 2800 to 6500 in steps of 10"),
        ({"auto_exposure": 2}, r"it is one of 1 \(Manual Mode\), 3"),
        ({"exposure_time_absolute": 100}, r"the rig sets it; give camera\.exposure_s"),
    ],
)
def test_a_control_that_cannot_be_set_is_named(node: TableNode, wanted: dict[str, int], message: str) -> None:
    with pytest.raises(SettingRefused, match=message):
        settings(node, **wanted)


def test_every_problem_is_told_at_once(node: TableNode) -> None:
    with pytest.raises(SettingRefused) as refused:
        settings(node, gain=101, gian=1)
    assert len(str(refused.value).splitlines()) == 2


def test_a_value_that_does_not_stick_names_asked_got_and_range(node: TableNode) -> None:
    node.deaf = {GAIN}
    with pytest.raises(SettingRefused, match=r"gain: asked for 7, the camera has 0 .range 0 … 100, step 1"):
        apply_settings(node, settings(node, gain=7))


def test_a_control_that_another_one_decides_over_is_refused(node: TableNode) -> None:
    planned = settings(node, white_balance_automatic=1, white_balance_temperature=5000)
    with pytest.raises(SettingRefused, match="white_balance_temperature is inactive"):
        apply_settings(node, planned)
    offer_settings(node, planned)
    with pytest.raises(SettingRefused, match="white_balance_temperature is inactive"):
        hold_controls(node, planned)


def test_controls_that_stick_only_while_frames_come_are_set_again_then(node: TableNode) -> None:
    planned = settings(node, gain=20)
    node.deaf = {GAIN, WHITE_AUTO}
    offer_settings(node, planned)
    node.deaf = {GAIN}
    with pytest.raises(SettingRefused, match="gain: asked for 20, the camera has 0"):
        hold_controls(node, planned)
    node.deaf = set()
    hold_controls(node, planned)
    assert changed_settings(node, planned) == []
    assert node.values[GAIN] == 20


def test_what_drifts_is_noticed(node: TableNode) -> None:
    planned = settings(node, gain=20)
    apply_settings(node, planned)
    node.values[GAIN] = 21
    assert [setting.control.name for setting in changed_settings(node, planned)] == ["gain"]


@pytest.mark.parametrize("number", [errno.EPIPE, errno.EIO, errno.EBUSY, errno.ETIMEDOUT])
def test_a_control_that_stalls_for_a_moment_is_set_again(node: TableNode, number: int) -> None:
    node.failures = [number] * 3
    apply_settings(node, settings(node, gain=20))
    assert node.values[GAIN] == 20


def test_a_control_that_stalls_on_and_on_is_an_error_in_time(node: TableNode) -> None:
    node.failures = [errno.EPIPE] * 1000
    with pytest.raises(DeviceError, match=r"setting control auto_exposure to 1 failed: Broken pipe \(EPIPE\)"):
        apply_settings(node, settings(node))
    assert len(node.failures) > 900


@pytest.mark.parametrize(
    ("flags", "refused"), [((), False), (("read-only",), True), (("disabled",), True), (("inactive",), False)]
)
def test_read_only_controls_cannot_be_set(flags: tuple[str, ...], refused: bool) -> None:
    control = ControlAbility(
        name="gain", id=GAIN, kind="integer", minimum=0, maximum=1, step=1, default=0, value=0, menu={}, flags=flags
    )
    assert control.is_settable is not refused


def test_a_gain_is_the_camera_s_own_held_while_one_looks_and_put_back(node: TableNode) -> None:
    node.table[GAIN] = ("Gain", INTEGER, 0, 100, 8, 0)
    held, changes = settings(node, gain=16), []
    apply_settings(node, held)
    gain = gain_of(node, held, lambda: changes.append(1))
    assert gain is not None
    assert gain.now() == (16, 0, 100, "steps")
    assert gain.change(51).value == 48  # the nearest step
    assert gain.change(100).value == 96  # the last one
    assert gain.profile_lines() == "[camera.controls] gain = 96"
    assert changed_settings(node, held) == []  # it is what the camera is held to
    with pytest.raises(SettingRefused, match="outside the camera's 0 … 100 steps"):
        gain.change(101)
    gain.put_back()
    assert node.values[GAIN] == 16
    assert len(changes) == 3
    node.deaf.add(GAIN)
    with pytest.raises(SettingRefused, match="asked for 48"):
        gain.change(48)
    del node.table[GAIN]
    assert gain_of(node, held, lambda: None) is None
