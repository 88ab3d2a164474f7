"""Worlds are made once for as long as the same are asked for, and made anew by all that may change them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from rig.devices.clock import VirtualClock
from rig.devices.simulated import stage
from rig.devices.simulated.rigs import from_profile, simulated_world_of, simulated_worlds_of
from rig.devices.simulated.settings import SimulatedMaterial
from rig.errors import ProfileError
from rig.profile.schema import Profile


@pytest.fixture
def coarse(tiny_profile: Profile) -> Profile:
    return changed(tiny_profile, cell_size_m=0.5, pixel_samples=1)


def changed(profile: Profile, **settings: object) -> Profile:
    assert profile.simulation is not None
    return profile.model_copy(update={"simulation": profile.simulation.model_copy(update=settings)})


def with_narrower_camera(profile: Profile) -> Profile:
    return profile.model_copy(update={"cameras": (profile.camera.model_copy(update={"width_px": 100}),)})


def test_the_same_profile_has_the_same_world_and_its_devices_too(coarse: Profile) -> None:
    (world,) = simulated_worlds_of(coarse)
    assert simulated_world_of(coarse.model_copy()) is world
    from_profile(coarse, VirtualClock())
    assert simulated_world_of(coarse) is world


@pytest.mark.parametrize(
    "change",
    [
        lambda profile: changed(profile, seed=2),
        lambda profile: changed(profile, texture=0.31),
        lambda profile: changed(profile, projectors=(profile.simulation.projector.model_copy(update={"flux": 0.5}),)),
        with_narrower_camera,
    ],
    ids=["seed", "texture", "a device's settings", "a picture's size"],
)
def test_another_setting_or_size_has_another_world(coarse: Profile, change: Callable[[Profile], Profile]) -> None:
    other = change(coarse)
    world, of_other = simulated_world_of(coarse), simulated_world_of(other)
    assert of_other is not world
    assert of_other.settings == other.simulation
    assert of_other.camera.shape == other.camera.shape[:2]


def test_a_world_made_again_sends_the_same_light_to_the_last_bit(coarse: Profile) -> None:
    world = simulated_world_of(coarse)
    shown = np.random.default_rng(1).random(world.projector.shape, dtype=np.float32)
    simulated_world_of(changed(coarse, seed=2)).light_of(shown)
    again = simulated_world_of(coarse)
    assert again is not world
    assert np.array_equal(again.light_of(shown).total, world.light_of(shown).total)


def save_ball(path: Path, radius_m: float) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=radius_m)
    ball.invert()
    ball.export(path)


def test_another_file_of_the_same_name_has_another_world_and_none_is_refused(coarse: Profile, tmp_path: Path) -> None:
    pytest.importorskip("embreex")
    path = tmp_path / "ball.ply"
    save_ball(path, 4.0)
    grey = (SimulatedMaterial(name="*", reflectance=(0.5,)),)
    within = changed(coarse, scene=str(path), rays=16, posters=(), materials=grey)
    first = simulated_world_of(within)
    assert simulated_world_of(within) is first
    save_ball(path, 4.5)
    assert simulated_world_of(within) is not first
    path.unlink()
    with pytest.raises(ProfileError, match="no such file"):
        simulated_world_of(within)


def test_only_the_last_worlds_are_kept(coarse: Profile) -> None:
    simulated_world_of(coarse)
    simulated_world_of(changed(coarse, seed=3))
    assert len(stage._kept) == 1
