"""Units do not matter: what is measured in other ones is told alike."""

import re

import numpy as np
import pandas as pd
import pytest
from problems import make_problem
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.effects.base import Context
from hybridsurrogate.inference.procedure import make_target
from hybridsurrogate.inference.sampling.modes import starting_points
from hybridsurrogate.model.problem import spread

PRIORS = {"vmax": stats.uniform(2, 6), "km": stats.uniform(0.1, 0.6)}


def uptake(s, vmax, km):
    return vmax * s / (km + s)


@pytest.fixture(scope="module")
def batches():
    """Runs, and measurements of which one batch is off."""
    runs = hs.Simulator(uptake, {"s": (0, 2)}, PRIORS).run(100, random_state=1)
    rng = np.random.default_rng(21)
    X = pd.DataFrame({"s": rng.uniform(0.02, 2, 40), "batch": rng.integers(0, 3, 40)})
    y = uptake(X.s, 5, 0.3) + 0.6 * (X.batch == 2) + 0.15 * rng.standard_normal(40)
    return runs, X, y


def in_units(runs, unit):
    return hs.SimulationData(
        runs.X, runs.omega, runs.y * unit, inputs={"s": (0, 2)}, parameters=PRIORS
    )


CAUSE = hs.MissingInput("batch", shape="categorical", level=2)


@pytest.mark.slow
@pytest.mark.parametrize("surrogate", [hs.Kriging(), hs.PolynomialChaos()], ids=repr)
def test_a_fit_with_a_cause_in_other_units_of_the_output(batches, surrogate):
    runs, X, y = batches
    told = []
    for unit in (1.0, 1e-9, 1e9):
        model = hs.PowerScaledSurrogate(
            in_units(runs, unit), surrogate, effects=(CAUSE,), n_draws=300, random_state=0
        ).fit(X, y * unit)
        told.append(np.column_stack([model.posterior_.values, model.posterior_.sigma / unit]))
    # the lengths of kriging end differently by rounding: medians of 300 draws know 0.07 sd
    middle, sd = np.median(told, axis=1), np.std(told[0], axis=0)
    assert np.abs((middle[1:] - middle[0]) / sd).max() < 0.35


def test_climbs_start_from_the_same_place_in_other_units(batches):
    """From a noise far off they may end at a false peak."""
    runs, X, y = batches
    starts = []
    for unit in (1.0, 1e-9, 1e9):
        problem = make_problem(
            in_units(runs, unit),
            hs.PolynomialChaos(),
            hs.Normal(),
            None,
            (CAUSE,),
            ("s", "batch"),
            X.to_numpy(dtype=float),
            y.to_numpy() * unit,
        )
        found = starting_points(make_target(problem, 1.0, 1.0), np.random.RandomState(0))
        starts.append(found - np.log(unit) * np.eye(found.shape[1])[-1])
    np.testing.assert_allclose(starts[1:], [starts[0], starts[0]], atol=1e-3)


@pytest.mark.parametrize("method", ["RK45", "LSODA"])
@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e12])
def test_an_ode_in_other_units_of_its_state(method, unit):
    simulator = hs.OdeSimulator(
        lambda t, state, rate: np.stack([-rate * state[0]]),
        initial_state=[3 * unit],
        observe=lambda state: state[0],
        inputs={"t": (0, 10)},
        parameters={"rate": stats.uniform(0.1, 0.9)},
        states="amount",
        method=method,
    )
    t = np.linspace(0, 10, 7)
    told = simulator(t[:, None], np.full((7, 1), 0.5))
    np.testing.assert_allclose(told, 3 * unit * np.exp(-0.5 * t), rtol=1e-5)


def search_of(rng, unit, likelihood, exponent):
    """Diagnose 60 rows with noise proportional to a power of the output, in some unit."""
    simulator = hs.Simulator(
        lambda t, a, r: unit * a * np.exp(-r * t) * (1.3 + np.sin(t)),
        {"t": (0, 10)},
        {"a": hs.truncated_normal(5, 1, 2, 8), "r": hs.truncated_normal(0.2, 0.05, 0.05, 0.4)},
    )
    t = rng.uniform(0, 10, 60)
    mean = 5.2 * np.exp(-0.22 * t) * (1.3 + np.sin(t))
    spread = 0.05 * mean**exponent * rng.standard_normal(60)
    y = unit * (mean * np.exp(spread) if likelihood == "lognormal" else mean + spread)
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        likelihood=likelihood,
        n_draws=300,
        random_state=0,
    )
    settings = {"cv": None, "n_replicates": 40, "random_state": 0}
    return hs.DiscrepancyDiagnosis(model, **settings).fit(t[:, None], y), y


@pytest.mark.slow
@pytest.mark.parametrize("likelihood", ["normal", "lognormal"])
def test_a_diagnosis_in_other_units_of_the_output(likelihood):
    found = [
        search_of(np.random.default_rng(3), unit, likelihood, 1.5)[0] for unit in (1.0, 1e-3, 1e6)
    ]
    told = []
    for one in found:
        none, *causes = one.search_.candidates
        told.append({w.cause.name: w.log_evidence - none.log_evidence for w in causes})
    assert told[1] == pytest.approx(told[0], abs=0.01)
    assert told[2] == pytest.approx(told[0], abs=0.01)


@pytest.mark.slow
def test_noise_that_follows_the_output_is_told_in_full():
    """The factor between a large and a small output belongs to the exponent and the data."""
    named = 0
    for seed in range(4):
        found, y = search_of(np.random.default_rng(seed), 1.0, "normal", 1.5)
        numbers = found.best_cause_.estimates
        if "exponent" not in numbers:
            continue
        named += 1
        ends = y.mean() + np.array([-1, 1]) * y.std()
        low, high = np.hypot(ends, np.sqrt(np.mean(y**2)) / 20)
        factor = high / low
        assert numbers["exponent"][0] == pytest.approx(1.5, abs=0.4)
        assert numbers["ratio"][1:] == pytest.approx(
            factor ** np.array(numbers["exponent"][1:]), rel=0.01
        )
    assert named >= 3


@pytest.mark.parametrize(
    ("cause", "numbers"),
    [
        (hs.Bump("t"), {"location": 63.73, "width": 3.0, "amplitude": 1.5}),
        (hs.Ramp("t"), {"location": 42.78, "slope": 0.1}),
        (hs.Step("t"), {"location": 64.21, "amplitude": 1.0}),
        (hs.Trend("t"), {"level": 1.0, "slope": 0.1}),
        (hs.Saturation("t"), {"amplitude": 1.0, "half": 12.25}),
        (hs.Decay("t"), {"amplitude": 1.0, "scale": 12.25}),
        (hs.MissingInput("t"), {"slope": 0.1}),
        (hs.ParameterDrift("rate", "t", "step"), {"change": 0.1, "location": 42.78}),
        (hs.ParameterDrift("rate", "t"), {"slope": 0.1}),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_formulas_tell_places_that_are_far_from_zero(cause, numbers):
    """Days since the year one: five digits of them are 738060 for half a month."""
    days, start = np.linspace(0.25, 100.25, 41), 738000.0
    context = Context(
        {"t": start + days}, 1, {"rate": stats.norm(1, 0.2)}, {}, scale=1.0, location=0.0
    )
    prepared = cause.prepare(context)
    values = {k: v + start * (k in ("location", "half")) for k, v in numbers.items()}
    place = start + numbers.get("location", days.mean())
    if isinstance(cause, hs.Decay | hs.Saturation):
        place = start + 0.25
    for text in (prepared.formula(values), prepared.latex(values)):
        told = [float(number) for number in re.findall(r"7380\d\d(?:\.\d+)?", text)]
        assert told, text
        assert told == pytest.approx([place] * len(told), abs=0.06, rel=0), text


@pytest.mark.parametrize("level", [None, 20240117.0])
def test_formulas_tell_levels_in_full(level):
    """A batch may be called by its date."""
    batches = np.repeat([20240116.0, 20240117.0, 20240118.0], 4)
    cause = hs.MissingInput("batch", shape="categorical", level=level)
    prepared = cause.prepare(Context({"t": np.arange(12.0), "batch": batches}, 1, {}, {}, 1.0))
    values = dict.fromkeys(prepared.coefficients, 0.5)
    assert "batch = 20240117" in prepared.formula(values)
    assert "20240117" in prepared.latex(values)
    assert level is None or "20240117" in prepared.name


@pytest.mark.parametrize("level", [0.0, 1e10, 1e12])
def test_a_small_spread_around_a_large_level(level):
    x = np.linspace(0, 1, 40)
    y = level + np.sin(6 * x) + 0.1 * np.random.default_rng(0).standard_normal(40)
    model = hs.PowerScaledSurrogate(None, hs.PolynomialChaos(5), n_draws=300, random_state=0)
    assert model.fit(x[:, None], y).posterior_.sigma.mean() == pytest.approx(0.077, abs=0.001)


@pytest.mark.parametrize("value", [0.1, -1 / 3, 1e10 / 3])
def test_a_constant_has_its_size_as_spread(value):
    weights = np.random.default_rng(0).random(999)
    assert spread(np.full(999, value)) == abs(value)
    assert spread(np.full(999, value), weights) == abs(value)
    assert spread(np.zeros(3)) == 1.0
