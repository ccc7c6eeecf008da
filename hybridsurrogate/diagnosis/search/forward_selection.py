"""Several causes, one after the other: each accepted cause becomes part of "nothing is wrong"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from hybridsurrogate.diagnosis.search.evidence import (
    Candidate,
    Search,
    leader,
    prior_odds,
    search,
    with_processes,
)
from hybridsurrogate.diagnosis.search.exact_scores import scored, screened_at_best
from hybridsurrogate.diagnosis.search.joint_refit import placed_together
from hybridsurrogate.diagnosis.search.local_fit import InterruptedSearch
from hybridsurrogate.diagnosis.search.local_prediction import draw_the_same
from hybridsurrogate.diagnosis.search.noise_of_outputs import at_best_noise
from hybridsurrogate.diagnosis.search.null_test import NullTest, evidence_bound, null_test
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.statistics import EmulatorPosterior

# probability of a cause that may be meant
_LIKELY = 0.01


@dataclass(frozen=True)
class SearchStep:
    """One search, the test of the whole of it, and the cause that it chose.

    Attributes
    ----------
    search : Search
    test : NullTest or None
        None: probabilities alone decided.
    chosen : Candidate
        The first of ``search.candidates`` where nothing (further) is wrong.
    conditional : Search
        The search given all other accepted causes, the later ones too.
    tried : tuple of Search
        The searches for a second cause given this one and given others in its place.
    """

    search: Search
    test: NullTest | None
    chosen: Candidate
    conditional: Search
    tried: tuple[Search, ...] = ()

    def __repr__(self) -> str:
        test = "" if self.test is None else f", p = {self.test.p_value:.3g}"
        return f"SearchStep(chosen={self.chosen!r}{test}, search={self.search!r})"

    @property
    def is_accepted(self) -> bool:
        """Whether a cause was accepted."""
        return self.chosen is not self.search.candidates[0]


def forward_search(
    problem: Problem,
    causes: Sequence[Cause],
    emulator: EmulatorPosterior,
    max_causes: int,
    false_alarm_rate: float,
    n_replicates: int | None,
    random_state: np.random.RandomState,
    nearby: Sequence[Search] = (),
) -> list[SearchStep]:
    """Search, accept the best cause, and search again given it, until nothing more is detected.

    Every search has separate replicates, in which the causes accepted so far are true, so that the
    chance of a false cause is controlled at each step. A smooth discrepancy of unknown shape ends
    the search: it explains all that could be named. So do outliers. Where one more cause may
    follow, a cause is chosen for what it explains together with its best second cause: two curves
    over one input are no curve of the catalogue, and either alone is easily beaten by a curve of
    any shape.

    Parameters
    ----------
    n_replicates : int or None
        None: probabilities alone decide, and no remainder is compared: quick, for folds.
    nearby : sequence of Search
        Searches in other rows of the same data: starting points for those of these rows given the
        same accepted causes.

    Returns
    -------
    list of SearchStep
        At least one; only the last may have detected nothing.

    Raises
    ------
    InterruptedSearch
        On an interrupt: it contains the first search, as far as it came.
    """
    steps: list[SearchStep] = []
    result: Search | None = None
    thorough = n_replicates is not None
    try:
        known = _given_same(problem.model.effects, nearby)
        result = search(problem, causes, emulator, thorough, nearby=known)
        while True:
            test = None
            if n_replicates is not None:
                # where nothing may be detected, how large a fault would have shown is asked next
                in_doubt = not steps and evidence_bound(result) > false_alarm_rate
                test = null_test(result, n_replicates, random_state, in_doubt)
            if not steps:
                result = at_best_noise(result, thorough)
                result = scored(screened_at_best(result, causes, emulator))
                problem = result.problem
                # given accepted causes, the evidence keeps their places fixed
                if test is not None:
                    test = test._replace(bound=evidence_bound(result))
            # the p-value guards against noise, the probability against a cause that is no better
            by_chance = test is not None and test.p_value > false_alarm_rate
            if by_chance or result.probability[0] > 0.5:
                return _alone(steps) or [SearchStep(result, test, result.candidates[0], result)]
            chosen, conditional = _first_choice(result), None
            tried: tuple[Search, ...] = ()
            if len(steps) + 1 < max_causes:
                chosen, conditional, tried = _look_ahead(
                    problem, causes, emulator, result, chosen, thorough, nearby
                )
            steps.append(SearchStep(result, test, chosen, result, tried))
            if conditional is None:
                return steps
            problem, causes, result = conditional.problem, _others(causes, chosen), conditional
    except KeyboardInterrupt as stop:
        kept = steps[0].search if steps else result or getattr(stop, "kept", None)
        raise InterruptedSearch(kept) from stop


def with_correlated_noise(
    steps: Sequence[SearchStep], causes: Sequence[Cause], emulator: EmulatorPosterior
) -> list[SearchStep]:
    """Return the steps and, where the last cause needs correlated noise in addition, one with that.

    It is no further cause of what the simulation misses: a cause that was compared given such noise
    is used together with it.

    Parameters
    ----------
    steps : sequence of SearchStep
    causes : sequence of Cause
        All that were compared in the first search.
    emulator : EmulatorPosterior
    """
    last, found = steps[-1].chosen, steps[-1].conditional
    place = next((k for k, w in enumerate(found.candidates) if w is last), None)
    if ends_search(last) or place is None or found.correlated[place] <= 0.5:
        return list(steps)
    paths = [cause for cause in causes if cause.is_correlated_noise]
    given = _search_given(found.problem, paths, emulator, last)
    return [*steps, SearchStep(given, None, given.candidates[leader(given)], given)]


def searches(steps: Sequence[SearchStep]) -> list[Search]:
    """Return every search of a forward search, the first one first."""
    return [steps[0].search, *(one for step in steps for one in step.tried)]


def _given_same(accepted: Sequence[Cause], nearby: Sequence[Search]) -> Search | None:
    """Return the search given the same accepted causes, None without one."""

    def forms(causes: Sequence[Cause]) -> list[tuple[str, str]]:
        return [(cause.name, cause.variant) for cause in causes]

    same = (one for one in nearby if forms(one.problem.model.effects) == forms(accepted))
    return next(same, None)


def _first_choice(result: Search) -> Candidate:
    """Return the most probable cause; a prior that is too narrow before its like.

    A factor on the output, for example, may draw the same curve as a parameter beyond its prior.
    The data cannot separate the two, and the prior is looked at first.
    """
    first = result.candidates[leader(result)]
    for w, probability in zip(result.candidates[1:], result.probability[1:], strict=True):
        assert w.cause is not None
        likely = w.cause.concerns == "prior" and probability > _LIKELY
        if likely and w is not first and draw_the_same(result, first, w):
            return w
    return first


def _alone(steps: list[SearchStep]) -> list[SearchStep]:
    """Return the steps; a single one has the most probable cause alone."""
    if len(steps) != 1:
        return steps
    result = steps[0].search
    return [replace(steps[0], chosen=_first_choice(result))]


def _search_given(
    problem: Problem,
    causes: Sequence[Cause],
    emulator: EmulatorPosterior,
    first: Candidate,
    nearby: Sequence[Search] = (),
) -> Search:
    """Return the quick search for a cause given a first one, which is fixed at its fit."""
    effects = first.model.effects
    extended = replace(problem, model=problem.model.with_effects(effects))
    return search(extended, causes, emulator, False, first, _given_same(effects, nearby))


def _look_ahead(
    problem: Problem,
    causes: Sequence[Cause],
    emulator: EmulatorPosterior,
    result: Search,
    first_choice: Candidate,
    thorough: bool,
    nearby: Sequence[Search],
) -> tuple[Candidate, Search | None, tuple[Search, ...]]:
    """Return the cause that explains most together with a second one, and the search given it.

    And every search that was made. No search where nothing can be named in addition to the cause:
    a smooth discrepancy, or outliers.
    """
    log_prior = np.log(prior_odds([w.cause for w in result.candidates]))
    at = next(k for k, w in enumerate(result.candidates) if w is first_choice)
    # the most probable, then what explains most without a process: the second may be one
    explained = log_prior + [w.log_evidence for w in result.candidates]
    order = [at, *(int(k) for k in np.argsort(-explained) if k != at)]
    named = [k for k in order if not ends_search(result.candidates[k])]
    position = {id(result.candidates[k].cause): k for k in named}
    waiting = named[: SETTINGS.looked_ahead]
    if (
        not ends_search(first_choice)
        and result.probability[at] > SETTINGS.beyond_doubt
        and result.remainder[at] < 0.5
        # such noise imitates a second cause
        and result.correlated[at] < 0.5
    ):
        waiting = [at]
    in_doubt = len(waiting) > 1
    made: dict[int, Search] = {}
    values: dict[int, float] = {}
    while waiting:
        k = waiting.pop(0)
        first = result.candidates[k]
        second = _search_given(problem, _others(causes, first), emulator, first, nearby)
        alone = log_prior[k] + first.log_evidence
        # where all is explained, there is nothing to place in addition to the first
        left = in_doubt or second.probability[0] < 0.5
        within = max(values.values(), default=-np.inf) - SETTINGS.pair_pruned
        if left and alone + _evidence_of_others(second) > within:
            second = placed_together(result, first, second)
        made[k], values[k] = second, alone + _evidence_of_others(second)
        if not waiting:
            # the other half of the best pair has its turn as the first, until none is new
            best = max(values, key=lambda k: values[k])
            other = position.get(id(_second(made[best]).cause))
            waiting = [other] if other is not None and other not in made else []
    tried = tuple(made.values())
    if not values:
        return first_choice, None, tried
    best = max(values, key=lambda k: values[k])
    if ends_search(first_choice) and log_prior[at] + first_choice.log_evidence > values[best]:
        return first_choice, None, tried
    # of two that name each other, the one that explains more alone comes first
    other = position.get(id(_second(made[best]).cause))
    if other in made and _second(made[other]).cause is result.candidates[best].cause:
        best = max(best, other, key=lambda k: result.probability[k])
    last = _second(made[best])
    if last.cause is not None and ends_search(last) and best != at:
        # nothing is compared given a process: the first cause is the best of the table without it
        if at not in made:
            return first_choice, None, tried
        best = at
    chosen = made[best]
    return result.candidates[best], scored(with_processes(chosen, thorough)), tried


def _evidence_of_others(conditional: Search) -> float:
    """Return the log of how much better a cause explains with whatever second, or none."""
    evidence = np.array([w.log_evidence for w in conditional.candidates])
    odds = prior_odds([w.cause for w in conditional.candidates])
    # two causes are the same two in either order, and each order has this prior
    odds[1:] *= 2
    return float(special.logsumexp(evidence - evidence[0] + np.log(odds)))


def _second(conditional: Search) -> Candidate:
    """Return the most probable second cause, "none" included."""
    return conditional.candidates[int(np.argmax(conditional.probability))]


def _others(causes: Sequence[Cause], chosen: Candidate) -> list[Cause]:
    return [cause for cause in causes if cause is not chosen.cause]


def ends_search(candidate: Candidate) -> bool:
    """Return whether nothing is searched for in addition to a cause."""
    cause = candidate.cause
    if cause is None or "outliers" in cause.acts_on:  # with outliers there is no closed form
        return True
    # a curve or path of any shape explains all else, a parameter that differs does not
    return cause.is_process and cause.hierarchy is None
