"""The model after, and what it says about the causes."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

from numpy.typing import ArrayLike

from hybridsurrogate.diagnosis.answers.discrepancy import estimate_discrepancies
from hybridsurrogate.diagnosis.answers.finding import finding_of
from hybridsurrogate.diagnosis.checks.identifiability import (
    confounded,
    confounding,
    sentences_on_parameters,
)
from hybridsurrogate.diagnosis.fitting.result import Conclusion, Extension
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep
from hybridsurrogate.diagnosis.validation.beta_scan import BetaScans
from hybridsurrogate.diagnosis.validation.refit import (
    accepted,
    extended_estimator,
    extended_simulator,
)
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.estimators.averaged import AveragedSurrogate, leading
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate, as_causes
from hybridsurrogate.exceptions import ConfoundingWarning
from hybridsurrogate.inference.prior_ends import AtPriorEnd, at_prior_ends
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.types import FloatArray


def extend(
    before: Any,
    steps: Sequence[SearchStep],
    conclusion: Conclusion,
    kept: tuple[ArrayLike, ArrayLike],
    weights: FloatArray | None,
    y_err: FloatArray | None,
    n_jobs: int | None,
) -> Extension:
    """Return the model after, with a `ConfoundingWarning` of what the data cannot separate.

    Parameters
    ----------
    before : PowerScaledSurrogate
        Fitted.
    steps : sequence of SearchStep
    conclusion : Conclusion
    kept : (X, y)
        A copy of what was measured, for later scans over the weight.
    weights : ndarray of shape (n,) or None
    y_err : ndarray of the shape of y, or None
    n_jobs : int or None
        For these scans.
    """
    causes, search = accepted(steps), steps[0].search
    after = extended_estimator(before, steps)
    found = leading(after)
    outputs, first = before.simulation.outputs, steps[0].chosen.cause
    bands = dict(zip(outputs, estimate_discrepancies(search, first), strict=True))
    known = found.posterior_.model.effects[: len(as_causes(before.effects))]
    simulator = extended_simulator(before.simulation.simulator, (*known, *causes), search.problem)
    table = confounding(before, found, before.data_.single.X)
    for sentence in sentences_on_parameters(confounded(table)):
        warnings.warn(sentence, ConfoundingWarning, stacklevel=4)
    return Extension(
        estimator=after,
        simulator=simulator,
        found_causes=tuple(
            finding_of(step, len(known) + k, found.posterior_, () if k else conclusion.same_curve)
            for k, step in enumerate(steps)
        ),
        discrepancies=bands,
        discrepancy=bands[(first and first.output) or outputs[0]],
        confounded=table,
        at_prior_end=_at_prior_end(causes, before, found, conclusion.verdict),
        beta_scans=BetaScans((before, found), *kept, n_jobs, weights, y_err),
    )


def posteriors_of_mean(
    before: Any,
    after: PowerScaledSurrogate | AveragedSurrogate,
    steps: Sequence[SearchStep],
) -> list[Posterior]:
    """Return the posterior before and, where the cause is in the mean, that after."""
    causes = accepted(steps)
    of_any_shape = any(cause.is_process for cause in causes)
    found = [] if of_any_shape or not causes else [leading(after).posterior_]
    return [before.posterior_, *found]


def _at_prior_end(
    causes: Sequence[Cause],
    before: Any,
    found: PowerScaledSurrogate,
    verdict: str,
) -> tuple[AtPriorEnd, ...]:
    """Return what is at an end of its prior in the extended model, else in the calibrated."""
    replaced = {cause.replaces for cause in causes}
    first = at_prior_ends(before.posterior_) if verdict == "undecided" else []
    every = {one.name: one for one in (*first, *at_prior_ends(found.posterior_))}
    return tuple(one for name, one in every.items() if name not in replaced)
