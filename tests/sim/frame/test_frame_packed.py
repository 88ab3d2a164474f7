"""Numbers in 16 bits, as the frame kernel reads them."""

import numpy as np

from sim.frame.packed import LEAST, packed, packed_rows


def test_packed_numbers_keep_four_digits_and_zero():
    values = np.random.default_rng(0).uniform(0, 3, (2, 40, 50)) ** 4
    values[0, 0, :7] = 0
    again = packed(values).values
    assert not again[0, 0, :7].any()
    large = values > LEAST * values.max()
    assert (np.abs(again - values)[large] <= 2.0**-12.9 * values[large]).all()
    assert (again[values > 0] > 0).all()


def test_packed_numbers_keep_their_digits_beside_one_that_is_out_of_all_proportion():
    values = np.random.default_rng(1).uniform(0.5, 2, (1, 30, 30))
    values[0, 3, 4] = 1e9
    again = packed(values).values
    others = values < 10
    assert (np.abs(again - values)[others] <= 2.0**-12.9 * values[others]).all()
    assert again[0, 3, 4] > 4000


def test_each_row_of_a_packed_matrix_keeps_four_digits_of_its_largest():
    matrices = np.random.default_rng(2).normal(size=(3, 40, 70)) * np.logspace(-9, 3, 40)[:, None]
    matrices[1, 7] = 0
    again = packed_rows(matrices).values
    largest = np.abs(matrices).max(axis=2, keepdims=True)
    assert (np.abs(again - matrices) <= 1.6e-5 * largest).all()
    assert not again[1, 7].any()
