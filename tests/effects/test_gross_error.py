"""Single measurements that are unlike the others: which rows, what they cost, what is left out."""

from __future__ import annotations

import numpy as np
import pytest
from problems import make_problem
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.catalogue import catalogue
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.search import search
from hybridsurrogate.effects.base import ROW, Context
from hybridsurrogate.effects.noise.outliers import GrossRow
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.model.context import make_context
from hybridsurrogate.model.statistics import emulator_posterior

T = np.arange(20.0)


def prepared(n_rows=1, missed=(), n=20):
    context = Context({"t": T[:n]}, 1, {}, {}, 1.0, missed=np.array(missed))
    return hs.GrossError(n_rows).prepare(context)


def test_every_row_has_a_cell_of_the_same_mass():
    one = prepared()
    cells, prior = one.grid()["which"], one.parameters["which"]
    np.testing.assert_allclose(np.diff(prior.cdf(cells)).ravel(), 1 / 20)
    rows = {"t": T, ROW: T}
    columns = one.columns(rows, {"which": np.full(20, 11.0)})
    np.testing.assert_array_equal(columns.ravel(), T == 11)


def test_pairs_that_are_not_tried_keep_their_prior():
    """Of 190 pairs those of the twelve rows missed most are tried, and pay for all others."""
    two = prepared(2, missed=np.where(np.isin(T, [3, 17]), -99.0, 20 - T))
    cells, prior = two.grid()["which"], two.parameters["which"]
    mass = np.diff(prior.cdf(cells)).ravel()
    assert len(mass) == 66 + 1
    np.testing.assert_allclose(mass[:-1], 1 / 190)
    assert mass.sum() == pytest.approx(1.0)
    assert two.is_screened
    assert not prepared().is_screened
    which = next(k for k in range(66) if set(two.at(k)) == {3, 17})
    columns = two.columns({"t": T, ROW: T}, {"which": np.full(20, float(which))})
    np.testing.assert_array_equal(np.flatnonzero(columns.any(axis=1)), [3, 17])
    # the rest is nothing
    assert not two.columns({"t": T, ROW: T}, {"which": np.full(20, 100.0)}).any()


def test_rows_that_were_not_measured_have_no_shift():
    one = prepared()
    other = {"t": T + 0.5, ROW: T}
    assert not one.columns(other, {"which": np.full(20, 11.0)}).any()
    assert not one.columns({"t": T}, {"which": np.full(20, 11.0)}).any()


@pytest.mark.parametrize("n_rows", [0, 3, 1.5])
def test_more_rows_are_outliers(n_rows):
    with pytest.raises(ValueError, match="n_rows must be 1 or 2, got"):
        prepared(n_rows)


def test_evidence_is_that_of_the_row_left_out():
    """Against the mean-shift model by hand, one row at a time, noise integrated out on a grid."""
    simulator = hs.Simulator(lambda t: 0 * t, inputs={"t": (0, 19)})
    y = 0.3 * np.random.default_rng(2).standard_normal(20)
    y[11] += 3.0
    likelihood = as_likelihood("normal")
    problem = make_problem(
        simulator, hs.ExactSurrogate(), likelihood, None, (), ("t",), T[:, None], y
    )
    basis = problem.model.basis
    context = make_context(
        *(simulator, ("t",), 1, T[:, None], problem.scale, likelihood, basis, np.mean(y))
    )
    cause = hs.GrossError().prepare(context)
    found = search(SearchContext.of(problem, emulator_posterior(basis, None)), [cause])
    logs = np.linspace(np.log(0.1), np.log(3), 400)
    sigma = np.exp(logs)
    prior = problem.noise_prior.logpdf(sigma) + logs + np.log(logs[1] - logs[0])
    terms = []
    for size in found.sizes:
        # a size is the root mean square over all rows
        for row in range(20):
            sd = np.hypot(sigma, size * np.sqrt(20))
            others = np.delete(y, row)
            logpdf = stats.norm.logpdf(others[:, None], 0, sigma).sum(axis=0)
            terms.append(logpdf + stats.norm.logpdf(y[row], 0, sd) + prior)
    exact = np.logaddexp.reduce(np.concatenate(terms)) - np.log(20 * len(found.sizes))
    # the noise is the fit's where sizes are compared with it
    assert found.candidates[1].log_evidence == pytest.approx(exact, abs=0.3)


def test_an_estimator_leaves_a_known_row_out_wherever_it_stands():
    simulator = hs.Simulator(
        lambda t, slope: slope * t, inputs={"t": (0, 19)}, parameters={"slope": stats.norm(1, 1)}
    )
    y = 2 * T + 0.1 * np.random.default_rng(0).standard_normal(20)
    y[4] = 999.0
    wild = hs.GrossError(rows=(GrossRow(5, (("t", 4.0),), 999.0),))
    options = {"surrogate": hs.ExactSurrogate(), "n_draws": 200, "random_state": 0}
    model = hs.PowerScaledSurrogate(simulator, effects=(wild,), **options)
    order = np.random.default_rng(1).permutation(20)
    model.fit(T[order, None], y[order])
    plain = hs.PowerScaledSurrogate(simulator, **options)
    plain.fit(np.delete(T, 4)[:, None], np.delete(y, 4))
    means = [one.posterior_.named()["slope"].mean() for one in (model, plain)]
    assert means[0] == pytest.approx(means[1], abs=1e-3)
    assert means[0] == pytest.approx(2.0, abs=0.02)
    assert model.predict([[4.0]])[0] == pytest.approx(8.0, abs=0.1)


def test_counts_have_no_single_rows():
    counts = Context({"t": T}, 1, {}, {}, 1.0, gaussian=False)
    causes, skipped = catalogue(counts)
    assert "gross-error" not in {cause.kind for cause in causes}
    (reason,) = {one.reason for one in skipped if one.kind == "gross-error"}
    assert "the likelihood is not normal" in reason
