"""Several causes: how probable each is beside the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from few_kinds import all_but
from hidden_effects.several import make_several

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.forward_selection import _alone

T = np.linspace(0, 10, 80)
PARAMETERS = {
    "a": hs.truncated_normal(5, 1, 1, 9),
    "k": hs.truncated_normal(0.3, 0.1, 0.05, 0.8),
}


def decay(t, a, k):
    return a * np.exp(-k * t)


def decay_with_wave(t, a, k):
    return decay(t, a, k) + 0.4 * np.sin(2 * np.pi * t / 2.5)


def diagnosed(function, max_causes, **settings):
    rng = np.random.default_rng(3)
    y = decay_with_wave(T, 4.6, 0.33) + 0.9 * (T > 6) + 0.2 * rng.standard_normal(80)
    simulator = hs.Simulator(function, inputs={"t": (0, 10)}, parameters=PARAMETERS)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    settings |= {"cv": None, "max_causes": max_causes, "random_state": 0}
    return hs.DiscrepancyDiagnosis(model, **settings).fit(T[:, None], y)


@pytest.fixture(scope="module")
def both():
    return diagnosed(decay, None)


@pytest.mark.slow
def test_a_cause_is_weighed_beside_the_other(both):
    """Alone the jump is beaten by a smooth curve, which draws the wave as well."""
    assert [found.kind for found in both.found_causes_] == ["step", "periodic"]
    alone = [w.kind for w in both.search_.candidates]
    assert both.search_.probability[alone.index("unexplained")] > 0.9
    assert both.verdict_ == "named"
    assert both.indistinguishable_ == ["step"]
    assert both.best_cause_.probability > 0.9
    # it is as probable as for someone who knows the wave
    known = diagnosed(decay_with_wave, 1)
    evidence, direct = (
        d.causes_.drop_duplicates("kind").set_index("kind")["log_evidence"] for d in (both, known)
    )
    for kind in ("step", "bump", "ramp", "unexplained"):
        assert evidence[kind] == pytest.approx(direct[kind], abs=3), kind


@pytest.mark.slow
def test_the_report_tells_of_it(both):
    text = " ".join(str(both.report(full=True)).split())
    assert "step in t has 99" in text
    assert "The table is about the first cause, conditional on the others" in text
    assert "leave open how" not in text


@pytest.mark.slow
def test_a_cause_gives_way_to_one_that_is_better_beside_the_other():
    """A trend was taken for a ramp as long as the other column was not known."""
    case = make_several("trend+missing-input", 2.0, 2144293775, 80)
    model = hs.PowerScaledSurrogate(
        case.simulator, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    found = hs.DiscrepancyDiagnosis(model, cv=None, max_causes=2, random_state=0)
    found.fit(case.X, case.y)
    assert {cause.kind for cause in found.found_causes_} == {"trend", "missing-input"}
    first = found.result_.steps[0]
    assert first.search.candidates[first.search.leader].kind != "trend"
    for step, told in zip(found.result_.steps, found.found_causes_, strict=True):
        best = step.conditional.candidates[step.conditional.leader]
        assert best.kind == told.kind


def test_what_was_chosen_for_its_companion_needs_it():
    """Where no companion is accepted the cause that explains most on its own is chosen."""
    few = all_but("step", "periodic", "trend")
    one = diagnosed(decay, 1, exclude=few, n_replicates=20)
    found = one.search_
    other = found.candidates[1 if found.leader != 1 else 0]
    step = replace(one.result_.steps[0], chosen=other, conditional=found)
    assert _alone([step])[0].chosen is found.candidates[found.leader]
    assert _alone([step, step])[0].chosen is other
