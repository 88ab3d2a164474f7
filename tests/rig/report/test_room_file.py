"""The measured room as binary glTF: what another reader finds in it is what the session measured."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from rig.errors import UsageError
from rig.report.scene.room_file import RoomFile, export_room
from rig.report.scene.shadows import FATES, shadow_map
from rig.report.scene.view import scene_of
from rig.session import Session
from rig.stages.model import FittedScene, load_model
from tests.rig.conftest import Finished


@pytest.fixture(scope="module")
def model(finished: Finished) -> FittedScene:
    return load_model(Session.read(finished.folder))


@pytest.fixture(scope="module")
def written(finished: Finished, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RoomFile]:
    path = tmp_path_factory.mktemp("room") / "room.glb"
    return path, export_room(finished.folder, path)


def head_of(path: Path) -> dict:
    """The JSON of a GLB, by the lengths that its specification gives."""
    content = path.read_bytes()
    magic, version, total, length, kind = struct.unpack("<IIIII", content[:20])
    assert (magic, version, total, kind) == (0x46546C67, 2, len(content), 0x4E4F534A)
    return json.loads(content[20 : 20 + length])


def test_another_reader_finds_the_walls_where_they_were_measured(written, model: FittedScene) -> None:
    path, said = written
    scene = trimesh.load_scene(path)
    assert set(scene.geometry) == set(said.parts)
    assert set(said.parts) == set(model.scene_model.walls)
    # y is up in glTF: x, y, z there are x, z, -y here.
    low, high = scene.bounds
    corners = model.scene_model.scene.vertices.reshape(-1, 3)
    assert [low[0], -high[2], low[1]] == pytest.approx(corners.min(axis=0).tolist(), abs=1e-5)
    assert [high[0], -low[2], high[1]] == pytest.approx(corners.max(axis=0).tolist(), abs=1e-5)
    assert scene.area == pytest.approx(model.scene_model.scene.areas.sum(), rel=1e-5)
    floor = scene.geometry["floor"]
    assert (floor.face_normals[:, 2] > 0.99).all()


def test_reflectance_is_its_colour_and_confidence_an_attribute(written, model: FittedScene) -> None:
    scene = trimesh.load_scene(written[0])
    for name, mesh in scene.geometry.items():
        own = model.scene_model.scene.region == model.scene_model.walls.index(name)
        picture = np.asarray(mesh.visual.material.baseColorTexture.convert("L"), dtype=float) / 255
        uv = mesh.visual.uv
        assert uv.min() >= 0
        assert uv.max() <= 1
        # Of each triangle's middle; trimesh counts v from below.
        middle = uv[mesh.faces].mean(axis=1)
        rows = ((1 - middle[:, 1]) * picture.shape[0]).astype(int)
        codes = picture[rows, (middle[:, 0] * picture.shape[1]).astype(int)]
        linear = ((codes + 0.055) / 1.055) ** 2.4
        assert np.median(linear) == pytest.approx(np.median(model.scene_model.scene.reflectance[own]), abs=0.05)
        confidence = mesh.vertex_attributes["_CONFIDENCE"]
        assert set(np.unique(confidence)) <= {0.0, 0.5, 1.0}
    assert any((mesh.vertex_attributes["_CONFIDENCE"] == 1).any() for mesh in scene.geometry.values())


def test_devices_are_cameras_that_look_where_they_look(written, model: FittedScene) -> None:
    head = head_of(written[0])
    found = model.scene_model
    for name, device in (*found.cameras.items(), *found.projectors.items()):
        node = next(node for node in head["nodes"] if node["name"] == name)
        matrix = np.array(node["matrix"]).reshape(4, 4).T
        pose = device.device.pose
        assert matrix[:3, 3] == pytest.approx(pose.position_m)
        assert -matrix[:3, 2] == pytest.approx(pose.rotation[2])
        assert matrix[:3, 1] == pytest.approx(-pose.rotation[1])
        field = head["cameras"][node["camera"]]["perspective"]["yfov"]
        lens = device.device.lens
        assert field == pytest.approx(2 * np.arctan(lens.height_px / 2 / lens.focal_px[1]))
        assert node["extras"]["kind"] == ("camera" if name in found.cameras else "projector")


def test_a_name_that_is_no_glb_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"ends in \.glb"):
        export_room(tmp_path / "no-session", tmp_path / "room.obj")
    with pytest.raises(UsageError, match="there is no folder"):
        export_room(tmp_path / "no-session", tmp_path / "nowhere" / "room.glb")


def test_the_fates_of_all_projector_pixels_add_up(model: FittedScene) -> None:
    shadows = shadow_map(model)
    assert sum(shadows.shares) == pytest.approx(1)
    steered = np.isin(shadows.fate, [FATES.index("steered"), FATES.index("on two surfaces")])
    assert np.array_equal(steered.ravel(), model.room.active)
    # An empty room hides nothing.
    assert shadows.shares[FATES.index("out of the camera's sight")] < 0.002


def test_the_view_of_page_and_report_has_all_patches_and_a_tile_for_each(
    finished: Finished, model: FittedScene
) -> None:
    view = scene_of(finished.folder)
    assert len(view.patches) == model.scene_model.scene.n_patches
    assert (view.texture.width_px // view.texture.tile_px) * (view.texture.height_px // view.texture.tile_px) >= len(
        view.patches
    )
    page = (finished.folder / "report.html").read_text("utf-8")
    begin = page.index('id="room-data">') + len('id="room-data">')
    data = json.loads(page[begin : page.index("</script>", begin)])
    assert len(data["patches"]) == len(view.patches)
