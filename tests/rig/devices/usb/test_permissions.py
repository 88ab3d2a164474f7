"""Who may not open a device is told how to be allowed, ready to paste."""

import errno
import os
import shlex
import subprocess
from pathlib import Path

import pytest

from rig.devices.clock import VirtualClock
from rig.devices.usb import reset
from rig.devices.usb.find import find_usb_devices
from rig.devices.usb.permissions import forbidden, udev_rule
from rig.errors import DeviceError, DeviceForbidden, DeviceLost


def test_the_udev_rule_covers_raw_usb_video_and_hidraw_nodes() -> None:
    lines = udev_rule(0x0451, 0x6401).splitlines()
    assert lines[0] == "sudo tee /etc/udev/rules.d/70-procam-rig-0451-6401.rules <<'RULE'"
    ids = 'ATTRS{idVendor}=="0451", ATTRS{idProduct}=="6401", MODE="0660", TAG+="uaccess"'
    assert lines[1:4] == [f'SUBSYSTEM=="{name}", {ids}' for name in ("usb", "video4linux", "hidraw")]
    assert lines[4:] == ["RULE", "sudo udevadm control --reload-rules", "sudo udevadm trigger"]


def test_the_udev_rule_can_be_pasted_into_a_shell(tmp_path: Path) -> None:
    script = udev_rule(0x1209, 0x0001)
    stubs = f'sudo() {{ case $1 in tee) cat > {shlex.quote(str(tmp_path))}/rule;; *) echo "$@";; esac; }}\n'
    done = subprocess.run(["sh", "-c", stubs + script], capture_output=True, text=True, check=True, timeout=20)
    assert done.stdout.splitlines() == ["udevadm control --reload-rules", "udevadm trigger"]
    assert (tmp_path / "rule").read_text().count('ATTRS{idVendor}=="1209"') == 3


def test_a_refusal_says_whose_the_node_is_and_what_to_paste(tmp_path: Path) -> None:
    node = tmp_path / "video0"
    node.touch(mode=0o600)
    error = forbidden(node, 0x1209, 0x0001)
    assert isinstance(error, DeviceForbidden)
    assert f"{node}: you may not open it: it is -rw-------" in str(error)
    assert "70-procam-rig-1209-0001.rules" in str(error)


def test_a_refusal_without_ids_or_node_still_reads_well(tmp_path: Path) -> None:
    error = forbidden(tmp_path / "gone")
    assert str(error) == f"{tmp_path / 'gone'}: you may not open it"


def plug(root: Path) -> Path:
    folder = root / "sys/bus/usb/devices/1-4"
    interface = folder / "1-4:1.0"
    interface.mkdir(parents=True)
    for name, text in {"idVendor": "1209", "idProduct": "1", "busnum": "1", "devnum": "2", "speed": "480"}.items():
        (folder / name).write_text(text)
    (interface / "bInterfaceNumber").write_text("00")
    (interface / "bInterfaceClass").write_text("0e")
    (folder / "authorized").write_text("1")
    driver = root / "sys/bus/usb/drivers/uvcvideo"
    driver.mkdir(parents=True)
    (interface / "driver").symlink_to(driver)
    node = root / "dev/bus/usb/001/002"
    node.parent.mkdir(parents=True)
    node.touch()
    return folder


def refuse(number: int) -> None:
    raise OSError(number, os.strerror(number))


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    seen: list[int] = []
    monkeypatch.setattr("fcntl.ioctl", lambda descriptor, request, value: seen.append(request))
    return seen


def test_a_reset_asks_the_kernel_and_returns_the_device_that_came_back(tmp_path: Path, calls: list[int]) -> None:
    plug(tmp_path)
    before = find_usb_devices(tmp_path)[0]
    assert reset.reset_usb_device(before, clock=VirtualClock(), root=tmp_path) == before
    assert reset.reset_usb_device("1-4", clock=VirtualClock(), root=tmp_path) == before
    assert calls == [reset.USBDEVFS_RESET, reset.USBDEVFS_RESET]


@pytest.mark.parametrize("number", [errno.ENODEV, errno.EIO])
def test_a_reset_that_the_kernel_answers_by_enumerating_anew_or_refuses_still_brings_it_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    plug(tmp_path)
    monkeypatch.setattr("fcntl.ioctl", lambda *given: refuse(number))
    assert reset.reset_usb_device("1-4", clock=VirtualClock(), root=tmp_path).bus_path == "1-4"


def test_a_device_that_does_not_come_back_with_its_driver_is_lost_in_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = plug(tmp_path)
    monkeypatch.setattr("fcntl.ioctl", lambda *given: (folder / "1-4:1.0/driver").unlink())
    clock = VirtualClock()
    with pytest.raises(DeviceLost, match="is there, but not all its drivers are 3 s after its reset"):
        reset.reset_usb_device("1-4", timeout_s=3.0, clock=clock, root=tmp_path)
    assert clock.now_s() == pytest.approx(3.0)


def test_resetting_nothing_is_named(tmp_path: Path) -> None:
    with pytest.raises(DeviceLost, match="no USB device at 1-9"):
        reset.reset_usb_device("1-9", clock=VirtualClock(), root=tmp_path)


def test_a_reset_that_the_user_may_not_do_gives_the_rule(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plug(tmp_path)
    monkeypatch.setattr("fcntl.ioctl", lambda *given: refuse(errno.EACCES))
    monkeypatch.setattr(Path, "write_text", lambda *given: refuse(errno.EACCES))
    with pytest.raises(DeviceForbidden, match=r"70-procam-rig-1209-0001\.rules"):
        reset.reset_usb_device("1-4", clock=VirtualClock(), root=tmp_path)


def test_a_reset_that_the_kernel_refuses_both_ways_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plug(tmp_path)
    monkeypatch.setattr("fcntl.ioctl", lambda *given: refuse(errno.EIO))
    monkeypatch.setattr(Path, "write_text", lambda *given: refuse(errno.EINVAL))
    with pytest.raises(DeviceError, match=r"cannot be reset \(Input/output error\) nor switched off and on"):
        reset.reset_usb_device("1-4", clock=VirtualClock(), root=tmp_path)
