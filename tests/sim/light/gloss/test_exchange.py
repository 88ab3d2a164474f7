"""Light between patches by way of gloss: reciprocal, never growing, and in a mirror that of the mirrored room."""

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.form_factors.sampled import RaySample, sampled_form_factors
from sim.geometry.scene import Face, Scene
from sim.light.gloss.exchange import GlossyFormFactors, glossy_form_factors, points_on
from sim.light.gloss.material import Gloss, matte_equivalent
from sim.light.radiosity import Radiosity
from sim.scenes.gridded import furnace, room, room_with_box


def plates(height_m, cells=4, size_m=2.0):
    """A floor that looks up and a ceiling that looks down, gridded alike."""
    floor = Face(
        name="floor",
        origin_m=np.zeros(3),
        edge_u_m=np.array([size_m, 0, 0]),
        edge_v_m=np.array([0, size_m, 0]),
        rows=cells,
        columns=cells,
        first_patch=0,
    )
    ceiling = Face(
        name="ceiling",
        origin_m=np.array([0, 0, height_m]),
        edge_u_m=np.array([0, size_m, 0]),
        edge_v_m=np.array([size_m, 0, 0]),
        rows=cells,
        columns=cells,
        first_patch=cells**2,
    )
    return Scene("plates", (floor, ceiling), np.full(2 * cells**2, 0.1), convex=True)


def on_floor(scene, share, roughness):
    n = scene.faces[0].n_patches
    return Gloss.of(scene, np.where(np.arange(scene.n_patches) < n, share, 0.0), roughness)


def test_a_mirror_shows_the_ceiling_to_itself_at_twice_the_distance():
    scene, share = plates(1.2), 0.9
    gloss = on_floor(scene, share, 0.001)
    straight = form_factors(scene)
    by_gloss = glossy_form_factors(scene, straight, gloss, rays=16384).matrix - straight.matrix
    n = scene.faces[0].n_patches
    # The image of ceiling patch (row, column) lies under it; the floor's patches are numbered across.
    mirrored = form_factors(plates(2.4)).matrix[:n, n:]
    image = mirrored.reshape(4, 4, n).transpose(1, 0, 2).reshape(n, n)
    expected = share * image
    error = by_gloss[n:, n:] - expected
    assert np.sqrt((error**2).mean()) < 0.04 * expected.mean()
    assert by_gloss[n:, n:].sum() == pytest.approx(expected.sum(), rel=5e-3)
    assert not by_gloss[:n].any()


def test_factors_by_gloss_are_reciprocal_and_the_same_every_time():
    scene = room_with_box(0.8, reflectance=0.5)
    gloss, straight = on_floor(scene, 0.4, 0.3), form_factors(scene)
    extended = glossy_form_factors(scene, straight, gloss, rays=32)
    exchange = scene.areas[:, None] * extended.matrix
    assert np.abs(exchange - exchange.T).max() < 1e-12 * exchange.max()
    assert np.array_equal(extended.matrix, glossy_form_factors(scene, straight, gloss, rays=32).matrix)
    other = glossy_form_factors(scene, straight, gloss, rays=32, seed=1)
    assert not np.array_equal(extended.matrix, other.matrix)


def test_a_patch_sees_itself_in_gloss_and_products_know_it():
    scene = furnace(reflectance=0.3)
    extended = glossy_form_factors(scene, form_factors(scene), Gloss.of(scene, 0.4, 0.3), rays=64)
    assert np.diagonal(extended.matrix).max() > 0
    x = np.random.default_rng(0).uniform(size=scene.n_patches)
    assert np.allclose(extended.apply(x), extended.matrix @ x, rtol=1e-12)
    assert np.allclose(extended.exchange(np.stack([x, x], axis=1))[:, 1], extended.exchange(x), rtol=1e-12)


@pytest.mark.parametrize("roughness", [0.001, 0.2, 1.0])
@pytest.mark.parametrize("share", [0.3, 0.9])
def test_light_never_grows_however_few_the_rays(share, roughness):
    scene = furnace(reflectance=1 - share)
    extended = glossy_form_factors(scene, form_factors(scene), Gloss.of(scene, share, roughness), rays=16)
    # What comes to rest of a patch's light: never more than all of it.
    assert (extended.matrix @ np.full(scene.n_patches, 1 - share)).max() <= 1 + 1e-12
    radius = np.abs(np.linalg.eigvals((1 - share) * extended.matrix)).max()
    assert radius <= 1 + 1e-12


def test_a_furnace_of_mirrors_and_matte_walls_loses_only_what_walls_absorb():
    # Narrow lobes keep all light: in even light B = E (1 - rho_s) / (1 - rho - rho_s).
    scene, share = furnace(reflectance=0.3), 0.4
    extended = glossy_form_factors(scene, form_factors(scene), Gloss.of(scene, share, 0.001), rays=64)
    B = Radiosity(extended, scene.reflectance).solve(np.ones(scene.n_patches))
    assert np.allclose(B, (1 - share) / (1 - 0.3 - share), rtol=5e-3)


def test_sampled_factors_are_extended_too():
    scene = room((2.0, 2.0, 1.0), 0.5, 0.5)
    gloss = on_floor(scene, 0.4, 0.3)
    sample = RaySample(surface=scene)
    sample.lengthen(1024)
    sparse = glossy_form_factors(scene, sampled_form_factors(sample), gloss, rays=1024)
    dense = glossy_form_factors(scene, form_factors(scene), gloss, rays=1024)
    assert isinstance(sparse, GlossyFormFactors)
    E = np.zeros(scene.n_patches)
    E[-8:] = 1.0
    found, exact = (Radiosity(factors, scene.reflectance).solve(E) for factors in (sparse, dense))
    assert np.abs(found - exact).max() < 0.03 * exact[:-8].max()
    assert np.allclose(sparse.exchange(E), scene.areas * sparse.apply(E))
    assert np.allclose(sparse.apply(np.ones(scene.n_patches)), sparse.row_sums)


def test_matte_patches_of_equal_albedo_send_back_as_much_of_even_light():
    scene = furnace(reflectance=0.3)
    gloss = Gloss.of(scene, 0.4, 1.0)
    assert np.allclose(matte_equivalent(scene, gloss), 0.3 + 0.4 * 4 * (1 - np.log(2)) ** 2, atol=1e-3)


def test_points_are_spread_evenly_over_patches():
    scene = room((2.0, 2.0, 1.0), 1.0, 0.5)
    chances = np.random.default_rng(0).uniform(size=(20000, 2))
    points = points_on(scene, np.full(20000, 3), chances)
    corners = scene.vertices[3]
    assert np.allclose(points.mean(axis=0), corners.mean(axis=0), atol=0.01)
    assert np.allclose(points[:, :2].var(axis=0), 1 / 12, atol=0.003)


@pytest.mark.parametrize(
    ("share", "roughness", "what"),
    [
        (0.6, 0.3, "together more than 1"),
        (-0.1, 0.3, "it must lie in 0"),
        (np.nan, 0.3, "it must lie in 0"),
        (0.2, 0.0, "a mirror is no lobe"),
        (0.2, 1.5, "it must lie in 0.001"),
        ([0.1, 0.2], 0.3, "one each"),
        ("much", 0.3, "give numbers"),
    ],
)
def test_a_gloss_that_cannot_be_is_refused(share, roughness, what):
    with pytest.raises(SimulationError, match=what):
        Gloss.of(furnace(reflectance=0.5), share, roughness)


def test_parts_that_do_not_belong_together_are_refused():
    scene, other = furnace(reflectance=0.5), furnace(0.5, reflectance=0.5)
    gloss = Gloss.of(scene, 0.2)
    with pytest.raises(SimulationError, match="from the same surface"):
        glossy_form_factors(scene, form_factors(other), gloss)
    with pytest.raises(SimulationError, match="gloss of 96 patches for 24"):
        glossy_form_factors(other, form_factors(other), gloss)
    with pytest.raises(SimulationError, match="8 rays"):
        glossy_form_factors(scene, form_factors(scene), gloss, rays=8)
    with pytest.raises(SimulationError, match="one a patch each"):
        Gloss(np.zeros(3), np.full(2, 0.3))
