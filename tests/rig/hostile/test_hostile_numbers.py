"""Numbers that are numbers but overflow when they are multiplied: refused in words, wherever they stand.

A warning of numpy is an error in the tests, so a product that begins to overflow is found here before it is wrong.
"""

import base64
import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh

from rig.profile.schema import load_profile
from tests.rig.hostile.conftest import ANSWERS, Said
from tests.rig.hostile.mutations import with_number
from tests.rig.offline.test_scan import write_manifest, write_photographs

pytestmark = pytest.mark.timeout(60, func_only=True)
HUGE = (b"1e300", b"-1e155", b"1e-300")


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photographs")
    write_photographs(folder)
    write_manifest(folder)
    return folder


def finite(words: str) -> bool:
    """Whether all numbers of a result are numbers."""
    return all(math.isfinite(value) for value in json.loads(words).values() if isinstance(value, float))


@pytest.mark.parametrize("place", range(36))
def test_in_a_list_of_corners_or_its_manifest(
    rig: Callable[..., Said], boards: Path, tmp_path: Path, place: int
) -> None:
    path = boards / ("lenses.toml", "corners.vnl", "projector.vnl")[place % 3]
    data = path.read_bytes()
    path.write_bytes(with_number(data, 37 * (place // 3) + place, HUGE[place // 3 % 3]))
    try:
        found = rig("lenses", boards / "lenses.toml", "-o", tmp_path / "out.toml", "--json")
    finally:
        path.write_bytes(data)
    assert (tmp_path / "out.toml").exists() == bool(found.out)


@pytest.mark.parametrize("place", range(45))
def test_in_a_manifest_of_photographs(rig: Callable[..., Said], photographs: Path, tmp_path: Path, place: int) -> None:
    path = photographs / "replay.toml"
    data = path.read_bytes()
    path.write_bytes(with_number(data, place // 3 * 2 + place, HUGE[place % 3]))
    try:
        scanned = rig("scan", path, "-o", tmp_path / "cloud.ply", "--json")
    finally:
        path.write_bytes(data)
    there = (tmp_path / "cloud.ply").exists()
    assert there == bool(scanned.out)
    assert not there or (scanned.status in ANSWERS and finite(scanned.out))


@pytest.mark.parametrize("place", range(60))
def test_in_a_profile(rig: Callable[..., Said], tmp_path: Path, place: int) -> None:
    path = tmp_path / "profile.toml"
    text = load_profile("ci-tiny").path.read_bytes()
    path.write_bytes(with_number(text, place, HUGE[place % 3]))
    checked = rig("profile", "check", path)
    planned = rig("run", tmp_path / "new", "-p", path, "--dry-run")
    assert (planned.status == 0) <= (checked.status == 0)


def room(kind: str, matrix_scale: float) -> bytes:
    box = trimesh.creation.box((2.0, 3.0, 2.5))
    box.invert()
    if kind == "obj":
        return str(box.export(file_type="obj")).encode()
    parts = trimesh.Scene(box).export(file_type="gltf")
    scene = json.loads(parts["model.gltf"])
    for node in scene["nodes"]:
        if "mesh" in node:
            node["matrix"] = [matrix_scale, 0, 0, 0, 0, matrix_scale, 0, 0, 0, 0, matrix_scale, 0, 0, 0, 0, 1]
    for buffer in scene["buffers"]:
        coded = base64.b64encode(parts[buffer["uri"]]).decode()
        buffer["uri"] = f"data:application/octet-stream;base64,{coded}"
    return json.dumps(scene).encode()


@pytest.mark.parametrize("scale", [1e200, 1e-200, 1e308])
def test_in_the_matrix_of_a_scene(rig: Callable[..., Said], tmp_path: Path, scale: float) -> None:
    path = tmp_path / "room.gltf"
    path.write_bytes(room("gltf", scale))
    assert rig("simulate", path, "--reflectance", "0.5", "--tolerance", "50").status in (1, 2)


@pytest.mark.parametrize("place", range(12))
def test_in_a_corner_of_a_mesh(rig: Callable[..., Said], tmp_path: Path, place: int) -> None:
    path = tmp_path / "room.obj"
    path.write_bytes(with_number(room("obj", 1.0), place + 1, HUGE[place % 3]))
    simulated = rig("simulate", path, "--reflectance", "0.5", "--tolerance", "50", "--memory-mb", "500", "--json")
    if simulated.status == 0:
        assert json.loads(simulated.out)["actual"]["energy_balance"] < 1e-2
