"""Whole sessions over emulated cameras: GigE that loses packets and is unplugged once, and still cameras."""

import threading
from collections.abc import Mapping
from pathlib import Path

import pytest

from rig.run.request import SessionRequest
from rig.run.session import run_session
from rig.session import Session
from rig.stages.photograph import frame_notes
from rig.terminal import silent
from tests.gige import gige_rig, needs_aravis, plugged
from tests.still import RAW, needs_gphoto2, still_rig

LOST = 0.002
UNPLUGGED_AT = 60
"""Pictures after which the cable is pulled."""


@needs_aravis
@pytest.mark.slow
def test_lost_packets_and_a_pulled_cable_cost_time_and_nothing_else(tmp_path: Path) -> None:
    gige = gige_rig()
    path = tmp_path / "gige.toml"
    path.write_bytes(gige.profile.raw)
    ended = threading.Event()

    def pull() -> None:
        while gige.camera.frames < UNPLUGGED_AT and not ended.wait(0.05):
            pass
        gige.camera.unplug()
        ended.wait(1.0)
        gige.camera.plug()

    with plugged(gige):
        gige.camera.lose_packets(LOST)
        puller = threading.Thread(target=pull)
        puller.start()
        try:
            request = SessionRequest(folder=tmp_path / "session", profile=str(path), strategies=("none",))
            result = run_session(request, silent)
        finally:
            ended.set()
            puller.join()
    with Session.open(tmp_path / "session") as session:
        kinds = {note.event for note in frame_notes(session)}
    assert {"unplugged", "replugged"} <= kinds
    assert result.geometry.rms_px < 0.125  # of the simulated camera in this room 0.11
    assert result.comparison is not None
    assert result.comparison.within_3_sigma > 0.97
    assert result.comparison.rmse < 1.25 * result.comparison.noise_rms


@needs_gphoto2
@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, RAW], ids=["JPEG", "raw"])
def test_a_session_of_a_still_camera_ends_with_a_report(tmp_path: Path, changes: Mapping[str, str]) -> None:
    still = still_rig(tmp_path, **changes)
    with still.camera:
        request = SessionRequest(folder=tmp_path / "session", profile=str(still.path), strategies=("none",))
        result = run_session(request, silent)
    assert result.geometry.rms_px < 0.2
    assert result.comparison is not None
    assert "belong to their pictures by waiting" in (tmp_path / "session" / "report.html").read_text("utf-8")
