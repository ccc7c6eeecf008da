"""Every kind of cause: its formula by hand, what holds for all, pictures, causes of one's own."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from scipy import stats
from sklearn.base import clone
from tide import CASES, FRAME, SIMULATOR, context_of, plain, prepared, problem_of

import hybridsurrogate as hs
from hybridsurrogate.catalogue import catalogue
from hybridsurrogate.diagnosis.answers.extension import extend_simulator
from hybridsurrogate.effects.context import Axis
from hybridsurrogate.effects.picture import plot_cause

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
        ("drift, exponential", {"rate": 0.2}, 8.0, 3 * 1.4918247),
        ("drift, exponential", {"rate": -0.2}, 8.0, 3 / 1.4918247),
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
    """Return all that the methods give for rows and theta, each (n,) or (n, q)."""
    n = len(rows["t"])
    omega = {"height": np.full(n, 3.0), "rate": np.full(n, 0.5), "floor": np.full(n, 10.0)}
    run_rows, run_omega = cause.inputs(rows, omega, theta)
    parts = {f"run {name}": np.broadcast_to(v, n) for name, v in {**run_rows, **run_omega}.items()}
    parts["gain"] = np.broadcast_to(cause.gain(rows, theta), n)
    parts["simulated"] = 10.0 + 4.0 * np.sin(rows["t"])
    changed = cause.response(parts["simulated"], rows, theta)
    changed = (parts["simulated"], np.ones(n)) if changed is None else changed
    parts["response"], parts["response slope"] = changed
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
    # these change nothing at an end of their prior only
    ends = {"limit": {"limit": np.full(n, -1e9 if cause.variant else 1e9)}}
    ends["build-up"] = {"scale": np.full(n, 1e-9)}
    ends["loss"] = {"location": np.full(n, 1e9)}
    neutral |= ends.get(name.partition(",")[0], {})
    if cause.kind == "build-up":
        rows["t"] = rows["t"] + 1e-6  # at zero there is nothing yet
    parts = everything(cause, rows, {**middle, **neutral})
    for column, values in rows.items():
        np.testing.assert_array_equal(parts[f"run {column}"], values)
    for parameter, value in {"height": 3.0, "rate": 0.5, "floor": 10.0}.items():
        np.testing.assert_allclose(parts[f"run {parameter}"], value)
    np.testing.assert_array_equal(parts["gain"], 1)
    np.testing.assert_allclose(parts["response"], parts["simulated"], rtol=1e-14)
    np.testing.assert_array_equal(parts["response slope"], 1)
    np.testing.assert_array_equal(parts["noise"], 1)
    assert cause.coefficients or cause.start() or name.partition(",")[0] in ("noise", *ends)


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
    """The cause in docs/how-to/own_cause.md works as it stands."""
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "own_cause.md").read_text()
    (source,) = (b for b in re.findall(r"```python\n(.*?)```", page, re.S) if "class AirDrag" in b)
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


def test_an_exponential_drift_is_for_parameters_of_one_sign():
    simulator = hs.Simulator(
        lambda t, rate, level: level + rate * t,
        inputs={"t": (0, 12)},
        parameters={"rate": hs.truncated_normal(1, 1, 0, 5), "level": stats.norm(0, 1)},
    )
    context = context_of(FRAME[["t", "wind"]], simulator)
    drifts = {cause.name for cause in catalogue(context)[0] if cause.kind == "parameter-drift"}
    assert "parameter-drift(rate over t, exponential)" in drifts
    assert "parameter-drift(rate over wind, exponential)" in drifts
    assert "parameter-drift(level over t)" in drifts
    assert "parameter-drift(level over t, exponential)" not in drifts
    with pytest.raises(ValueError, match="'level', whose prior has values of both signs"):
        hs.ParameterDrift("level", "t", shape="exponential").prepare(context)


def test_a_rate_that_doubles_every_ten_degrees_is_named_and_foreseen():
    """Blind: the reaction is tried at three temperatures, and needed at a fourth."""
    rng = np.random.default_rng(3)
    hours, degrees = (v.ravel() for v in np.meshgrid(np.linspace(1, 12, 10), [10.0, 20.0, 30.0]))
    left = lambda h, d: 50 * np.exp(-0.05 * 2 ** ((d - 20) / 10) * h)  # noqa: E731
    simulator = hs.Simulator(
        lambda hours, rate: 50 * np.exp(-rate * hours),
        inputs={"hours": (0, 12)},
        parameters={"rate": hs.truncated_normal(0.06, 0.04, 0, 1)},
    )
    X = pd.DataFrame({"hours": hours, "degrees": degrees})
    y = left(hours, degrees) + 0.7 * rng.standard_normal(len(hours))
    model = hs.PowerScaledSurrogate(simulator, hs.ExactSurrogate(), n_draws=400, random_state=0)
    found = hs.DiscrepancyDiagnosis(model, cv=None, n_replicates=39, random_state=0).fit(X, y)
    best = found.best_cause_
    assert (best.kind, best.target) == ("parameter-drift", "rate")
    _, low, high = best.estimates["rate"]
    assert low < np.log(2) / 10 < high
    warmer = X[X.degrees == 30.0].assign(degrees=40.0)
    truth = left(warmer.hours, warmer.degrees)
    assert np.sqrt(np.mean((found.predict(warmer) - truth) ** 2)) < 2.0


def test_a_diagnosis_whose_cause_reads_an_extra_extends_with_it():
    wind = FRAME.wind.to_numpy()
    problem = problem_of(FRAME, np.asarray(plain(FRAME)))
    drift = hs.ParameterDrift("height", "wind").prepare(context_of())
    extended = extend_simulator(SIMULATOR, drift, problem)
    assert extended.input_names == ("t", "dose", "wind")
    assert extended.input_ranges["wind"] == pytest.approx((wind.min(), wind.max()))
    row = np.array([[np.pi / 2, 0.0, drift.pivot + 1]])
    assert extended(row, [[3.0, 0.5, 0.25]])[0] == pytest.approx(10 + 3.25)


@pytest.mark.parametrize("harmonics", [1, 2])
def test_the_formula_of_a_wave_is_its_curve(harmonics):
    """With numbers for everything in it, so that it can be drawn."""
    cause = hs.Periodic(
        "t", period=stats.uniform(1, 9), harmonics=harmonics, axis=Axis.of([35.0, 65.0])
    )
    rng = np.random.default_rng(0)
    coefficients = {name: np.array([rng.standard_normal()]) for name in cause.coefficients}
    t, theta = np.linspace(35, 65, 40), {"period": np.array([4.3])}
    columns = cause.columns({"t": t}, {"period": np.full(40, 4.3)})
    told = {name: value[0] for name, value in cause.estimates(theta, coefficients).items()}
    text = cause.formula(told).replace("2 pi", "2 * np.pi *").replace("cos", "* np.cos")
    curve = eval(text, {"simulation": 0.0, "t": t, "np": np})
    expected = columns @ np.concatenate(list(coefficients.values()))
    np.testing.assert_allclose(curve, expected, atol=2e-3 * np.abs(expected).max())


def test_one_peak_is_told_in_all_draws():
    """Where draws lie on both sides of the seam half a period from the middle."""
    cause = hs.Periodic("t", period=stats.uniform(1, 9), axis=Axis.of([35.0, 65.0]))
    angle = np.pi + np.array([-0.1, 0.1, -0.05, 0.05])
    pair = {"sine": np.sin(angle), "cosine": np.cos(angle)}
    peak = cause.estimates({"period": np.full(4, 4.0)}, pair)["peak"]
    assert np.ptp(peak) == pytest.approx(0.2 * 4 / (2 * np.pi))
    assert abs(abs(peak.mean() - 50.0) - 2.0) < 1e-6
