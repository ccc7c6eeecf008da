"""From measured rows to all that is found on them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from joblib import parallel_config
from sklearn.base import clone

from hybridsurrogate.diagnosis.answers.discrepancy import estimate_discrepancy
from hybridsurrogate.diagnosis.answers.experimental_design import next_measurement
from hybridsurrogate.diagnosis.answers.finding import cause_table, finding_of, not_reached
from hybridsurrogate.diagnosis.checks.caution import Caution
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
    Settings,
    check_each_output,
    check_rows,
    confounded,
    confounding,
    sentences_on_parameters,
)
from hybridsurrogate.diagnosis.checks.simulation import (
    cautions_of_failures,
    check_emulator,
    warn_if_rough,
    warn_if_slow,
)
from hybridsurrogate.diagnosis.fitting.result import Conclusion, DiagnosisResult, Extension
from hybridsurrogate.diagnosis.fitting.verdict import concluded, contradicted
from hybridsurrogate.diagnosis.search.context import blurred, on_working_rows
from hybridsurrogate.diagnosis.search.forward_selection import (
    SearchStep,
    forward_search,
    searches,
    tested,
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
from hybridsurrogate.estimators.averaged import leading
from hybridsurrogate.estimators.emulation import as_given
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate, as_causes
from hybridsurrogate.exceptions import ConfoundingWarning, DiagnosisWarning
from hybridsurrogate.inference.procedure import at_prior_ends
from hybridsurrogate.model.rows.measured_data import GivenRows
from hybridsurrogate.notebook import doing
from hybridsurrogate.numerics.linear_algebra import one_blas_thread


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
    fitted = Pair(before, result.extension.estimator, kinds)
    found, most = searches(result.steps), max(len(tested(result.steps)), 1)
    refitted = Refit(clone(before), settings, found, most, fitted)
    within = random_folds(len(y), cv, deepcopy(result.fold_random))
    beyond = folds_beyond(before.simulation, X)
    rows = result.rows._replace(y=y)
    with one_blas_thread():
        gain, out_of_range = cross_validated(refitted, within, beyond, rows, n_jobs, progress)
    return replace(result, gain=gain, gain_out_of_range=out_of_range)


def extend(
    before: Any,
    steps: Sequence[SearchStep],
    conclusion: Conclusion,
    rows: GivenRows,
    n_jobs: int | None,
) -> Extension:
    """Return the model after, with a `ConfoundingWarning` of what the data cannot separate.

    Parameters
    ----------
    before : PowerScaledSurrogate
        Fitted.
    steps : sequence of SearchStep
    conclusion : Conclusion
    rows : GivenRows
        A copy of what was measured, for later scans over the weight.
    n_jobs : int or None
        For these scans.
    """
    causes, search = accepted(steps), steps[0].search
    after = extended_estimator(before, steps)
    found = leading(after)
    outputs, first = before.simulation.outputs, steps[0].chosen.cause
    bands = {name: estimate_discrepancy(search, first, k) for k, name in enumerate(outputs)}
    known = found.posterior_.model.effects[: len(as_causes(before.effects))]
    simulator = extended_simulator(before.simulation.simulator, (*known, *causes), search.problem)
    replaced = {cause.replaces for cause in causes}
    # of a search that decides nothing also those before it
    models = (before, found) if conclusion.verdict == "undecided" else (found,)
    at_end = {one.name: one for model in models for one in at_prior_ends(model.posterior_)}
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
        at_prior_end=tuple(one for name, one in at_end.items() if name not in replaced),
        beta_scans=BetaScans((before, found), rows, n_jobs),
    )


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

    def __init__(
        self, search: Search | None, causes: pd.DataFrame | None, prepared: Prepared
    ) -> None:
        super().__init__("the diagnosis was interrupted")
        n = 0 if search is None else len(search.candidates) - 1
        if search is not None and causes is None:
            left = not_reached(search, prepared.causes)
            causes = cause_table(search, [*left, *prepared.skipped])
        self.search, self.causes = search, causes
        self.sentence = (
            f"The diagnosis was interrupted: {n} of {len(prepared.causes)} causes had been compared"
            f"{', and causes_ lists them' if n else ''}. There is no gain, and no report."
        )


def diagnose(
    estimator: PowerScaledSurrogate | None,
    rows: GivenRows,
    settings: Settings,
    random: np.random.RandomState,
) -> DiagnosisResult:
    """Return all that is found on measured rows, but for the gain: prepare, compare, extend.

    Its warnings are those of the caller of ``fit``, which calls this.

    Parameters
    ----------
    estimator : PowerScaledSurrogate
        Not fitted.
    rows : GivenRows
        Measured, without gaps; where a fit makes runs, processes share them.
    settings : Settings
    random : RandomState

    Raises
    ------
    InterruptedDiagnosis
        On an interrupt once causes are being compared.
    """
    jobs = settings.n_jobs
    with nullcontext() if jobs is None else parallel_config(n_jobs=jobs):
        before = as_given(clone(estimator).fit(*rows))
    check_each_output(before.measured_[1], before.simulation.outputs)
    prepared = prepare(before, settings.causes, settings.exclude, settings.max_causes)
    prepared.warn()
    problem, ranges = prepared.problem, before.data_.simulation.input_ranges
    model = problem.model
    check_rows(len(problem.y), model.columns, [*model.parameters, *model.constants])
    check_digits(problem)
    cautions = [*copied_rows(problem.X, problem.y), *doubtful_columns(problem, ranges)]
    warn_if_slow(problem, settings.cv)
    warn_if_rough(problem)
    steps: list[SearchStep] = []
    causes: pd.DataFrame | None = None
    try:
        with one_blas_thread(), doing("Search", settings.progress):
            steps, known = compare(prepared, before, settings, random)
            first = steps[0]
            check = check_emulator(first.search, model.basis, before.data_.simulation)
            if check is not None:
                cautions += check.cautions(before.surrogate_)
            causes = cause_table(first.conditional, prepared.skipped)
            conclusion, doubts = concluded(steps, before, problem, check, known, settings)
            cautions += doubts
            places = [next_measurement(step.conditional, ranges) for step in steps]
            # the search about which one more measurement informs most
            asked = max(range(len(steps)), key=lambda k: places[k].information)
            # a copy: the user's table may change
            rows = deepcopy(rows)._replace(y_err=before.data_.y_err)
            extension = extend(before, steps, conclusion, rows, jobs)
        found, accepted_ = leading(extension.estimator).posterior_, accepted(steps)
        cautions += contradicted(found, as_causes(before.effects))
        posteriors = [before.posterior_]
        if accepted_ and not any(cause.is_process for cause in accepted_):
            posteriors.append(found)
        cautions += cautions_of_failures(before.data_.simulation, before.posterior_, problem.X)
        cautions += cautions_of_dispersion(problem, posteriors)
        cautions += cautions_of_rounding(before.likelihood_, check)
    except KeyboardInterrupt as stop:
        search = steps[0].search if steps else getattr(stop, "kept", None)
        raise InterruptedDiagnosis(search, causes, prepared) from stop
    finally:
        for one in cautions:
            warnings.warn(one.sentence, DiagnosisWarning, stacklevel=3)
    return DiagnosisResult(
        settings=settings,
        rows=rows,
        fold_random=deepcopy(random),
        before=before,
        steps=tuple(steps),
        causes=causes,
        indistinguishable=tuple(first.conditional.credible_kinds),
        asked=steps[asked].conditional,
        next_measurement=places[asked],
        emulator_check=check,
        conclusion=conclusion,
        extension=extension,
        cautions=tuple(cautions),
    )


def compare(
    prepared: Prepared, before: Any, settings: Settings, random: np.random.RandomState
) -> tuple[list[SearchStep], list[Caution]]:
    """Return all causes compared, one search after the other, and doubts of the data from it.

    Parameters
    ----------
    prepared : Prepared
    before : PowerScaledSurrogate
    settings : Settings
    random : RandomState
    """
    problem, emulator = trained_emulator(prepared.problem, before)
    problem = on_working_rows(problem, before.posterior_)
    limits = settings.max_causes, settings.false_alarm_rate, settings.n_replicates
    steps = forward_search(problem, prepared.causes, emulator, *limits, random)
    if not is_exact(steps[0].search):
        return steps, []
    steps = forward_search(blurred(problem), prepared.causes, emulator, *limits, random)
    return steps, exact(steps[0].search)
