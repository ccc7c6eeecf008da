"""Several causes, one after the other: each accepted cause becomes part of "nothing is wrong"."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import special

from hybridsurrogate.diagnosis.search.candidate import MIN_PROBABILITY, Candidate, prior_of
from hybridsurrogate.diagnosis.search.context import Fitted, InterruptedSearch, SearchContext
from hybridsurrogate.diagnosis.search.exact_scores import placed_together, scored
from hybridsurrogate.diagnosis.search.null_test import NullTest, evidence_bound, null_test
from hybridsurrogate.diagnosis.search.processes import at_best_noise, with_processes
from hybridsurrogate.diagnosis.search.residuals import check_residuals, has_residual_structure
from hybridsurrogate.diagnosis.search.search import Search, draw_the_same, search
from hybridsurrogate.effects.base import Cause, Nothing
from hybridsurrogate.inference.evidence.grid import make_grid
from hybridsurrogate.inference.evidence.linearised import linearise
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.statistics import EmulatorPosterior
from hybridsurrogate.scoring.scores import COVERAGE_LEVEL

# rows that are searched first where there are at least twice as many: 0.5 to 0.7 of the time of
# 2,500 rows with a cause, 1.2 to 1.3 without one; the same verdicts in 16 data sets of 8 kinds
_N_SAMPLED_ROWS = 1000

# first causes for which second ones are searched: with four 16 pairs have the same outcomes in 1.3
# times the time; with one, in 0.9 times, a step that a saturation led by 0.03 was not found
_FIRST_CAUSES = 2

# causes at most where their number is open: dialyzers need three (measured_data_more.md)
_MOST_CAUSES = 3


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
    max_causes: int | None,
    false_alarm_rate: float,
    n_replicates: int | None,
    random_state: np.random.RandomState,
    nearby: Sequence[Search] = (),
) -> list[SearchStep]:
    """Search, accept the best cause, and search again given it, until nothing more is detected.

    Every search has separate replicates, in which the causes accepted so far are true, so that the
    chance of a false cause is controlled at each step. A smooth discrepancy of unknown shape ends
    the search: it explains all that could be named. Outliers come last: given them all others are
    compared from the start. Where one more cause may follow, a cause is chosen for what it explains
    together with its best second cause: two curves over one input are no curve of the catalogue,
    and either alone is easily beaten by a curve of any shape.

    Parameters
    ----------
    max_causes : int or None
        None: a further one is searched where residual structure remains, up to three.
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
    context = SearchContext.of(problem, emulator)
    test = None if n_replicates is None else (n_replicates, random_state)
    steps = _one_after_the_other(context, causes, max_causes, false_alarm_rate, test, nearby)
    if test is not None:
        steps = _backfitted(steps, causes)
    return _with_correlated_noise(steps, causes)


def _one_after_the_other(
    context: SearchContext,
    causes: Sequence[Cause],
    max_causes: int | None,
    false_alarm_rate: float,
    tested: tuple[int, np.random.RandomState] | None,
    nearby: Sequence[Search],
) -> list[SearchStep]:
    """Return a step for each accepted cause, or one in which nothing was detected."""
    steps: list[SearchStep] = []
    result: Search | None = None
    every = causes
    thorough = tested is not None
    try:
        known = _nearby(context.problem.model, causes, nearby)
        known = known or _in_a_sample(context, causes)
        result = search(context, causes, nearby=known)
        result = with_processes(result, thorough, known if nearby else None)
        while True:
            screened, test = result, None
            if not steps:
                result = at_best_noise(result, thorough)
                result = scored(result, causes)
            if tested is not None:
                # given accepted causes, the evidence keeps their places fixed
                bounds = (1.0,) if steps else (evidence_bound(screened), evidence_bound(result))
                least = 1 / (1 + tested[0])
                if max(bounds) <= least:
                    # no replicates could show less: a quarter of the time of 40 rows, a third of
                    # 4,000
                    test = NullTest(np.nan, np.empty(0), bounds[-1], least)
                else:
                    test = null_test(screened, *tested)._replace(bound=bounds[-1])
            # the p-value guards against noise, the probability against a cause that is no better
            by_chance = test is not None and test.p_value > false_alarm_rate
            if by_chance or result.probability[0] > 0.5:
                return _alone(steps) or [SearchStep(result, test, result.candidates[0], result)]
            chosen, conditional = _first_choice(result), None
            if _is_outliers(chosen) and max_causes != 1:
                found = [*steps, SearchStep(result, test, chosen, result)]
                again = partial(
                    _one_after_the_other,
                    causes=_not_of_single_rows(every),
                    max_causes=max_causes and max_causes - 1,
                    false_alarm_rate=false_alarm_rate,
                    tested=tested,
                    nearby=nearby,
                )
                return _beyond_outliers(context, found, again)
            tried: tuple[Search, ...] = ()
            last = len(steps) + 1 >= (max_causes or _MOST_CAUSES)
            if not last and (max_causes or not _is_enough(result, chosen)):
                chosen, conditional, tried = _look_ahead(result, causes, chosen, thorough, nearby)
            steps.append(SearchStep(result, test, chosen, result, tried))
            if conditional is None:
                return steps
            causes, result = _others(causes, chosen.cause), conditional
    except KeyboardInterrupt as stop:
        kept = steps[0].search if steps else result or getattr(stop, "kept", None)
        raise InterruptedSearch(kept) from stop


def _beyond_outliers(
    context: SearchContext,
    found: Sequence[SearchStep],
    others_in: Callable[[SearchContext], list[SearchStep]],
) -> list[SearchStep]:
    """Return steps of other causes, compared in rows of which none is far off; outliers last.

    A few wild rows hide all else under normal noise, or make it of another kind. The scales of
    rows are those of one fit: with them all other causes are compared from the start. Once more
    with the scales that rows have given these, the same was found in 9 of 9 sets.

    Parameters
    ----------
    context : SearchContext
        Without any cause.
    found : sequence of SearchStep
        Of which the last one chose outliers.
    others_in : callable
        The steps of causes that are not of single rows, of a problem with scaled rows.
    """
    first, problem, outliers = found[0].search, context.problem, found[-1].chosen.cause
    assert outliers is not None
    alone = next(w for w in first.candidates if w.cause is outliers)
    out = list(found)
    if np.isfinite(alone.log_evidence):
        # what was found before has a part of what the wild rows look like
        out = [SearchStep(first, found[0].test, alone, first)]
    steps = others_in(SearchContext.of(_at_scales(problem, out[-1]), context.emulator))
    last = steps[-1].chosen
    if last.cause is None:
        return out
    model = replace(last.fit.model, has_row_noise=problem.model.has_row_noise)
    last = last._replace(fit=last.fit._replace(model=model))
    given = search(context.at(replace(problem, model=model)), [outliers], last)
    if given.probability[0] > 0.5:  # the others explain what looked like outliers
        return steps
    return [*steps, SearchStep(given, found[-1].test, given.candidates[1], given)]


def _at_scales(problem: Problem, step: SearchStep) -> Problem:
    """Return a problem whose rows have the scales that the outliers of a step give them."""
    context, fit = step.conditional.context, step.chosen.fit
    plain = linearise(fit.model, context.problem.X, context.emulator, fit.grid, fit.mode.z).noise
    scaled = context.linearise(fit).noise
    assert scaled is not None
    # errors that are known stay columns of their own
    noise = scaled[fit.mode.node] / (1.0 if plain is None else plain[-1])
    X = problem.X
    if problem.model.has_row_noise:
        X, noise = X[:, :-1], X[:, -1] * noise
    model = replace(problem.model, has_row_noise=True)
    return replace(problem, model=model, X=np.column_stack([X, noise]))


def _in_a_sample(context: SearchContext, causes: Sequence[Cause]) -> Search | None:
    """Return the search in a sample of many rows, None of few: what is far behind there is left."""
    problem = context.problem
    # of one output and normal noise
    plain = problem.working_point is None and problem.stacking is None
    if not plain or len(problem.y) < 2 * _N_SAMPLED_ROWS:
        return None
    # a fixed sample: the search is reproducible
    rows = np.sort(np.random.RandomState(0).choice(len(problem.y), _N_SAMPLED_ROWS, replace=False))
    some = replace(
        problem,
        X=problem.X[rows],
        y=problem.y[rows],
        weights=problem.weights[rows],
        observed=problem.observed[rows],
    )
    return search(SearchContext.of(some, context.emulator), causes)


def _backfitted(steps: Sequence[SearchStep], causes: Sequence[Cause]) -> list[SearchStep]:
    """Return the steps, each cause compared again with all others part of the simulation.

    Alone the first cause also has to explain what the second one does, and a smooth curve may do
    that better than either: how probable each is shows only given the others. A cause is replaced
    where an alternative is more probable, a curve of any shape included, and left out where the
    others explain all of it. A smooth curve or outliers that were accepted last stay out, as
    nothing is compared given them.
    """
    out = dict(enumerate(steps))
    named = [k for k, step in out.items() if not ends_search(step.chosen)]
    if len(named) < 2:
        return list(steps)
    if any(_is_outliers(step.chosen) for step in steps):
        causes = _not_of_single_rows(causes)
    joint = out[named[-1]]
    stale = set(named[:-1])
    for k in named * SETTINGS.alternation_rounds:
        if k not in stale:
            continue
        found = _without(out[k].chosen, joint, causes)
        best = found.candidates[found.leader]
        stale = stale - {k}
        if found.probability[0] > 0.5:
            del out[k]
            named = [one for one in named if one != k]
            stale, joint = set(named), replace(joint, chosen=found.candidates[0], conditional=found)
            continue
        if ends_search(best):
            if found.probability[found.leader] > 0.5:
                # nothing is compared given it: the others stay as they are given the cause
                out[k] = replace(out[k], chosen=best, conditional=found)
                continue
            able = [one for one, w in enumerate(found.candidates) if not ends_search(w)]
            best = found.candidates[max(able, key=lambda one: found.probability[one])]
        if best.cause is not out[k].chosen.cause:
            stale = set(named) - {k}
        joint = out[k] = replace(out[k], chosen=best, conditional=found)
    return list(out.values())


def _without(left_out: Candidate, joint: SearchStep, causes: Sequence[Cause]) -> Search:
    """Search for one cause, all others fixed where they are in the joint fit of all of them."""
    context, fit = joint.conditional.context, joint.chosen.fit
    others = [
        cause
        for cause in fit.model.effects
        if cause is not left_out.cause and not isinstance(cause, Nothing)
    ]
    model, order = fit.model.reordered(others)
    # all places are known: there is no grid to look at
    grid = make_grid(model.with_effects([*others, Nothing()]))
    mode = fit.mode._replace(z=context.places_of(fit)[0][order])
    accepted = Candidate(None, Fitted(model, grid, mode, fit.sigma), 0.0)
    given = context.at(replace(context.problem, model=model))
    return with_processes(search(given, _others(causes, *others), accepted))


def _with_correlated_noise(
    steps: Sequence[SearchStep], causes: Sequence[Cause]
) -> list[SearchStep]:
    """Return the steps and, where the last cause needs correlated noise in addition, one with that.

    It is no further cause of what the simulation misses: a cause that was compared given such noise
    is used together with it.
    """
    last, found = steps[-1].chosen, steps[-1].conditional
    places = [k for k, w in enumerate(found.candidates) if w.cause is last.cause]
    if ends_search(last) or not places or found.correlated[places[0]] <= 0.5:
        return list(steps)
    paths = [cause for cause in causes if cause.is_correlated_noise]
    given = _search_given(found, paths, last)
    return [*steps, SearchStep(given, None, given.candidates[given.leader], given)]


def tested(steps: Sequence[SearchStep]) -> list[SearchStep]:
    """Return the steps with a cause, without noise that the last one needs in addition."""
    return [step for step in steps if step.is_accepted and step.test is not None]


def searches(steps: Sequence[SearchStep]) -> list[Search]:
    """Return every search of a forward search, the first one first."""
    return [steps[0].search, *(one for step in steps for one in step.tried)]


def _nearby(
    model: MeasuredModel, causes: Sequence[Cause], searches: Sequence[Search]
) -> Search | None:
    """Return the search over the same causes in other rows, None without one."""
    return next((one for s in searches if (one := s.over(model, causes)) is not None), None)


def _first_choice(result: Search) -> Candidate:
    """Return the most probable cause; a prior that is too narrow before its like.

    A factor on the output, for example, may draw the same curve as a parameter beyond its prior.
    The data cannot separate the two, and the prior is looked at first.
    """
    first = result.candidates[result.leader]
    for w, probability in zip(result.candidates[1:], result.probability[1:], strict=True):
        assert w.cause is not None
        likely = w.cause.concerns == "prior" and probability > MIN_PROBABILITY
        if likely and w is not first and draw_the_same(result, first, w):
            return w
    return first


def _is_enough(result: Search, chosen: Candidate) -> bool:
    """Return whether a cause leaves no residual structure, and is no curve of any shape."""
    assert chosen.cause is not None
    if chosen.cause.is_smooth_curve:
        return False
    if chosen.cause.is_correlated_noise:
        return True
    at = next(k for k, w in enumerate(result.candidates) if w is chosen)
    # such noise imitates a second cause
    imitated = result.correlated[at] > 0.5
    check = check_residuals(result, chosen)
    return not imitated and not has_residual_structure(result, chosen, check)


def _alone(steps: list[SearchStep]) -> list[SearchStep]:
    """Return the steps; a single one has the most probable cause, without a second cause."""
    if len(steps) != 1:
        return steps
    return [replace(steps[0], chosen=_first_choice(steps[0].search))]


def _search_given(
    result: Search, causes: Sequence[Cause], first: Candidate, nearby: Sequence[Search] = ()
) -> Search:
    """Return the quick search for a cause given a first one, which is fixed at its fit."""
    model = first.fit.model
    given = result.context.at(replace(result.problem, model=model))
    # a second cause may be noise itself: nothing is compared given a process
    return search(given, causes, first, _nearby(model, causes, nearby))


def _look_ahead(
    result: Search,
    causes: Sequence[Cause],
    first_choice: Candidate,
    thorough: bool,
    nearby: Sequence[Search],
) -> tuple[Candidate, Search | None, tuple[Search, ...]]:
    """Return the cause that explains most together with a second one, and the search given it.

    And every search that was made. No search where nothing can be named in addition to the cause:
    a smooth discrepancy, or outliers.
    """
    log_prior = np.log(prior_of(result.candidates))
    at = next(k for k, w in enumerate(result.candidates) if w is first_choice)
    # the most probable, then what explains most without a process: the second may be one
    explained = log_prior + [w.log_evidence for w in result.candidates]
    order = [at, *(int(k) for k in np.argsort(-explained) if k != at)]
    named = [k for k in order if not ends_search(result.candidates[k])]
    position = {id(result.candidates[k].cause): k for k in named}
    # the leading cause alone where it has its credible set for itself
    is_alone = np.max(result.probability[named], initial=0.0) > COVERAGE_LEVEL
    waiting = named[: 1 if is_alone else _FIRST_CAUSES]
    made: dict[int, Search] = {}
    values: dict[int, float] = {}
    while waiting:
        k = waiting.pop(0)
        first = result.candidates[k]
        second = _search_given(result, _others(causes, first.cause), first, nearby)
        alone = log_prior[k] + first.log_evidence
        # where all is explained, there is nothing to place in addition to the first
        within = max(values.values(), default=-np.inf) - SETTINGS.max_behind
        if second.probability[0] < 0.5 and alone + _evidence_of_others(second) > within:
            known = _nearby(second.problem.model, _others(causes, first.cause), nearby)
            second = placed_together(result, first, second, known)
        made[k], values[k] = second, alone + _evidence_of_others(second)
        # the other half of the best pair has its turn as the first, until none is new
        best = max(values, key=lambda k: values[k])
        other = position.get(id(_second(made[best]).cause))
        if not waiting and other is not None and other not in made:
            waiting = [other]
    tried = tuple(made.values())
    if not values:
        return first_choice, None, tried
    if ends_search(first_choice) and log_prior[at] + first_choice.log_evidence > values[best]:
        return first_choice, None, tried
    # of two that name each other, the one that explains more alone comes first
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
    odds = prior_of(conditional.candidates)
    # two causes are the same two in either order, and each order has this prior
    odds[1:] *= 2
    return float(special.logsumexp(evidence - evidence[0] + np.log(odds)))


def _second(conditional: Search) -> Candidate:
    """Return the most probable second cause, "none" included."""
    return conditional.candidates[int(np.argmax(conditional.probability))]


def _others(causes: Sequence[Cause], *accepted: Cause | None) -> list[Cause]:
    """Return the causes that may be found given accepted ones."""
    given = [cause for cause in accepted if cause is not None]
    return [c for c in causes if not any(c is one or _share_a_curve(c, one) for one in given)]


def _share_a_curve(one: Cause, other: Cause) -> bool:
    """Return whether two causes are sums of fixed curves over one column, such as a line in both.

    A viscous friction of 204 became -7683, and 7882 of a parabola.
    """
    fixed = (c.coefficients and not c.parameters and not c.is_process for c in (one, other))
    return (one.kind, one.target) == (other.kind, other.target) and all(fixed)


def _not_of_single_rows(causes: Sequence[Cause]) -> list[Cause]:
    return [c for c in causes if not ("outliers" in c.acts_on or c.concerns == "data")]


def _is_outliers(candidate: Candidate) -> bool:
    return candidate.cause is not None and "outliers" in candidate.cause.acts_on


def ends_search(candidate: Candidate) -> bool:
    """Return whether nothing is searched for in addition to a cause."""
    cause = candidate.cause
    if cause is None or _is_outliers(candidate):  # scales of rows are of one fit
        return True
    # a curve or path of any shape explains all else, a parameter that differs does not
    return cause.is_process and cause.hierarchy is None
