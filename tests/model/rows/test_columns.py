"""Measured columns: which is which, whatever they are called."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.model.rows.columns import matched_columns


def plane(x1, x2, g, h=0.0):
    return g * x1 + x2


def test_a_column_without_a_name_takes_none_that_is_there():
    simulator = hs.Simulator(plane, {"x1": (0, 1), "x2": (0, 1)}, {"g": stats.norm(1, 0.5)})
    rng = np.random.default_rng(0)
    X = rng.uniform(size=(30, 3))
    y = plane(X[:, 0], X[:, 1], 1.5) + 0.4 * X[:, 2] + 0.01 * rng.standard_normal(30)
    names, _ = matched_columns([], 3, simulator)
    assert names == ("x1", "x2", "x2_")
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        effects=(hs.MissingInput("x2_", center=0.0),),
        n_draws=200,
        random_state=0,
    )
    posterior = model.fit(X, y).posterior_
    assert posterior.named()["g"].mean() == pytest.approx(1.5, abs=0.03)
    assert posterior.estimates(0)["slope"].mean() == pytest.approx(0.4, abs=0.03)


@pytest.mark.parametrize("estimator", [hs.PowerScaledSurrogate, hs.PredictiveWeightedSurrogate])
def test_a_missing_number_is_told_with_its_column_and_row(simulation, measured, estimator):
    frame = pd.DataFrame({"t": measured[0][:20, 0], "wind": np.arange(20.0)})
    holed = frame.assign(wind=frame.wind.where(frame.wind != 6))
    match = r"1 of 20 values of the column 'wind' are missing \(NaN\), the first in row 7"
    with pytest.raises(ValueError, match=match):
        estimator(simulation, n_draws=100).fit(holed, measured[1][:20])
    fitted = estimator(simulation, n_draws=100, random_state=0).fit(frame, measured[1][:20])
    with pytest.raises(ValueError, match=match):
        fitted.predict(holed)
