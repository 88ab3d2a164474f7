"""The verb that serves virtual cameras, and the camera's faults as typed."""

import io
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from rig.capture.rig import open_rig
from rig.devices.gphoto2.camera import SHUTTER_SPEED, seconds
from rig.devices.gphoto2.find import FoundStill, describe_still
from rig.devices.gphoto2.port import StillPort
from rig.emulated.virtual import COMMANDS, obey, run_virtual
from rig.errors import DeviceError, ProfileError
from tests.gige import gige_rig, needs_aravis, plugged
from tests.still import RAW, needs_gphoto2, still_rig


@needs_gphoto2
def test_a_virtual_still_camera_is_served_until_quit(tmp_path: Path) -> None:
    rig, served, said = still_rig(tmp_path), [], []
    run_virtual("still", str(rig.path), served.append, said.append, io.StringIO("what\nquit\n"))
    assert [one.device_id for one in served] == [f"virtual:{tmp_path}"]
    assert said[-1] == "a virtual still camera knows quit"
    assert not (tmp_path / "shutter").exists()


@needs_gphoto2
def test_a_virtual_camera_needs_a_folder(tmp_path: Path) -> None:
    rig = still_rig(tmp_path)
    other = rig.path.with_name("other.toml")
    other.write_text(rig.path.read_text().replace(f"virtual:{tmp_path}", "usb:001,002"))
    with pytest.raises(ProfileError, match="names no virtual camera"):
        run_virtual("still", str(other), print, print, io.StringIO("quit\n"))


@needs_gphoto2
def test_raw_files_of_a_virtual_camera_are_its_sensors_numbers(tmp_path: Path) -> None:
    still = still_rig(tmp_path, **RAW)
    with still.camera, open_rig(still.profile) as rig:
        assert rig.camera.shape == (240, 320, 1)
        white = np.full(rig.projector.shape, 255, np.uint8)
        short, long = (rig.shoot(white, name="white", exposure_s=one).pixels.astype(float) for one in (0.005, 0.01))
        lit = (short > 1000) & (long < 12000)
        assert lit.mean() > 0.3
        assert np.median((long - 256)[lit] / (short - 256)[lit]) == pytest.approx(2.0, rel=0.01)
        assert rig.camera.delay_s is not None
    able = describe_still(FoundStill("Nikon DSC D750", f"virtual:{tmp_path}"))
    assert able.exposure_range_s is not None
    assert able.exposure_range_s.shortest_s < 0.005 < able.exposure_range_s.longest_s


@needs_gphoto2
def test_a_virtual_camera_takes_more_pictures_than_its_card_ever_holds(tmp_path: Path) -> None:
    """Its port counts to 26, and says that the card is full whatever was deleted; settings outlast that."""
    still = still_rig(tmp_path)
    with still.camera, closing(StillPort(f"virtual:{tmp_path}", "the camera")) as port:
        shown = port.value(SHUTTER_SPEED)
        slower = next(one for one in port.choices(SHUTTER_SPEED) if one != shown and (seconds(one) or 9) < 0.5)
        port.hold(SHUTTER_SPEED, slower)
        assert all(port.release(1e-3) for _ in range(27))
        assert port.value(SHUTTER_SPEED) == slower
    assert still.camera.pictures == 28


@needs_gphoto2
def test_a_camera_that_is_not_served_is_named(tmp_path: Path) -> None:
    still = still_rig(tmp_path)
    with still.camera, open_rig(still.profile) as rig:
        still.camera.stop()
        with pytest.raises(DeviceError, match="start it first"):
            rig.camera.capture(after_s=0.0, timeout_s=5.0)


@needs_aravis
def test_typed_faults_reach_the_camera() -> None:
    with plugged(gige_rig()) as gige:
        assert obey(gige.camera, "loss 2") == ""
        assert gige.camera.faults.lost_packets == pytest.approx(0.002)
        assert obey(gige.camera, "jitter 5") == ""
        assert gige.camera.faults.jitter_s == pytest.approx(0.005)
        for word in ("heartbeat", "unplug", "plug", ""):
            assert obey(gige.camera, word) == ""
        assert all(name in (obey(gige.camera, "help") or "") for name in COMMANDS)
        assert obey(gige.camera, "quit") is None
