"""Cost over rows, form by form: `pytest tests/benchmarks/test_rows.py --benchmark-only`.

`exponent` in the extra information is the slope of the logarithm of the processor's time over the
logarithm of the rows: one means that cost is proportional to the rows.
"""

import time
import warnings

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.answers.finding import form_of
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.search import search
from hybridsurrogate.diagnosis.search.setup import prepare, trained_emulator

ROWS = (500, 2000, 8000)
SEEDS = (0, 1, 2)
FORMS = (
    *("offset", "gain", "wrong-constant", "trend", "trend: quadratic", "periodic"),
    *("periodic: overtone", "step", "ramp", "bump", "decay", "saturation", "delay"),
    *(f"parameter-drift: {shape} over t" for shape in ("linear", "step", "logistic", "periodic")),
    *("parameter-drift: linear over batch", "interaction", "missing-input"),
    *("missing-input: quadratic", "missing-input: categorical", "missing-input: level 1", "noise"),
    *("missing-input: from zero", "step: before"),
    *("noise: mean", "noise: tails", "noise: autocorrelation", "unexplained"),
)
COURSES = ("logistic", "exponential", "periodic")
INSIDE = (
    *(f"parameter-drift: {course} inside the dynamics" for course in COURSES),
    *("missing-term: constant", "missing-term: proportional", "missing-term: seasonal"),
    "delay: inside the dynamics",
)


def cooled(t, depth, rate, start):
    return start * np.exp(-rate * t) - 0.1 * depth


SIMULATOR = hs.Simulator(
    cooled,
    inputs={"t": (0, 10), "depth": (0, 5)},
    parameters={"rate": hs.truncated_normal(0.3, 0.1, 0, 1)},
    assumed={"start": hs.Assumed(3.0, stats.uniform(2, 2))},
)


ODE = hs.OdeSimulator(
    lambda t, state, rate: -rate * state,
    initial_state=[3.0],
    observe=lambda state: state[0],
    inputs={"t": (0, 10)},
    parameters={"rate": hs.truncated_normal(0.3, 0.1, 0, 1)},
    states="level",
    max_step=0.1,
)


FITTED = {
    "terms": hs.PolynomialChaos(),
    "simulation": hs.ExactSurrogate(),
}


def measured(n):
    """Return n measured rows of the simulation."""
    rng = np.random.default_rng(n)
    X = np.column_stack([np.linspace(0, 10, n), rng.uniform(0, 5, n)])
    return X, cooled(*X.T, 0.32, 3.0) + 0.1 * rng.standard_normal(n)


def surrogate_of(kind):
    simulation = SIMULATOR.run(300, random_state=0) if kind == "terms" else SIMULATOR
    return hs.PowerScaledSurrogate(simulation, surrogate=FITTED[kind], random_state=0)


def exponent(run, rows):
    """Return the slope over the rows of the logarithm of the processor's time, and the last run.

    Of three times the shortest: others of the machine's processes only add to it.
    """
    seconds = []
    for n in rows:
        ready, times = run(n), []
        for _ in range(3):
            start = time.process_time()
            ready()
            times.append(time.process_time() - start)
        seconds.append(min(times))
    return float(np.polyfit(np.log(rows), np.log(seconds), 1)[0]), ready


@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
@pytest.mark.parametrize("kind", FITTED)
def test_fit_over_rows(benchmark, kind):
    def run(n):
        X, y = measured(n)
        return lambda: surrogate_of(kind).fit(X, y)

    run(100)()
    slope, last = exponent(run, (1000, 10_000, 100_000))
    benchmark.extra_info["exponent"] = slope
    benchmark.pedantic(last, rounds=1)


@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
@pytest.mark.parametrize("kind", FITTED)
def test_intervals_over_rows(benchmark, kind):
    model = surrogate_of(kind).fit(*measured(100))
    slope, last = exponent(lambda n: lambda: model.predict_interval(measured(n)[0]), (1000, 10_000))
    benchmark.extra_info["exponent"] = slope
    benchmark.pedantic(last, rounds=1)


def searches(form, n, seed=0):
    """Return a function that weighs one form on n rows."""
    rng = np.random.default_rng([n, seed])
    X = pd.DataFrame({"t": np.linspace(0, 10, n), "depth": rng.uniform(0, 5, n)})
    X["batch"] = rng.integers(0, 4, n).astype(float)
    y = cooled(X["t"], X["depth"], 0.3, 3.2) + 0.1 * rng.standard_normal(n)
    simulator = SIMULATOR
    if form in INSIDE:
        simulator, X, y = ODE, X[["t"]], y + 0.1 * X["depth"] - 0.2 * np.exp(-0.3 * X["t"])
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), n_draws=20)
    prepared = prepare(model.set_params(random_state=0).fit(X, y), ())
    causes = [cause for cause in prepared.causes if form_of(cause) == form]
    assert causes
    problem, emulator = trained_emulator(prepared.problem, model)
    return lambda: search(SearchContext.of(problem, emulator), causes)


@pytest.mark.parametrize("form", [*FORMS, *INSIDE])
def test_cost_over_rows(benchmark, form):
    seconds = np.empty((len(SEEDS), len(ROWS)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        searches(form, ROWS[0])()
        for at in np.ndindex(seconds.shape):
            weigh = searches(form, ROWS[at[1]], SEEDS[at[0]])
            start = time.process_time()
            weigh()
            seconds[at] = time.process_time() - start
    # how often a search refines and climbs depends on the data: some sets together
    slope = np.polyfit(np.log(ROWS), np.log(seconds.sum(axis=0)), 1)[0]
    benchmark.extra_info["exponent"] = float(slope)
    benchmark.pedantic(weigh, rounds=1)
