"""Sparse products and scaling on all threads: scipy's definition, and the same bits on any number of threads."""

import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array, random_array

from sim.form_factors.sparse import product, scale_both_sides
from sim.threads import set_threads


def exchange(rows=700, density=0.2):
    """Of a size that threads share, one row of it empty."""
    half = random_array((rows, rows), density=density, random_state=7, format="csr")
    kept = np.ones(rows)
    kept[rows // 2] = 0
    return csr_array(diags_array(kept) @ (half + half.T) @ diags_array(kept))


@pytest.mark.parametrize("shape", [(700,), (700, 1), (700, 3)])
def test_products_are_those_of_scipy(shape):
    K, x = exchange(), np.random.default_rng(1).normal(size=shape)
    assert product(K, x) == pytest.approx(K @ x, rel=1e-12, abs=1e-12)
    assert product(K, x).shape == shape


def test_what_is_empty_receives_nothing():
    received = product(exchange(), np.ones(700))
    assert received[350] == 0
    assert (np.delete(received, 350) > 0).all()
    assert (product(csr_array((4, 3)), np.ones(3)) == 0).all()


def test_columns_of_another_array_are_read_as_they_stand():
    K, x = exchange(), np.random.default_rng(1).normal(size=(700, 4))
    assert product(K, x[:, 1]) == pytest.approx(K @ x[:, 1], rel=1e-12, abs=1e-12)
    assert product(K, np.asfortranarray(x)) == pytest.approx(K @ x, rel=1e-12, abs=1e-12)


def test_both_sides_are_scaled_in_place():
    K, scale = exchange(), np.random.default_rng(2).uniform(0.5, 2, 700)
    expected = (diags_array(scale) @ K @ diags_array(scale)).toarray()
    data = K.data
    scale_both_sides(K, scale)
    assert K.data is data
    assert K.toarray() == pytest.approx(expected, rel=1e-12)


def test_every_number_of_threads_gives_the_same_bits(restored):
    x = np.random.default_rng(3).normal(size=700)
    found = []
    for count in (1, 2):
        set_threads(count)
        K = exchange()
        scale_both_sides(K, 1 + x**2)
        found.append((product(K, x), product(K, np.stack([x, -x], axis=1)), K.data))
    for one, other in zip(*found, strict=True):
        assert (one == other).all()


def test_more_entries_than_the_kernel_counts_are_left_to_scipy():
    K, x = exchange(), np.random.default_rng(4).normal(size=700)
    expected = product(K, x)
    K.indptr, K.indices = K.indptr.astype(np.int64), K.indices.astype(np.int64)
    assert product(K, x) == pytest.approx(expected, rel=1e-12)
    scale_both_sides(K, 1 + x**2)
    assert product(K, x) == pytest.approx((1 + x**2) * (exchange() @ ((1 + x**2) * x)), rel=1e-12, abs=1e-12)
