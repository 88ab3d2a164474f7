"""The native kernels against their plain numpy definitions, other integration rules, and one another."""

import numpy as np
import pytest

from sim import _kernel
from sim.form_factors import ClosureWarning, form_factors
from sim.geometry.mesh import Mesh
from sim.reference import closed_form as closed_form_reference
from sim.reference import paper as paper_reference
from sim.scenes.gridded import furnace, paper_room, room, room_with_box


def as_mesh(scene):
    return Mesh(
        name=scene.name,
        vertices=scene.vertices,
        reflectance=scene.reflectance,
        convex=scene.convex,
        closed=scene.closed,
        region=scene.region,
    )


@pytest.fixture
def at_level():
    """Run at another instruction set, and go back afterwards."""
    yield _kernel.set_instruction_set
    _kernel.set_instruction_set(_kernel.best_instruction_set())


def gauss_exchange_area(scene, i, j, order):
    """A_i F_ij by a plain product rule over both patches."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    nodes, weights = (nodes + 1) / 2, np.multiply.outer(weights, weights).ravel() / 4
    u, v = (grid.ravel() for grid in np.meshgrid(nodes, nodes))
    first, second = (
        corners[0] + u[:, None] * (corners[1] - corners[0]) + v[:, None] * (corners[3] - corners[0])
        for corners in scene.vertices[[i, j]]
    )
    line = second[None] - first[:, None]
    squared = (line**2).sum(axis=2)
    kernel = (line @ scene.normals[i]) * -(line @ scene.normals[j]) / (np.pi * squared**2)
    return scene.areas[i] * scene.areas[j] * float(weights @ kernel @ weights)


def test_the_closed_form_agrees_with_its_definition():
    for scene in (paper_room(), furnace(0.1), room((2.0, 1.3, 0.7), 0.31), room_with_box(0.8)):
        exchange = np.empty((scene.n_patches,) * 2)
        reference = closed_form_reference.exchange_areas(scene)
        if scene.convex:
            exchange = form_factors(scene, "closed_form").matrix * scene.areas[:, None]
        else:
            with pytest.warns(ClosureWarning):
                exchange = form_factors(scene, "closed_form", "none").matrix * scene.areas[:, None]
        assert np.abs(exchange - reference).max() < 1e-13
        assert np.array_equal(exchange > 0, reference > 0)


@pytest.mark.parametrize("patch_size_m", [0.4, 0.2])
def test_far_and_grazing_pairs_keep_nine_digits(patch_size_m):
    scene = paper_room(patch_size_m=patch_size_m)
    factors = form_factors(scene).matrix
    rng = np.random.default_rng(0)
    first, second = rng.integers(0, scene.n_patches, (2, 600))
    distance = np.linalg.norm(scene.centres[first] - scene.centres[second], axis=1) / patch_size_m
    pairs = [k for k in np.flatnonzero(distance > 3) if factors[first[k], second[k]] > 0]
    assert len(pairs) > 300
    for k in pairs:
        i, j = first[k], second[k]
        expected = gauss_exchange_area(scene, i, j, 10) / scene.areas[i]
        assert factors[i, j] == pytest.approx(expected, rel=1e-9)


def test_near_pairs_agree_with_the_closed_form_in_extended_precision():
    if np.finfo(np.longdouble).eps > 1e-18:
        pytest.skip("this processor's long double is no better than double")
    h, x = np.longdouble("0.4"), np.arange(0, 3, dtype=np.longdouble) * np.longdouble("0.4")

    def corner(squared, y):
        root = np.sqrt(squared)
        r2 = squared + y * y
        logarithm = np.log(r2) if r2 > 0 else np.longdouble(0)
        return y * root * np.arctan2(y, root) - (squared - y * y) / 4 * logarithm

    scene = paper_room()
    factors = form_factors(scene).matrix
    wall = scene.faces[2].first_patch
    for row, along in ((0, 0), (0, 1), (1, 3), (1, 0)):
        total = np.longdouble(0)
        for i in (0, 1):
            for j in (0, 1):
                for k in (0, 1):
                    for m in (0, 1):
                        term = corner(x[i] ** 2 + x[row + j] ** 2, (along + k - m) * h)
                        total += -term if (i + j + k + m) % 2 else term
        expected = float(total / (2 * np.longdouble(np.pi)) / (h * h))
        # Floor patch (column 0, row ``along``) and the patch of the wall x = 0 in its row, at y = 0.
        assert factors[12 * along, wall + 12 * row] == pytest.approx(expected, rel=1e-11)


def test_rectangles_of_any_size_agree_with_the_grid():
    scene = room((2.4, 1.6, 1.2), 0.2, faces=("floor", "x0", "y1", "ceiling"))
    grid, single = form_factors(scene).matrix, form_factors(as_mesh(scene)).matrix
    assert np.allclose(single, grid, rtol=2e-9, atol=0)


def test_a_quartered_patch_exchanges_what_the_whole_did():
    coarse, fine = room((1.0, 1.0, 1.0), 1.0), room((1.0, 1.0, 1.0), 0.125)
    mixed = np.concatenate([coarse.vertices[:3], fine.vertices[fine.region >= 3]])
    mesh = Mesh(name="mixed", vertices=mixed, reflectance=np.full(len(mixed), 0.5), convex=True, closed=True)
    factors = form_factors(mesh)
    assert factors.method == "closed_form"
    assert factors.closure_max < 1e-12
    assert factors.matrix[0, 3 : 3 + 64].sum() == pytest.approx(form_factors(coarse).matrix[0, 3], rel=1e-12)


def test_a_tilted_room_of_rectangles_still_has_its_closed_form():
    scene = room((2.0, 1.5, 1.0), 0.5)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    mesh = Mesh(
        name="tilted", vertices=scene.vertices @ turn.T, reflectance=scene.reflectance, convex=True, closed=True
    )
    factors = form_factors(mesh)
    assert factors.method == "closed_form"
    assert np.allclose(factors.matrix, form_factors(scene).matrix, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("method", ["closed_form", "paper"])
@pytest.mark.filterwarnings("ignore::sim.form_factors.ClosureWarning")
def test_every_instruction_set_gives_the_same_bits(method, at_level):
    scenes = [paper_room(), as_mesh(room((1.0, 2.0, 1.5), 0.25))]
    results = []
    for level in _kernel.instruction_sets():
        at_level(level)
        results.append([form_factors(scene, method).matrix for scene in scenes])
    for other in results[1:]:
        for one, two in zip(results[0], other, strict=True):
            assert np.array_equal(one, two)


def test_an_instruction_set_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="baseline, avx2, avx512, avx512vbmi"):
        _kernel.set_instruction_set("sse9")


def test_one_thread_gives_the_bits_of_two():
    scene = paper_room()
    threads = _kernel.threads()
    x = np.random.default_rng(1).random(scene.n_patches)
    try:
        results = []
        for n in (1, 2):
            _kernel.set_threads(n)
            factors = form_factors(scene)
            results.append((factors.matrix, factors.exchange(x)))
    finally:
        _kernel.set_threads(threads)
    assert all(np.array_equal(one, two) for one, two in zip(*results, strict=True))


@pytest.mark.filterwarnings("ignore::sim.form_factors.ClosureWarning")
def test_the_papers_quadrature_agrees_with_its_definition():
    scene = room((1.2, 1.6, 0.8), 0.4)
    factors = form_factors(scene, "paper")
    reference = paper_reference.exchange_areas(scene) / scene.areas[:, None]
    assert np.allclose(factors.matrix, reference, rtol=1e-12, atol=0)
    assert np.allclose(factors.row_sums, reference.sum(axis=1), rtol=1e-12)


def test_the_symmetric_product_reads_half_and_means_the_whole():
    scene = room((2.0, 1.3, 0.9), 0.15)
    factors = form_factors(scene)
    x = np.random.default_rng(2).normal(size=scene.n_patches)
    assert np.allclose(factors.apply(x), factors.matrix @ x, rtol=0, atol=1e-13)
    single = factors.in_single_precision()
    assert single.matrix.dtype == np.float32
    assert np.allclose(single.apply(x), factors.matrix @ x, rtol=0, atol=1e-6)
