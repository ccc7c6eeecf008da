"""Where a discrepancy lies, against closed forms."""

import numpy as np
import pytest

from hybridsurrogate.diagnosis.answers.discrepancy import Discrepancy, shares_of_thirds


def test_a_straight_line_has_its_square_in_the_last_third():
    # the integral of x^2 over the thirds of [0, 1]: 1/27, 7/27, 19/27
    x = (np.arange(30_000) + 0.5) / 30_000
    thirds = shares_of_thirds(x[:, None], 5 * x, ["x"])
    assert [t.share for t in thirds] == pytest.approx([1 / 27, 7 / 27, 19 / 27], abs=1e-3)
    assert [t.rows for t in thirds] == pytest.approx([1 / 3] * 3, abs=1e-3)
    assert [t.low for t in thirds] == pytest.approx([0, 1 / 3, 2 / 3], abs=1e-3)


def test_each_column_has_its_own_thirds():
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.uniform(-1, 1, 20_000), rng.uniform(0, 3, 20_000), np.ones(20_000)])
    # nothing but in the last third of the second column
    thirds = shares_of_thirds(X, 1.0 * (X[:, 1] > 2), ["a", "b", "constant"])
    assert [t.column for t in thirds] == ["a"] * 3 + ["b"] * 3
    assert [t.share for t in thirds[:3]] == pytest.approx([1 / 3] * 3, abs=0.02)
    assert [t.share for t in thirds[3:]] == pytest.approx([0, 0, 1], abs=1e-2)


def test_no_discrepancy_has_no_shares():
    thirds = shares_of_thirds(np.arange(9.0)[:, None], np.zeros(9), ["t"])
    assert [t.share for t in thirds] == [0, 0, 0]
    assert sum(t.rows for t in thirds) == pytest.approx(1)


def test_stretches_in_which_the_band_excludes_zero():
    x = np.arange(7.0)
    mean = np.array([-2.0, -2.0, 0.5, 3.0, 3.0, 0.0, 3.0])
    band = Discrepancy(x[:, None], "x", mean, mean - 1, mean + 1)
    assert band.stretches(x) == [(0.0, 1.0, -1), (3.0, 4.0, 1), (6.0, 6.0, 1)]
    assert band.share_outside == pytest.approx(5 / 7)


def test_few_values_are_levels_not_thirds():
    batch = np.array([0.0, 1, 2, 2, 0, 1])
    found = shares_of_thirds(batch[:, None], np.array([0, 0, 3.0, 3, 0, 1]), ["batch"])
    assert [(t.low, t.high) for t in found] == [(0, 0), (1, 1), (2, 2)]
    assert [t.share for t in found] == pytest.approx([0, 1 / 19, 18 / 19])
    assert [t.rows for t in found] == pytest.approx([1 / 3] * 3)
