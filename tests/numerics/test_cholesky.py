"""Factors of many matrices at once."""

import numpy as np
from agreement import assert_same_numbers

from hybridsurrogate.numerics.linear_algebra import nudged_cholesky


def test_rounding_in_one_matrix_leaves_the_others_as_they_are():
    slope = np.array([[1e60, 1e60]])
    matrices = np.stack([np.array([[2.0, 1.0], [1.0, 3.0]]), slope.T @ slope + np.eye(2)])
    factors = nudged_cholesky(matrices)
    assert_same_numbers(factors[0], np.linalg.cholesky(matrices[0]))
    np.testing.assert_allclose(factors[1] @ factors[1].T, matrices[1], rtol=1e-9)
