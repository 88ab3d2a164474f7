"""Numbers of a simulated rig in a wrong unit are refused with the unit that was probably meant."""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.cli.app import run_command

Capture = pytest.CaptureFixture[str]
TINY = Path("hw_profiles/ci-tiny.toml").read_text("utf-8")


@pytest.mark.parametrize(
    ("table", "key", "value", "said"),
    [
        ("simulation", "size_m", "[3200.0, 3200.0, 2400.0]", "metres, not centimetres or millimetres?"),
        ("simulation", "cell_size_m", "120.0", "metres, not centimetres or millimetres?"),
        ("simulation", "ambient_flicker_hz", "100000.0", "hertz, not kilohertz?"),
        ("simulation.camera", "position_m", "[900.0, 1600.0, 1200.0]", "metres, not centimetres or millimetres?"),
        ("simulation.camera", "full_well_e", "1e9", "electrons, not digital numbers?"),
        ("simulation.camera", "readout_s", "16.0", "seconds, not milliseconds?"),
        ("simulation.camera", "roll_deg", "3600.0", "degrees?"),
        ("simulation.projector", "latency_s", "50.0", "seconds, not milliseconds?"),
        ("simulation.projector", "look_at_m", "[0.0, 9000.0, 0.0]", "metres, not centimetres or millimetres?"),
        ("simulation.projector", "lamp_warm_up_s", "60000.0", "seconds, not milliseconds or minutes?"),
    ],
)
def test_a_unit_that_was_mistaken_is_named(
    capsys: Capture, tmp_path: Path, table: str, key: str, value: str, said: str
) -> None:
    lines, inside = [], ""
    for line in TINY.splitlines():
        inside = line.split("#")[0].strip("[] ") if line.startswith("[") else inside
        if inside == table and line.split("=")[0].strip() == key:
            continue
        lines.append(line)
        if line.startswith("[") and inside == table:
            lines.append(f"{key} = {value}")
    path = tmp_path / "lab.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    assert run_command(["profile", "check", str(path)]) == 2
    captured = capsys.readouterr()
    words = " ".join((captured.out + captured.err).split())
    assert f"{table}.{key}" in words
    assert said in words
