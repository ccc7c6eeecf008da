"""From measured rows to all that is found on them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from joblib import parallel_config
from numpy.typing import ArrayLike
from sklearn.base import clone

from hybridsurrogate.diagnosis.answers.experimental_design import NextMeasurement, next_measurement
from hybridsurrogate.diagnosis.answers.table import cause_table, not_reached
from hybridsurrogate.diagnosis.checks.caution import Caution, warn_of
from hybridsurrogate.diagnosis.checks.columns import doubtful_columns
from hybridsurrogate.diagnosis.checks.cost import warn_if_slow
from hybridsurrogate.diagnosis.checks.data import check_digits, copied_rows, exact, is_exact
from hybridsurrogate.diagnosis.checks.dispersion import (
    cautions_of_dispersion,
    cautions_of_rounding,
)
from hybridsurrogate.diagnosis.checks.emulator import check_emulator
from hybridsurrogate.diagnosis.checks.parameters import check_each_output, check_rows
from hybridsurrogate.diagnosis.checks.roughness import warn_if_rough
from hybridsurrogate.diagnosis.fitting.conclusion import concluded, contradicted
from hybridsurrogate.diagnosis.fitting.extension import extend, posteriors_of_mean
from hybridsurrogate.diagnosis.fitting.result import DiagnosisResult, Settings
from hybridsurrogate.diagnosis.search.context import InterruptedSearch
from hybridsurrogate.diagnosis.search.forward_selection import (
    SearchStep,
    forward_search,
)
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.diagnosis.search.setup import Prepared, prepare, trained_emulator
from hybridsurrogate.diagnosis.search.working_rows import blurred, on_working_rows
from hybridsurrogate.diagnosis.validation.progress import doing
from hybridsurrogate.estimators.averaged import leading
from hybridsurrogate.estimators.emulation import as_given
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate, as_causes
from hybridsurrogate.model.statistics import EmulatorPosterior
from hybridsurrogate.numerics.threads import one_blas_thread
from hybridsurrogate.types import FloatArray


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
