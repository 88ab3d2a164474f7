"""Gloss of mesh files: what glTF's metal and roughness become, for model and simulated world alike."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from rig.devices.simulated.mesh.find import find_scene
from rig.files.mesh import read_mesh, read_triangles
from rig.files.mesh_gloss import gloss_of_material, gloss_of_patches
from tests.rig.devices.simulated.mesh.scenes_of_tests import settings_of


def material(**values):
    return SimpleNamespace(**({"baseColorFactor": (255, 255, 255, 255)} | values))


def test_paint_is_a_dielectric() -> None:
    found = gloss_of_material(material(metallicFactor=0.0, roughnessFactor=0.5))
    assert (found.gloss, found.roughness, found.matte_share) == pytest.approx((0.04, 0.25, 0.96))


def test_metal_has_no_matte_part_and_the_gloss_of_its_colour() -> None:
    found = gloss_of_material(material(metallicFactor=1.0, roughnessFactor=0.0, baseColorFactor=(51, 51, 51, 255)))
    assert (found.gloss, found.matte_share) == pytest.approx((0.2, 0.0))
    assert found.roughness == 1e-3


@pytest.mark.parametrize("metal", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("colour", [0, 100, 255])
def test_matte_and_glossy_together_never_create_light(metal: float, colour: int) -> None:
    found = gloss_of_material(
        material(metallicFactor=metal, roughnessFactor=0.3, baseColorFactor=(colour, colour, colour, 255))
    )
    assert found.gloss + found.matte_share * colour / 255 <= 1


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"metallicFactor": 1.0},
        {"roughnessFactor": 0.1},
        {"metallicFactor": 0.5, "roughnessFactor": 0.5, "metallicRoughnessTexture": object()},
        {"metallicFactor": 0.5, "roughnessFactor": 0.5, "baseColorFactor": None},
    ],
)
def test_what_states_nothing_is_matte(values: dict[str, object]) -> None:
    assert gloss_of_material(material(**values)).gloss == 0
    assert gloss_of_material(None).matte_share == 1


def saved(folder: Path) -> Path:
    """Two squares in one plane, of one colour: the first of metal, the second of nothing stated."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 0, -1], [0, 0, -1.0]])
    scene = trimesh.Scene()
    for name, shift, more in (("metal", 0.0, {"metallicFactor": 0.5, "roughnessFactor": 0.5}), ("paint", 2.0, {})):
        square = trimesh.Trimesh(corners + np.array([shift, 0, 0]), [[0, 1, 2], [0, 2, 3]], process=False)
        look = trimesh.visual.material.PBRMaterial(name=name, baseColorFactor=(128, 128, 128, 255), **more)
        square.visual = trimesh.visual.TextureVisuals(material=look)
        scene.add_geometry(square, geom_name=name, node_name=name)
    scene.export(folder / "squares.glb")
    return folder / "squares.glb"


def test_each_patch_has_the_gloss_of_its_triangles(tmp_path: Path) -> None:
    mesh = read_mesh(saved(tmp_path))
    found = gloss_of_patches(read_triangles(tmp_path / "squares.glb"), mesh)
    metal = mesh.centres[:, 0] < 1.5
    assert metal.sum() == 1
    assert found.gloss[metal] == pytest.approx(0.5 * 0.04 + 0.5 * 128 / 255, abs=1e-6)
    assert found.roughness[metal] == pytest.approx(0.25)
    assert found.gloss[~metal] == 0


def test_patches_that_were_moved_off_their_triangles_take_the_nearest_ones(tmp_path: Path) -> None:
    mesh = read_mesh(saved(tmp_path))
    moved = replace(mesh, vertices=mesh.vertices + np.array([0.0, 0.0, 0.03]))
    soup = read_triangles(tmp_path / "squares.glb")
    assert np.array_equal(gloss_of_patches(soup, moved).gloss, gloss_of_patches(soup, mesh).gloss)


def test_the_simulated_world_reads_the_same_gloss(tmp_path: Path) -> None:
    soup = read_triangles(saved(tmp_path))
    scene = find_scene(settings_of(scene="squares.glb", scene_up="y"), tmp_path)
    assert np.array_equal(scene.gloss, soup.gloss)
    assert np.array_equal(scene.roughness, soup.roughness)
    on_metal = scene.gloss > 0
    assert on_metal.sum() == 2
    np.testing.assert_allclose(scene.reflectance[on_metal], 0.48 * 128 / 255, atol=1e-6)
    np.testing.assert_allclose(scene.reflectance[~on_metal], 128 / 255, atol=1e-6)
