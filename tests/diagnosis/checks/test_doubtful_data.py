"""Measured data that hold copies, or no noise: what is said of them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from few_kinds import all_but

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.checks.data import copied_rows

T = np.linspace(0, 10, 20)
DECAY = hs.Simulator(
    lambda t, a, k: a * np.exp(-k * t),
    inputs={"t": (0, 10)},
    parameters={
        "a": hs.truncated_normal(5, 1, 1, 9),
        "k": hs.truncated_normal(0.3, 0.1, 0.05, 0.8),
    },
)


def measured(noise):
    noises = np.random.default_rng(0).standard_normal(len(T))
    return DECAY.function(T, 4.6, 0.33) + noise * noises


def told(t, y):
    """Return what a diagnosis warns of."""
    model = hs.PowerScaledSurrogate(
        DECAY, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        settings = {"exclude": all_but("step", "trend"), "cv": None, "n_replicates": 39}
        hs.DiscrepancyDiagnosis(model, **settings, random_state=0).fit(t[:, None], y)
    # whoever calls fit is told
    assert all(w.category is hs.DiagnosisWarning and w.filename == __file__ for w in said)
    return [str(w.message) for w in said]


@pytest.mark.parametrize("noise", [0.0, 1e-9, 1e-5])
def test_what_is_met_to_a_millionth(noise):
    """As where one code is compared with another."""
    warned = told(T, measured(noise))
    assert len(warned) == (noise < 1e-6)
    assert all("add noise as large as the differences that matter" in text for text in warned)


def test_a_file_that_was_read_twice():
    y = measured(0.2)
    (warned,) = told(np.tile(T, 2), np.tile(y, 2))
    assert "20 of 40 measured rows are copies" in warned
    assert "drop_duplicates" in warned


def test_measurements_made_again_are_no_copies():
    rng = np.random.default_rng(0)
    x = np.repeat(np.arange(10.0), 4)[:, None]
    y = rng.standard_normal(40)
    assert not copied_rows(x, y)
    # an instrument with few digits: some agree
    assert not copied_rows(x, y.round(1))
    # four rows that slipped in again
    X, y = np.vstack([T[:, None], T[:4, None]]), np.append(measured(1), measured(1)[:4])
    (found,) = copied_rows(X, y)
    assert found.sentence.startswith(f"4 of {len(y)} ")
    # nothing is repeated, whatever the output
    assert not copied_rows(T[:, None], np.zeros(20))
