"""What `rig simulate --output` writes, and where its projector may stand."""

import csv
import json
from pathlib import Path

import pytest
import trimesh

from rig.cli.app import run_command
from rig.files.ply_mesh import read_ply_mesh

PLACED = ["--projector-at", "1.2,1.2,1.2", "--look-at", "3.6,3.6,1.2", "--fov", "60"]


@pytest.fixture
def written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[Path, list[str]]:
    folder = tmp_path / "light"
    status = run_command(["simulate", "paper-room", "--tolerance", "5", *PLACED, "--output", str(folder), "--json"])
    assert status == 0
    return folder, json.loads(capsys.readouterr().out)["files"]


def test_picture_table_meshes_and_page_are_there(written: tuple[Path, list[str]]) -> None:
    folder, files = written
    assert sorted(Path(one).name for one in files) == sorted(path.name for path in folder.iterdir())
    mesh = trimesh.load(folder / "light.glb", force="mesh")
    ply = read_ply_mesh(folder / "light.ply").to_mesh()
    # All of the room's surface, in both.
    assert mesh.area == pytest.approx(92.16, rel=1e-4)
    assert ply.area == pytest.approx(92.16, rel=1e-9)
    assert "Brightness by surface" in (folder / "simulation.html").read_text(encoding="utf-8")


def test_the_table_keeps_the_energy_of_a_closed_room(written: tuple[Path, list[str]]) -> None:
    with (written[0] / "brightness.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["surface"] for row in rows] == ["floor", "ceiling", "x0", "x1", "y0", "y1"]
    area, direct, indirect = ([float(row[key]) for row in rows] for key in ("area_m2", "direct", "indirect"))
    sent = sum(a * d for a, d in zip(area, direct, strict=True))
    # Integrating cavity: indirect is rho / (1 - rho) times the direct light, on average.
    assert sum(a * h for a, h in zip(area, indirect, strict=True)) == pytest.approx(0.7 / 0.3 * sent, rel=0.01)
    # Aimed at the corner of x1 and y1, 60 degrees wide: nothing falls on the walls behind.
    assert [row["surface"] for row in rows if float(row["direct"]) == 0] == ["x0", "y0"]
    assert float(rows[3]["direct"]) == pytest.approx(float(rows[5]["direct"]), rel=0.01)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--projector-at", "9,9,9", "--look-at", "1,1,1"], "(9, 9, 9) m is in or behind a wall, or outside"),
        (["--projector-at", "1,1,1"], "--projector-at and --look-at belong together"),
        (["--projector-at", "1,1", "--look-at", "2,2,1"], "--projector-at 1,1: give three numbers in metres"),
        (["--projector-at", "1,1,1", "--look-at", "nan,1,1"], "--look-at nan,1,1: give metres"),
        (["--projector-at", "1,1,1", "--look-at", "1,1,1"], "the aim is at the lens"),
        ([*PLACED[:4], "--fov", "200"], "--fov 200: lenses have 1 ... 160 degrees"),
        ([*PLACED, "--light", "floor"], "takes the place of --light"),
    ],
)
def test_a_projector_that_cannot_be_is_refused(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command(["simulate", "paper-room", "--tolerance", "5", *options]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


def test_a_folder_that_cannot_be_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert run_command(["simulate", "furnace", "--tolerance", "9", "-o", str(tmp_path / "file" / "in")]) == 2
    assert "no folder for files" in capsys.readouterr().err
