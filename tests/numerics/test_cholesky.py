"""Factors of many matrices at once."""

import numpy as np
import pytest
from agreement import assert_same_numbers

from hybridsurrogate.numerics.linear_algebra import factor_by_columns, nudged_cholesky


def test_rounding_in_one_matrix_leaves_the_others_as_they_are():
    slope = np.array([[1e60, 1e60]])
    matrices = np.stack([np.array([[2.0, 1.0], [1.0, 3.0]]), slope.T @ slope + np.eye(2)])
    factors = nudged_cholesky(matrices)
    assert_same_numbers(factors[0], np.linalg.cholesky(matrices[0]))
    np.testing.assert_allclose(factors[1] @ factors[1].T, matrices[1], rtol=1e-9)


@pytest.mark.parametrize("length", [0.03, 30.0])
@pytest.mark.parametrize("n", [30, 300])
def test_a_factor_by_columns_is_whole_where_many_are_needed(length, n):
    x = np.random.default_rng(0).uniform(size=n)
    covariance = np.exp(-((x[:, None] - x) ** 2) / (2 * length**2))
    asked = []

    def columns(some):
        asked.append(some)
        return covariance[:, some]

    factor = factor_by_columns(np.ones(n), columns, 1e-6, n)
    np.testing.assert_allclose(factor @ factor.T, covariance, atol=1e-5)
    # few columns of a smooth curve of many places; else all of them at once
    assert (slice(None) in asked) == (n == 30 or length < 1)
