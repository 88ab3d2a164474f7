"""Trees, tracers and light that were found for a surface stay with it, and let an interrupt through when it goes."""

import sys

import numpy as np
import pytest

from sim.form_factors.sampled import RaySample, tree_of
from sim.geometry.adaptive_patches import coarsest_patches
from sim.geometry.rays import tracer_of
from sim.kept import Kept
from sim.light.lighting import emission, make_test_lighting
from sim.scenes.cluttered import corner_with_ball
from sim.scenes.gridded import paper_room
from tests.sim.meshes_of_scenes import as_mesh


@pytest.fixture(scope="module")
def ball():
    return corner_with_ball(200)


def all_found_for(patches):
    return tree_of(patches), tracer_of(patches), emission(patches, make_test_lighting("uniform", patches))


def test_what_was_found_for_a_surface_is_found_once(ball):
    patches = coarsest_patches(ball)
    light = make_test_lighting("uniform", patches)
    for find in (tree_of, tracer_of, lambda of: emission(of, light)):
        assert find(patches) is find(patches)


def test_another_lighting_takes_the_place_of_the_one_before(ball):
    patches = coarsest_patches(ball)
    first, second = make_test_lighting("uniform", patches), make_test_lighting("uniform", patches)
    before = emission(patches, first)
    assert emission(patches, second) is not before
    assert np.array_equal(emission(patches, first).irradiance, before.irradiance)


def test_rays_of_another_seed_are_other_rays(ball):
    patches = coarsest_patches(ball)
    of = [RaySample.first(patches, seed) for seed in (0, 1, 0)]
    means = [sample.halves(patches.centres[:, 0]).mean for sample in of]
    assert np.array_equal(means[0], means[2])
    assert not np.array_equal(means[0], means[1])


def test_a_mesh_with_another_reflectance_shares_the_tree_of_its_geometry():
    mesh = as_mesh(paper_room())
    tree = tree_of(mesh)
    assert tree_of(mesh.with_reflectance(0.3)) is tree


def test_nothing_is_kept_for_another_object_or_under_another_name(ball):
    one, other = coarsest_patches(ball), coarsest_patches(ball)
    note, another = Kept[object, int]("_note"), Kept[object, int]("_another")
    assert note.keep(one, 7) == 7
    assert (note.get(one), another.get(one), note.get(other)) == (7, None, None)


def test_no_function_runs_when_a_surface_is_freed_which_would_throw_an_interrupt_away(ball):
    # What Python calls while it frees an object may not raise: KeyboardInterrupt that is seen there is printed as
    # "Exception ignored in", and the work goes on.
    patches = [coarsest_patches(ball)]
    all_found_for(patches[0])
    called = []
    sys.setprofile(lambda frame, event, _: called.append(frame.f_code.co_qualname) if event == "call" else None)
    try:
        patches.clear()
    finally:
        sys.setprofile(None)
    assert called == []
