"""Whole sessions with the virtual still camera: JPEG as the camera develops it, and raw files."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from rig.run.request import SessionRequest
from rig.run.session import run_session
from rig.terminal import silent
from tests.still import RAW, needs_gphoto2, still_rig


@needs_gphoto2
@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, RAW], ids=["JPEG", "raw"])
def test_a_session_of_a_still_camera_ends_with_a_report(tmp_path: Path, changes: Mapping[str, str]) -> None:
    still = still_rig(tmp_path, **changes)
    with still.camera:
        request = SessionRequest(folder=tmp_path / "session", profile=str(still.path), strategies=("none",))
        result = run_session(request, silent)
    print(result.geometry.rms_px, result.comparison)
    assert result.geometry.rms_px < 0.2
    assert result.comparison is not None
    assert "belong to their pictures by waiting" in (tmp_path / "session" / "report.html").read_text("utf-8")
