"""What a check says of the network between a camera and this machine."""

from pathlib import Path

import pytest

from rig.self_check.run import run_check
from rig.terminal import silent
from tests.gige import gige_rig, needs_aravis, plugged


@needs_aravis
def test_small_buffers_and_lost_packets_are_rows_with_the_setting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.devices.genicam.setup.socket_buffer_limit", lambda: 212992)
    gige = gige_rig()
    path = tmp_path / "gige.toml"
    path.write_bytes(gige.profile.raw)
    with plugged(gige):
        gige.camera.lose_packets(0.005)
        result = run_check(str(path), silent, only=("exposure",))
        gige.camera.lose_packets(0.0)
    (row,) = result.parts["transport"].verdicts
    assert row.value == 2
    assert "sysctl -w net.core.rmem_max=8388608" in row.advice
    assert "frames came incomplete" in row.advice
    assert "a network card and a cable of its own" in row.advice
