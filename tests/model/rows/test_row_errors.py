"""Layout of the standard deviations that rows bring with them."""

import numpy as np
import pandas as pd
import pytest

from hybridsurrogate.effects.base import ERROR
from hybridsurrogate.effects.noise.known_errors import Jitter, RowErrors
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.model.rows.measured_data import (
    MeasuredData,
    check_errors,
    row_errors,
    taken_out,
)
from hybridsurrogate.model.rows.stacking import stacking_of
from hybridsurrogate.simulation.outputs import OUTPUT


def test_errors_of_several_outputs_are_named_by_a_list():
    table = pd.DataFrame({"t": [1.0, 2.0], "e1": [0.1, 0.2], "e2": [3.0, 4.0]})
    X, errors = taken_out(table, ["e2", "e1"])
    assert list(X) == ["t"]
    assert errors.tolist() == [[3.0, 0.1], [4.0, 0.2]]


def test_a_missing_output_needs_no_error():
    y, errors = np.array([[1.0, np.nan], [2.0, 3.0]]), [[0.1, np.nan], [0.2, 0.3]]
    found = check_errors(errors, y, as_likelihood("normal"), ("a", "b"))
    np.testing.assert_array_equal(found, errors)


def test_rows_that_agree_in_all_but_their_error_stay_apart():
    X, y, ones = np.ones((3, 1)), np.ones(3), np.ones(3)
    data = MeasuredData(
        X, y, ones, None, [0], ("t",), None, None, None, scatter=np.array([0.1, 0.2, 0.1])
    )
    distinct = data.distinct
    assert distinct.X.tolist() == [[1.0, 0.1], [1.0, 0.2]]
    assert distinct.weights.tolist() == [2.0, 1.0]


def test_stacked_rows_have_their_errors_in_the_unit_of_their_output():
    Y = np.array([[0.0, 0.0], [2.0, 200.0], [4.0, np.nan]])
    stacking = stacking_of(Y, ("level", "flow"), 1, scaled=True)
    scatter = np.array([[1.0, 10.0], [2.0, 20.0], [3.0, np.nan]])
    data = MeasuredData(
        np.arange(3.0)[:, None], Y, np.ones(3), None, [0], ("t", OUTPUT), None, stacking, None,
        scatter=scatter,
    )  # fmt: skip
    wanted = (scatter / stacking.scale)[np.isfinite(Y)]
    np.testing.assert_allclose(data.single.X[:, -1], wanted)
    errors = row_errors("added", scatter, stacking, np.ones(3))
    np.testing.assert_allclose(errors.typical, [2.0, 15.0] / stacking.scale)


def test_noise_of_rows_with_errors():
    rows = {ERROR: np.array([3.0, 1.0]), OUTPUT: np.array([0.0, 1.0])}
    errors = RowErrors("added", typical=(2.0, 1.0))
    jitter = Jitter(errors, None, ("level", "flow"))
    theta = {"jitter of level": np.full(2, 4.0), "jitter of flow": np.full(2, 0.5)}
    noise = errors.unit * errors.factor(rows, 2) * jitter.noise(rows, theta)
    np.testing.assert_allclose(noise, np.hypot([3.0, 1.0], [4.0, 0.5]))
    fixed = errors.with_jitter((4.0, 0.5))
    np.testing.assert_allclose(fixed.unit * fixed.factor(rows, 2), noise)
    assert errors.fixes_sigma
    assert not fixed.fixes_sigma
    # a row without its error has the typical one of its output
    del rows[ERROR]
    assert errors.of_rows(rows, 2).tolist() == [2.0, 1.0]


@pytest.mark.parametrize("likelihood", ["normal", "student-t"])
def test_errors_are_scales_of_eta(likelihood):
    errors, y = np.array([0.5, 1.0]), np.array([10.0, 20.0])
    assert as_likelihood(likelihood).scatter(errors, y).tolist() == errors.tolist()
    np.testing.assert_allclose(as_likelihood("lognormal").scatter(errors, y), errors / y)
