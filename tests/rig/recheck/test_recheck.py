"""A session's rig is looked at again: what moved is named, what stands still is told so, and the session stays."""

import hashlib
import json
import shutil
from pathlib import Path

import pytest

from rig.cli.app import run_command
from rig.devices.simulated.devices import SimulatedProjector
from rig.errors import CalibrationFailed, SessionError
from rig.recheck.records import RecheckRequest
from rig.recheck.run import run_recheck
from rig.session import Session
from rig.session.alignment import aligned_folder, rechecks_of
from tests.rig.conftest import Finished

ROOT = Path(__file__).parents[3]
TINY = (ROOT / "hw_profiles" / "ci-tiny.toml").read_text()


@pytest.fixture
def session(finished: Finished, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished.folder, tmp_path / "session"))


def profile(folder: Path, *, replaced: dict[str, str]) -> str:
    text = TINY
    for old, new in replaced.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "other.toml"
    path.write_text(text)
    return str(path)


def files_of(folder: Path) -> dict[str, str]:
    there = [path for path in folder.rglob("*") if path.is_file() and "rechecks" not in path.parts]
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in there}


def test_a_rig_that_stands_still_is_within_its_limits(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = files_of(session)
    assert run_command(["recheck", str(session), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["moved"] == "nothing"
    assert found["device_s"] < 60
    assert found["camera"]["image_px"] < 0.05
    assert files_of(session) == before
    assert "speckle is noise" in Path(found["report"]).read_text()


def test_a_turned_camera_and_a_dimmer_lamp_are_both_found(session: Path, tmp_path: Path) -> None:
    other = profile(
        tmp_path,
        replaced={
            "[[simulation.camera]]\n": "[[simulation.camera]]\nturned_deg = [0.0, 0.5, 0.0]\n",
            "flux = 10.0": "flux = 9.0",
        },
    )
    found = run_recheck(RecheckRequest(folder=session, profile=other))
    assert found.moved == "camera"
    assert found.camera.turned_deg == pytest.approx(0.5, abs=0.03)
    assert found.light.lamp_gain == pytest.approx(0.9, abs=0.01)
    assert [row.what for row in found.limits if not row.met] == ["camera moved", "change of the lamp"]
    assert "The camera moved, the projector did not" in found.summary


def test_a_realigned_session_takes_the_place_of_the_first_which_stays(session: Path, tmp_path: Path) -> None:
    other = profile(
        tmp_path, replaced={"[[simulation.projector]]\n": "[[simulation.projector]]\nmoved_m = [0.03, -0.02, 0.01]\n"}
    )
    before = files_of(session)
    found = run_recheck(RecheckRequest(folder=session, profile=other, realign=True))
    assert found.moved == "projector"
    assert found.projector.moved_mm == pytest.approx(37.4, rel=0.1)
    assert found.realigned is not None
    assert found.realigned.error_after is not None
    assert found.realigned.error_before is not None
    assert found.realigned.error_after < 1.1 * found.realigned.error_before
    assert aligned_folder(session) == Path(found.realigned.folder)
    assert files_of(session) == before
    with Session.read(found.realigned.folder) as realigned:
        assert realigned.is_finished("model")


def test_a_projector_that_is_off_is_named_and_costs_two_photographs(session: Path, tmp_path: Path) -> None:
    other = profile(tmp_path, replaced={"flux = 10.0": "flux = 0.001"})
    with pytest.raises(CalibrationFailed, match="the projector is off, asleep or covered"):
        run_recheck(RecheckRequest(folder=session, profile=other))
    (look,) = rechecks_of(session)
    with Session.read(look) as begun:
        gray = begun.begun("gray")
        assert gray is not None
        assert len(gray.frame_names) == 2


def test_a_projector_that_was_set_to_rear_projection_is_named(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    show = SimulatedProjector.show
    monkeypatch.setattr(
        SimulatedProjector, "show", lambda self, codes, *, name: show(self, codes[:, ::-1].copy(), name=name)
    )
    with pytest.raises(CalibrationFailed, match="one of the pictures is mirrored"):
        run_recheck(RecheckRequest(folder=session))


def test_light_in_the_room_is_named(session: Path, tmp_path: Path) -> None:
    other = profile(tmp_path, replaced={"ambient = 0.0004": "ambient = 5.0"})
    with pytest.raises(CalibrationFailed, match="a light is on, or daylight"):
        run_recheck(RecheckRequest(folder=session, profile=other))


def test_another_room_is_not_explained_by_a_move(session: Path, tmp_path: Path) -> None:
    other = profile(
        tmp_path,
        replaced={
            "[simulation] ": "[simulation] ",
            "size_m = [4.8, 4.8, 2.4]\ncell": "size_m = [3.9, 4.1, 2.1]\ncell",
            "look_at_m = [4.60, 4.55, 1.12]": "look_at_m = [3.8, 3.5, 1.0]",
            "look_at_m = [4.80, 4.72, 1.20]": "look_at_m = [3.8, 3.9, 0.9]",
        },
    )
    with pytest.raises(CalibrationFailed, match=r"another rig's session|calibrate a new session"):
        run_recheck(RecheckRequest(folder=session, profile=other))


def test_another_rigs_profile_is_refused_before_anything_opens(session: Path) -> None:
    with pytest.raises(SessionError, match="is not the rig of"):
        run_recheck(RecheckRequest(folder=session, profile="sim-room"))
    assert rechecks_of(session) == []


def test_a_session_that_was_never_calibrated_is_refused(tmp_path: Path) -> None:
    from rig.profile.schema import load_profile

    with Session.open(tmp_path / "empty", load_profile("ci-tiny")):
        pass
    with pytest.raises(SessionError, match="is not calibrated"):
        run_recheck(RecheckRequest(folder=tmp_path / "empty"))
