"""How many causes there are: the data say so where nobody did."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search import forward_selection
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep
from hybridsurrogate.diagnosis.search.search import search
from hybridsurrogate.diagnosis.search.setup import prepare, trained_emulator

T = np.linspace(0, 10, 60)
DECAY = hs.Simulator(
    lambda t, a, k: a * np.exp(-k * t),
    inputs={"t": (0, 10)},
    parameters={
        "a": hs.truncated_normal(5, 1, 1, 9),
        "k": hs.truncated_normal(0.3, 0.1, 0.05, 0.8),
    },
)
FEW = all_but("step", "periodic", "unexplained", "gain")


def measured(step, wave):
    rng = np.random.default_rng(3)
    eta = 4.6 * np.exp(-0.33 * T) + step * (T > 6) + wave * np.sin(2 * np.pi * T / 2.5)
    return eta + 0.2 * rng.standard_normal(len(T))


def diagnosed(y, **settings):
    model = hs.PowerScaledSurrogate(
        DECAY, surrogate=hs.ExactSurrogate(), n_draws=200, random_state=0
    )
    settings = {"cv": None, "exclude": FEW, "n_replicates": 50, "random_state": 0} | settings
    return hs.DiscrepancyDiagnosis(model, **settings).fit(T[:, None], y)


def test_two_faults_are_found_without_being_asked_for():
    both = diagnosed(measured(0.9, 0.4))
    assert {found.kind for found in both.found_causes_} == {"step", "periodic"}
    assert diagnosed(measured(0.9, 0.4), max_causes=1).verdict_ in ("nearest", "unexplained")


@pytest.mark.slow
# few draws in each fold
@pytest.mark.filterwarnings("ignore:.*doubtful draws:hybridsurrogate.DiagnosisWarning")
def test_folds_hold_as_many_causes_as_all_rows():
    both = diagnosed(measured(0.9, 0.4), cv=2)
    # with half of the rows one fold may find something else
    assert "periodic + step" in both.gain_.kinds
    alone = diagnosed(measured(0.9, 0.0), cv=2)
    assert set(alone.gain_.kinds) == {"step"}


@pytest.mark.parametrize(("step", "found"), [(0.9, "step"), (0.0, "none")])
def test_where_one_is_enough_none_is_searched_beside_it(step, found, monkeypatch):
    def searched(*given):
        raise AssertionError("a second cause was searched")

    monkeypatch.setattr(forward_selection, "_look_ahead", searched)
    assert [one.kind for one in diagnosed(measured(step, 0.0)).found_causes_] == [found]


def test_two_forms_that_share_a_curve_are_not_both_found():
    """A friction that also grows with the square: its viscous part is none of a parabola's."""
    rng = np.random.default_rng(0)
    velocity = rng.uniform(-1, 1, len(T))
    y = measured(0.0, 0.0) + 2.0 * velocity + 0.5 * np.sign(velocity) + 3.0 * velocity**2
    model = hs.PowerScaledSurrogate(
        DECAY, surrogate=hs.ExactSurrogate(), n_draws=200, random_state=0
    )
    few = all_but("missing-input", "unexplained", "step")
    diagnosis = hs.DiscrepancyDiagnosis(
        model, exclude=few, cv=None, max_causes=2, n_replicates=50, random_state=0
    )
    found = diagnosis.fit(pd.DataFrame({"t": T, "velocity": velocity}), y).found_causes_
    assert [one.kind for one in found].count("missing-input") == 1


def line_with_wild_rows(seed, step, n_wild):
    rng = np.random.default_rng(seed)
    x, day = np.sort(rng.uniform(0, 10, 80)), rng.permutation(np.arange(80.0))
    y = 5 + x + step * (day > 40) + 0.25 * rng.standard_normal(80)
    wild = rng.choice(80, n_wild, replace=False)
    y[wild] += rng.choice([-1, 1], n_wild) * rng.uniform(6, 14, n_wild)
    simulator = hs.Simulator(
        lambda x, start, slope: start + slope * x,
        inputs={"x": (0, 10)},
        parameters={
            "start": hs.truncated_normal(5, 3, -5, 15),
            "slope": hs.truncated_normal(1, 0.5, -1, 3),
        },
    )
    model = hs.PowerScaledSurrogate(simulator, n_draws=200, random_state=0)
    causes = all_but("step", "periodic", "noise", "gross-error", "unexplained")
    diagnosis = hs.DiscrepancyDiagnosis(
        model, cv=None, exclude=causes, n_replicates=50, random_state=0
    )
    return diagnosis.fit(pd.DataFrame({"x": x, "day": day}), y)


def test_wild_rows_do_not_hide_what_the_simulation_lacks():
    found = line_with_wild_rows(1, step=2.0, n_wild=5)
    assert [(one.kind, one.target) for one in found.found_causes_] == [
        ("step", "day"),
        ("noise", None),
    ]
    low, high = found.found_causes_[0].estimates["location"][1:]
    assert low <= 41
    assert high >= 40
    low, high = found.found_causes_[0].estimates["amplitude"][1:]
    assert low < 2.0 < high
    assert "stands" not in str(found.report())


def test_wild_rows_alone_are_outliers():
    alone = line_with_wild_rows(1, step=0.0, n_wild=5)
    assert [(one.kind, one.target) for one in alone.found_causes_] == [("noise", None)]
    assert "The mean of the simulation stands" in str(alone.report())


@pytest.mark.parametrize(
    ("lacking", "expected"),
    [
        (lambda t: 0 * t, {"periodic"}),
        (lambda t: 1.5 * (t > 6), {"step", "periodic"}),
    ],
)
def test_each_cause_has_to_do_better_given_the_others(lacking, expected):
    """A trend is taken for the first cause, and then compared again given the second one."""
    y = measured(0.0, 0.6) + lacking(T)
    model = hs.PowerScaledSurrogate(
        DECAY, surrogate=hs.ExactSurrogate(), n_draws=20, random_state=0
    ).fit(T[:, None], y)
    prepared = prepare(model, ())
    context = SearchContext.of(*trained_emulator(prepared.problem, model))
    kinds = ("step", "periodic", "trend", "unexplained")
    causes = [one for one in prepared.causes if one.kind in kinds]
    first = search(context, causes)
    trend = next(w for w in first.candidates if w.kind == "trend")
    given = forward_selection._search_given(
        first, [one for one in causes if one is not trend.cause], trend
    )
    waves = [w for w in given.candidates if w.kind == "periodic"]
    wave = max(waves, key=lambda w: w.log_evidence)
    steps = [SearchStep(first, None, trend, first), SearchStep(given, None, wave, given)]
    found = forward_selection._backfitted(steps, causes)
    assert {step.chosen.kind for step in found} == expected
