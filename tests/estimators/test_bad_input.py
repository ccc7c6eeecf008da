"""Bad input of the estimators: an error that says what to do, where it enters."""

import numpy as np
import pandas as pd
import pytest
from conftest import fall
from scipy import stats
from sklearn.exceptions import NotFittedError

import hybridsurrogate as hs
from hybridsurrogate.surrogates import Surrogate


def power_scaled(simulation, **parameters):
    arguments = {"surrogate": hs.PolynomialChaos(2), "n_draws": 100, "random_state": 0}
    return hs.PowerScaledSurrogate(simulation, **(arguments | parameters))


@pytest.mark.parametrize(
    ("parameters", "error", "match"),
    [
        ({"beta": -0.1}, ValueError, "beta == -0.1, must be >= 0"),
        ({"beta": 1.5}, ValueError, "beta == 1.5, must be <= 1"),
        ({"beta": float("nan")}, ValueError, "beta must lie between 0 and 1, got NaN"),
        ({"beta": "half"}, TypeError, "beta must be an instance of"),
        ({"n_draws": 3}, ValueError, "n_draws == 3, must be >= 10"),
        ({"n_draws": 100.0}, TypeError, "n_draws must be an instance of"),
        ({"sampler": "nuts"}, ValueError, r"sampler must be one of .*, got 'nuts'"),
        (
            {"likelihood": "gamma"},
            ValueError,
            r"one of \['beta-binomial', 'binomial', 'lognormal', 'neg",
        ),
        ({"noise_prior": 0.5}, TypeError, "prior of 'noise_prior' must be a frozen"),
        ({"surrogate": "pce"}, TypeError, "must be a surrogate object such as Polynomial"),
        ({"surrogate": hs.PolynomialChaos}, TypeError, "must be a surrogate object"),
        ({"likelihood": hs.StudentT(np.inf)}, ValueError, "positive and finite, got inf"),
        ({"effects": hs.Offset()}, TypeError, r"sequence of causes such as \[Trend"),
        ({"effects": ["trend"]}, TypeError, "sequence of causes"),
        ({"effects": [hs.Offset]}, TypeError, "sequence of causes"),
        ({"effects": None}, TypeError, "sequence of causes"),
        ({"effects": [hs.Trend("depth")]}, ValueError, r"no measured column 'depth'; .*\['t'\]"),
        ({"effects": [hs.WrongConstant("mass")]}, ValueError, "'mass' is not an assumed constant"),
        (
            {"effects": [hs.ParameterDrift("drag", "t")]},
            ValueError,
            r"'drag' is not a parameter of the simulation; these are: \['gravity'\]",
        ),
        (
            {"effects": [hs.ParameterDrift("gravity", "depth")]},
            ValueError,
            "no measured column 'depth'",
        ),
        (
            {"noise_prior": stats.uniform(-2, 1)},
            ValueError,
            "noise_prior must have mass above zero: .* ends at -1",
        ),
    ],
    # an object without a name of its own would put its address into the test's name
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else None,
)
def test_bad_parameters(simulation, measured, parameters, error, match):
    with pytest.raises(error, match=match):
        power_scaled(simulation, **parameters).fit(*measured)


def test_bad_simulation(simulation, measured):
    for wrong in (simulation.y, "runs.csv", [simulation]):
        with pytest.raises(TypeError, match=r"must be SimulationData .* a Simulator or None, got"):
            power_scaled(wrong).fit(*measured)


ESTIMATORS = [hs.PowerScaledSurrogate, hs.PredictiveWeightedSurrogate]


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_a_simulator_must_be_run_for_an_emulator(simulator, measured, estimator):
    with pytest.raises(ValueError, match=r"PolynomialChaos is trained on runs.*simulator.run\(100"):
        estimator(simulator, hs.PolynomialChaos(), n_draws=100).fit(*measured)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_runs_made_elsewhere_cannot_be_exact(measured, estimator):
    t, gravity = np.repeat([0.0, 2.0, 4.0], 3), np.tile([5.0, 10.0, 15.0], 3)
    runs = hs.SimulationData(
        t,
        gravity,
        fall(t, gravity),
        inputs=["t"],
        parameters={"gravity": hs.truncated_normal(9.8, 1, 5, 15)},
    )
    with pytest.raises(ValueError, match="ExactSurrogate evaluates the simulation itself, but"):
        estimator(runs, surrogate=hs.ExactSurrogate(), n_draws=100).fit(*measured)


@pytest.mark.parametrize(
    ("X", "y", "match"),
    [
        ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0], "Expected 2D array, got 1D array"),
        ([[1.0], [2.0], [3.0]], [[1.0, 2.0]] * 3, "y should be a 1d array"),
        ([[1.0], [2.0], [3.0]], [1.0, 2.0], "inconsistent numbers of samples"),
        ([[1.0]], [90.0], r"1 sample\(s\).* a minimum of 2 is required"),
        ([[1.0], [2.0], [3.0]], [np.nan] * 3, "Input y contains NaN alone"),
        ([[1.0], [2.0], [3.0]], [1.0, np.inf, 3.0], "Input y contains infinity"),
        ([[1.0], [np.nan], [3.0]], [1.0, 2.0, 3.0], "Input X contains NaN"),
        ([["a"], ["b"]], [1.0, 2.0], "could not convert string to float"),
    ],
)
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_bad_data(simulation, X, y, match, estimator):
    with pytest.raises(ValueError, match=match):
        estimator(simulation, n_draws=100).fit(X, y)


@pytest.mark.parametrize(
    "kind",
    [np.asarray, list, pd.Series, lambda y: pd.Series(pd.array(y, dtype="boolean"))],
    ids=["array", "list", "series", "nullable"],
)
@pytest.mark.parametrize("with_diagnosis", [False, True])
def test_booleans_are_no_numbers_with_noise(simulation, measured, kind, with_diagnosis):
    X, y = measured
    model = power_scaled(simulation)
    model = hs.DiscrepancyDiagnosis(model) if with_diagnosis else model
    with pytest.raises(ValueError, match=r"y holds booleans.*normal .*likelihood='binomial'"):
        model.fit(X, kind(y > 80))


def test_booleans_are_outcomes_of_a_binomial_likelihood():
    simulator = hs.Simulator(
        lambda x, a: 1 / (1 + np.exp(a * (0.5 - x))), {"x": (0, 1)}, {"a": stats.norm(5, 2)}
    )
    x = np.linspace(0, 1, 40)
    outcome = np.random.default_rng(0).uniform(size=40) < simulator(x, np.full(40, 5.0))
    model = power_scaled(simulator, surrogate=hs.ExactSurrogate(), likelihood="binomial")
    told, numbers = (
        model.fit(x[:, None], y).predict(x[:, None]) for y in (outcome, outcome.astype(float))
    )
    np.testing.assert_array_equal(told, numbers)


@pytest.mark.parametrize("values", [[np.nan], [np.inf]])
def test_bad_data_in_scores(fitted, values):
    with pytest.raises(ValueError, match="Input y contains"):
        fitted.score([[1.0]], values)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_columns_that_the_simulation_needs(simulation, measured, estimator):
    X, y = measured
    frame = pd.DataFrame({"time": X[:, 0], "wind": X[:, 0]})
    match = r"lack the simulation's inputs \['t'\]; their columns are \['time', 'wind'\]"
    with pytest.raises(ValueError, match=match):
        estimator(simulation, n_draws=100).fit(frame, y)


@pytest.mark.parametrize(
    "column",
    [
        pd.Series(["A", "B"] * 10),
        pd.Series(["A", "B"] * 10, dtype="category"),
        pd.Series(["noon", *map(str, range(19))]),
    ],
    ids=["text", "category", "numbers and text"],
)
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_columns_that_hold_no_numbers(simulation, measured, column, estimator):
    X, y = measured[0][:20], measured[1][:20]
    frame = pd.DataFrame({"t": column})
    match = rf"columns \['t'\] hold no numbers: row 1 of 't' is '{column[0]}'.*map.*Timestamp"
    with pytest.raises(ValueError, match=match):
        estimator(simulation, n_draws=100).fit(frame, y)
    # numbers are taken however they are stored
    stored = frame.assign(t=pd.Series(X[:, 0]).astype(str))
    fitted = estimator(simulation, n_draws=100, random_state=0).fit(stored, y)
    with pytest.raises(ValueError, match=match):
        fitted.predict(frame)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_numbers_with_a_word_among_them_are_no_labels(simulation, measured, estimator):
    X, y = measured[0][:20], measured[1][:20]
    frame = pd.DataFrame({"t": X[:, 0], "dose": ["1", "2"] * 9 + ["2", "n.d."]})
    with pytest.raises(ValueError, match=r"row 20 of 'dose' is 'n.d.'. Correct it"):
        estimator(simulation, n_draws=100).fit(frame, y)


def two_inputs(t, height, gravity):
    return height - gravity / 2 * t**2


def test_too_few_columns_of_an_array(measured):
    simulator = hs.Simulator(
        two_inputs,
        inputs={"t": (0, 4), "height": (80, 120)},
        parameters={"gravity": hs.truncated_normal(9.8, 1, 5, 15)},
    )
    runs = simulator.run(64, random_state=0)
    with pytest.raises(ValueError, match=r"X has 1 columns, but the simulation has 2 inputs"):
        power_scaled(runs).fit(*measured)


def test_other_columns_than_in_fit(fitted):
    with pytest.raises(ValueError, match=r"X has 2 features, but .* is expecting 1 features"):
        fitted.predict([[1.0, 2.0]])


@pytest.mark.parametrize("method", ["predict", "sample_predictive_mean", "predict_interval"])
def test_predictions_before_fit(simulation, method):
    with pytest.raises(NotFittedError, match="not fitted yet"):
        getattr(power_scaled(simulation), method)([[1.0]])


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_rows_outside_the_simulated_range(simulation, estimator):
    t = np.append(np.linspace(0, 4, 18), [4.5, 5.0])
    model = estimator(simulation, surrogate=hs.PolynomialChaos(2), n_draws=200, random_state=0)
    match = r"2 of 20 measured rows \(10%\) have 't' outside the simulated range \[0, 4\]"
    with pytest.warns(hs.ExtrapolationWarning, match=match) as record:
        model.fit(t[:, None], fall(t, 9.5) + np.cos(40 * t))
    assert record[0].filename == __file__


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_predictions_outside_the_simulated_range(simulation, simulator, measured, estimator):
    model = estimator(simulation, surrogate=hs.PolynomialChaos(2), n_draws=200, random_state=0)
    model.fit(*measured)
    for method in ("predict", "predict_interval", "sample_posterior_predictive"):
        match = r"1 of 2 predicted rows \(50%\) have 't' outside the simulated range \[0, 4\]"
        with pytest.warns(hs.ExtrapolationWarning, match=match) as record:
            getattr(model, method)([[3.0], [30.0]])
        assert record[0].filename == __file__
        getattr(model, method)([[3.0], [4.0]])
    exact = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    # the simulation itself is run there
    exact.fit(*measured).predict([[30.0]])


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_outputs_of_another_unit(simulation, measured, estimator):
    X, y = measured
    with pytest.warns(hs.ExtrapolationWarning, match="the same units") as record:
        estimator(simulation, n_draws=50).fit(X, 1000 * y + 5000)
    assert record[0].filename == __file__


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("low", [0.0, -3.0])
def test_log_normal_needs_positive_measured_values(simulation, measured, low, estimator):
    X, y = measured
    match = rf"1 of 32 measured values are zero or negative \(first at row 4: {low:g}\)"
    with pytest.raises(ValueError, match=match):
        estimator(simulation, likelihood="lognormal").fit(
            X, np.where(np.arange(len(y)) == 4, low, y)
        )


def test_means_that_one_draw_carries():
    """Three rows leave the noise of a logarithm so open that its exponential has no mean."""
    simulator = hs.Simulator(
        lambda t, rate: 100 * np.exp(rate * t),
        {"t": (0, 10)},
        {"rate": hs.truncated_normal(0.8, 0.2, 0.1, 1.5)},
    )
    t = np.linspace(0, 10, 3)
    y = 100 * np.exp(0.7 * t + 0.1 * np.random.default_rng(0).standard_normal(3))
    model = hs.PredictiveWeightedSurrogate(
        simulator.run(100, random_state=0), likelihood="lognormal", random_state=0
    ).fit(t[:, None], y)
    with pytest.warns(hs.SamplingWarning, match="At 1 rows a single draw makes up more") as record:
        model.predict([[5.0]])
    assert record[0].filename == __file__
    tight = model.set_params(noise_prior=stats.halfnorm(scale=0.5)).fit(t[:, None], y)
    assert tight.predict([[5.0]])[0] == pytest.approx(100 * np.exp(3.5), rel=0.5)


def test_log_normal_needs_positive_values_to_score(simulator, measured):
    above_ground = simulator.run(32, random_state=0, ends=0)
    model = power_scaled(above_ground, likelihood="lognormal").fit(*measured)
    with pytest.raises(ValueError, match="1 of 1 measured values"):
        model.score([[1.0]], [0.0])


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_log_normal_needs_positive_simulated_values(measured, estimator):
    t, gravity = np.repeat([0.0, 2.0, 4.0], 3), np.tile([5.0, 10.0, 15.0], 3)
    runs = hs.SimulationData(
        t,
        gravity,
        np.maximum(fall(t, gravity), 0),
        inputs=["t"],
        parameters={"gravity": hs.truncated_normal(9.8, 1, 5, 15)},
    )
    with pytest.raises(ValueError, match="1 of 9 simulated values are zero or negative"):
        estimator(runs, likelihood="lognormal").fit(*measured)


class Faulty(hs.Cause):
    """A cause that returns what it is told to."""

    kind = "faulty"
    coefficients = ("amplitude",)

    def __init__(self, method="columns", value=None):
        self.method = method
        self.value = value

    def columns(self, X, theta):
        return self.value if self.method == "columns" else np.ones((len(X["t"]), 1))

    def gain(self, X, theta):
        return self.value if self.method == "gain" else 1.0

    def noise(self, X, theta):
        return self.value if self.method == "noise" else 1.0

    def inputs(self, X, omega, theta):
        return (self.value, omega) if self.method == "inputs" else (X, omega)


class Asking(hs.Cause):
    coefficients = ("amplitude",)

    def columns(self, X, theta):
        return X["depth"][:, None]


class Unfrozen(Faulty):
    parameters = {"width": 3}


class Nothing(Surrogate):
    def build(self, domain):
        return None


@pytest.mark.parametrize(
    ("parameters", "error", "match"),
    [
        ({"effects": [Asking()]}, ValueError, r"needs 'depth'; there are \['t', 'gravity'\]"),
        ({"effects": [Unfrozen()]}, TypeError, "prior of 'width of the cause faulty' must be"),
        ({"surrogate": Nothing()}, TypeError, "Nothing.build must return a Basis, got None"),
    ],
)
def test_causes_and_surrogates_of_ones_own_that_are_incomplete(
    simulation, measured, parameters, error, match
):
    with pytest.raises(error, match=match):
        power_scaled(simulation, **parameters).fit(*measured)


@pytest.mark.parametrize(
    ("weights", "match"),
    [
        (lambda n: np.ones(n - 1), "sample_weight must have shape"),
        (lambda n: -np.ones(n), "sample_weight must be finite and not negative"),
        (lambda n: np.full(n, np.nan), "sample_weight must be finite and not negative"),
        (np.zeros, "sample_weight sums to zero"),
    ],
)
def test_weights_of_a_score(fitted, measured, weights, match):
    X, y = measured
    with pytest.raises(ValueError, match=match):
        fitted.score(X, y, sample_weight=weights(len(y)))


@pytest.mark.parametrize(
    ("method", "value", "match"),
    [
        ("columns", None, r"'faulty' must return shape .* from columns .*'amplitude'.*got None"),
        ("columns", np.ones(64), r"from columns .* got \(64,\)"),
        ("columns", np.ones((3, 1)), r"must return shape \(64, 1\) from columns"),
        ("columns", np.full((64, 1), np.nan), "'faulty' returned NaN or infinity from columns"),
        ("gain", np.ones(5), r"must return shape \(\) or \(64,\) from gain"),
        ("gain", np.full(64, np.inf), "NaN or infinity from gain"),
        ("noise", np.ones((64, 1)), r"from noise, got \(64, 1\)"),
        ("noise", np.zeros(64), "'faulty' returned a noise that is not positive"),
        ("inputs", {}, r"from inputs, 't', got None"),
        ("inputs", {"t": np.full(64, np.nan)}, "NaN or infinity from inputs, 't'"),
    ],
)
def test_a_cause_that_returns_nonsense(simulation, measured, method, value, match):
    with pytest.raises(ValueError, match=match):
        power_scaled(simulation, effects=[Faulty(method, value)]).fit(*measured)


def broken(t, gravity):
    return np.full_like(t, np.nan)


def test_a_simulation_that_fails_everywhere(measured):
    simulator = hs.Simulator(
        broken, inputs={"t": (0, 4)}, parameters={"gravity": hs.truncated_normal(9.8, 1, 5, 15)}
    )
    with pytest.raises(ValueError, match="the simulation fails everywhere"):
        power_scaled(simulator, surrogate=hs.ExactSurrogate()).fit(*measured)


def draining(t, rate):
    with np.errstate(invalid="ignore"):
        return np.sqrt(10 - rate * t)  # the tank is empty at t = 10 / rate


def test_predictions_where_the_simulation_fails_for_some_draws():
    rng = np.random.default_rng(0)
    t = np.linspace(0, 8, 12)
    simulator = hs.Simulator(
        draining, {"t": (0, 8)}, {"rate": hs.truncated_normal(1, 0.1, 0.5, 1.2)}
    )
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    model.fit(t[:, None], draining(t, 1.0) + 0.3 * rng.standard_normal(12))
    rate = model.posterior_.values[:, 0]
    X = np.array([[8.0], [10.0]])
    empty = rate > 1.0
    assert 0.1 < empty.mean() < 0.9
    with pytest.warns(hs.FailedRunsWarning, match="At 1 of 2 rows .* count as impossible there"):
        mean = model.predict(X)
    assert mean[0] == pytest.approx(draining(8.0, rate).mean())
    # each of the others counts once or twice or so: their spread over what is left of the draws
    others = draining(10.0, rate[~empty])
    assert mean[1] == pytest.approx(others.mean(), abs=4 * others.std() / len(others) ** 0.5)
    with pytest.warns(hs.FailedRunsWarning):
        lower, upper = model.predict_interval(X)
    assert (lower < mean).all()
    assert (mean < upper).all()
    with pytest.warns(hs.FailedRunsWarning):
        assert np.isfinite(model.score(X, [1.4, 0.5]))
    with pytest.warns(hs.FailedRunsWarning, match="every draw fails, and there is no prediction"):
        assert np.isnan(model.predict([[20.0]])).all()


def test_a_noise_prior_too_narrow_to_draw_from():
    simulator = hs.Simulator(
        lambda x, level: level + 0 * x, {"x": (0, 1)}, {"level": stats.norm(0, 1)}
    )
    model = hs.PowerScaledSurrogate(
        simulator, hs.ExactSurrogate(), noise_prior=stats.uniform(0.1, 1e-7), random_state=0
    )
    with pytest.raises(ValueError, match="a prior with hard ends may be too narrow"):
        model.fit(np.linspace(0, 1, 9)[:, None], np.linspace(0, 0.3, 9))
