"""Every kind of cause: its formula by hand, recovery, extension, the catalogue, the evidence."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from scipy import stats
from scipy.special import logsumexp
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.discrepancy import predict_locally
from hybridsurrogate.diagnosis.evidence import kind_of, search
from hybridsurrogate.diagnosis.extension import extend_simulator
from hybridsurrogate.diagnosis.verdict import form_of
from hybridsurrogate.effects.catalogue import catalogue
from hybridsurrogate.effects.picture import plot_cause
from hybridsurrogate.estimators.problem import make_context, make_problem
from hybridsurrogate.inference.layout import layout
from hybridsurrogate.inference.linearised import coefficient_belief, linearise
from hybridsurrogate.inference.scan import scan
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.surrogates.exact import ExactBasis

NOISE = 0.1


def tide(t, dose, height, rate, floor):
    return floor + height * np.sin(t) + rate * dose**2


SIMULATOR = hs.Simulator(
    tide,
    inputs={"t": (0, 12), "dose": (0, 4)},
    parameters={
        "height": hs.truncated_normal(3, 0.5, 1, 5),
        "rate": hs.truncated_normal(0.5, 0.1, 0.1, 1),
    },
    assumed={"floor": hs.Assumed(10.0, stats.norm(10, 1))},
    output="level",
)


def measured(n=100):
    rng = np.random.default_rng(11)
    return pd.DataFrame(
        {
            "t": np.linspace(0, 12, n),
            "dose": rng.permutation(np.linspace(0, 4, n)),
            "wind": rng.normal(2, 1, n),
            "batch": rng.permutation(np.arange(n) % 4 + 1.0),
        }
    )


FRAME = measured()


def plain(r, **changed):
    return tide(r.t, r.dose, **({"height": 3.2, "rate": 0.45, "floor": 10.0} | changed))


def drifting(shift):
    return lambda r: plain(r, height=3.2 + shift(r))


# cause, what is measured without noise, and the numbers a report should state
CASES = {
    "offset": (hs.Offset(), lambda r: plain(r) + 0.8, {"amplitude": 0.8}),
    "trend": (
        hs.Trend("t"),
        lambda r: plain(r) + 0.3 + 0.15 * (r.t - 6),
        {"level": 0.3, "slope": 0.15},
    ),
    "parabola": (
        hs.Trend("t", degree=2),
        lambda r: plain(r) + 0.3 + 0.1 * (r.t - 6) + 0.04 * (r.t - 6) ** 2,
        {"level": 0.3, "slope": 0.1, "curvature": 0.04},
    ),
    "periodic": (
        hs.Periodic("t"),
        lambda r: plain(r) + 0.5 * np.sin(2 * np.pi * r.t / 2.3 + 1),
        {"period": 2.3, "amplitude": 0.5},
    ),
    "overtone": (
        hs.Periodic("t", harmonics=2),
        lambda r: (
            plain(r) + 0.5 * np.sin(2 * np.pi * r.t / 2.3 + 1) + 0.3 * np.sin(4 * np.pi * r.t / 2.3)
        ),
        {"period": 2.3, "amplitude": 0.5, "overtone": 0.3},
    ),
    "step": (hs.Step("t"), lambda r: plain(r) + 0.6 * (r.t > 7.5), {"amplitude": 0.6}),
    "ramp": (
        hs.Ramp("t"),
        lambda r: plain(r) + 0.3 * np.maximum(r.t - 7, 0),
        {"location": 7.0, "slope": 0.3},
    ),
    "bump": (
        hs.Bump("t"),
        lambda r: plain(r) + 0.9 * np.exp(-0.5 * ((r.t - 4) / 0.7) ** 2),
        {"location": 4.0, "width": 0.7, "amplitude": 0.9},
    ),
    "decay": (
        hs.Decay("t"),
        lambda r: plain(r) + 1.2 * np.exp(-r.t / 2.5),
        {"amplitude": 1.2, "scale": 2.5},
    ),
    "saturation": (
        hs.Saturation("t"),
        lambda r: plain(r) + 1.5 * r.t / (r.t + 2.0),
        {"amplitude": 1.5, "half": 2.0},
    ),
    "gain": (hs.Gain(), lambda r: 1.1 * plain(r), {"gain": 1.1}),
    "wrong-constant": (
        hs.WrongConstant("floor"),
        lambda r: plain(r, floor=10.9),
        {"value": 10.9},
    ),
    "delay": (
        hs.Delay("t"),
        lambda r: tide(r.t - 0.4, r.dose, 3.2, 0.45, 10.0),
        {"lag": 0.4},
    ),
    "drift": (
        hs.ParameterDrift("height", "t"),
        drifting(lambda r: 0.1 * (r.t - 6)),
        {"slope": 0.1},
    ),
    "drift over an extra": (
        hs.ParameterDrift("height", "wind"),
        drifting(lambda r: 0.3 * r.wind),
        {"slope": 0.3},
    ),
    "drift, step": (
        hs.ParameterDrift("height", "t", shape="step"),
        drifting(lambda r: 0.8 * (r.t > 6.95)),
        {"change": 0.8},
    ),
    "drift, logistic": (
        hs.ParameterDrift("height", "t", shape="logistic"),
        drifting(lambda r: 1.5 / (1 + np.exp(-(r.t - 5) / 0.8))),
        {"change": 1.5, "location": 5.0, "width": 0.8},
    ),
    "drift, periodic": (
        hs.ParameterDrift("height", "t", shape="periodic"),
        drifting(lambda r: 0.8 * np.sin(2 * np.pi * r.t / 3.7 + 0.5)),
        {"period": 3.7, "amplitude": 0.8},
    ),
    "missing input": (
        hs.MissingInput("wind"),
        lambda r: plain(r) + 0.2 * (r.wind - FRAME.wind.mean()),
        {"slope": 0.2},
    ),
    "missing input, quadratic": (
        hs.MissingInput("wind", shape="quadratic"),
        lambda r: (
            plain(r) + 0.2 * (r.wind - FRAME.wind.mean()) + 0.1 * (r.wind - FRAME.wind.mean()) ** 2
        ),
        {"slope": 0.2, "curvature": 0.1},
    ),
    "missing input, categorical": (
        hs.MissingInput("batch", shape="categorical"),
        lambda r: plain(r) + r.batch.map({1.0: 0.4, 2.0: -0.1, 3.0: 0.1, 4.0: -0.4}),
        {"level_1": 0.4, "level_2": -0.1, "level_3": 0.1, "level_4": -0.4},
    ),
    "missing input, level": (
        hs.MissingInput("batch", shape="categorical", level=3),
        lambda r: plain(r) + 0.5 * (r.batch == 3),
        {"amplitude": 0.5},
    ),
    "interaction": (
        hs.Interaction("t", "dose"),
        lambda r: plain(r) + 0.1 * (r.t - 6) * (r.dose - 2),
        {"slope": 0.1},
    ),
    "noise": (hs.Noise("t"), plain, {"slope": 0.2, "ratio": np.exp(0.2 * 12)}),
}


def context_of(frame=FRAME, simulator=SIMULATOR, likelihood="normal"):
    columns = tuple(frame.columns)
    X = frame.to_numpy(dtype=float)
    n_inputs = len(simulator.input_names)
    basis = ExactBasis(np.empty(0), np.empty(0), simulator)
    return make_context(simulator, columns, n_inputs, X, 1.0, as_likelihood(likelihood), basis)


def problem_of(frame, y, simulator=SIMULATOR):
    X, columns = frame.to_numpy(dtype=float), tuple(frame.columns)
    normal = as_likelihood("normal")
    return make_problem(simulator, hs.ExactSurrogate(), normal, None, (), columns, X, y)


def prepared(name):
    return CASES[name][0].prepare(context_of())


# --------------------------------------------------------------------- formulas, by hand


def at(cause, theta=None, **columns):
    """Return columns of a cause at one row, rounded."""
    rows = {name: np.array([float(value)]) for name, value in columns.items()}
    theta = {name: np.array([float(value)]) for name, value in (theta or {}).items()}
    return np.round(cause.columns(rows, theta)[0], 6).tolist()


def test_columns_by_hand():
    # t from 0 to 12 is scaled to -1 ... 1: t = 9 is 0.5
    assert at(prepared("offset"), t=9) == [1]
    assert at(prepared("trend"), t=9) == [1, 0.5]
    assert at(prepared("parabola"), t=9) == [1, 0.5, (3 * 0.25 - 1) / 2]
    # a quarter of a period after the middle of the measured rows
    assert at(prepared("periodic"), {"period": 4}, t=7) == [1, 0]
    assert at(prepared("overtone"), {"period": 4}, t=7) == [1, 0, 0, -1]
    assert at(prepared("step"), {"location": 5}, t=4) == [0]
    assert at(prepared("step"), {"location": 5}, t=6) == [1]
    assert at(prepared("ramp"), {"location": 5}, t=8) == [3 / 12]
    assert at(prepared("ramp"), {"location": 5}, t=4) == [0]
    assert at(prepared("bump"), {"location": 5, "width": 2}, t=7) == [0.606531]
    assert at(prepared("decay"), {"scale": 3}, t=6) == [0.135335]
    assert at(prepared("decay"), {"scale": 3}, t=-6) == [1]
    assert at(prepared("saturation"), {"half": 3}, t=9) == [0.75]
    assert at(prepared("saturation"), {"half": 3}, t=-1) == [0]
    # dose from 0 to 4: 3 is 0.5
    assert at(prepared("interaction"), t=9, dose=3) == [0.25]


def test_columns_of_missing_inputs_by_hand():
    frame = pd.DataFrame({"t": np.arange(8.0), "wind": [0, 0, 0, 0, 0, 0, 4, 4.0]})
    frame["batch"] = [1, 1, 1, 2, 2, 2, 2, 2.0]
    simulator = hs.Simulator(lambda t: t, inputs={"t": (0, 8)})
    context = context_of(frame, simulator)
    # the mean of the wind is 1, its half span 2
    assert at(hs.MissingInput("wind").prepare(context), wind=4) == [1.5]
    assert at(hs.MissingInput("wind", shape="quadratic").prepare(context), wind=4) == [1.5, 2.25]
    levels = hs.MissingInput("batch", shape="categorical").prepare(context)
    assert levels.coefficients == ("level_1", "level_2")
    assert at(levels, batch=1) == [1 - 3 / 8, -5 / 8]
    assert at(levels, batch=2) == [-3 / 8, 1 - 5 / 8]
    assert at(levels, batch=7) == [0, 0]
    one = hs.MissingInput("batch", shape="categorical", level=2).prepare(context)
    assert [at(one, batch=1), at(one, batch=2)] == [[0], [1]]
    # deviations of a level from the mean over the rows: 3/8 of 2 and 5/8 of -1 is 1/8
    told = levels.estimates({}, {"level_1": np.array([2.0]), "level_2": np.array([-1.0])})
    assert told["level_1"][0] == pytest.approx(1.875)
    assert told["level_2"][0] == pytest.approx(-1.125)


@pytest.mark.parametrize(
    ("name", "theta", "t", "expected"),
    [
        ("drift", {"slope": 0.5}, 8.0, 3 + 0.5 * 2),
        ("drift, step", {"change": 0.7, "location": 5}, 6.0, 3.7),
        ("drift, step", {"change": 0.7, "location": 5}, 4.0, 3.0),
        ("drift, logistic", {"change": 1, "location": 5, "width": 2}, 7.0, 3 + 0.7310586),
        ("drift, periodic", {"sine": 0.4, "cosine": 0.3, "period": 4}, 7.0, 3.4),
        ("drift, periodic", {"sine": 0.4, "cosine": 0.3, "period": 4}, 10.0, 3.3),
    ],
)
def test_drifting_parameters_by_hand(name, theta, t, expected):
    rows, omega = prepared(name).inputs({"t": np.array([t])}, {"height": np.array([3.0])}, theta)
    assert omega["height"][0] == pytest.approx(expected)
    assert rows["t"][0] == t


def test_gain_constant_delay_and_noise_by_hand():
    rows = {"t": np.array([0.0, 6.0, 12.0])}
    assert prepared("gain").gain(rows, {"gain": 1.3}) == 1.3
    _, omega = prepared("wrong-constant").inputs(rows, {"floor": 10.0}, {"value": 11.0})
    assert omega["floor"] == 11.0
    moved, _ = prepared("delay").inputs(rows, {}, {"lag": 0.5})
    np.testing.assert_array_equal(moved["t"], [-0.5, 5.5, 11.5])
    noise = prepared("noise").noise(rows, {"slope": np.log(3)})
    np.testing.assert_allclose(noise, [1 / 3, 1, 3])


def test_noise_factors_have_geometric_mean_one():
    for column in FRAME.columns:
        cause = hs.Noise(column).prepare(context_of())
        factor = cause.noise({column: FRAME[column].to_numpy()}, {"slope": 1.7})
        assert np.mean(np.log(factor)) == pytest.approx(0, abs=1e-12)
        assert factor.max() > 3


def test_prior_nodes_and_priors_lie_where_they_should():
    low, high = prepared("decay").parameters["scale"].support()
    assert (low, high) == pytest.approx((2 * 12 / 99, 12))
    low, high = prepared("saturation").parameters["half"].support()
    assert (low, high) == pytest.approx((12 / 99, 12))
    nodes = prepared("noise").grid()["slope"]
    assert len(nodes) == 15
    assert nodes.min() == pytest.approx(-nodes.max())
    # the overtone must be resolved as well
    for harmonics in (1, 2):
        period = hs.Periodic("t", harmonics=harmonics).prepare(context_of()).parameters["period"]
        assert period.support()[0] == pytest.approx(harmonics * 24 / 99)
    # a quarter of all lags is beyond a tenth of the span
    assert prepared("delay").parameters["lag"].ppf(0.75) == pytest.approx(1.2)


# ------------------------------------------------------------- what holds for every kind


def draws_of(cause, n_draws):
    rng = np.random.default_rng(3)
    middle = (rng.uniform(0.2, 0.8, n_draws) for _ in cause.parameters)
    return {
        name: prior.ppf(share)
        for (name, prior), share in zip(cause.parameters.items(), middle, strict=True)
    }


def everything(cause, rows, theta):
    """Return all that the four methods give for rows and theta, each (n,) or (n, q)."""
    n = len(rows["t"])
    omega = {"height": np.full(n, 3.0), "rate": np.full(n, 0.5), "floor": np.full(n, 10.0)}
    run_rows, run_omega = cause.inputs(rows, omega, theta)
    parts = {f"run {name}": np.broadcast_to(v, n) for name, v in {**run_rows, **run_omega}.items()}
    parts["gain"] = np.broadcast_to(cause.gain(rows, theta), n)
    parts["noise"] = np.broadcast_to(cause.noise(rows, theta), n)
    if cause.coefficients:
        parts["columns"] = cause.columns(rows, theta)
        assert parts["columns"].shape == (n, len(cause.coefficients))
    return parts


@pytest.mark.parametrize("name", CASES)
def test_all_rows_of_all_draws_in_one_call(name):
    cause, n_draws = prepared(name), 5
    rows = {column: FRAME[column].to_numpy() for column in FRAME}
    n, theta = len(FRAME), draws_of(cause, n_draws)
    tiled = {column: np.tile(values, n_draws) for column, values in rows.items()}
    together = everything(cause, tiled, {k: np.repeat(v, n) for k, v in theta.items()})
    for j in range(n_draws):
        alone = everything(cause, rows, {k: np.full(n, v[j]) for k, v in theta.items()})
        for part, values in alone.items():
            np.testing.assert_allclose(together[part][j * n : (j + 1) * n], values)


@pytest.mark.parametrize("name", CASES)
def test_neutral_values_change_nothing(name):
    cause, n = prepared(name), len(FRAME)
    rows = {column: FRAME[column].to_numpy() for column in FRAME}
    middle = {k: np.full(n, prior.median()) for k, prior in cause.parameters.items()}
    neutral = {k: np.full(n, v) for k, v in cause.start().items()}
    if cause.kind == "noise":
        neutral = {"slope": np.zeros(n)}
    parts = everything(cause, rows, {**middle, **neutral})
    for column, values in rows.items():
        np.testing.assert_array_equal(parts[f"run {column}"], values)
    for parameter, value in {"height": 3.0, "rate": 0.5, "floor": 10.0}.items():
        np.testing.assert_allclose(parts[f"run {parameter}"], value)
    np.testing.assert_array_equal(parts["gain"], 1)
    np.testing.assert_array_equal(parts["noise"], 1)
    assert cause.coefficients or cause.start() or cause.kind == "noise"


@pytest.mark.parametrize("name", CASES)
def test_clone_and_parameters(name):
    cause = CASES[name][0]
    assert clone(cause).get_params() == cause.get_params()
    ready = prepared(name)
    again = clone(ready)
    theta = {k: np.array([prior.median()]) for k, prior in ready.parameters.items()}
    row = {column: FRAME[column].to_numpy()[:1] for column in FRAME}
    first, second = everything(ready, row, theta), everything(again, row, theta)
    for part, values in first.items():
        np.testing.assert_array_equal(values, second[part])
    # preparing again changes nothing
    assert ready.prepare(context_of()).grid().keys() == ready.grid().keys()
    assert cause.get_params() == CASES[name][0].get_params()


# ------------------------------------------------------------ blind recovery and extension


@pytest.fixture(scope="module")
def fits():
    """Return a function that fits the estimator of a case, once."""
    made = {}

    def fit(name):
        if name not in made:
            cause, truth, _ = CASES[name]
            rng = np.random.default_rng(list(CASES).index(name))
            scatter = NOISE * rng.standard_normal(len(FRAME))
            if name == "noise":
                scatter *= np.exp(0.2 * (FRAME.t.to_numpy() - 6))
            y = np.asarray(truth(FRAME)) + scatter
            columns = ["t", "dose", *(c for c in cause.reads if c in ("wind", "batch"))]
            model = hs.PowerScaledSurrogate(
                SIMULATOR,
                surrogate=hs.ExactSurrogate(),
                effects=(cause,),
                n_draws=400,
                random_state=0,
            )
            made[name] = model.fit(FRAME[columns], y), FRAME[columns], y
        return made[name]

    return fit


@pytest.mark.parametrize("name", CASES)
@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.SamplingWarning")
def test_the_truth_is_recovered(fits, name):
    model, _, _ = fits(name)
    estimates = model.posterior_.estimates(0)
    for quantity, truth in CASES[name][2].items():
        low, high = np.quantile(estimates[quantity], [0.005, 0.995])
        assert low < truth < high, (quantity, low, truth, high)
        assert high - low < 2 * abs(truth) + 0.5
    means = {key: float(np.mean(draws)) for key, draws in estimates.items()}
    words = model.posterior_.model.effects[0].formula(means)
    assert words.startswith(("simulation", "1.", "0.9"))
    assert "{" not in words


@pytest.mark.parametrize("name", CASES)
@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.SamplingWarning")
def test_the_extended_simulator_is_simulator_and_effect(fits, name):
    model, frame, y = fits(name)
    posterior = model.posterior_
    cause = posterior.model.effects[0]
    problem = problem_of(frame, y)
    if name == "noise":
        with pytest.raises(ValueError, match="leaves the simulation as it is"):
            extend_simulator(SIMULATOR, cause, problem)
        return
    extended = extend_simulator(SIMULATOR, cause, problem)
    X = frame.to_numpy(dtype=float)
    eta, _ = posterior.eta(X)
    assert set(extended.input_names) == set(frame.columns)
    for draw in (0, 9):
        omega = np.concatenate([posterior.values[draw], posterior.effect_coefficients[draw]])
        run = extended(X, np.tile(omega, (len(X), 1)))
        np.testing.assert_allclose(run, eta[draw], rtol=1e-10)
    # and the fitted one follows the noise-free truth
    assert np.sqrt(np.mean((model.predict(frame) - np.asarray(CASES[name][1](FRAME))) ** 2)) < 0.06


# ----------------------------------------------------------------------- errors and skips


@pytest.mark.parametrize(
    "cause",
    [
        hs.Trend("depth"),
        hs.Periodic("depth"),
        hs.Step("depth"),
        hs.Ramp("depth"),
        hs.Bump("depth"),
        hs.Decay("depth"),
        hs.Saturation("depth"),
        hs.Delay("depth"),
        hs.ParameterDrift("height", "depth"),
        hs.MissingInput("depth"),
        hs.Interaction("t", "depth"),
        hs.Noise("depth"),
    ],
    ids=lambda cause: cause.kind,
)
def test_a_column_that_is_not_there(cause):
    with pytest.raises(ValueError, match=r"no measured column 'depth'; the columns are \['t'"):
        cause.prepare(context_of())


@pytest.mark.parametrize(
    ("cause", "message"),
    [
        (hs.Trend("t", degree=3), "degree of a trend is 1 or 2, got 3"),
        (hs.Periodic("t", harmonics=0), "harmonics must be 1 or 2, got 0"),
        (hs.Interaction("t", "t"), "two different columns, got 't' twice"),
        (hs.Delay("wind"), r"shifts an input of the simulation, and 'wind' is none.*\['t', 'dose'"),
        (hs.ParameterDrift("speed", "t"), "'speed' is not a parameter"),
        (hs.ParameterDrift("rate", "t", shape="zigzag"), "shape must be one of.*got 'zigzag'"),
        (hs.MissingInput("wind", shape="cubic"), "shape must be one of.*got 'cubic'"),
        (hs.MissingInput("wind", level=2), "level=2 needs shape='categorical'"),
        (hs.MissingInput("wind", shape="categorical"), "wind has 100 distinct values, 2 to 6"),
        (hs.MissingInput("batch", shape="categorical", level=9), "'batch' is never 9"),
    ],
)
def test_causes_that_cannot_work(cause, message):
    with pytest.raises(ValueError, match=message):
        cause.prepare(context_of())


def test_the_whole_catalogue():
    causes, skipped = catalogue(context_of())
    drifts = [cause for cause in causes if cause.kind == "parameter-drift"]
    levels = [cause for cause in causes if getattr(cause, "level", None) is not None]
    rest = {form_of(cause) for cause in causes if cause not in (*drifts, *levels)}
    assert rest == {
        *("offset", "gain", "wrong-constant", "trend", "trend: quadratic", "periodic"),
        *("periodic: overtone", "step", "ramp", "bump", "decay", "saturation", "delay"),
        *("interaction", "missing-input", "missing-input: quadratic", "missing-input: categorical"),
        *("noise", "noise: mean", "noise: tails", "noise: autocorrelation", "unexplained"),
    }
    # a continuous column has no levels, and this simulation has no dynamics
    assert {(s.kind, s.target) for s in skipped} == {
        ("missing-input", "wind"),
        ("missing-term", None),
    }
    assert {s.reason.partition(":")[0] for s in skipped} == {
        "categorical",
        "level",
        "inside the dynamics",
    }
    assert [cause.level for cause in levels] == [1, 2, 3, 4]
    assert [cause.target for cause in causes if cause.kind == "interaction"] == ["t * dose"]
    assert len(drifts) == 2 * 2 * 4 + 2 * 2


def test_what_is_left_out_comes_with_a_reason():
    frame = pd.DataFrame({"t": [0.0, 1, 2, 3, 3, 3], "side": [0.0, 0, 0, 1, 1, 1]})
    simulator = hs.Simulator(lambda t: t, inputs={"t": (0, 3)})
    _, skipped = catalogue(context_of(frame, simulator, "lognormal"))
    reasons = {}
    for s in skipped:
        reasons.setdefault(s.kind, []).append(s.reason)
    assert "a factor, weighed as gain" in reasons["offset"][0]
    assert reasons["interaction"] == ["a product needs two inputs, the simulation has one"]
    assert reasons["wrong-constant"] == ["the simulation has no assumed constants"]
    assert reasons["parameter-drift"] == ["the simulation has no parameters"]
    assert reasons["delay"] == ["t has 4 distinct values, 5 are needed"]
    assert reasons["step"] == ["t has 4 distinct values, 6 are needed"]
    assert reasons["periodic"][1] == "overtone: t has 4 distinct values, 12 are needed"
    few = "6 rows are too few"
    assert sorted(reasons["noise"]) == [few] * 2 + [
        f"autocorrelation: {few}",
        f"mean: {few}",
        f"tails: {few}",
    ]
    assert any("straight line over it says the same" in r for r in reasons["missing-input"])
    _, without = catalogue(context_of(frame[["t"]], simulator))
    assert ("missing-input", "no measured column beside the inputs") in {
        (s.kind, s.reason) for s in without
    }


def test_a_diagnosis_weighs_the_whole_catalogue():
    y = plain(FRAME) + NOISE * np.random.default_rng(0).standard_normal(len(FRAME))
    model = hs.PowerScaledSurrogate(
        SIMULATOR, surrogate=hs.ExactSurrogate(), random_state=0, n_draws=100
    )
    found = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(FRAME, y)
    causes, skipped = catalogue(context_of())
    # and "none"
    assert len(found.search_.weighed) == 1 + len(causes)
    assert len(found.causes_) == 1 + len(causes) + len(skipped)


# ------------------------------------------------------------- noise factors in the evidence


def line(t, level, slope):
    return level + slope * t


LINE = hs.Simulator(
    line,
    inputs={"t": (0, 4)},
    parameters={"level": stats.norm(1, 0.5), "slope": stats.norm(2, 0.3)},
)


class NoisyBump(hs.Cause):
    """Columns and noise at once, with one node parameter for both."""

    kind = "noisy-bump"
    target = "t"
    parameters = {"place": stats.uniform(0, 4)}
    coefficients = ("height",)

    def columns(self, X, theta):
        return np.exp(-((X["t"] - theta["place"]) ** 2))[:, None]

    def noise(self, X, theta):
        return 0.5 + np.abs(X["t"] - theta["place"])


@pytest.mark.parametrize("cause", [hs.Noise("t"), NoisyBump(), hs.Trend("t")])
def test_evidence_equals_the_gaussian_marginal_likelihood(cause):
    rng = np.random.default_rng(5)
    t = np.linspace(0, 4, 9)
    n, sigma, sizes = len(t), 0.4, np.array([0.2, 1.5])
    y = line(t, 1.2, 1.8) + rng.normal(0, sigma, (3, n))
    problem = problem_of(pd.DataFrame({"t": t}), y[0], LINE)
    context = make_context(
        LINE, ("t",), 1, t[:, None], problem.scale, problem.likelihood, problem.model.basis
    )
    cause = cause.prepare(context)
    model = replace(problem.model, effects=(cause,))
    plan = layout(model)
    belief = coefficient_belief(model.basis, None)
    error = rng.normal(0, 0.3, (n, 2))  # of an emulator, as a factor of its covariance
    parts = replace(linearise(model, problem.X, belief, plan, plan.neutral), U=error)

    def fixed_sigma(squares):
        return -0.5 * n * np.log(2 * np.pi * sigma**2) - 0.5 * squares / sigma**2

    found = scan(parts, y, sigma, fixed_sigma, sizes)

    prior = 0.5**2 + 0.3**2 * np.outer(t, t) + error @ error.T
    names = list(cause.grid())
    for k, node in enumerate(plan.grid):
        theta = dict(zip(names, node, strict=True))
        factor = np.broadcast_to(cause.noise({"t": t}, theta), n)
        shape = np.empty((n, 0))
        if cause.coefficients:
            shape = cause.columns({"t": t}, theta)
            shape = shape / np.sqrt(np.mean(shape**2, axis=0))
        for r in range(len(y)):
            by_size = [
                stats.multivariate_normal(
                    1 + 2 * t, prior + np.diag((sigma * factor) ** 2) + s**2 * shape @ shape.T
                ).logpdf(y[r])
                for s in sizes
            ]
            expected = logsumexp(by_size) - np.log(len(sizes)) + plan.log_weight[k]
            assert found[r, k] == pytest.approx(expected, abs=1e-6)


def weigh_noise(growth, seed):
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 4, 60)
    y = line(t, 1.2, 1.8) + 0.3 * np.exp(growth * (t - 2)) * rng.standard_normal(60)
    problem = problem_of(pd.DataFrame({"t": t}), y, LINE)
    context = make_context(
        LINE, ("t",), 1, t[:, None], problem.scale, problem.likelihood, problem.model.basis
    )
    forms = ("noise", "trend", "bump", "unexplained")
    causes = [cause for cause in catalogue(context)[0] if form_of(cause) in forms]
    found = search(problem, causes, coefficient_belief(problem.model.basis, None))
    return found, {kind_of(w): w for w in found.weighed}


def test_noise_that_grows_is_told_from_noise_that_does_not():
    found, weighed = weigh_noise(0.6, 0)
    assert weighed["noise"].log_evidence > weighed["none"].log_evidence + 5
    assert kind_of(found.weighed[int(np.argmax(found.probability))]) == "noise"
    slope = weighed["noise"].plan.grid[weighed["noise"].peak.node, 0] / 2
    assert slope == pytest.approx(0.6, abs=0.25)
    # sigma keeps its meaning, and predictions know where the noise is
    assert weighed["noise"].sigma == pytest.approx(0.3, rel=0.3)
    _, variance = predict_locally(found, weighed["noise"], np.array([[0.0], [4.0]]))
    assert variance[1] > 20 * variance[0]
    _, quiet = weigh_noise(0.0, 1)
    assert quiet["noise"].log_evidence < quiet["none"].log_evidence + 0.5


def test_a_diagnosis_names_growing_noise_where_it_is_weighed():
    rng = np.random.default_rng(2)
    growing = np.exp(0.3 * (FRAME.t.to_numpy() - 6))
    y = np.asarray(plain(FRAME)) + NOISE * growing * rng.standard_normal(len(FRAME))
    model = hs.PowerScaledSurrogate(
        SIMULATOR, surrogate=hs.ExactSurrogate(), random_state=0, n_draws=200
    )
    found = hs.DiscrepancyDiagnosis(
        model, causes=[hs.Noise("t"), hs.Delay("t")], cv=2, random_state=0
    ).fit(FRAME[["t", "dose"]], y)
    assert (found.verdict_, found.best_cause_.kind) == ("named", "noise")
    _, low, high = found.best_cause_.estimates["slope"]
    assert low < 0.3 < high
    # the simulation is right: nothing to extend, and predictions are worth more all the same
    assert found.extended_simulator_ is None
    assert found.gain_.elpd_difference > 2 * found.gain_.standard_error
    assert "noise" in str(found.report())
    assert set(found.next_measurement_) == {"t", "dose"}


# ------------------------------------------------------------------- pictures, own causes


@pytest.mark.parametrize("name", CASES)
def test_a_picture_of_every_kind(name):
    ax = plot_cause(prepared(name), context_of())
    assert isinstance(ax, Axes)
    assert len(ax.lines) >= 2
    heights = np.concatenate([np.asarray(drawn.get_ydata(), dtype=float) for drawn in ax.lines])
    assert np.isfinite(heights).all()
    assert ax.get_ylabel()
    assert plot_cause(prepared(name), context_of(), ax=ax) is ax


def test_air_drag_of_the_documentation():
    """The cause in docs/causes.md works as it stands."""
    page = (Path(__file__).parents[1] / "docs" / "causes.md").read_text()
    (source,) = (b for b in re.findall(r"```python\n(.*?)```", page, re.S) if "AirDrag" in b)
    names = {}
    exec(source, names)
    fall = hs.Simulator(
        lambda t, gravity: 100 - gravity / 2 * t**2,
        inputs={"t": (0, 4)},
        parameters={"gravity": hs.truncated_normal(9.8, 0.3, 8, 12)},
    )
    rng = np.random.default_rng(0)
    t = np.linspace(0, 4, 60)
    y = 100 - 4.9 * t**2 + 6 * (1 - np.exp(-0.3 * t**3)) + 0.2 * rng.standard_normal(60)
    model = hs.PowerScaledSurrogate(
        fall, surrogate=hs.ExactSurrogate(), effects=(names["AirDrag"](),), random_state=0
    ).fit(t[:, None], y)
    draws = model.posterior_.estimates(0)
    for quantity, truth in {"amplitude": 6, "rate": 0.3}.items():
        low, high = np.quantile(draws[quantity], [0.005, 0.995])
        assert low < truth < high
        assert high - low < 0.5 * truth


def test_a_diagnosis_whose_cause_reads_an_extra_extends_with_it():
    wind = FRAME.wind.to_numpy()
    problem = problem_of(FRAME, np.asarray(plain(FRAME)))
    drift = hs.ParameterDrift("height", "wind").prepare(context_of())
    extended = extend_simulator(SIMULATOR, drift, problem)
    assert extended.input_names == ("t", "dose", "wind")
    assert extended.input_ranges["wind"] == pytest.approx((wind.min(), wind.max()))
    row = np.array([[np.pi / 2, 0.0, drift.center + 1]])
    assert extended(row, [[3.0, 0.5, 0.25]])[0] == pytest.approx(10 + 3.25)
