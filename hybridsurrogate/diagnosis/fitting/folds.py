"""What an extension gains on held-out rows, the search repeated without them."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

from sklearn.base import clone

from hybridsurrogate.diagnosis.fitting.result import DiagnosisResult
from hybridsurrogate.diagnosis.search.forward_selection import searches
from hybridsurrogate.diagnosis.validation.cross_validation import cross_validated
from hybridsurrogate.diagnosis.validation.folds import folds_beyond, random_folds
from hybridsurrogate.diagnosis.validation.gain import in_one_word
from hybridsurrogate.diagnosis.validation.refit import Pair, Refit
from hybridsurrogate.numerics.threads import one_blas_thread


def with_gain(
    result: DiagnosisResult, cv: int, n_jobs: int | None, progress: bool
) -> DiagnosisResult:
    """Return a result with the gain within the measured range and beyond it.

    Parameters
    ----------
    result : DiagnosisResult
    cv : int
        Folds within the measured range.
    n_jobs : int or None
        Processes that share the folds.
    progress : bool
    """
    before, settings = result.before, result.settings
    X, y = before.measured_
    kinds = in_one_word([cause.kind for cause in result.extension.found_causes])
    refitted = Refit(
        clone(before),
        settings.causes,
        settings.exclude,
        searches(result.steps),
        Pair(before, result.extension.estimator, kinds),
        settings.max_causes,
        settings.false_alarm_rate,
    )
    within = random_folds(len(y), cv, deepcopy(result.fold_random))
    beyond = folds_beyond(before.simulation, X)
    with one_blas_thread():
        gain, out_of_range = cross_validated(
            refitted, within, beyond, result.X, y, n_jobs, progress, result.weights, result.y_err
        )
    return replace(result, gain=gain, gain_out_of_range=out_of_range)
