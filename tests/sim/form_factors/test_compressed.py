"""Compressed form factors against the dense matrix, whole rows and the laws they must keep."""

import functools

import numpy as np
import pytest

from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.form_factors.compressed import CompressedFormFactors, compressed_form_factors, exact_rows
from sim.geometry.mesh import Mesh
from sim.geometry.scene import Scene
from sim.light.radiosity import Radiosity
from sim.scenes.gridded import furnished_room, paper_room, room_with_box
from tests.sim.plates import parallel_plates


@functools.cache
def empty_room() -> Scene:
    return paper_room(patch_size_m=0.16)


@functools.cache
def dense_empty() -> FloatArray:
    return form_factors(empty_room(), method="closed_form").matrix


@functools.cache
def compressed_empty(tolerance: float = 1e-3) -> CompressedFormFactors:
    return compressed_form_factors(empty_room(), tolerance)


@functools.cache
def box() -> Scene:
    return room_with_box(patch_size_m=0.3, box_patch_size_m=0.25)


@functools.cache
def compressed_box() -> CompressedFormFactors:
    return compressed_form_factors(box(), 1e-3)


def lights(n: int) -> FloatArray:
    generator = np.random.default_rng(7)
    return np.stack([np.ones(n), np.linspace(0, 1, n), generator.uniform(size=n), generator.random(n) < 0.5], axis=1)


def test_products_in_an_empty_room_are_those_of_the_closed_form_to_the_tolerance() -> None:
    x = lights(empty_room().n_patches)
    difference = compressed_empty().apply(x) - dense_empty() @ x
    assert np.abs(difference).max() < 2e-3
    assert np.sqrt((difference**2).mean()) < 5e-4


def test_ten_times_the_tolerance_costs_accuracy_and_a_tenth_buys_it() -> None:
    x = lights(empty_room().n_patches)
    exact = dense_empty() @ x
    errors = [np.sqrt(((compressed_empty(t).apply(x) - exact) ** 2).mean()) for t in (1e-2, 1e-3, 1e-4)]
    assert errors[0] > 2.5 * errors[1] > 2.5 * 2.5 * errors[2]


def test_products_past_a_box_are_those_of_the_dense_matrix_to_the_tolerance() -> None:
    dense = form_factors(box(), visibility="exact")
    x = lights(box().n_patches)
    difference = compressed_box().apply(x) - dense.matrix @ x
    assert np.sqrt((difference**2).mean()) < 1e-3
    assert np.abs(difference).max() < 1e-2


def test_the_operator_is_symmetric_to_rounding() -> None:
    factors = compressed_box()
    x, y = np.random.default_rng(3).normal(size=(2, box().n_patches))
    assert x @ (factors.areas * factors.apply(y)) == pytest.approx(y @ (factors.areas * factors.apply(x)), rel=1e-11)


def test_columns_are_applied_as_they_would_be_alone() -> None:
    factors = compressed_box()
    x = lights(box().n_patches)
    together = factors.apply(x)
    assert np.array_equal(together, np.stack([factors.apply(column) for column in x.T], axis=1))


def test_row_sums_of_a_closed_room_are_one_to_the_tolerance() -> None:
    assert compressed_empty().closure_max < 2e-3
    assert compressed_empty().closure_max == np.abs(compressed_empty().row_sums - 1).max()


def test_the_measured_error_is_that_against_the_dense_matrix() -> None:
    x = np.ones((empty_room().n_patches, 1))
    true = np.abs(compressed_empty().apply(x) - dense_empty() @ x).max()
    assert compressed_empty().error.max > 0.3 * true
    assert compressed_empty().error.rms <= compressed_empty().error.max


def test_rows_evaluated_again_are_those_of_the_dense_matrix_past_a_box() -> None:
    dense = form_factors(box(), visibility="exact")
    rows = np.arange(0, box().n_patches, 29)
    again = exact_rows(compressed_box(), rows, np.eye(box().n_patches))
    assert np.abs(again - dense.matrix[rows]).max() < 5e-3
    assert np.abs((again - dense.matrix[rows]).sum(axis=1)).max() < 3e-3


def test_five_thousand_patches_need_a_tenth_of_the_dense_matrix() -> None:
    scene = paper_room(patch_size_m=0.13)
    assert scene.n_patches > 5000
    factors = compressed_form_factors(scene, 1e-3)
    assert factors.stored_mb < 0.1 * 8e-6 * scene.n_patches**2


def test_radiosity_is_within_a_thousandth_of_white_of_the_dense_one() -> None:
    scene = empty_room()
    light = np.where(scene.region == 2, 1.0, 0.0)
    dense = Radiosity(form_factors(scene, method="closed_form"), 0.7).solve(light)
    compressed = Radiosity(compressed_empty(), 0.7).solve(light)
    assert np.abs(compressed - dense).max() < 1e-3


def test_parallel_plates_are_those_of_the_textbook() -> None:
    # F of directly opposed unit squares at distance 1 (Howell, A catalog of radiation configuration factors, C-11).
    factors = compressed_form_factors(parallel_plates(patch_size_m=0.04), 1e-4)
    mean = factors.row_sums.mean()
    assert mean == pytest.approx(0.19982, abs=3e-5)
    assert factors.closure_max == 0


def test_a_mesh_of_triangles_is_the_scene_it_was_cut_from() -> None:
    scene = paper_room(patch_size_m=0.4)
    a, b, c, d = np.moveaxis(scene.vertices, 1, 0)
    triangles = np.concatenate([np.stack([a, b, c, c], axis=1), np.stack([a, c, d, d], axis=1)])
    mesh = Mesh(
        name="triangles",
        vertices=triangles,
        reflectance=np.full(len(triangles), 0.5),
        convex=True,
        closed=True,
        region=np.tile(scene.region, 2),
    )
    assert compressed_form_factors(mesh, 1e-3).row_sums == pytest.approx(1.0, abs=2e-3)


def test_furniture_hides_but_makes_no_light() -> None:
    factors = compressed_form_factors(furnished_room(0.4), 1e-2)
    assert factors.visibility == "rays"
    assert factors.closure_max < 2e-2
    assert factors.row_sums.min() < 0.5


def test_progress_rises_to_one() -> None:
    seen: list[float] = []
    compressed_form_factors(paper_room(), 1e-2, seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, 1.0, float("nan")])
def test_a_tolerance_out_of_range_is_refused(tolerance: float) -> None:
    with pytest.raises(SimulationError, match="tolerance"):
        compressed_form_factors(paper_room(), tolerance)


def test_light_of_the_wrong_length_is_refused() -> None:
    with pytest.raises(SimulationError, match="shape"):
        compressed_empty().apply(np.ones(3))


def test_kept_within_closure_no_row_creates_light_and_light_goes_both_ways_alike():
    raw, kept = (compressed_form_factors(empty_room(), 1e-2, keep_within_closure=keep) for keep in (False, True))
    assert raw.row_sums.max() > 1 + 1e-6
    assert kept.row_sums.max() <= 1 + 1e-12
    assert kept.closure_max == raw.closure_max
    x, y = np.random.default_rng(2).uniform(size=(2, len(kept.areas)))
    assert y @ kept.exchange(x) == pytest.approx(x @ kept.exchange(y), rel=1e-5)
    with pytest.raises(SimulationError, match="one value a patch"):
        kept.apply(np.ones(3))
