"""Slopes of the simulation, against the derivative."""

from dataclasses import replace

import numpy as np
import pytest
from decay import make_decay
from problems import make_problem
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.emulators.conditioned import krige
from hybridsurrogate.inference.conjugate.noise_marginal import NoiseTable
from hybridsurrogate.inference.evidence.grid import make_grid
from hybridsurrogate.inference.evidence.linearised import (
    RecentSlopes,
    columns_at_nodes,
    linearise,
    values_at_nodes,
)
from hybridsurrogate.inference.evidence.marginal_likelihood import _whitener, scan
from hybridsurrogate.model.statistics import emulator_posterior

SIMULATOR = hs.Simulator(
    lambda t, rate: np.exp(-rate * t), {"t": (0, 10)}, {"rate": stats.uniform(0.1, 0.5)}
)


@pytest.mark.parametrize("kriged", [False, True], ids=["the simulation", "its runs"])
def test_slopes_are_the_derivative(kriged):
    """Two-sided where the simulation is run, one-sided where it is known from runs."""
    t, runs = np.linspace(0, 10, 20), SIMULATOR.run(64, random_state=0)
    surrogate = hs.PolynomialChaos(4) if kriged else hs.ExactSurrogate()
    y = np.exp(-0.3 * t)
    simulation = runs if kriged else SIMULATOR
    problem = make_problem(
        simulation, surrogate, hs.Normal(), None, (hs.Offset(),), ("t",), t[:, None], y
    )
    model, emulator = problem.model, emulator_posterior(problem.model.basis, problem.simulation)
    if kriged:
        basis, emulator = krige(model.basis, emulator, runs, runs.y)
        model = replace(model, basis=basis)
    z = make_grid(model).neutral + 0.3
    around = linearise(model, t[:, None], emulator, make_grid(model), z)
    rate = 0.1 + 0.5 * stats.norm.cdf(z[0] + np.array([-1e-3, 0.0, 1e-3]))
    low, here, high = model.basis.outer_output(t[:, None], rate[:, None], emulator.mean)
    error = around.G[0, :, 0] - (high - low) / 2e-3
    assert np.abs(error).max() < 1e-3 * np.abs(around.G).max()
    np.testing.assert_allclose(around.mean[0] + around.G[0, :, 0] * z[0], here, atol=1e-9)
    if not kriged:
        slope = -t * np.exp(-rate[1] * t) * 0.5 * stats.norm.pdf(z[0])
        np.testing.assert_allclose(around.G[0, :, 0], slope, atol=1e-4 * np.abs(slope).max())


def test_a_store_acts_where_its_gap_is_zero():
    """Unlike a rate of zero: its size is enumerated, so that nodes do not share the simulation."""
    t = np.linspace(1, 5, 12)
    problem = make_problem(
        make_decay(),
        hs.ExactSurrogate(),
        hs.Normal(),
        None,
        (hs.DynamicStore("n"),),
        ("t",),
        t[:, None],
        np.exp(-t),
    )
    model, emulator = problem.model, emulator_posterior(problem.model.basis, None)
    grid = make_grid(model)
    values = values_at_nodes(model, grid, grid.neutral)
    expected, _ = model.output(t[:, None], values, emulator.mean, 1)
    found = linearise(model, t[:, None], emulator, grid, grid.neutral).mean
    np.testing.assert_allclose(found, expected.reshape(found.shape), rtol=1e-9)


class Table(hs.Cause):
    """A cause that returns tables it keeps."""

    kind = "table"
    coefficients = ("height",)

    def __init__(self):
        self.tables = {}

    def columns(self, X, theta):
        t = X["t"]
        return self.tables.setdefault(len(t), 100 * np.sin(3 * t)[:, None])


@pytest.mark.parametrize("n", [1, 2], ids=["the last cause", "an earlier one"])
def test_a_table_that_a_cause_keeps_stays_as_it_is(n):
    t = np.linspace(0, 10, 20)
    table = Table()
    problem = make_problem(
        SIMULATOR,
        hs.ExactSurrogate(),
        hs.Normal(),
        None,
        (table, hs.Offset())[:n],
        ("t",),
        t[:, None],
        np.sin(t),
    )
    grid = make_grid(problem.model)
    columns_at_nodes(problem.model, t[:, None], grid, grid.neutral)
    np.testing.assert_array_equal(table.tables[20][:, 0], 100 * np.sin(3 * t))


class Spike(hs.Cause):
    """A narrow spike, next to nothing at all rows where it lies between them."""

    kind = "spike"
    target = "t"
    parameters = {"where": stats.uniform(0, 10)}
    coefficients = ("spike", "nothing")

    def columns(self, X, theta):
        spike = np.exp(-(((X["t"] - theta["where"]) / 0.03) ** 2))
        return np.stack([spike, 0 * spike], axis=-1)


@pytest.mark.parametrize("block", [1, 10**9])
def test_columns_next_to_nothing_stay_so(monkeypatch, block):
    t = np.linspace(0, 10, 20)[:, None]
    problem = make_problem(
        SIMULATOR,
        hs.ExactSurrogate(),
        hs.Normal(),
        None,
        (Spike(),),
        ("t",),
        t,
        np.exp(-0.3 * t[:, 0]),
    )
    grid = make_grid(problem.model)
    monkeypatch.setattr("hybridsurrogate.numerics.linear_algebra.BLOCK", block)
    found = columns_at_nodes(problem.model, t, grid, grid.neutral)
    spikes = np.exp(-(((t[:, 0] - grid.points) / 0.03) ** 2))
    np.testing.assert_allclose(found.own[:, :, 0] * found.rms[:, :1], spikes, rtol=1e-9)
    # as long as the others but for those that would be rounding
    size = np.sqrt(np.mean(found.own[:, :, 0] ** 2, axis=1))
    true = np.sqrt(np.mean(spikes**2, axis=1))
    np.testing.assert_allclose(size, np.minimum(true / (1e-12 * true.max()), 1), rtol=1e-9)
    assert size.min() < 1e-3
    assert not found.own[:, :, 1].any()


class Shift(hs.Cause):
    """A delay whose lag is enumerated."""

    kind = "shift"
    parameters = {"lag": stats.uniform(-2, 3)}

    def inputs(self, X, omega, theta):
        return {"t": X["t"] - theta["lag"]}, omega


@pytest.mark.parametrize("side", [-1, 1])
def test_slopes_at_the_edge_of_where_a_simulation_runs(side):
    """On one side alone it does: a slope of zero would hold an optimiser there for good."""
    t = np.linspace(0, 8, 12)

    def decay(t, level, rate):
        return np.where(side * (rate - 0.25) < 0, np.nan, level * np.exp(-rate * t))

    priors = {"level": stats.norm(10, 2), "rate": stats.norm(0.25, 0.1)}
    simulator = hs.Simulator(decay, {"t": (0, 8)}, priors)
    y = 10 * np.exp(-0.25 * t)
    model = make_problem(
        simulator, hs.ExactSurrogate(), hs.Normal(), None, (), ("t",), t[:, None], y
    ).model
    emulator, grid = emulator_posterior(model.basis, None), make_grid(model)
    found = linearise(model, t[:, None], emulator, grid, np.zeros(2))
    # by hand, times the standard deviations of the priors
    level = 2 * np.exp(-0.25 * t)
    rate = 0.1 * -t * 10 * np.exp(-0.25 * t)
    np.testing.assert_allclose(found.G[0], np.column_stack([level, rate]), rtol=2e-3, atol=1e-6)


def test_a_node_that_fails_at_a_row_has_no_slopes_there_or_elsewhere():
    """Slopes of 1e60 beside a row without a number are no reason to give up the other nodes."""

    def runaway(t, rate, start):
        with np.errstate(over="ignore"):
            return start * np.where(t < 5, rate * t, 10.0 ** (rate * (t - 5) * 150))

    simulator = hs.Simulator(
        runaway, {"t": (0, 10)}, {"rate": stats.uniform(0.5, 1), "start": stats.uniform(1, 1)}
    )
    t = np.linspace(0, 5, 21)[:-1]
    problem = make_problem(
        simulator, hs.ExactSurrogate(), hs.Normal(), None, (Shift(),), ("t",), t[:, None], t
    )
    emulator = emulator_posterior(problem.model.basis, None)
    grid = make_grid(problem.model)
    around = linearise(problem.model, t[:, None], emulator, grid, grid.neutral)
    failed = ~np.isfinite(around.mean).all(axis=1)
    assert 0 < failed.sum() < len(failed)
    assert not around.G[failed].any()
    assert np.abs(around.G[~failed]).max(axis=(1, 2)).min() > 0
    noise = NoiseTable(problem.noise_prior, problem.scale, len(t))
    nodes = scan(around, problem.y[None], 0.1, noise, np.array([1.0]))[0]
    np.testing.assert_array_equal(np.isfinite(nodes[failed]), False)
    assert np.isfinite(nodes[np.argmin(np.abs(grid.points[:, 0]))])


@pytest.mark.parametrize(("n", "r"), [(40, 7), (7, 40), (20, 20)], ids=["tall", "wide", "square"])
def test_whitened_rows_are_independent(n, r):
    """Whatever the emulator leaves open: nothing in some directions, 10,000 times the noise."""
    rng = np.random.default_rng(0)
    sigma, U = 0.3, rng.standard_normal((n, r)) * np.geomspace(1e-8, 3e3, r)
    U[:, 3] = U[:, 2]
    whiten, log_det = _whitener(U, sigma)
    W = whiten(np.eye(n)).T
    covariance = sigma**2 * np.eye(n) + U @ U.T
    np.testing.assert_allclose(W @ covariance @ W.T, sigma**2 * np.eye(n), atol=1e-6)
    expected = np.log1p((np.linalg.svd(U, compute_uv=False) / sigma) ** 2).sum() / 2
    np.testing.assert_allclose(log_det, expected, rtol=1e-9)
    np.testing.assert_allclose(whiten(np.ones((2, 3, n)))[1, 2], W @ np.ones(n))


def test_where_a_size_is_zero_the_simulation_is_run_at_one_node():
    """Its slopes along the parameters are the same at all nodes; those along the size are not."""
    rows = []

    def decay(t, rate, start):
        rows.append(len(t))
        return start * np.exp(-rate * t)

    priors = {"rate": stats.uniform(0.1, 0.5), "start": stats.norm(1, 0.1)}
    simulator = hs.Simulator(decay, {"t": (0, 10)}, priors)
    X = np.linspace(0, 10, 40)[:, None]
    cause = hs.ParameterDrift("rate", "t", "step")
    y = decay(X[:, 0], 0.3, 1.0)
    problem = make_problem(
        simulator, hs.ExactSurrogate(), hs.Normal(), None, (cause,), ("t",), X, y
    )
    model, emulator = problem.model, emulator_posterior(problem.model.basis, None)
    grid = make_grid(model)
    z = grid.neutral.copy()
    z[:2] = 0.4, -0.2
    assert grid.is_neutral(z)
    rows.clear()
    here = linearise(model, X, emulator, grid, z)
    at_zero = sum(rows)
    rows.clear()
    moved = z.copy()
    moved[grid.sizes] += 1e-9
    close_by = linearise(model, X, emulator, grid, moved)
    # three runs a node, and seven at one; elsewhere seven a node
    assert at_zero < 0.5 * sum(rows)
    for name in ("mean", "G", "H", "H_rms"):
        np.testing.assert_allclose(
            getattr(here, name), getattr(close_by, name), rtol=1e-5, atol=1e-7
        )


def _by_experiment(levels, last):
    """Rates that differ between experiments, already found, and one more cause."""
    asked = []

    def decay(t, rate):
        asked.append(len(t))
        return np.exp(-rate * t)

    simulator = hs.Simulator(decay, {"t": (0, 10)}, {"rate": stats.uniform(0.1, 0.5)})
    t, batch = np.linspace(0.5, 10, 36), np.arange(36) % levels
    X, y = np.column_stack([t, batch]), np.exp(-0.3 * t)
    effects = (hs.ParameterByExperiment("rate", "batch"), last)
    columns = ("t", "batch")
    surrogate = hs.ExactSurrogate()
    problem = make_problem(simulator, surrogate, hs.Normal(), None, effects, columns, X, y)
    return problem.model, X, emulator_posterior(problem.model.basis, problem.simulation), asked


def test_slopes_of_experiments_are_those_of_their_own_rows():
    """In closed form: the rate's slope times the spread in rows of the experiment, else zero."""
    model, X, emulator, _ = _by_experiment(4, hs.Offset())
    grid = make_grid(model)
    names = [name for _, name in model.theta_names]
    z = grid.neutral.copy()
    z[1 + names.index("spread")] = stats.norm.ppf(0.5)
    deviations = [k for k, name in enumerate(names, start=1) if name.startswith("batch = ")]
    z[deviations] = [0.3, -0.2, 0.1, -0.4]
    around = linearise(model, X, emulator, grid, z)
    spread = model.values(z[None])[0, 1 + names.index("spread")]
    t, batch = X.T
    rate = model.values(z[None])[0, 0] + spread * z[deviations][batch.astype(int)]
    slope = -t * np.exp(-rate * t) * spread
    for k, position in enumerate(deviations):
        found = around.G[0, :, list(grid.fixed).index(position)]
        expected = np.where(batch == k, slope, 0.0)
        np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(slope).max())


@pytest.mark.parametrize("last", [hs.Offset(), hs.Delay("t")], ids=["columns", "inputs"])
def test_more_experiments_need_no_more_runs(last):
    """Deviations of experiments have no row in common, and share a run."""
    rows = []
    for levels in (3, 12):
        model, X, emulator, asked = _by_experiment(levels, last)
        asked.clear()
        grid = make_grid(model)
        linearise(model, X, emulator, grid, grid.neutral + 0.1)
        rows.append(sum(asked))
    assert rows[0] == rows[1]


def numbers_in(parts):
    return [parts.mean, parts.G, parts.H, parts.U]


def test_recent_slopes_are_those_of_their_place():
    calls = []

    def decay(t, rate):
        calls.append(len(t))
        return np.exp(-rate * t)

    t = np.linspace(0, 10, 20)
    simulator = hs.Simulator(decay, {"t": (0, 10)}, {"rate": stats.uniform(0.1, 0.5)})
    problem = make_problem(
        simulator, hs.ExactSurrogate(), hs.Normal(), None, (), ("t",), t[:, None], np.exp(-0.3 * t)
    )
    emulator, recent = emulator_posterior(problem.model.basis, None), RecentSlopes()
    causes = [hs.Offset(), hs.Gain(), Spike()]
    for place in (0.3, -0.5, 0.3):
        for cause in causes:
            model = problem.model.with_effects((cause,))
            grid = make_grid(model)
            z = grid.neutral.copy()
            z[0] = place
            alone = linearise(model, t[:, None], emulator, grid, z)
            kept = linearise(model, t[:, None], emulator, grid, z, None, recent)
            for a, b in zip(numbers_in(alone), numbers_in(kept), strict=True):
                np.testing.assert_array_equal(a, b)
    # a place that was met already, under whatever cause that only adds to the output, takes no run
    before = len(calls)
    model = problem.model.with_effects((hs.Offset(),))
    z = make_grid(model).neutral.copy()
    z[0] = -0.5
    linearise(model, t[:, None], emulator, make_grid(model), z, None, recent)
    assert len(calls) == before
