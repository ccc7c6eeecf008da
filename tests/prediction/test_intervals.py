"""Central intervals of mixtures of normals, against the roots of their distribution functions."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import optimize, special

from hybridsurrogate.likelihoods import Normal
from hybridsurrogate.prediction.mixture import central_interval

N_ROWS, N_DRAWS = 60, 400


def mixture_of(*parts):
    """Return a function of rows k: a mixture of (weight, centres, sds), arrays (n,), (S, n)."""

    def posterior(centre, sigma):
        def eta(X):
            rows = X[:, 0].astype(int)
            return centre[:, rows], sigma[:, rows]

        model = SimpleNamespace(whole=lambda cuts, X: cuts)
        return SimpleNamespace(eta=eta, likelihood=Normal(), n_draws=len(centre), model=model)

    def at(X):
        rows = X[:, 0].astype(int)
        return [(np.broadcast_to(w, N_ROWS)[rows], posterior(c, s)) for w, c, s in parts]

    return at, np.arange(N_ROWS, dtype=float)[:, None]


def direct(parts, k, probability):
    """Return a quantile of row k by the root finder of scipy."""

    def off(y):
        each = [
            np.broadcast_to(w, N_ROWS)[k] * special.ndtr((y - c[:, k]) / s[:, k]).mean()
            for w, c, s in parts
        ]
        return np.sum(each) - probability

    low = min((c[:, k] - 20 * s[:, k]).min() for _, c, s in parts)
    high = max((c[:, k] + 20 * s[:, k]).max() for _, c, s in parts)
    return optimize.brentq(off, low, high, xtol=1e-13 * (high - low), rtol=1e-14)


def one_cloud(rng):
    sigma = np.exp(0.1 * rng.standard_normal((N_DRAWS, 1))) * np.ones(N_ROWS)
    return [(1.0, 1e3 + rng.standard_normal((N_DRAWS, N_ROWS)), sigma)]


def scales_apart(rng):
    sigma = np.exp(2 * rng.standard_normal((N_DRAWS, N_ROWS)))
    return [(1.0, 3 * rng.standard_normal((N_DRAWS, N_ROWS)), sigma)]


def far_apart(rng):
    """Two narrow clouds with nothing between them, their shares along the rows."""
    first = 0.01 * rng.standard_normal((N_DRAWS, N_ROWS))
    sigma = np.full((N_DRAWS, N_ROWS), 0.01)
    share = np.linspace(0, 1, N_ROWS)
    return [(share, first, sigma), (1 - share, 100 + first[:150], 3 * sigma[:150])]


@pytest.mark.parametrize("case", [one_cloud, scales_apart, far_apart])
@pytest.mark.parametrize("level", [0.5, 0.9, 0.9999])
def test_ends_are_the_roots_of_the_distribution_function(case, level):
    parts = case(np.random.default_rng(0))
    ends = central_interval(*mixture_of(*parts), level)
    tail = (1 - level) / 2
    for end, probability in zip(ends, (tail, 1 - tail), strict=True):
        expected = np.array([direct(parts, k, probability) for k in range(N_ROWS)])
        low = np.min([(c - 9 * s).min(axis=0) for _, c, s in parts], axis=0)
        reach = np.max([(c + 9 * s).max(axis=0) for _, c, s in parts], axis=0) - low
        # what the search promises: a thousand millionth of what holds all draws
        assert (np.abs(end - expected) <= 1e-9 * reach).all()


def test_an_end_takes_few_looks_at_the_distribution_function(monkeypatch):
    """What 10,000 rows cost: every look is at all draws of a row."""
    looked, ndtr = [], special.ndtr
    monkeypatch.setattr(special, "ndtr", lambda z: (looked.append(np.size(z)), ndtr(z))[1])
    central_interval(*mixture_of(*one_cloud(np.random.default_rng(1))), 0.9)
    assert sum(looked) <= 3 * 2 * N_DRAWS * N_ROWS


def test_a_row_without_a_prediction_has_no_interval_and_takes_none_from_others():
    (part,) = one_cloud(np.random.default_rng(2))
    lower, upper = central_interval(*mixture_of(part), 0.9)
    gone = part[1].copy()
    gone[:, 7] = np.nan
    ends = central_interval(*mixture_of((1.0, gone, part[2])), 0.9)
    assert np.isnan(ends)[:, 7].all()
    others = np.arange(N_ROWS) != 7
    np.testing.assert_allclose(ends[0][others], lower[others], rtol=1e-12)
    np.testing.assert_allclose(ends[1][others], upper[others], rtol=1e-12)
