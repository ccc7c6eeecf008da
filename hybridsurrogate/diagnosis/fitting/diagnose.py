"""From measured rows to all that is found on them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from copy import deepcopy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from joblib import parallel_config
from numpy.typing import ArrayLike
from sklearn.base import clone

from hybridsurrogate.diagnosis.answers.discrepancy import estimate_discrepancies
from hybridsurrogate.diagnosis.answers.experimental_design import NextMeasurement, next_measurement
from hybridsurrogate.diagnosis.answers.finding import cause_table, finding_of, not_reached
from hybridsurrogate.diagnosis.checks.caution import Caution, warn_of
from hybridsurrogate.diagnosis.checks.columns import doubtful_columns
from hybridsurrogate.diagnosis.checks.data import (
    cautions_of_dispersion,
    cautions_of_rounding,
    check_digits,
    copied_rows,
    exact,
    is_exact,
)
from hybridsurrogate.diagnosis.checks.parameters import (
    check_each_output,
    check_rows,
    confounded,
    confounding,
    sentences_on_parameters,
)
from hybridsurrogate.diagnosis.checks.simulation import check_emulator, warn_if_rough, warn_if_slow
from hybridsurrogate.diagnosis.fitting.result import (
    Conclusion,
    DiagnosisResult,
    Extension,
    Settings,
)
from hybridsurrogate.diagnosis.fitting.verdict import concluded, contradicted
from hybridsurrogate.diagnosis.search.context import InterruptedSearch, blurred, on_working_rows
from hybridsurrogate.diagnosis.search.forward_selection import (
    SearchStep,
    forward_search,
    searches,
)
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.diagnosis.search.setup import Prepared, prepare, trained_emulator
from hybridsurrogate.diagnosis.validation.beta_scan import BetaScans
from hybridsurrogate.diagnosis.validation.cross_validation import (
    cross_validated,
    folds_beyond,
    random_folds,
)
from hybridsurrogate.diagnosis.validation.gain import in_one_word
from hybridsurrogate.diagnosis.validation.refit import (
    Pair,
    Refit,
    accepted,
    extended_estimator,
    extended_simulator,
)
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.estimators.averaged import AveragedSurrogate, leading
from hybridsurrogate.estimators.emulation import as_given
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate, as_causes
from hybridsurrogate.exceptions import ConfoundingWarning
from hybridsurrogate.inference.procedure import AtPriorEnd, at_prior_ends
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.statistics import EmulatorPosterior
from hybridsurrogate.notebook import doing
from hybridsurrogate.numerics.linear_algebra import one_blas_thread
from hybridsurrogate.types import FloatArray


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


class InterruptedDiagnosis(KeyboardInterrupt):
    """An interrupt on its way out, with what had been compared when it came.

    Attributes
    ----------
    search : Search or None
        The first search, as far as it came; None where nothing was compared.
    causes : pandas.DataFrame or None
        Its table of causes.
    sentence : str
        What a warning says of it.
    """

    def __init__(self, search: Search | None, causes: pd.DataFrame | None, n_causes: int) -> None:
        super().__init__("the diagnosis was interrupted")
        n = 0 if search is None else len(search.candidates) - 1
        self.search, self.causes = search, causes
        self.sentence = (
            f"The diagnosis was interrupted: {n} of {n_causes} causes had been compared"
            f"{', and causes_ lists them' if n else ''}. There is no gain, and no report."
        )


class Compared(NamedTuple):
    """All causes compared.

    Attributes
    ----------
    steps : list of SearchStep
    emulator : EmulatorPosterior
        Given the runs alone.
    doubts : list of Caution
        Of the data, from the first search.
    """

    steps: list[SearchStep]
    emulator: EmulatorPosterior
    doubts: list[Caution]


def diagnose(
    estimator: PowerScaledSurrogate | None,
    X: ArrayLike,
    y: ArrayLike,
    weights: FloatArray | None,
    y_err: Any,
    settings: Settings,
    random: np.random.RandomState,
) -> DiagnosisResult:
    """Return all that is found on measured rows, but for the gain: prepare, compare, extend.

    Its warnings are those of the caller of ``fit``, which calls this.

    Parameters
    ----------
    estimator : PowerScaledSurrogate
        Not fitted.
    X, y : array-like of shape (n, n_columns), (n,) or (n, n_outputs)
        Without gaps.
    weights : ndarray of shape (n,) or None
    y_err : array-like of the shape of y, or None
    settings : Settings
    random : RandomState

    Raises
    ------
    InterruptedDiagnosis
        On an interrupt once causes are being compared.
    """
    before = fitted_before(estimator, X, y, weights, y_err, settings.n_jobs)
    prepared = prepare(before, settings.causes, settings.exclude, settings.max_causes)
    prepared.warn()
    cautions = checked(prepared, before)
    warn_if_slow(prepared.problem, settings.cv)
    warn_if_rough(prepared.problem)
    search: Search | None = None
    causes: pd.DataFrame | None = None
    try:
        with one_blas_thread(), doing("Search", settings.progress):
            compared = compare(prepared, before, settings, random)
            search = compared.steps[0].search
            check = check_emulator(search, prepared.problem.model.basis, before.data_.simulation)
            if check is not None:
                cautions += check.cautions(before.surrogate_)
            steps = compared.steps
            causes = cause_table(steps[0].conditional, prepared.skipped)
            conclusion, doubts = concluded(
                steps, before, prepared.problem, check, compared.doubts, settings
            )
            cautions += doubts
            asked, place = _asked(steps, before)
            rows = deepcopy((X, y))
            extension = extend(
                before, steps, conclusion, rows, weights, before.data_.y_err, settings.n_jobs
            )
        known = as_causes(before.effects)
        cautions += contradicted(leading(extension.estimator).posterior_, known)
        posteriors = posteriors_of_mean(before, extension.estimator, steps)
        cautions += cautions_of_dispersion(prepared.problem, posteriors)
        cautions += cautions_of_rounding(before.likelihood_, check)
    except KeyboardInterrupt as stop:
        raise _interrupted(stop, search, causes, prepared) from stop
    finally:
        warn_of(cautions, stacklevel=4)
    return DiagnosisResult(
        settings=settings,
        X=rows[0],
        y=rows[1],
        weights=weights,
        y_err=before.data_.y_err,
        fold_random=deepcopy(random),
        before=before,
        steps=tuple(steps),
        causes=causes,
        indistinguishable=tuple(steps[0].conditional.credible_kinds),
        asked=asked,
        next_measurement=place,
        emulator_check=check,
        conclusion=conclusion,
        extension=extension,
        cautions=tuple(cautions),
    )


def fitted_before(
    estimator: PowerScaledSurrogate | None,
    X: ArrayLike,
    y: ArrayLike,
    weights: FloatArray | None,
    y_err: Any,
    n_jobs: int | None,
) -> Any:
    """Return the model before, fitted; where its fit makes runs, processes share them."""
    with nullcontext() if n_jobs is None else parallel_config(n_jobs=n_jobs):
        before = as_given(clone(estimator).fit(X, y, weights, y_err))
    check_each_output(before.measured_[1], before.simulation.outputs)
    return before


def checked(prepared: Prepared, before: Any) -> list[Caution]:
    """Return what makes measured rows doubtful; raise where they serve no diagnosis."""
    problem = prepared.problem
    model = problem.model
    check_rows(len(problem.y), model.columns, [*model.parameters, *model.constants])
    check_digits(problem)
    ranges = before.data_.simulation.input_ranges
    return [*copied_rows(problem.X, problem.y), *doubtful_columns(problem, ranges)]


def compare(
    prepared: Prepared,
    before: Any,
    settings: Settings,
    random: np.random.RandomState,
) -> Compared:
    """Return all causes compared, one search after the other.

    Parameters
    ----------
    prepared : Prepared
    before : PowerScaledSurrogate
    settings : Settings
    random : RandomState
    """
    problem, emulator = trained_emulator(prepared.problem, before)
    problem = on_working_rows(problem, before.posterior_)
    doubts: list[Caution] = []
    limits = settings.max_causes, settings.false_alarm_rate, settings.n_replicates
    steps = forward_search(problem, prepared.causes, emulator, *limits, random)
    if is_exact(steps[0].search):
        steps = forward_search(blurred(problem), prepared.causes, emulator, *limits, random)
        doubts = exact(steps[0].search)
    return Compared(steps, emulator, doubts)


def _asked(steps: Sequence[SearchStep], before: Any) -> tuple[Search, NextMeasurement]:
    """Return the search about which one more measurement informs most, and where that is."""
    ranges = before.data_.simulation.input_ranges
    places = [next_measurement(step.conditional, ranges) for step in steps]
    most = max(range(len(steps)), key=lambda k: places[k].information)
    return steps[most].conditional, places[most]


def _interrupted(
    stop: KeyboardInterrupt,
    search: Search | None,
    causes: pd.DataFrame | None,
    prepared: Prepared,
) -> InterruptedDiagnosis:
    """Return an interrupt with what had been compared by then."""
    if search is None and isinstance(stop, InterruptedSearch):
        search = stop.kept or None
    if search is not None and causes is None:
        left = not_reached(search, prepared.causes)
        causes = cause_table(search, [*left, *prepared.skipped])
    return InterruptedDiagnosis(search, causes, len(prepared.causes))
