"""A search in some of the rows, which starts from that in all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.search import search
from hybridsurrogate.diagnosis.search.setup import prepare, trained_emulator

# wide enough for what a cause may gain or lose where a fifth of the rows is left out
REACH = 12.0


@pytest.fixture(scope="module", params=[0.0, 0.8, 8.0], ids=["none", "small", "large"])
def searches(request):
    """A step of some size in a straight line: all rows; four in five; these from all rows."""
    rng = np.random.default_rng(3)
    t = np.sort(rng.uniform(0, 80, 60))
    simulator = hs.Simulator(
        lambda t, slope: slope * t, inputs={"t": (0, 80)}, parameters={"slope": norm(1, 0.1)}
    )
    y = t + request.param * (t > 43) + rng.normal(size=60)
    out = []
    for rows in (np.arange(60), np.flatnonzero(np.arange(60) % 5 != 2)):
        model = hs.PowerScaledSurrogate(
            simulator, surrogate=hs.ExactSurrogate(), n_draws=20, random_state=0
        ).fit(t[rows, None], y[rows])
        prepared = prepare(model, ())
        problem, emulator = trained_emulator(prepared.problem, model)
        whole = out[0] if out else None
        if whole is not None:
            basis = whole.problem.model.basis
            problem = replace(problem, model=replace(problem.model, basis=basis))
        out += [search(SearchContext.of(problem, emulator), prepared.causes, nearby=whole)]
        if whole is not None:
            out += [search(SearchContext.of(problem, emulator), prepared.causes)]
    return out


def test_the_same_is_probable_as_from_scratch(searches):
    _, near, anew = searches
    probable = anew.probability > 0.02
    np.testing.assert_allclose(near.probability[probable], anew.probability[probable], atol=0.05)
    np.testing.assert_allclose(near.probability.sum(), 1)


def test_what_was_far_behind_in_all_rows_is_not_compared(searches):
    whole, near, anew = searches
    left_out = np.array([w.log_evidence == -np.inf for w in near.candidates])
    with np.errstate(divide="ignore"):
        behind = np.log(whole.probability[1:].max() / whole.probability)
    assert (behind[left_out] >= REACH).all()
    # and nothing else is: what failed from scratch as well is no choice of the search
    failed = np.array([w.log_evidence == -np.inf for w in anew.candidates])
    processes = np.array([w.cause is not None and w.cause.is_process for w in near.candidates])
    processes |= [w.cause is not None and w.cause.is_correlated_noise for w in near.candidates]
    expected = (behind > REACH) & ~processes
    np.testing.assert_array_equal((left_out | failed)[1:], (expected | failed)[1:])
    assert not left_out[0]
    if behind[0] > REACH:  # a large step: most else is out of reach
        assert left_out.sum() > 10
    compared = [w for w, out in zip(near.candidates, left_out, strict=True) if not out]
    # a curve of any shape and correlated noise are always compared
    assert {"none", "unexplained"} <= {w.kind for w in compared}
    assert np.isfinite(near.remainder).all()
    assert np.isfinite(near.correlated).all()
    assert (near.probability[left_out] == 0).all()
