"""Jumps that come back and decay: where they are, what they cost, and when they are named."""

from __future__ import annotations

from math import comb, log

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy.stats import norm
from shared_files import shared_path
from tide import context_of

import hybridsurrogate as hs
from hybridsurrogate.catalogue import catalogue
from hybridsurrogate.diagnosis.search.candidate import prior_odds

CYCLE = np.arange(1.0, 61.0)
PLACES = np.array([12.0, 30.0, 47.0])
FEW = all_but("recurring-jumps", "noise", "step", "episode", "decay", "trend")


def fade(cycle, start, rate):
    return start - rate * cycle


FADE = hs.Simulator(
    fade, {"cycle": (1, 60)}, {"start": norm(2, 0.1), "rate": hs.truncated_normal(0.01, 0.01, 0, 1)}
)


def measured(sizes, seed=0):
    since = CYCLE[:, None] - PLACES
    jumps = np.where(since >= 0, np.exp(-np.maximum(since, 0) / 5), 0) @ np.asarray(sizes)
    return fade(CYCLE, 2.0, 0.01) + jumps + 0.01 * np.random.default_rng(seed).normal(size=60)


def diagnosed(y):
    model = hs.PowerScaledSurrogate(
        FADE, surrogate=hs.ExactSurrogate(), n_draws=200, random_state=0
    )
    settings = {"exclude": FEW, "cv": None, "n_replicates": 39, "random_state": 0}
    return hs.DiscrepancyDiagnosis(model, causes=[hs.RecurringJumps("cycle")], **settings).fit(
        CYCLE[:, None], y
    )


def test_jumps_are_found_where_they_are():
    found = diagnosed(measured([0.08, 0.05, 0.1]))
    assert (found.verdict_, found.best_cause_.kind) == ("named", "recurring-jumps")
    after = found.extended_estimator_
    (cause,) = (e for e in getattr(after, "estimators_", [after])[0].effects if e.is_learned)
    assert cause.places == tuple(PLACES)
    assert abs(found.best_cause_.estimates["scale"][0] - 5) < 2
    # within three times the noise of a row
    assert abs(found.best_cause_.estimates["jump_3"][0] - 0.1) < 0.03
    assert "at 12, " in found.best_cause_.formula
    # the extended simulation has them, and so has the module
    omega = [2.0, 0.01, 5.0, 0.08, 0.05, 0.1]
    extended = found.extended_simulator_
    assert extended.parameter_names == ("start", "rate", "scale", "jump_1", "jump_2", "jump_3")
    expected = extended(CYCLE[:, None], np.tile(omega, (60, 1)))
    module: dict[str, object] = {}
    exec(found.to_python(), module)
    numbers = dict(zip(extended.parameter_names, omega, strict=True))
    np.testing.assert_allclose(module["extended"](fade, CYCLE, **numbers), expected, rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_noise_alone_has_no_jumps(seed):
    found = diagnosed(measured([0, 0, 0], seed))
    assert found.verdict_ == "adequate"
    table = found.causes_.set_index("kind")["probability"]
    assert table["recurring-jumps"] < 0.01


def test_places_from_the_data_pay_for_all_others():
    context = context_of(pd.DataFrame({"cycle": CYCLE}), FADE)
    known = hs.RecurringJumps("cycle", places=(12.0, 30.0)).prepare(context)
    assert known.log_prior_of_choice == 0.0
    assert not known.is_screened
    detected = known.filled(n_tried=59)
    assert detected.is_screened
    assert detected.log_prior_of_choice == pytest.approx(-log(20) - log(comb(59, 2)))
    step = hs.Step("cycle")
    alone, paid = prior_odds([None, step, known]), prior_odds([None, step, detected])
    np.testing.assert_allclose(paid[:2], alone[:2])
    assert paid[2] / alone[2] == pytest.approx(np.exp(detected.log_prior_of_choice))


def test_what_is_not_enough_is_left_out():
    context = context_of(pd.DataFrame({"cycle": CYCLE[:12]}), FADE)
    causes, skipped = catalogue(context, [hs.RecurringJumps("cycle")])
    assert "recurring-jumps" not in {cause.kind for cause in causes}
    assert any("too few rows for jumps" in one.reason for one in skipped)


@pytest.mark.slow
def test_a_battery_recovers_after_its_rests():
    """The cell B0005 (NASA PCoE): documented rests are at these cycles (Saha and Goebel 2009)."""
    frame = pd.read_csv(shared_path("faults", "battery_b0005.csv"), comment="#")
    cycle, capacity = frame["cycle"].to_numpy(float), frame["capacity_Ah"].to_numpy(float)
    simulator = hs.Simulator(
        fade,
        {"cycle": (1, 170)},
        {"start": norm(1.85, 0.1), "rate": hs.truncated_normal(0.003, 0.002, 0, 0.02)},
    )
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    found = hs.DiscrepancyDiagnosis(
        model, causes=[hs.RecurringJumps("cycle")], cv=None, random_state=0
    ).fit(cycle[:, None], capacity)
    assert found.best_cause_.kind == "recurring-jumps"
    after = found.extended_estimator_
    effects = getattr(after, "estimators_", [after])[0].effects
    places = next(e.places for e in effects if e.kind == "recurring-jumps")
    for rest in (20, 31, 48, 90, 104, 120, 133, 151):
        assert min(abs(rest - place) for place in places) <= 1
