"""The door for tables, arrays and numbers: the same answers for every estimator and simulation."""

from __future__ import annotations

import datetime
import warnings

import numpy as np
import pandas as pd
import pytest
from scipy import sparse, stats

import hybridsurrogate as hs
from hybridsurrogate.effects.registry import kinds
from hybridsurrogate.simulation.arrays import as_numbers, as_table, check_number


class Table:
    """A frame of a library that is not pandas: names, and a column for a name."""

    def __init__(self, columns):
        self._columns = columns

    @property
    def columns(self):
        return list(self._columns)

    def __getitem__(self, name):
        return self._columns[name]

    def __array__(self, dtype=None, copy=None):
        return np.column_stack(list(self._columns.values())).astype(dtype)

    @property
    def shape(self):
        return (len(next(iter(self._columns.values()))), len(self._columns))


def polars_frame(columns):
    return pytest.importorskip("polars").DataFrame(columns)


FRAMES = {"pandas": pd.DataFrame, "stand-in": Table, "polars": polars_frame}


@pytest.fixture(params=FRAMES)
def frame(request):
    return FRAMES[request.param]


def plane(x1, x2, slope):
    return 10 * x1 + slope * x2


SLOPE = {"slope": hs.truncated_normal(1.0, 0.3, 0, 2)}


@pytest.fixture(scope="module")
def plane_simulator():
    return hs.Simulator(plane, {"x1": (0, 1), "x2": (0, 1)}, SLOPE)


@pytest.fixture(scope="module")
def plane_runs(plane_simulator):
    return plane_simulator.run(64, random_state=0)


@pytest.fixture(scope="module")
def rows():
    rng = np.random.default_rng(0)
    X = rng.uniform(size=(20, 2))
    return X, plane(X[:, 0], X[:, 1], 1.4) + 0.1 * rng.standard_normal(20)


def swapped(frame, X):
    return frame({"x2": X[:, 1], "x1": X[:, 0]})


def power_scaled(runs, **parameters):
    arguments = {"surrogate": hs.PolynomialChaos(2), "n_draws": 50, "random_state": 0}
    return hs.PowerScaledSurrogate(runs, **(arguments | parameters))


# ----------------------------------------------------------------- columns go by name


def test_runs_take_columns_by_name(frame, plane_runs):
    runs = hs.SimulationData(
        swapped(frame, plane_runs.X),
        frame({"slope": plane_runs.omega[:, 0]}),
        plane_runs.y,
        ["x1", "x2"],
        SLOPE,
    )
    np.testing.assert_array_equal(runs.X, plane_runs.X)
    np.testing.assert_array_equal(runs.omega, plane_runs.omega)


def test_from_frame_takes_frames_of_any_library(frame, plane_runs):
    table = frame(
        {
            "y": plane_runs.y,
            "note": np.array(["a"] * 64),
            "slope": plane_runs.omega[:, 0],
            "x2": plane_runs.X[:, 1],
            "x1": plane_runs.X[:, 0],
        }
    )
    runs = hs.SimulationData.from_frame(table, ["x1", "x2"], SLOPE)
    np.testing.assert_array_equal(runs.X, plane_runs.X)
    with pytest.raises(ValueError, match="'note' must hold numbers"):
        hs.SimulationData.from_frame(table, ["x1", "note"], SLOPE)
    with pytest.raises(TypeError, match="from_frame takes a DataFrame"):
        hs.SimulationData.from_frame(plane_runs.X, ["x1", "x2"], SLOPE)


def test_a_simulator_takes_columns_by_name(frame, plane_simulator, rows):
    X = rows[0]
    expected = plane(X[:, 0], X[:, 1], 1.2)
    omega = frame({"slope": np.full(len(X), 1.2)})
    np.testing.assert_allclose(plane_simulator(swapped(frame, X), omega), expected)


def test_an_ode_simulator_takes_columns_by_name(frame):
    ode = hs.OdeSimulator(
        lambda t, state, rate: -rate * state,
        lambda start: [start],
        lambda state: state[0],
        inputs={"t": (0, 2)},
        parameters={"start": stats.uniform(1, 2), "rate": stats.uniform(0.1, 1)},
        states=("n",),
    )
    omega = frame({"rate": np.array([0.5, 0.5]), "start": np.array([2.0, 3.0])})
    out = ode(frame({"t": np.array([1.0, 2.0])}), omega)
    np.testing.assert_allclose(out, [2 * np.exp(-0.5), 3 * np.exp(-1.0)], rtol=1e-4)


@pytest.mark.parametrize("fitted_on", ["array", "frame"])
def test_estimators_take_columns_by_name(frame, fitted_on, plane_runs, rows):
    X, y = rows
    model = power_scaled(plane_runs)
    model.fit(X if fitted_on == "array" else frame({"x1": X[:, 0], "x2": X[:, 1]}), y)
    other = swapped(frame, X)
    with warnings.catch_warnings():
        # fitted on a frame, scikit-learn warns of arrays without names
        warnings.filterwarnings("ignore", "X does not have valid feature names")
        answers = [
            (model.predict(X), model.predict(other)),
            (model.predict_interval(X), model.predict_interval(other)),
            (model.score(X, y), model.score(other, y)),
            (model.sample_predictive_mean(X), model.sample_predictive_mean(other)),
        ]
    for given, named in answers:
        np.testing.assert_array_equal(given, named)
    again = power_scaled(plane_runs).fit(other, y)
    np.testing.assert_array_equal(again.predict(other), answers[0][0])


def test_sources_take_columns_by_name(frame, plane_runs, rows):
    X, y = rows
    models = [
        hs.MultiSourceSurrogate(
            [hs.Source(plane_runs, 0.5), hs.Source((more, y), 0.5)],
            surrogate=hs.PolynomialChaos(2),
            n_draws=50,
            random_state=0,
        ).fit(X, y)
        for more in (X, swapped(frame, X))
    ]
    np.testing.assert_array_equal(models[0].predict(X), models[1].predict(X))


def test_choosing_beta_takes_columns_by_name(frame, plane_runs, rows):
    X, y = rows
    choices = [
        hs.choose_beta(power_scaled(plane_runs), given, y, betas=[0.2, 0.8], cv=2).table
        for given in (X, swapped(frame, X))
    ]
    pd.testing.assert_frame_equal(*choices)


def test_a_diagnosis_takes_columns_by_name(frame, plane_simulator, rows):
    X, y = rows
    exact = power_scaled(plane_simulator, surrogate=hs.ExactSurrogate())
    others = [kind for kind in kinds() if kind not in ("offset", "gain")]
    diagnoses = [
        hs.DiscrepancyDiagnosis(exact, exclude=others, n_replicates=20, cv=2, random_state=0).fit(
            given, y
        )
        for given in (X, swapped(frame, X))
    ]
    first, second = (d.causes_.set_index("kind")["log_evidence"] for d in diagnoses)
    pd.testing.assert_series_equal(first, second)
    test = swapped(frame, X), y
    assert diagnoses[0].gain_on(X, y).elpd_before == diagnoses[1].gain_on(*test).elpd_before
    assert diagnoses[1].gain_.elpd_before == pytest.approx(diagnoses[0].gain_.elpd_before)
    assert diagnoses[0].extended_estimator_.score(X, y) == diagnoses[1].score(*test)


# ----------------------------------------------------------- what is no number is refused


def both(X, y, plane_runs):
    """Return functions of (X, y) that take data, by what they are."""
    fitted = power_scaled(plane_runs).fit(X, y)
    predictive = hs.PredictiveWeightedSurrogate(plane_runs, n_draws=50, random_state=0).fit(X, y)
    exact = power_scaled(plane_runs.simulator, surrogate=hs.ExactSurrogate())
    return {
        "fit": lambda X, y: power_scaled(plane_runs).fit(X, y),
        "predictive fit": lambda X, y: hs.PredictiveWeightedSurrogate(plane_runs).fit(X, y),
        "score": fitted.score,
        "predictive score": predictive.score,
        "log_predictive_density": fitted.log_predictive_density,
        "diagnosis": lambda X, y: hs.DiscrepancyDiagnosis(exact).fit(X, y),
        "source": lambda X_, y_: hs.MultiSourceSurrogate(
            [hs.Source(plane_runs), hs.Source((X_, y_))], n_draws=50
        ).fit(X, y),
        "choose_beta": lambda X, y: hs.choose_beta(power_scaled(plane_runs), X, y, cv=2),
        "elpd_scorer": lambda X, y: hs.scoring.elpd_scorer(fitted, X, y),
        "neg_crps_scorer": lambda X, y: hs.scoring.neg_crps_scorer(fitted, X, y),
        "neg_rmse_scorer": lambda X, y: hs.scoring.neg_rmse_scorer(fitted, X, y),
    }


@pytest.fixture(scope="module")
def entrances(rows, plane_runs):
    return both(*rows, plane_runs)


def one_of(values, wrong):
    out = np.array(values, dtype=object)
    out.flat[3] = wrong
    return out


DAYS = np.arange(20).astype("datetime64[D]")
BAD_OUTPUTS = {
    "masked": (lambda y: np.ma.array(y, mask=np.arange(20) == 3), "values of y are masked"),
    "dates": (lambda y: DAYS, "y holds dates or durations"),
    "durations": (lambda y: DAYS - DAYS[0], "y holds dates or durations"),
    "dates as objects": (lambda y: list(map(datetime.date.fromordinal, range(1, 21))), "y holds d"),
    "a series of dates": (lambda y: pd.Series(DAYS).dt.tz_localize("UTC"), "y holds dates"),
    "None": (lambda y: [None] * 20, "y contains NaN alone"),
    "pandas.NA": (lambda y: pd.Series([pd.NA] * 20), "y contains NaN alone"),
    "NaN": (lambda y: np.full(20, np.nan), "y contains NaN alone"),
    "infinite": (lambda y: one_of(y, np.inf), "y contains infinity"),
    "complex": (lambda y: y + 1j, "Complex data not supported"),
    "text": (lambda y: ["high"] * 20, "y must hold numbers: could not convert string"),
    "too large": (lambda y: y * 1e200, r"y has values as large as 1.*e\+201: .* another unit"),
}


@pytest.mark.parametrize("kind", BAD_OUTPUTS)
def test_outputs_that_are_no_numbers(entrances, rows, kind):
    make, match = BAD_OUTPUTS[kind]
    for enter in entrances.values():
        with pytest.raises((ValueError, TypeError), match=match):
            enter(rows[0], make(rows[1]))


BAD_INPUTS = {
    "masked": (lambda X: np.ma.array(X, mask=X > 0.9), "values of X are masked"),
    "masked rows": (lambda X: [np.ma.array(x, mask=x > 0.9) for x in X], "values of X are masked"),
    "dates": (lambda X: np.column_stack([DAYS, DAYS]), "X holds dates or durations"),
    "complex": (lambda X: X + 1j, "Complex data not supported"),
    "text": (lambda X: np.full(X.shape, "high"), "X must hold numbers: could not convert string"),
    "ragged": (lambda X: [[1.0, 2.0], [1.0]] * 10, "X must hold numbers"),
    "sparse": (lambda X: sparse.csr_array(X), r"X is sparse.*pass X.toarray\(\)"),
    "sparse columns": (
        lambda X: pd.DataFrame(X, columns=["x1", "x2"]).astype(pd.SparseDtype(float)),
        "X has sparse columns: pass frame.sparse.to_dense",
    ),
    "copies of a column": (
        lambda X: pd.DataFrame(X[:, [0, 1, 1]], columns=["x1", "x2", "x2"]),
        "X has more than one column 'x2'",
    ),
    "too large": (lambda X: one_of(X, 1e308).astype(float), r"X has values as large as 1e\+308"),
}


@pytest.mark.parametrize("kind", BAD_INPUTS)
def test_inputs_that_are_no_numbers(entrances, rows, kind):
    make, match = BAD_INPUTS[kind]
    for enter in entrances.values():
        with pytest.raises((ValueError, TypeError), match=match):
            enter(make(rows[0]), rows[1])


@pytest.mark.parametrize("kind", [kind for kind in BAD_INPUTS if kind != "too large"])
def test_runs_and_calls_of_what_is_no_number(plane_runs, plane_simulator, kind):
    make, match = BAD_INPUTS[kind]
    X = make(plane_runs.X[:20])
    omega = plane_runs.omega[:20]
    with pytest.raises((ValueError, TypeError), match=match):
        hs.SimulationData(X, omega, plane_runs.y[:20], ["x1", "x2"], SLOPE)
    with pytest.raises((ValueError, TypeError), match=match):
        plane_simulator(X, omega)


def test_runs_whose_output_is_masked_or_too_large(plane_runs):
    X, omega, y = plane_runs.X, plane_runs.omega, plane_runs.y
    with pytest.raises(ValueError, match=r"values of y are masked.*filled\(numpy.nan\)"):
        hs.SimulationData(X, omega, np.ma.array(y, mask=y > 9), ["x1", "x2"], SLOPE)
    with pytest.raises(ValueError, match="y of the runs has values as large as"):
        hs.SimulationData(X, omega, 1e200 * y, ["x1", "x2"], SLOPE)
    with pytest.raises(ValueError, match="X of the runs has values as large as"):
        hs.SimulationData(1e308 * X, omega, y, ["x1", "x2"], SLOPE)


def test_a_simulation_that_returns_masked_values(rows):
    simulator = hs.Simulator(
        lambda x1, x2, slope: np.ma.array(x1, mask=x2 > 0.5), {"x1": (0, 1), "x2": (0, 1)}, SLOPE
    )
    with pytest.raises(ValueError, match="values of The output of '<lambda>' are masked"):
        simulator.run(16, random_state=0)


def test_numbers_are_taken_however_they_are_stored(plane_runs, rows):
    X, y = rows
    expected = power_scaled(plane_runs).fit(X, y).predict(X)
    stored = [
        (X.astype(object), list(y)),
        (np.ma.array(X, mask=False), pd.Series(y, dtype="Float64")),
        (pd.DataFrame(X.astype(object), columns=["x1", "x2"]), y.astype(object)),
        (np.array([(a, b) for a, b in X], dtype=[("x1", float), ("x2", float)]), y),
    ]
    for columns, outputs in stored:
        model = power_scaled(plane_runs).fit(columns, outputs)
        np.testing.assert_array_equal(model.predict(columns), expected)


def test_weights_that_are_no_numbers(plane_runs, rows):
    for wrong, match in [
        (np.ma.array(np.ones(20), mask=np.arange(20) == 3), "sample_weight are masked"),
        (DAYS, "sample_weight holds dates"),
        (np.full(20, 1e308), "sample_weight has values as large as"),
    ]:
        with pytest.raises(ValueError, match=match):
            power_scaled(plane_runs).fit(*rows, sample_weight=wrong)


def test_a_lazy_frame_is_to_be_computed(rows):
    class Lazy(Table):
        def collect(self):
            return Table(self._columns)

    lazy = Lazy({"x1": rows[0][:, 0]})
    with pytest.raises(TypeError, match=r"X is a Lazy, not computed yet: pass frame.collect\(\)"):
        as_table(lazy)


def test_a_lazy_frame_of_polars(rows):
    lazy = polars_frame({"x1": rows[0][:, 0]}).lazy()
    with pytest.raises(TypeError, match=r"X is a LazyFrame, not computed yet"):
        as_table(lazy)


def test_missing_and_text_columns_of_a_frame(frame, plane_runs, rows):
    X, y = rows
    model = power_scaled(plane_runs)
    holed = np.where(np.arange(20) == 6, np.nan, X[:, 1])
    with pytest.raises(ValueError, match=r"column 'x2' are missing \(NaN\), the first in row 7"):
        model.fit(frame({"x1": X[:, 0], "x2": holed}), y)
    with pytest.raises(ValueError, match=r"x"):
        model.fit(frame({"x1": X[:, 0], "x2": np.array(["a", "b"] * 10)}), y)
    with pytest.raises(ValueError, match=r"lack the simulation's inputs \['x2'\]"):
        model.fit(frame({"x1": X[:, 0], "depth": X[:, 1]}), y)


def test_integers_beyond_doubles():
    with pytest.raises(ValueError, match="y must hold numbers: int too large"):
        as_numbers([1, 10**400], "y")


# ----------------------------------------------------------------- what can be squared


@pytest.mark.parametrize("size", [1e-140, 1e-100, 1e100, 1e140])
def test_outputs_of_any_unit_that_can_be_squared(plane_runs, rows, size):
    X, y = rows
    runs = hs.SimulationData(
        plane_runs.X, plane_runs.omega, size * plane_runs.y, ["x1", "x2"], SLOPE
    )
    scaled = power_scaled(runs).fit(X, size * y)
    expected = power_scaled(plane_runs).fit(X, y)
    np.testing.assert_allclose(scaled.predict(X) / size, expected.predict(X), rtol=1e-3)


@pytest.mark.parametrize(
    ("values", "match"),
    [
        (np.full(20, 5e-324), "y has values that differ by no more than 4.9.*e-324, or are as"),
        (np.full(20, 1e-200), "y has values that differ by no more than 1e-200"),
        (1e-200 * np.arange(20.0), "y has values that differ by no more than 1.9e-199"),
        (np.full(20, 1e200), r"y has values as large as 1e\+200"),
        (np.full(20, 1.7e308), r"y has values as large as 1.7e\+308"),
    ],
)
def test_outputs_that_cannot_be_squared(plane_runs, rows, values, match):
    for model in (power_scaled(plane_runs), power_scaled(None), hs.PredictiveWeightedSurrogate()):
        with pytest.raises(ValueError, match=match):
            model.fit(rows[0], values)


@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.HybridSurrogateWarning")
@pytest.mark.parametrize("value", [0.0, 3.0, -1e-140, 1e140])
def test_constant_outputs(rows, value):
    model = power_scaled(None).fit(rows[0], np.full(20, value))
    np.testing.assert_allclose(model.predict(rows[0]), value, rtol=1e-6, atol=1e-6)


def test_ranges_that_cannot_be_squared():
    for low, high in [(-1e308, 1e308), (0, 1e-200)]:
        with pytest.raises(ValueError, match="The range of 't'"):
            hs.Simulator(lambda t: t, {"t": (low, high)})


# ----------------------------------------------------------------- numbers


def test_numbers_that_are_none(plane_simulator, plane_runs, rows):
    model = power_scaled(plane_runs).fit(*rows)
    nan = float("nan")
    refused = [
        lambda: model.predict_interval(rows[0], level=nan),
        lambda: plane_simulator.run(8, ends=nan),
        lambda: hs.MultiSourceSurrogate([hs.Source(plane_runs, nan)]).fit(*rows),
        lambda: hs.MultiSourceSurrogate([hs.Source(plane_runs)], power=nan).fit(*rows),
        lambda: power_scaled(plane_runs, sampler=hs.EnsembleSampler(tol=nan)).fit(*rows),
        lambda: check_number(nan, "level", float),
    ]
    for call in refused:
        with pytest.raises(ValueError, match="must be a number, got NaN"):
            call()


def test_settings_of_a_diagnosis_that_are_no_numbers(plane_simulator, rows):
    exact = power_scaled(plane_simulator, surrogate=hs.ExactSurrogate())
    for wrong, error in [
        ({"false_alarm_rate": float("nan")}, ValueError),
        ({"false_alarm_rate": "low"}, TypeError),
        ({"n_replicates": float("nan")}, TypeError),
        ({"n_replicates": "many"}, TypeError),
    ]:
        with pytest.raises(error, match=next(iter(wrong))):
            hs.DiscrepancyDiagnosis(exact, **wrong).fit(*rows)


# ----------------------------------------------------------------- inputs far away


@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.ExtrapolationWarning")
@pytest.mark.parametrize("surrogate", [hs.PolynomialChaos(2), hs.Kriging()])
@pytest.mark.parametrize("estimator", [hs.PowerScaledSurrogate, hs.PredictiveWeightedSurrogate])
def test_inputs_at_which_a_surrogate_has_no_numbers(plane_runs, rows, surrogate, estimator):
    far = one_of(rows[0], 1e20).astype(float)
    match = r"1 of 20 rows have 'x2' so far outside the simulated range .* 1e\+20 in row 2"
    model = estimator(plane_runs, surrogate=surrogate, n_draws=50, random_state=0)
    with pytest.raises(ValueError, match=match):
        model.fit(far, rows[1])
    model.fit(*rows)
    with pytest.raises(ValueError, match=match):
        model.predict(far)
    with pytest.raises(ValueError, match=match):
        model.score(far, rows[1])
