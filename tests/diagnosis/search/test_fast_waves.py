"""Waves that are faster than even rows would resolve, in irregular rows."""

import numpy as np
import pytest
from problems import make_problem
from scipy import stats
from scipy.special import logsumexp

import hybridsurrogate as hs
from hybridsurrogate.inference.conjugate.noise_marginal import NoiseTable
from hybridsurrogate.inference.evidence import linearised
from hybridsurrogate.inference.evidence.grid import make_grid, refine
from hybridsurrogate.inference.evidence.linearised import (
    is_long,
    linearise,
    linearised_pieces,
)
from hybridsurrogate.inference.evidence.marginal_likelihood import scan, shortened
from hybridsurrogate.model.statistics import emulator_posterior

SIMULATOR = hs.Simulator(
    lambda t, level: level + 0 * t, {"t": (0, 1000)}, {"level": stats.norm(0, 3)}
)


def measured(n, period, seed, amplitude=2.0):
    rng = np.random.default_rng([seed, n])
    t = np.sort(rng.uniform(0, 1000, n))
    wave = amplitude * np.sin(2 * np.pi * t / period + rng.uniform(0, 2 * np.pi))
    return t[:, None], 1 + wave + rng.standard_normal(n)


def diagnosed(X, y):
    model = hs.PowerScaledSurrogate(SIMULATOR, surrogate=hs.ExactSurrogate(), random_state=0)
    return hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(X, y)


@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
def test_a_wave_faster_than_even_rows_resolve_is_named():
    """Even rows would be 10 apart, and say nothing of periods below 20."""
    found = diagnosed(*measured(100, 15.0, 0))
    assert found.verdict_ == "named"
    assert found.best_cause_.kind == "periodic"
    assert found.best_cause_.estimates["period"][0] == pytest.approx(15.0, rel=0.01)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
@pytest.mark.parametrize(("n", "period"), [(100, 15.0), (1000, 5.0), (1000, 12.0), (1000, 30.0)])
def test_fast_waves_come_first_on_nine_of_ten_seeds(n, period):
    right = 0
    for seed in range(10, 20):
        cause = diagnosed(*measured(n, period, seed)).best_cause_
        right += (
            cause is not None
            and cause.kind == "periodic"
            and abs(cause.estimates["period"][0] / period - 1) < 0.01
        )
    assert right >= 9


def parts_of(n=1000, amplitude=0.0):
    """Return a wave in irregular rows: its model, and everything that its evidence needs."""
    X, y = measured(n, 5.0, 1, amplitude)
    cause = (hs.Periodic("t"),)
    problem = make_problem(SIMULATOR, hs.ExactSurrogate(), hs.Normal(), None, cause, ("t",), X, y)
    emulator = emulator_posterior(problem.model.basis, None)
    return problem, emulator, make_grid(problem.model)


@pytest.mark.parametrize("amplitude", [pytest.param(0.0, marks=pytest.mark.slow), 0.2, 2.0])
def test_a_shortened_grid_has_the_evidence_of_the_whole(amplitude):
    problem, emulator, grid = parts_of(amplitude=amplitude)
    model, X, y = problem.model, problem.X, problem.y
    assert is_long(model, X, grid)
    sigma, noise = float(np.std(y)), NoiseTable(problem.noise_prior, problem.scale, len(y))
    args = y[None], sigma, noise, np.geomspace(0.3 * sigma, 3 * sigma, 10)
    pieces = list(linearised_pieces(model, X, emulator, grid, grid.neutral))
    whole = np.concatenate([scan(parts, *args)[0] for parts in pieces])
    short = shortened(model, X, y, emulator, grid, grid.neutral, sigma, 3 * sigma)
    assert len(short.points) == 400
    assert logsumexp(short.log_weight) == pytest.approx(0.0, abs=1e-9)
    few = scan(linearise(model, X, emulator, short, grid.neutral), *args)[0]
    assert logsumexp(few) == pytest.approx(logsumexp(whole), abs=0.02)
    density = whole - grid.log_weight
    assert grid.points[np.argmax(density)] in short.points


def test_pieces_are_the_whole(monkeypatch):
    problem, emulator, grid = parts_of(200)
    args = problem.model, problem.X, emulator, grid, grid.neutral + 0.1
    assert not is_long(problem.model, problem.X, grid)
    whole = linearise(*args)
    monkeypatch.setattr(linearised, "_MOST_KEPT", 1000)
    monkeypatch.setattr(linearised, "LARGE_BLOCK", 40_000)
    pieces = list(linearised_pieces(*args))
    assert len(pieces) > 1
    for name in ("H", "H_rms", "log_weight"):
        together = np.concatenate([getattr(parts, name) for parts in pieces])
        np.testing.assert_allclose(together, getattr(whole, name), rtol=1e-12)
    np.testing.assert_allclose(pieces[1].G, whole.G)


def test_a_refined_grid_pays_for_what_it_left_out():
    """A wave in noise of a thousandth leaves cells 100 nats behind: their mass is not passed on."""
    X, y = measured(100, 30.0, 1)
    y = 1 + 2 * np.sin(2 * np.pi * X[:, 0] / 30.0) + 1e-3 * (y - y.mean())
    problem = make_problem(
        SIMULATOR, hs.ExactSurrogate(), hs.Normal(), None, (hs.Periodic("t"),), ("t",), X, y
    )
    emulator, grid = emulator_posterior(problem.model.basis, None), make_grid(problem.model)
    noise = NoiseTable(problem.noise_prior, problem.scale, len(y))
    prior = problem.model.priors[grid.nodes[0]]
    for _ in range(5):
        parts = linearise(problem.model, X, emulator, grid, grid.neutral)
        nodes = scan(parts, y[None], 0.1, noise, np.array([6.0]))[0]
        grid = refine(problem.model, grid, nodes)
    mass = np.diff(prior.cdf(grid.edges[:, 0]), axis=1)[:, 0]
    np.testing.assert_allclose(np.exp(grid.log_weight), mass, rtol=1e-6)
    assert mass.sum() < 0.9
