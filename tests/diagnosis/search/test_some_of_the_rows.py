"""A search in some of the rows, which starts from that in all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm, uniform

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.forward_selection import forward_search
from hybridsurrogate.diagnosis.search.forward_selection import searches as searches_of
from hybridsurrogate.diagnosis.search.search import search
from hybridsurrogate.diagnosis.search.setup import prepare, trained_emulator

# wide enough for what a cause may gain or lose where a fifth of the rows is left out
REACH = 12.0
SOME = ("step", "periodic", "ramp", "trend", "bump", "saturation", "decay")


def context_of(change, rows, whole=None):
    """Return what a search in some rows of a straight line with a change looks at, and causes."""
    rng = np.random.default_rng(3)
    t = np.sort(rng.uniform(0, 80, 60))
    simulator = hs.Simulator(
        lambda t, slope: slope * t, inputs={"t": (0, 80)}, parameters={"slope": norm(1, 0.1)}
    )
    y = t + change(t) + rng.normal(size=60)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=20, random_state=0
    ).fit(t[rows, None], y[rows])
    prepared = prepare(model, ())
    problem, emulator = trained_emulator(prepared.problem, model)
    if whole is not None:
        basis = whole.problem.model.basis
        problem = replace(problem, model=replace(problem.model, basis=basis))
    return SearchContext.of(problem, emulator), prepared.causes


@pytest.fixture(scope="module", params=[0.0, 0.8, 8.0], ids=["none", "small", "large"])
def searches(request):
    """A step of some size in a straight line: all rows; four in five; these from all rows."""

    def change(t):
        return request.param * (t > 43)

    whole = search(*context_of(change, np.arange(60)))
    some = context_of(change, np.flatnonzero(np.arange(60) % 5 != 2), whole)
    return whole, search(*some, nearby=whole), search(*some)


@pytest.fixture(scope="module")
def at_one_end():
    """A wave in a straight line: all rows, and the context of the first three in five."""

    def change(t):
        return np.sin(t / 4)

    whole = search(*context_of(change, np.arange(60)))
    return whole, *context_of(change, np.arange(36), whole)


def test_what_all_rows_lack_is_compared_as_from_scratch(at_one_end):
    """Some of the rows may put a parameter at the end of its prior."""
    whole, context, causes = at_one_end
    others = [w for w in whole.candidates if w.cause is None or w.cause.kind != "bump"]
    lacking = replace(whole, candidates=others).over(context.problem.model, causes)
    near, anew = search(context, causes, nearby=lacking), search(context, causes)
    bumps = [[w.log_evidence for w in one.candidates if w.kind == "bump"] for one in (near, anew)]
    np.testing.assert_allclose(*bumps, atol=0.1)
    # and so is all else: these rows may be too unlike all of them
    assert np.isfinite([w.log_evidence for w in near.candidates]).all()
    probable = anew.probability > 0.02
    assert probable.sum() > 1
    evidence = np.array([[w.log_evidence for w in one.candidates] for one in (near, anew)])
    np.testing.assert_allclose(*evidence[:, probable], atol=0.1)


def test_a_wild_row_is_looked_for_anew():
    """It has another number in other rows."""

    def change(t):
        return 9.0 * (np.arange(len(t)) == 20)

    whole = search(*context_of(change, np.arange(60)))
    some = context_of(change, np.flatnonzero(np.arange(60) % 5 != 2), whole)
    near, anew = (
        [w.log_evidence for w in one.candidates if w.kind in ("none", "gross-error")]
        for one in (search(*some, nearby=whole), search(*some))
    )
    np.testing.assert_allclose(near, anew, atol=0.1)
    assert max(near) > near[0] + 5


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


def test_few_first_causes_are_tried_for_a_second_one():
    """In all rows, and in four of five of them."""
    rng = np.random.default_rng(5)
    t = np.sort(rng.uniform(0, 20, 50))
    simulator = hs.Simulator(
        lambda t, a, k: a * np.exp(-k * t) + 5,
        inputs={"t": (0, 20)},
        parameters={"a": uniform(5, 6), "k": uniform(0.05, 0.4)},
    )
    y = 8 * np.exp(-0.2 * t) + 5 + 2.4 * (t > 11) + 1.8 * np.sin(2 * np.pi * t / 4.3)
    y += 0.3 * rng.normal(size=50)
    known, found = (), []
    for rows in (np.arange(50), np.flatnonzero(np.arange(50) % 5 != 2)):
        model = hs.PowerScaledSurrogate(
            simulator, surrogate=hs.ExactSurrogate(), n_draws=20, random_state=0
        ).fit(t[rows, None], y[rows])
        prepared = prepare(model, ())
        problem, emulator = trained_emulator(prepared.problem, model)
        causes = [c for c in prepared.causes if c.kind in SOME]
        random = np.random.RandomState(0)
        steps = forward_search(problem, causes, emulator, 2, 0.05, None, random, known)
        known = known or searches_of(steps)
        found.append(steps)
    for steps in found:
        assert {step.chosen.kind for step in steps} == {"step", "periodic"}
        # two leading causes and the partner of the better one have their turn as the first one
        assert 2 <= len(steps[0].tried) <= 3
