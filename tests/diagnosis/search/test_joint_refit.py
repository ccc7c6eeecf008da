"""Two causes, of which the first stands a little off its place without the second."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.exact_scores import movable, placed_together
from hybridsurrogate.diagnosis.search.null_test import null_test
from hybridsurrogate.diagnosis.search.search import Search, search
from hybridsurrogate.diagnosis.search.setup import prepare, trained_emulator

PERIOD, LOCATION = 40.0, 43.0


def found_in(y_of, kinds, seed=1):
    """Search these kinds alone, in a simulation that is a straight line, and beside the first."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0, 80, 80))
    simulator = hs.Simulator(
        lambda t, slope: slope * t, inputs={"t": (0, 80)}, parameters={"slope": norm(1, 0.1)}
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=20, random_state=0
    ).fit(t[:, None], t + y_of(t) + rng.normal(size=80))
    prepared = prepare(model, ())
    problem, emulator = trained_emulator(prepared.problem, model)
    causes = [next(c for c in prepared.causes if c.kind == kind) for kind in kinds]
    found = search(SearchContext.of(problem, emulator), causes)
    first = found.candidates[1]
    extended = replace(found.problem, model=first.fit.model)
    return found, first, search(found.context.at(extended), causes[1:], first)


def wave_and_step(t):
    return 3.5 * np.sin(2 * np.pi * t / PERIOD) + 4 * (t > LOCATION)


@pytest.fixture(scope="module")
def pair() -> tuple[Search, Candidate, Search]:
    return found_in(wave_and_step, ("periodic", "step"))


def place(candidate, owner):
    model, _, mode, _ = candidate.fit
    at = next(k for k, (effect, _) in enumerate(model.theta_names) if effect == owner)
    return model.values(mode.z[None])[0, model.n_parameters + at]


def test_first_cause_moves_to_its_place_beside_the_second(pair):
    found, first, conditional = pair
    together = placed_together(found, first, conditional)
    alone, after = place(conditional.candidates[0], 0), place(together.candidates[1], 0)
    assert abs(after - PERIOD) < 0.5 * abs(alone - PERIOD)
    assert together.candidates[1].log_evidence > conditional.candidates[1].log_evidence + 1
    # what is compared with stays: nothing further
    assert together.candidates[0] is conditional.candidates[0]
    np.testing.assert_allclose(together.probability.sum(), 1)


def test_evidence_of_two_causes_does_not_depend_on_which_is_first():
    def both(kinds):
        found, first, conditional = found_in(
            lambda t: 3 * np.sin(2 * np.pi * t / 13) + 4 * (t > LOCATION), kinds
        )
        none, second = placed_together(found, first, conditional).candidates
        held = conditional.candidates[1].log_evidence
        return first.log_evidence + np.array([second.log_evidence, held]) - none.log_evidence

    one, other = both(("step", "periodic")), both(("periodic", "step"))
    assert abs(one[0] - other[0]) < 0.5
    # held where they were found alone, they are worth very different things
    assert abs(one[1] - other[1]) > 3


def test_nothing_further_is_no_worse_than_the_accepted_cause(pair):
    _, first, conditional = pair
    null = conditional.context.nothing_further(first.fit)
    assert null.mode.squares < 1.05 * first.fit.mode.squares


def test_null_test_lets_the_first_cause_give_way(pair):
    found, first, conditional = pair
    together = placed_together(found, first, conditional)
    assert null_test(together, 99, np.random.RandomState(0)).p_value <= 0.05


def test_noise_has_no_place_to_move_to():
    assert movable(hs.Step("t"))
    assert not movable(hs.Noise("t"))
