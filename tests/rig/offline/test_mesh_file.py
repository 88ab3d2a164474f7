"""Mesh files of ``rig simulate``: what was mended is said, what is refused can be looked at."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

import sim.planning.simplified_plan as simplified_plan
from rig.cli.app import run_command
from rig.errors import UsageError
from rig.files.ply_mesh import write_ply_mesh
from rig.offline.mesh_file import COLOURS, SOUND, MeshOptions
from rig.offline.simulate import SimulationRequest, run_simulate
from rig.terminal import silent
from sim.geometry.mending.mend import facets_of
from sim.geometry.mending.remarks import Facets
from sim.geometry.mending.simplification import simplified
from sim.scenes.cluttered import corner_with_ball

CORNERS = "v 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nv 0 0 2.5\nv 4 0 2.5\nv 4 3 2.5\nv 0 3 2.5\n"
OUTWARDS = ("4 3 2 1", "6 7 8 5", "2 6 5 1", "3 7 6 2", "4 8 7 3", "1 5 8 4")


def room(folder: Path, *, corners: str = CORNERS, faces=OUTWARDS, more: str = "") -> str:
    path = folder / "room.obj"
    path.write_text(corners + "".join(f"f {face}\n" for face in faces) + more, encoding="utf-8")
    return str(path)


def request(scene: str, **options) -> SimulationRequest:
    return SimulationRequest(scene=scene, tolerance=4.0, reflectance=(0.7,), mesh=MeshOptions(**options))


def test_a_room_that_looks_outwards_is_turned_and_it_is_said(tmp_path, capsys):
    arguments = ["simulate", room(tmp_path), "--reflectance", "0.7", "--tolerance", "4"]
    assert run_command(arguments) == 0
    assert "mesh, mended: inside out: 12 facets looked into nothing" in capsys.readouterr().out
    assert run_command([*arguments, "--json"]) == 0
    mesh = json.loads(capsys.readouterr().out)["mesh"]
    assert mesh["file_facets"] == 12
    assert [(one["kind"], one["outcome"], one["facets"]) for one in mesh["remarks"]] == [("inside out", "mended", 12)]


def test_an_l_shaped_room_of_polygons_is_simulated(tmp_path):
    plan = [(0, 0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4)]
    corners = "".join(f"v {x} {y} {z}\n" for z in (0, 2.5) for x, y in plan)
    walls = [f"{k + 1} {k + 7} {(k + 1) % 6 + 7} {(k + 1) % 6 + 1}" for k in range(6)]
    scene = room(tmp_path, corners=corners, faces=["1 2 3 4 5 6", "12 11 10 9 8 7", *walls])
    result = run_simulate(request(scene), silent, check=True)
    assert result.mesh.remarks == ()
    assert result.actual.closure_max < 0.05
    assert result.actual.error <= 4.0


def test_what_is_refused_is_written_in_colours_where_it_was_asked_for(tmp_path):
    twice = "v 1 1 0\nv 3 1 0\nv 1 2.5 0\nf 9 11 10\n"
    scene, seen = room(tmp_path, more=twice), tmp_path / "seen.ply"
    with pytest.raises(UsageError, match=r"overlapping: 3 facets .*\n--faults FILE.ply writes the facets"):
        run_simulate(request(scene), silent)
    assert not seen.exists()
    with pytest.raises(UsageError, match=r"seen.ply: the facets in colours \(red: refused"):
        run_simulate(request(scene, faults=seen), silent)
    data = seen.read_bytes()
    assert b"overlapping: 3 facets share area" in data.partition(b"end_header")[0]
    facets = np.frombuffer(data[-13 * 16 :], dtype=[("n", "u1"), ("corners", "<i4", 3), ("rgb", "u1", 3)])
    colours = [tuple(int(x) for x in row) for row in facets["rgb"]]
    assert colours.count(COLOURS["refused"]) == 3
    assert set(colours) == {SOUND, COLOURS["mended"], COLOURS["refused"]} - {SOUND} | ({SOUND} & set(colours))


def test_the_unit_is_asked_about_unless_it_is_given(tmp_path):
    corners = np.array([line.split()[1:] for line in CORNERS.splitlines()], dtype=float)
    scene = room(tmp_path, corners="".join("v {} {} {}\n".format(*(100 * corner)) for corner in corners))
    said = [one.message for one in run_simulate(request(scene), silent).mesh.remarks if one.kind == "unit"]
    assert said == [
        "read in m the scene is 400 m large; is it --unit cm (4 m) or --unit in (10.2 m)? Shares of white do not "
        "depend on it"
    ]
    assert "unit" not in {one.kind for one in run_simulate(request(scene, unit="cm"), silent).mesh.remarks}


@pytest.mark.parametrize(
    ("options", "message"),
    [({"faults": Path("seen.png")}, "a name that ends in .ply"), ({"merge_mm": -1.0}, "a distance of 0 or more")],
)
def test_options_that_cannot_be_meant_are_refused(tmp_path, options, message):
    with pytest.raises(UsageError, match=message):
        run_simulate(request(room(tmp_path), **options), silent)


def ball_file(folder: Path, facets: int) -> tuple[str, Facets]:
    vertices = corner_with_ball(facets).vertices
    quads = (vertices[:, 2] != vertices[:, 3]).any(axis=1)
    corners = np.concatenate([vertices[:, :3], vertices[quads][:, [0, 2, 3]]])
    write_ply_mesh(folder / "ball.ply", corners, np.full((len(corners), 3), 200, dtype=np.uint8), ["a ball"])
    numbers = np.arange(3 * len(corners)).reshape(-1, 3)
    return str(folder / "ball.ply"), facets_of(corners.reshape(-1, 3), numbers, np.array(0.6))


def test_very_many_facets_are_simplified_as_far_as_the_tolerance_allows(tmp_path, monkeypatch):
    pytest.importorskip("fast_simplification")
    monkeypatch.setattr(simplified_plan, "PLANNED_AS_THEY_ARE", 3_000)
    monkeypatch.setattr(simplified_plan, "COARSEST", 500)
    scene, facets = ball_file(tmp_path, 6_000)
    told = {}

    def on_step(label, done, total):
        told.setdefault(label, []).append(done / total)

    coarse, fine = (
        run_simulate(SimulationRequest(scene=scene, tolerance=tolerance, light="uniform", reflectance=(0.6,)), on_step)
        for tolerance in (8.0, 2.5)
    )
    assert told["simplify the mesh"][:3] == [0.0, 0.5, 1.0]
    assert told["hold it against all facets"][:4] == [0.0, 0.7, 0.9, 1.0]
    assert coarse.mesh.file_facets == facets.n_facets
    assert coarse.mesh.facets < 1_000 < fine.plan.patches
    assert coarse.estimated.error <= 8.0
    assert fine.estimated.error <= 2.5
    assert 0 < coarse.mesh.simplified_within_m < 0.05


def test_without_the_library_one_line_says_which(monkeypatch):
    monkeypatch.setitem(sys.modules, "fast_simplification", None)
    from sim.errors import SimulationError

    facets = facets_of(np.eye(3), np.array([[0, 1, 2]]), np.array(0.5))
    with pytest.raises(SimulationError, match=r"pip install 'procam-rig\[meshes\]'"):
        simplified(facets, 1)
