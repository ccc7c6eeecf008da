import numpy as np
import pytest

from hybridsurrogate.scoring import coverage, elpd, paired_difference, rmse


def test_elpd_is_a_mean_with_the_standard_error_of_a_mean():
    mean, error = elpd([-1.0, -2.0, -6.0])
    assert mean == -3.0
    # sample variance (4 + 1 + 9) / 2 = 7
    assert error == pytest.approx(np.sqrt(7 / 3))


def test_one_row_has_no_standard_error():
    assert elpd([-1.0])[0] == -1.0
    assert np.isnan(elpd([-1.0])[1])
    assert np.isnan(paired_difference([1.0], [0.0]).standard_error)


def test_rmse_takes_the_root_in_every_row():
    # rows with errors (3, 4) and (0, 2): roots of 12.5 and 2
    draws = [[3.0, 1.0], [4.0, 3.0]]
    assert rmse(draws, [0.0, 1.0]) == pytest.approx((np.sqrt(12.5) + np.sqrt(2)) / 2)


def test_coverage_counts_rows_inside_ends_included():
    y, lower, upper = [0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.0]
    assert coverage(y, lower, upper) == 0.5


def test_paired_difference_has_the_error_of_the_differences():
    rng = np.random.default_rng(0)
    before = rng.normal(0, 100, 50)
    gain = paired_difference(before + 2, before)
    assert gain.difference == pytest.approx(2)
    assert gain.standard_error == pytest.approx(0, abs=1e-12)
    gain = paired_difference([1.0, 4.0, 1.0], [0.0, 0.0, 0.0])
    assert gain.difference == 2.0
    # sample variance of (1, 4, 1) is 3
    assert gain.standard_error == pytest.approx(1.0)
