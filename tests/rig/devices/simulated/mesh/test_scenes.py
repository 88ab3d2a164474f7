"""Scenes by name or from files: the library is whole, materials are those of file and profile, refusals are true."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydantic import ValidationError

from rig.devices.simulated.mesh.find import find_scene
from rig.devices.simulated.mesh.light_grid import make_light_grid
from rig.devices.simulated.mesh.scene import TriangleScene, made_fit
from rig.devices.simulated.mesh.tracer import Tracer
from rig.devices.simulated.mesh.world import MeshWorld, exchange_of
from rig.devices.simulated.settings import SimulatedMaterial, SimulationSettings
from rig.devices.simulated.worlds.scenes import SCENES, library_scene
from rig.devices.simulated.worlds.shapes import quad, room
from rig.errors import ProfileError
from rig.profile.schema import Profile, load_profile
from tests.rig.devices.simulated.mesh.scenes_of_tests import CAMERA, PROJECTOR, scene_of, settings_of, walls

SIZE = (4.8, 4.8, 2.4)
POSTER = {"face": "x1", "lower": (0.1, 0.1), "upper": (0.2, 0.2), "reflectance": 0.4}
ROOT = Path(__file__).parents[5]


@pytest.fixture(scope="module")
def furnished_profile() -> Profile:
    return load_profile(ROOT / "hw_profiles" / "sim-furnished.toml")


def library_settings(profile: Profile, **changes: object) -> SimulationSettings:
    assert profile.simulation is not None
    return SimulationSettings.model_validate(profile.simulation.model_dump(by_alias=True) | changes)


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_of_the_library_stands_in_its_room_and_every_ray_meets_it(name: str) -> None:
    pytest.importorskip("embreex")
    scene = made_fit(library_scene(name, SIZE), 0.3)
    corners = scene.triangles_m.reshape(-1, 3)
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [(0, 0, 0), SIZE], atol=1e-9)
    ways = np.random.default_rng(1).normal(size=(20_000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    hits = Tracer(scene).hits(np.array([1.0, 1.0, 1.2]), ways)
    assert hits.escaped.mean() < 1e-3
    assert not hits.is_back.any()  # whatever the devices see is seen from in front


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_of_the_library_is_photographed_with_one_line_changed(name: str, furnished_profile: Profile) -> None:
    pytest.importorskip("embreex")
    settings = library_settings(furnished_profile, scene=name, rays=16, cell_size_m=0.5, pixel_samples=1)
    small = settings.with_device(
        settings.camera.model_copy(update={"focal_px": 26.6, "principal_point_px": (31.5, 23.5)})
    )
    small = small.with_device(small.projector.model_copy(update={"focal_px": 20.2, "principal_point_px": (23.5, 17.5)}))
    world = MeshWorld(small, exchange_of(find_scene(small, ROOT), small), CAMERA, PROJECTOR)
    light = world.light(np.full(PROJECTOR, 255, np.uint8))
    assert np.isfinite(light.total).all()
    assert light.direct.min() >= 0
    assert light.global_.min() > 0


def saved(tmp_path: Path, name: str = "room.glb") -> str:
    """A room of which the floor is red and the rest has no colour."""
    scene = trimesh.Scene()
    for part, corners in room((3.0, 3.0, 2.4)).items():
        mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(6).reshape(2, 3), process=False)
        if part == "floor":
            material = trimesh.visual.material.PBRMaterial(name="carpet", baseColorFactor=(204, 51, 51, 255))
            mesh.visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(mesh, geom_name=part, node_name=part)
    scene.export(tmp_path / name)
    return name


def test_a_file_brings_its_colours_and_the_profile_the_rest(tmp_path: Path) -> None:
    materials = (
        SimulatedMaterial(name="*", reflectance=(0.6,)),
        SimulatedMaterial(name="carpet", gloss=0.1, roughness=0.2),
    )
    settings = settings_of(scene=saved(tmp_path), scene_up="z", material=materials)
    scene = find_scene(settings, tmp_path)
    on_floor = scene.material == scene.materials.index("carpet")
    assert on_floor.sum() == 2
    np.testing.assert_allclose(scene.reflectance[on_floor], np.tile([0.8, 0.2, 0.2], (2, 1)), atol=1e-6)
    assert set(scene.gloss[on_floor]) == {0.1}
    assert set(scene.roughness[on_floor]) == {0.2}
    np.testing.assert_allclose(scene.reflectance[~on_floor], 0.6)
    assert np.ptp(scene.triangles_m.reshape(-1, 3), axis=0) == pytest.approx((3.0, 3.0, 2.4))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scene": "furnishd", "size_m": SIZE}, "is 'furnishd', should be one of furnished, cylinder, .*mesh file"),
        ({"scene": "nowhere.glb"}, r"nowhere\.glb: no such file"),
        ({"scene": "room.off"}, "unknown mesh format '.off'"),
        (
            {"scene": "furnished", "size_m": SIZE, "material": ({"name": "sofa", "gloss": 0.1},)},
            "the scene furnished has none named 'sofa'; it has floor, .*table, column, box",
        ),
        (
            {"scene": "furnished", "size_m": SIZE, "material": ({"name": "floor", "gloss": 0.6, "reflectance": 0.5},)},
            "material 'floor' reflects 1.1 in all, more than 0.99",
        ),
    ],
)
def test_a_scene_that_cannot_be_used_is_refused_with_the_reason(
    tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    settings = settings_of(**changes)
    with pytest.raises(ProfileError, match=message):
        exchange_of(find_scene(settings, tmp_path), settings)


def test_cells_that_fit_in_no_memory_are_refused_when_the_profile_is_read() -> None:
    with pytest.raises(ValidationError, match=r"cell_size_m 0\.01 m makes 9\.22e\+05 cells .* the limit is 20000"):
        settings_of(scene="furnished", size_m=SIZE, cell_size_m=0.01)


def test_triangles_without_a_colour_are_counted(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match=r"10 of 12 triangles have no colour; give them one: .*name = \"\*\""):
        find_scene(settings_of(scene=saved(tmp_path)), tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scene": None}, "size_m .*give the width, depth and height"),
        ({"scene": None, "size_m": SIZE}, "reflectance: missing"),
        ({"scene": "a.ply", "size_m": SIZE}, "a mesh file has its own"),
        ({"scene": "dome", "size_m": (1.0, 1.0, 1.0)}, r"position_m .* is outside size_m"),
        (
            {
                "scene": "dome",
                "size_m": SIZE,
                "posters": ({"face": "x1", "lower": (0.1, 0.1), "upper": (0.2, 0.2), "reflectance": 0.4},),
            },
            "posters: only for a box",
        ),
    ],
)
def test_keys_of_a_box_and_of_a_scene_do_not_mix(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        settings_of(**changes)


def test_without_embree_the_message_names_the_command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "embreex.rtcore_scene", None)
    settings = settings_of(scene="dome", size_m=SIZE)
    with pytest.raises(ProfileError, match=r"needs Embree, .*: pip install 'procam-rig\[world\]'") as caught:
        exchange_of(find_scene(settings, tmp_path), settings)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("device", ["camera", "projector"])
def test_a_device_that_looks_past_the_scene_is_named(device: str) -> None:
    pytest.importorskip("embreex")
    away = {"position_m": (10.0, 10.0, 1.0), "look_at_m": (20.0, 20.0, 1.0)}
    settings = settings_of(**{device: away}, rays=16)
    with pytest.raises(ProfileError, match=rf"simulation\.{device}\.{device}: (sees|lights) nothing of the scene"):
        MeshWorld(settings, exchange_of(scene_of(walls()), settings), CAMERA, PROJECTOR)


def test_slivers_are_halved_until_they_are_none_and_nothing_is_lost() -> None:
    strip = {"strip": quad((0, 0, 0), (5.0, 0, 0), (0, 0.02, 0)), "point": np.zeros((1, 3, 3))}
    fit = made_fit(scene_of(strip), 0.3)
    area = np.linalg.norm(
        np.cross(fit.triangles_m[:, 1] - fit.triangles_m[:, 0], fit.triangles_m[:, 2] - fit.triangles_m[:, 0]), axis=1
    )
    assert area.sum() / 2 == pytest.approx(5.0 * 0.02)
    assert make_light_grid(fit, 0.2).n_cells < 1000  # cut into similar triangles: 40 000
    assert set(fit.material) == {0}


def test_a_corner_that_is_no_number_is_refused() -> None:
    scene: TriangleScene = scene_of({"strip": np.full((1, 3, 3), np.nan)})
    with pytest.raises(ProfileError, match="a corner is not a number"):
        made_fit(scene, 0.3)
