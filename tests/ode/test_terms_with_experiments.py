"""What is lost further on: two outputs, two experiments that start differently."""

import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.setup import prepare

TIMES = np.array([5, 10, 20, 35, 50, 70, 100.0])


def _simulator():
    def slopes(t, state, k):
        return np.stack([-k * state[0], k * state[0]])

    return hs.OdeSimulator(
        slopes,
        initial_state=lambda start: [start, 0.0 * start],
        observe=lambda state: {"a": state[0], "b": state[1]},
        inputs={"t": (0, 100)},
        states=("a", "b"),
        parameters={
            "k": hs.truncated_normal(0.04, 0.02, 0.005, 0.2),
            "start": hs.truncated_normal(4, 2, 0.5, 10),
        },
        output=("a", "b"),
    )


def _measured(seed, losses=(0.015, 0.015), rates=(0.035, 0.05), noise=0.08):
    """Return what is measured where b is lost as well: its solution is in every textbook."""
    random, parts = np.random.default_rng(seed), []
    for name, start, k, loss in zip("pq", (5.0, 3.0), rates, losses, strict=True):
        a = start * np.exp(-k * TIMES)
        b = start * k / (k - loss) * (np.exp(-loss * TIMES) - np.exp(-k * TIMES))
        ab = np.stack([a, b], axis=1) + noise * random.standard_normal((len(TIMES), 2))
        parts.append(pd.DataFrame({"t": TIMES, "assay": name, "a": ab[:, 0], "b": ab[:, 1]}))
    return pd.concat(parts, ignore_index=True)


def _model(**given):
    return hs.PowerScaledSurrogate(
        _simulator(),
        surrogate=hs.ExactSurrogate(),
        experiment="assay",
        n_draws=300,
        random_state=0,
        **given,
    )


BOTH = {"k": "own", "start": "own"}


def test_terms_are_compared_at_seven_times():
    rows = _measured(0)
    fitted = _model(by_experiment=BOTH).fit(rows[["t", "assay"]], rows[["a", "b"]])
    prepared = prepare(fitted, ())
    there = {(cause.target, cause.variant) for cause in prepared.causes}
    assert {("b", "proportional"), ("a", "constant"), ("b", "power")} <= there
    assert ("b", "proportional by assay") in there
    # what is placed in time needs more of them
    reasons = {(left.kind, left.target): left.reason for left in prepared.skipped}
    assert "t has 7 distinct values, 8 are needed" in reasons["parameter-drift", "k"]
    assert ("b", "seasonal") not in there


def test_a_term_by_experiment_is_fitted():
    rows = _measured(1, losses=(0.02, 0.005))
    loss = hs.TermByExperiment("b", "assay")
    model = _model(by_experiment=BOTH, effects=[loss]).fit(rows[["t", "assay"]], rows[["a", "b"]])
    told = model.posterior_.estimates(0)
    for name, truth in {"rate, assay = 0": -0.02, "rate, assay = 1": -0.005}.items():
        draws = told[name]
        assert abs(np.mean(draws) - truth) < 3.5 * np.std(draws)
        assert np.std(draws) < 0.005


@pytest.mark.slow
def test_a_loss_of_the_second_state_is_named():
    right = []
    for seed in range(10):
        rows = _measured(seed)
        diagnosis = hs.DiscrepancyDiagnosis(
            _model(by_experiment=BOTH), cv=None, random_state=0
        ).fit(rows[["t", "assay"]], rows[["a", "b"]])
        best = diagnosis.best_cause_
        right.append((best.kind, best.target) == ("missing-term", "b"))
    assert np.sum(right) >= 8
