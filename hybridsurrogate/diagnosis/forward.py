"""Several causes, one after the other: each accepted cause becomes part of "nothing is wrong"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hybridsurrogate.diagnosis.evidence import Search, Weighed, search
from hybridsurrogate.diagnosis.null import null_test
from hybridsurrogate.diagnosis.verdict import leader
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.estimators.problem import Problem
from hybridsurrogate.inference.linearised import Belief


def _ends(cause: Cause) -> bool:
    """Tell whether nothing is searched for beside a cause."""
    # a curve of any shape leaves nothing to name, and beside outliers nothing is in closed form
    return cause.kind == "unexplained" or cause.has_outliers


@dataclass(frozen=True)
class Step:
    """One search, the p-value of the whole of it, and the cause that it chose.

    Attributes
    ----------
    search : Search
    p_value : float
    chosen : Weighed
        The first of ``search.weighed`` where nothing (further) is wrong.
    """

    search: Search
    p_value: float
    chosen: Weighed

    @property
    def found(self) -> bool:
        """Whether a cause was accepted."""
        return self.chosen is not self.search.weighed[0]


def forward_search(
    problem: Problem,
    causes: Sequence[Cause],
    belief: Belief,
    max_causes: int,
    false_alarm_rate: float,
    n_replicates: int | None,
    random_state: np.random.RandomState,
) -> list[Step]:
    """Search, accept the best cause, and search again beside it until nothing more is found.

    Every search has its own replicates, in which the causes accepted so far are true, so that the
    chance of a false cause is controlled at each step. A smooth discrepancy of unknown shape ends
    the search: it leaves nothing to name. So do outliers.

    Parameters
    ----------
    n_replicates : int or None
        None: probabilities alone decide, and no remainder is weighed: quick, for folds.

    Returns
    -------
    list of Step
        At least one; only the last may have found nothing.
    """
    steps: list[Step] = []
    accepted: Weighed | None = None
    while True:
        found = search(problem, causes, belief, n_replicates is not None, accepted)
        p_value = 0.0
        if n_replicates is not None:
            p_value = null_test(found, n_replicates, random_state).p_value
        chosen = found.weighed[0]
        # the p-value guards against noise, the probability against a cause that is no better
        if p_value <= false_alarm_rate and found.probability[0] <= 0.5:
            chosen = found.weighed[leader(found)]
        step = Step(found, p_value, chosen)
        if steps and not step.found:
            return steps
        steps.append(step)
        cause = chosen.cause
        if cause is None or _ends(cause) or len(steps) == max_causes:
            return steps
        effects = (*problem.model.effects, cause)
        problem = replace(problem, model=problem.model.with_effects(effects))
        causes = [other for other in causes if other is not cause]
        accepted = chosen
