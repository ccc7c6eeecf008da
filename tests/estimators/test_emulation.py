"""A function that is slow to run is emulated by the fit itself; a quick one never is."""

import math
import pickle
import time
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from joblib import parallel_config
from scipy.stats import uniform
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.estimators import emulation

PRIORS = {"size": uniform(1, 2), "rate": uniform(0.1, 0.9)}
TIMES = np.linspace(0.2, 9.8, 60)


def curve(t, size, rate):
    return size * np.exp(-rate * t) + 0.3 * np.cos(2 * rate * t)


def number(t, size, rate):
    return size * math.exp(-rate * t) + 0.3 * math.cos(2 * rate * t)


class Counted:
    """A simulation that takes some seconds a call on a clock of its own, and counts its calls."""

    def __init__(self, function=number, seconds=0.005, fails=None):
        self.function, self.seconds, self.fails, self.calls = function, seconds, fails, 0
        self.now = 0.0
        self.__name__ = "counted"

    def __call__(self, t, size, rate):
        self.calls += 1
        self.now += self.seconds
        if self.fails is not None and self.fails(size, rate):
            raise ValueError("no solution")
        return self.function(t, size, rate)

    def __reduce__(self):
        return Counted, (self.function, self.seconds, self.fails)


@pytest.fixture
def clocked(monkeypatch):
    """Return a simulator of a counted function, whose clock is the one that is read."""

    def make(counted, **settings):
        # nobody else uses the machine
        for clock in ("perf_counter", "process_time"):
            monkeypatch.setattr(emulation.time, clock, lambda: counted.now)
        settings = {"vectorized": False, "output": "level", **settings}
        return hs.Simulator(counted, {"t": (0, 10)}, PRIORS, **settings)

    return make


def measured(seed=0, noise=0.05):
    scatter = np.random.default_rng(seed).standard_normal(len(TIMES))
    return curve(TIMES, 2.0, 0.4) + noise * scatter


def draws_of(model):
    found = model.posterior_.named()
    return np.column_stack([found["size"], found["rate"], found["sigma"]])


def by_grid(y, noise_sd):
    """Return mean and standard deviation of size and rate on a grid, sigma integrated out."""
    size, rate = np.linspace(1.8, 2.2, 201), np.linspace(0.35, 0.45, 201)
    sigma = np.linspace(0.3, 2.5, 120) * noise_sd
    model = curve(TIMES, size[:, None, None], rate[None, :, None])
    squares = np.sum((y - model) ** 2, axis=-1)[..., None]
    log_density = -0.5 * squares / sigma**2 - len(y) * np.log(sigma)
    # half-normal with the spread of the output
    log_density = log_density - 0.5 * (sigma / np.std(y)) ** 2
    weight = np.exp(log_density - log_density.max())
    out = []
    for axis, values in ((0, size), (1, rate)):
        share = weight.sum(axis=tuple({0, 1, 2} - {axis}))
        share = share / share.sum()
        mean = share @ values
        out.append((mean, np.sqrt(share @ (values - mean) ** 2)))
    return out


def test_a_slow_function_is_emulated_and_agrees_with_the_posterior_on_a_grid(clocked):
    """Before: an error that the simulation had not been run, or 25 minutes with ExactSurrogate."""
    counted, y = Counted(), measured()
    model = hs.PowerScaledSurrogate(clocked(counted), random_state=0)
    with pytest.warns(hs.EmulationWarning) as caught:
        model.fit(TIMES[:, None], y)
    assert counted.calls < 4000  # of some 300,000
    said = str(caught[0].message)
    assert "300 ms for one set of parameters" in said
    assert f"{model.emulation_.runs.n_runs} runs" in said
    assert "times the noise" in said
    assert "surrogate=ExactSurrogate() runs the simulation itself" in said
    assert caught[0].filename == __file__
    assert model.emulation_.left_open < 0.1
    # a design of runs that leaves a tenth of the noise open hardly moves any estimate
    for values, (mean, sd) in zip(draws_of(model).T, by_grid(y, 0.05), strict=False):
        assert values.mean() == pytest.approx(mean, abs=4 * sd / np.sqrt(1000) + 0.1 * sd)
        assert values.std() == pytest.approx(sd, rel=0.15)


def test_what_is_left_open_is_not_less_than_the_error_of_the_emulator(clocked):
    y = measured()
    model = hs.PowerScaledSurrogate(clocked(Counted()), random_state=0)
    with pytest.warns(hs.EmulationWarning):
        model.fit(TIMES[:, None], y)
    means = model.sample_predictive_mean(TIMES[:, None])
    size, rate, sigma = draws_of(model).T[:, :, None]
    error = np.sqrt(np.mean(((means - curve(TIMES, size, rate)) / sigma) ** 2))
    assert error < 2 * model.emulation_.left_open


def test_further_runs_are_made_where_the_posterior_is(clocked):
    """Twenty runs over the priors leave more open than a tenth of a small noise."""
    y = measured(noise=0.002)
    model = hs.PowerScaledSurrogate(clocked(Counted()), random_state=0)
    with pytest.warns(hs.EmulationWarning):
        model.fit(TIMES[:, None], y)
    runs = model.emulation_.runs
    assert 20 < runs.n_runs <= 60
    assert model.emulation_.left_open < 0.1
    # the truth in priors from 1 to 3 and 0.1 to 1
    near = np.all(np.abs(runs.omega[runs.run >= 20] - [2.0, 0.4]) < 0.05, axis=1)
    assert near.any()
    size, rate, _ = draws_of(model).mean(axis=0)
    assert (size, rate) == (pytest.approx(2.0, abs=0.005), pytest.approx(0.4, abs=0.001))


def test_the_same_seed_gives_the_same_draws(clocked):
    simulator = clocked(Counted())
    draws = []
    for _ in range(2):
        model = hs.PowerScaledSurrogate(simulator, random_state=3, n_draws=200)
        with pytest.warns(hs.EmulationWarning):
            draws.append(draws_of(model.fit(TIMES[:, None], measured())))
    np.testing.assert_allclose(*draws)


@pytest.mark.parametrize("vectorized", [True, False])
def test_a_quick_function_is_run_itself(clocked, vectorized):
    """Without a surrogate it was an error."""
    # sixty rows of ten microseconds, or of a call for all of them
    counted = Counted(curve if vectorized else number, 1e-5)
    simulator = clocked(counted, vectorized=vectorized)
    models = [
        hs.PowerScaledSurrogate(simulator, surrogate, n_draws=200, random_state=0)
        for surrogate in (None, hs.ExactSurrogate())
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for model in models:
            model.fit(TIMES[:, None], measured())
    assert models[0].emulation_ is None
    assert isinstance(models[0].surrogate_, hs.ExactSurrogate)
    np.testing.assert_allclose(*map(draws_of, models))


def test_what_takes_no_longer_for_many_is_run_itself(clocked):
    """An ODE of which all solutions are found at once: 20 ms for one, and for a hundred."""
    model = hs.PowerScaledSurrogate(clocked(Counted(curve, 0.02), vectorized=True), random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.fit(TIMES[:, None], measured())
    assert model.emulation_ is None


def test_who_asks_for_the_simulation_itself_gets_it(clocked):
    counted = Counted()
    model = hs.PowerScaledSurrogate(
        clocked(counted), surrogate=hs.ExactSurrogate(), n_draws=50, random_state=0
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.fit(TIMES[:, None], measured())
    assert model.emulation_ is None
    assert counted.calls > 60_000


def test_a_function_of_curves_is_called_once_a_run(clocked):
    counted = Counted(curve)
    model = hs.PowerScaledSurrogate(clocked(counted, returns="curve"), random_state=0)
    with pytest.warns(hs.EmulationWarning, match=" 5 ms for one set"):
        model.fit(TIMES[:, None], measured())
    # once without a clock, once with it
    assert counted.calls == model.emulation_.runs.n_runs + 2


def test_runs_that_fail_are_dropped_with_a_warning(clocked):
    counted = Counted(fails=lambda size, rate: size > 2.5)
    model = hs.PowerScaledSurrogate(clocked(counted), random_state=0)
    with (
        pytest.warns(hs.EmulationWarning),
        pytest.warns(hs.FailedRunsWarning, match="runs of 'counted' failed.*no solution"),
        pytest.warns(hs.PriorWarning, match="'size' lies in its simulated range"),
    ):
        model.fit(TIMES[:, None], measured())
    assert model.emulation_.runs.omega[:, 0].max() <= 2.5
    assert model.posterior_.named()["size"].mean() == pytest.approx(2.0, abs=0.05)


def test_outputs_that_a_likelihood_excludes_are_runs_that_failed(clocked):
    """The curve falls below zero for some parameters, of which a log-normal has no logarithm."""
    t = TIMES[TIMES < 4]
    y = curve(t, 2.0, 0.2) * np.exp(0.02 * np.random.default_rng(0).standard_normal(len(t)))
    model = hs.PowerScaledSurrogate(clocked(Counted()), likelihood="lognormal", random_state=0)
    with (
        pytest.warns(hs.EmulationWarning),
        pytest.warns(hs.FailedRunsWarning, match="outputs of the runs were dropped"),
    ):
        model.fit(t[:, None], y)
    assert (model.emulation_.runs.y > 0).all()
    assert model.posterior_.named()["rate"].mean() == pytest.approx(0.2, abs=0.02)


def test_several_outputs(clocked):
    def both(t, size, rate):
        return number(t, size, rate), 10 * rate

    y = np.column_stack([measured(), np.full(60, 4.0)])
    y[:, 1] += 0.2 * np.random.default_rng(1).standard_normal(60)
    simulator = clocked(Counted(both), output=("level", "slope"))
    model = hs.PowerScaledSurrogate(simulator, random_state=0)
    with pytest.warns(hs.EmulationWarning):
        model.fit(TIMES[:, None], y)
    assert model.predict(TIMES[:, None]).shape == (60, 2)
    assert model.posterior_.named()["rate"].mean() == pytest.approx(0.4, abs=0.02)


def test_what_a_fit_leaves(clocked):
    simulator = clocked(Counted())
    model = hs.PowerScaledSurrogate(simulator, random_state=0)
    with pytest.warns(hs.EmulationWarning):
        model.fit(TIMES[:, None], measured())
    assert model.get_params()["simulation"] is simulator
    assert model.get_params()["surrogate"] is None
    assert isinstance(model.surrogate_, hs.Kriging)
    runs = model.emulation_.runs
    assert set(model.summary()["simulation"]) == {f"emulated, {runs.n_runs} runs"}
    with pytest.warns(hs.ExtrapolationWarning):
        model.predict([[20.0]])
    assert not hasattr(clone(model), "posterior_")
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_allclose(again.predict(TIMES[:, None]), model.predict(TIMES[:, None]))
    # runs that were given are no runs of the fit
    given = clone(model).set_params(simulation=runs, surrogate=hs.Kriging())
    assert given.fit(TIMES[:, None], measured()).emulation_ is None


def test_predictive_weighting_emulates_too(clocked):
    model = hs.PredictiveWeightedSurrogate(clocked(Counted()), beta=0.5, random_state=0)
    with pytest.warns(hs.EmulationWarning):
        model.fit(TIMES[:, None], measured())
    assert model.simulation_posterior_.named()["rate"].mean() == pytest.approx(0.4, abs=0.02)
    assert "simulation" in model.summary()


def test_many_runs_are_announced(clocked):
    model = hs.PowerScaledSurrogate(clocked(Counted(seconds=1.0)), random_state=0)
    with (
        pytest.warns(hs.EmulationWarning, match=r"is run at least 20 times.*minutes.*store='runs'"),
        pytest.warns(hs.EmulationWarning, match="was emulated"),
    ):
        model.fit(TIMES[:, None], measured())


def test_processes_share_the_runs_where_n_jobs_allows(clocked):
    draws = []
    for n_jobs in (1, 2):
        counted = Counted()
        model = hs.PowerScaledSurrogate(clocked(counted), n_draws=100, random_state=0)
        with parallel_config(n_jobs=n_jobs), pytest.warns(hs.EmulationWarning):
            draws.append(draws_of(model.fit(TIMES[:, None], measured())))
    np.testing.assert_allclose(*draws)
    # of 2,000 runs those that are timed, and the first of each batch
    assert counted.calls < 200


def busy(t, size, rate):
    """Return a number after five milliseconds."""
    end = time.perf_counter() + 0.005
    while time.perf_counter() < end:
        pass
    return number(t, size, rate)


@pytest.mark.slow
def test_a_fit_and_a_diagnosis_of_a_function_of_5_ms_take_less_than_a_minute():
    """With the simulation itself a diagnosis takes 2.5 hours."""
    y = measured() + 0.15 * (TIMES > 5)
    simulator = hs.Simulator(busy, {"t": (0, 10)}, PRIORS, vectorized=False, output="level")
    direct = hs.Simulator(curve, {"t": (0, 10)}, PRIORS, output="level")
    found, seconds = [], []
    for simulation in (simulator, direct):
        start = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hs.EmulationWarning)
            model = hs.PowerScaledSurrogate(simulation, random_state=0)
            found.append(
                hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(TIMES[:, None], y)
            )
        seconds.append(time.process_time() - start)
    assert seconds[0] < 45
    slow, exact = found
    assert slow.verdict_ == exact.verdict_ == "named"
    assert slow.best_cause_.kind == exact.best_cause_.kind == "step"
    for name, (mean, low, high) in exact.best_cause_.estimates.items():
        assert slow.best_cause_.estimates[name][0] == pytest.approx(mean, abs=0.2 * (high - low))
    full = " ".join(str(slow.report(full=True)).split())
    assert "was emulated by Kriging() from" in full
    summary = slow.report().summary
    assert summary["emulation"]["n_runs"] == slow.estimator_.emulation_.runs.n_runs


def of_wind(fails, vectorized=False, output="y"):
    """Return a simulator of k * wind that raises where ``fails(wind, k)``."""

    def blows(wind, k):
        if np.any(fails(wind, k)):
            raise RuntimeError("wind too strong")
        return k * wind if output == "y" else (k * wind, k + wind)

    prior = {"k": hs.truncated_normal(1, 0.5, 0, 2)}
    return hs.Simulator(blows, {"wind": (0, 4)}, prior, vectorized=vectorized, output=output)


WIND = np.linspace(0, 4, 9)


@pytest.mark.parametrize("vectorized", [False, True])
@pytest.mark.parametrize("kind", [hs.PowerScaledSurrogate, hs.PredictiveWeightedSurrogate])
def test_what_a_simulation_raises_is_quoted(kind, vectorized):
    simulator = of_wind(lambda wind, k: wind > 3, vectorized)
    model = kind(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    said = (
        r"fails at 2 of 9 measured rows, first in row 8 \(index 7\): RuntimeError: wind too strong"
    )
    with pytest.raises(ValueError, match=said):
        model.fit(WIND[:, None], WIND)


@pytest.mark.parametrize("vectorized", [False, True])
def test_an_error_beside_the_middle_of_the_priors_is_quoted(vectorized):
    """The middle of the priors works, and explains no count at wind zero."""
    simulator = of_wind(lambda wind, k: np.abs(k - 1) > 1e-3, vectorized)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), likelihood="poisson", random_state=0
    )
    said = r"At wind = \S+, k = \S+ the simulation fails: RuntimeError: wind too strong\.$"
    with pytest.raises(ValueError, match=said):
        model.fit(WIND[:, None], np.round(WIND) + 1)


def test_an_error_of_one_of_several_outputs_is_quoted():
    simulator = of_wind(lambda wind, k: wind > 3, output=("load", "sum"))
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    with pytest.raises(ValueError, match=r"fails at 2 of 9 measured rows.*wind too strong"):
        model.fit(WIND[:, None], np.column_stack([WIND, 1 + WIND]))


def test_the_first_call_is_not_timed():
    """A function of numbers finds that out in its first call, which takes longer."""
    asked = []

    def slow_at_first(x, a):
        asked.append(len(np.atleast_1d(x)))
        if len(asked) == 1:
            time.sleep(0.05)
        return a * x

    simulator = hs.Simulator(slow_at_first, {"x": (0, 1)}, {"a": hs.truncated_normal(1, 1, 0, 2)})
    assert emulation.seconds_a_set(simulator, np.linspace(0, 1, 20)[:, None]) < 0.001


def test_a_slow_simulation_without_parameters_is_run_as_it_is():
    def slow(t):
        time.sleep(2e-3)
        return 2 * t

    simulator = hs.Simulator(slow, {"t": (0, 10)}, {}, vectorized=False)
    y = 2 * TIMES[::6] + 0.1 * np.random.default_rng(0).standard_normal(10)
    found = hs.PowerScaledSurrogate(simulator, random_state=0).fit(TIMES[::6, None], y)
    assert found.emulation_ is None
    np.testing.assert_allclose(found.predict([[3.0]]), 6.0)


@pytest.mark.parametrize(("busy", "expected"), [(1.0, 0.002), (0.3, 0.0006), (0.01, 0.002)])
def test_what_other_programs_take_of_the_machine_does_not_count(monkeypatch, busy, expected):
    """The busy share of the time counts; all of it where a simulation waits for something."""
    passed = [0.0]

    def takes_time(x, a):
        passed[0] += 1e-4 * np.size(x)
        return a * x

    simulator = hs.Simulator(
        takes_time, inputs={"x": (0, 1)}, parameters={"a": uniform(0, 1)}, vectorized=True
    )
    clocks = SimpleNamespace(perf_counter=lambda: passed[0], process_time=lambda: busy * passed[0])
    monkeypatch.setattr(emulation, "time", clocks)
    found = emulation.seconds_a_set(simulator, np.linspace(0, 1, 20)[:, None])
    assert found == pytest.approx(expected)
