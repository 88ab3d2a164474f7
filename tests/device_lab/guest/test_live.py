"""Live pictures on a real display driver: its cable is pulled, and the program is ended from outside.

Runs in a device lab machine: `python tests/device_lab/machine.py 'python -m pytest THIS'`.
"""

import signal
from collections.abc import Callable
from pathlib import Path

from rig.devices.clock import SystemClock
from rig.devices.kms.find import choose_output, list_outputs
from rig.devices.kms.readback import Readback
from rig.errors import DeviceError
from tests.contract.lab import display_output
from tests.device_lab.live_show import live_show

LIMIT_S = 120.0


def wait_until(true: Callable[[], bool]) -> None:
    clock = SystemClock()
    until_s = clock.now_s() + LIMIT_S
    while not true():
        assert clock.now_s() < until_s, f"not true within {LIMIT_S:g} s"
        clock.wait_until_s(clock.now_s() + 0.1)


def is_lit(output: str) -> bool:
    """Whether anything but black is on an output; also false for one that is off."""
    readback = Readback(output)
    try:
        readback.open()
        return bool(readback.picture().any())
    except DeviceError:
        return False
    finally:
        readback.close()


def test_a_pulled_cable_is_waited_for_and_the_output_is_dark_after_the_end(tmp_path: Path) -> None:
    output = display_output("vkms")
    status = choose_output(output, list_outputs()).folder / "status"
    with live_show("kms", output, tmp_path) as show:
        wait_until(lambda: is_lit(output))
        status.write_text("off")
        wait_until(lambda: not is_lit(output))
        status.write_text("on")
        wait_until(lambda: is_lit(output))
        result = show.end(signal.SIGTERM)
    assert not is_lit(output)
    assert result["unplugged"] >= 1
    assert result["frames"] > 1
    assert result["out_of_order"] == 0
    assert [note.split(":")[0] for note in result["notes"] if "plugged" in note][:2] == ["unplugged", "replugged"]
