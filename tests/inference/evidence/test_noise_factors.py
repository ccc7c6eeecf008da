"""Noise factors in the evidence, and growing noise found."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.special import logsumexp
from searching import compared
from tide import FRAME, NOISE, SIMULATOR, plain, problem_of

import hybridsurrogate as hs
from hybridsurrogate.catalogue import catalogue
from hybridsurrogate.diagnosis.answers.finding import form_of
from hybridsurrogate.diagnosis.search.search import predict_locally
from hybridsurrogate.inference.evidence.grid import make_grid
from hybridsurrogate.inference.evidence.linearised import linearise
from hybridsurrogate.inference.evidence.marginal_likelihood import scan
from hybridsurrogate.model.context import make_context
from hybridsurrogate.model.statistics import emulator_posterior


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
        *(LINE, ("t",), 1, t[:, None], problem.scale, problem.likelihood, problem.model.basis),
        location=float(np.mean(problem.y)),
    )
    cause = cause.prepare(context)
    model = replace(problem.model, effects=(cause,))
    grid = make_grid(model)
    emulator = emulator_posterior(model.basis, None)
    error = rng.normal(0, 0.3, (n, 2))  # of an emulator, as a factor of its covariance
    parts = replace(linearise(model, problem.X, emulator, grid, grid.neutral), U=error)

    def fixed_sigma(squares):
        return -0.5 * n * np.log(2 * np.pi * sigma**2) - 0.5 * squares / sigma**2

    found = scan(parts, y, sigma, fixed_sigma, sizes)

    prior = 0.5**2 + 0.3**2 * np.outer(t, t) + error @ error.T
    names = list(cause.grid())
    for k, node in enumerate(grid.points):
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
            expected = logsumexp(by_size) - np.log(len(sizes)) + grid.log_weight[k]
            assert found[r, k] == pytest.approx(expected, abs=1e-6)


def weigh_noise(growth, seed):
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 4, 60)
    y = line(t, 1.2, 1.8) + 0.3 * np.exp(growth * (t - 2)) * rng.standard_normal(60)
    problem = problem_of(pd.DataFrame({"t": t}), y, LINE)
    context = make_context(
        *(LINE, ("t",), 1, t[:, None], problem.scale, problem.likelihood, problem.model.basis),
        location=float(np.mean(problem.y)),
    )
    forms = ("noise", "trend", "bump", "unexplained")
    causes = [cause for cause in catalogue(context)[0] if form_of(cause) in forms]
    found = compared(problem, causes, emulator_posterior(problem.model.basis, None))
    return found, {w.kind: w for w in found.candidates}


def test_noise_that_grows_is_told_from_noise_that_does_not():
    found, weighed = weigh_noise(0.6, 0)
    assert weighed["noise"].log_evidence > weighed["none"].log_evidence + 5
    assert found.candidates[int(np.argmax(found.probability))].kind == "noise"
    slope = weighed["noise"].fit.values[0, -1] / 2
    assert slope == pytest.approx(0.6, abs=0.25)
    # sigma keeps its meaning, and predictions know where the noise is
    assert weighed["noise"].fit.sigma == pytest.approx(0.3, rel=0.3)
    _, variance = predict_locally(found, weighed["noise"], np.array([[0.0], [4.0]]))
    assert variance[1] > 20 * variance[0]
    _, quiet = weigh_noise(0.0, 1)
    assert quiet["noise"].log_evidence < quiet["none"].log_evidence + 0.5


@pytest.mark.slow
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
    assert "noise" in str(found.report(full=True))
    assert set(found.next_measurement_) == {"t", "dose"}
