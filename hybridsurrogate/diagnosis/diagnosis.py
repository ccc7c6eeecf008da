"""From measured data to a named cause, an extended model and its gain."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from copy import deepcopy
from dataclasses import replace
from numbers import Integral
from typing import Any

import numpy as np
from joblib import parallel_config
from numpy.typing import ArrayLike
from sklearn.base import clone
from sklearn.utils import check_consistent_length, check_random_state, check_scalar
from sklearn.utils.validation import check_is_fitted

from hybridsurrogate.diagnosis.answers.discrepancy import estimate_discrepancies
from hybridsurrogate.diagnosis.answers.experimental_design import next_measurement
from hybridsurrogate.diagnosis.answers.finding import finding_of
from hybridsurrogate.diagnosis.answers.result import DiagnosisResult
from hybridsurrogate.diagnosis.answers.table import cause_table, not_reached
from hybridsurrogate.diagnosis.checks.caution import Caution, warn_of
from hybridsurrogate.diagnosis.checks.columns import (
    better_columns,
    check_columns,
    doubtful_columns,
)
from hybridsurrogate.diagnosis.checks.cost import warn_if_slow
from hybridsurrogate.diagnosis.checks.data import (
    check_digits,
    copied_rows,
    counted_rows,
    exact,
    gross_errors,
    is_exact,
    mirrored,
    single_rows,
)
from hybridsurrogate.diagnosis.checks.detectable import smallest_detectable
from hybridsurrogate.diagnosis.checks.dispersion import (
    cautions_of_dispersion,
    cautions_of_rounding,
)
from hybridsurrogate.diagnosis.checks.emulator import check_emulator
from hybridsurrogate.diagnosis.checks.identifiability import confounded, confounding, sentences
from hybridsurrogate.diagnosis.checks.outside import probability_right
from hybridsurrogate.diagnosis.checks.parameters import (
    check_each_output,
    check_rows,
    check_settings,
)
from hybridsurrogate.diagnosis.checks.residuals import check_residuals
from hybridsurrogate.diagnosis.checks.roughness import warn_if_rough
from hybridsurrogate.diagnosis.fitted import FittedDiagnosis
from hybridsurrogate.diagnosis.search.backfitting import backfitted
from hybridsurrogate.diagnosis.search.evidence import credible_kinds
from hybridsurrogate.diagnosis.search.forward_selection import (
    SearchStep,
    forward_search,
    searches,
    with_correlated_noise,
)
from hybridsurrogate.diagnosis.search.local_fit import InterruptedSearch, blurred
from hybridsurrogate.diagnosis.search.setup import Prepared, prepare, trained_emulator
from hybridsurrogate.diagnosis.search.working_rows import on_working_rows
from hybridsurrogate.diagnosis.validation.beta_scan import BetaScans, FewScan
from hybridsurrogate.diagnosis.validation.cross_validation import cross_validated
from hybridsurrogate.diagnosis.validation.folds import folds_beyond, random_folds
from hybridsurrogate.diagnosis.validation.gain import HeldOutGain, in_one_word
from hybridsurrogate.diagnosis.validation.progress import doing
from hybridsurrogate.diagnosis.validation.refit import (
    Pair,
    Refit,
    accepted,
    extended,
    extended_simulator,
)
from hybridsurrogate.diagnosis.validation.rows_left_out import with_rows
from hybridsurrogate.diagnosis.verdict import Verdict, conclude
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.in_output import InOutput
from hybridsurrogate.effects.noise.gross_error import GrossError
from hybridsurrogate.estimators.averaged import leading
from hybridsurrogate.estimators.emulation import as_given
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.exceptions import ConfoundingWarning, DiagnosisWarning
from hybridsurrogate.inference.prior_ends import AtPriorEnd, at_prior_ends
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.rows.measured_rows import check_outcomes, without_gaps
from hybridsurrogate.numerics.threads import one_blas_thread
from hybridsurrogate.simulation.arrays import complete_table


class DiscrepancyDiagnosis(FittedDiagnosis):
    """Find out what a simulation gets wrong, name the cause, extend the model, measure the gain.

    Parameters
    ----------
    estimator : PowerScaledSurrogate
        The model before, with its simulation; without effects.
    causes : sequence of Cause, default=()
        User-defined causes, compared in addition to the catalogue. Each replaces the catalogue's
        cause of the same form and target.
    exclude : sequence of str, default=()
        Kinds of the catalogue that cannot be the cause, such as "delay" where the clock is right.
        Other kinds share their prior probability; ``causes_`` lists them as not compared.
    false_alarm_rate : float, default=0.05
        The verdict is "adequate" where the p-value of the whole search is more than this. Where
        it is at most this, and "none" has more than half of the probability, it is "undecided".
    n_replicates : int, default=200
        Replicated data sets for the p-value.
    cv : int or None, default=5
        Folds for ``gain_``; None: no cross-validation, and neither gain is measured.
    max_causes : int, default=1
        How many causes are accepted, one after the other, each with the same control of false
        alarms.
    n_jobs : int or None, default=None
        Processes that share the folds; the result is the same for any number.
    random_state : int, RandomState or None, default=None
    progress : bool, default=False
        Print on stderr, where that is a terminal, what is being done: search, folds.

    Attributes
    ----------
    estimator_ : PowerScaledSurrogate
        The model before, fitted.
    verdict_ : {"adequate", "named", "nearest", "ambiguous", "unexplained", "undecided"}
        "undecided": runs, rows or a prior do not suffice for a verdict; see ``undecided_by_``.
        "nearest": a cause of the catalogue has most of the probability, but the residuals have
        structure. The true cause may be a similar one outside the catalogue.
    concerns_ : {"simulation", "noise", "inputs", "data", "prior"} or None
        What is at fault: the simulation's mean, how the measurements scatter, the measured inputs,
        single measurements, or the prior of a parameter. None where nothing is, or where the
        verdict is "undecided".
    undecided_by_ : {"runs", "rows", "prior"} or None
        What does not suffice, where the verdict is "undecided".
    smallest_detectable_ : float or None
        Where no cause was detected: the root mean square, on the scale of eta, of the smallest
        fault that would have been detected in nine of ten data sets like these. Faults are steps
        and straight lines over the inputs, of which the median is taken.
    probability_right_ : float or None
        Probability that the most probable cause is the right one. Causes outside the catalogue
        count too, at their frequency in measured data sets. None where no cause has a name.
        ``best_cause_.probability`` supposes that the catalogue contains the cause.
    residual_check_ : ResidualCheck or None
        Whether noise alone gives residuals like those of the extended model. It does in 95 % of
        the cases in which the cause is right. None where nothing was detected, and with noise that
        is not normal.
    cautions_ : list of Caution
        Reasons to doubt the verdict, each with what to do; the report begins with them, and each
        was a `DiagnosisWarning`.
    p_value_ : float
        Of the whole search under "the simulation is right": the share of replicates in which the
        best cause looks as convincing or, where it is less, one over the ratio of the evidence.
    causes_ : pandas.DataFrame
        One row a cause, most probable first. Where several causes were accepted: given all but
        the first of them. Columns:

        - kind, target and form (such as "parameter-drift: logistic over t");
        - probability;
        - log_evidence, against "none": averaged over the cause alone, with a smooth curve and
          with correlated noise;
        - smooth_curve: probability that a smooth curve is needed in addition to the cause;
        - correlated: probability that, given the cause, the noise of neighbouring rows is
          correlated;
        - note: why a cause was not compared, or how often the simulation fails under it.
    beta_scans_ : BetaScans
        What `beta_scan` tries at a few weights when it is first asked for.
    best_cause_ : CauseFinding
    found_causes_ : list of CauseFinding
        Every accepted cause in the order of acceptance, ``best_cause_`` the first.
    indistinguishable_ : list of str
        Kinds that together reach 90 % probability, given that something is wrong.
    discrepancy_ : Discrepancy
        Of several outputs that of the output which the first cause concerns.
    discrepancies_ : dict of output to Discrepancy
        The parameters of the simulation were estimated together with each of them alone. Where
        another output is at fault these parameters are biased, and so is the curve.
    extended_estimator_ : AveragedSurrogate or PowerScaledSurrogate
        Fitted; ``predict`` and ``score`` of the diagnosis are those of this estimator. It is the
        average, weighted by probability, over the causes with at least 5 %, "none" included. Of
        several accepted causes, each in turn is replaced by its alternatives. Each extension keeps
        a `Remainder` beyond the measured range. The first estimator, ``estimators_[0]``, has the
        accepted causes, and ``posterior_`` is its posterior. Where the verdict is "adequate", this
        is the estimator before.
    extended_simulator_ : Simulator or None
        The simulation with the cause in it; None when there are only runs, or nothing to add.
    confounded_ : pandas.DataFrame
        For each accepted cause and each parameter: the correlation of the cause's estimates with
        the parameter, the parameter's shift when the cause was added, its uncertainty then, and
        the share of the cause's curve that it could absorb. A `ConfoundingWarning` reports a
        pair where the correlation is at least 0.9, the parameter keeps half of its prior
        uncertainty, and it could absorb half of the curve.
    gain_ : HeldOutGain or None
        On held-out rows within the measured range, the search repeated in each fold. Its methods
        return the best weight of the simulation before and after.
    gain_out_of_range_ : HeldOutGain or None
        The same beyond it: the last 40 % of the rows in three blocks, each predicted from all rows
        before it. None where rows are few, or have no order: of several inputs without an
        `OdeSimulator`, none by which they come sorted.
    at_prior_end_ : list of AtPriorEnd
        Parameters of the extended model, and where the verdict is "undecided" of the one before,
        that the data push against the end of their prior. The detected cause may replace what the
        prior excludes.
    next_measurement_ : dict of str to float
        Inputs at which one more measurement would best separate the alternatives. Of several
        causes, those of the cause about which it informs most.
    next_information_ : float
        Its expected information about which alternative is true, in bits.
    emulator_check_ : EmulatorCheck or None
        Uncertainty of the emulator and error of the surrogate at the measured rows, in standard
        deviations of the noise. A `DiagnosisWarning` reports more than 1 and 2, respectively.
        None where the simulation itself is run.
    search_ : Search
        All causes at their best in the first search, given no other cause.
    result_ : DiagnosisResult
        All searches, and the settings of this fit, which `set_params` does not change.

    Notes
    -----
    An interrupted ``fit`` (KeyboardInterrupt) keeps its results: ``search_`` and ``causes_`` list
    the causes that were compared by then. A `DiagnosisWarning` reports it, and the interrupt is
    raised. The diagnosis does not count as fitted, unless only folds remained: then only the gain
    is missing.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> model = hs.PowerScaledSurrogate(
    ...     case.simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    >>> diagnosis = hs.DiscrepancyDiagnosis(model, random_state=0).fit(case.X, case.y)
    >>> diagnosis.best_cause_.kind
    'periodic'
    """

    def __init__(
        self,
        estimator: PowerScaledSurrogate | None = None,
        causes: Sequence[Cause] = (),
        exclude: Sequence[str] = (),
        false_alarm_rate: float = 0.05,
        n_replicates: int = 200,
        cv: int | None = 5,
        max_causes: int = 1,
        n_jobs: int | None = None,
        random_state: Any = None,
        progress: bool = False,
    ):
        self.estimator = estimator
        self.causes = causes
        self.exclude = exclude
        self.false_alarm_rate = false_alarm_rate
        self.n_replicates = n_replicates
        self.cv = cv
        self.max_causes = max_causes
        self.n_jobs = n_jobs
        self.random_state = random_state
        self.progress = progress

    def fit(
        self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None
    ) -> DiscrepancyDiagnosis:
        """Diagnose measured data.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
            May carry columns that the simulation ignores: by name (DataFrame) or after its inputs
            (array). They are compared as missing inputs, and other causes may act along them.
        y : array-like of shape (n,), or (n, n_outputs) of a simulation of several outputs
            With NaN for what was not measured: of one output such rows are excluded, with a
            warning.
        sample_weight : array-like of shape (n,) or None, default=None
            As the estimator's: powers of the likelihoods of single rows, a weight of zero leaves a
            row out. The search takes each row for one measurement whose noise has a variance
            divided by its weight, relative to the mean weight; the gain is a weighted mean. Give
            precisions, such as the counts behind means, a mean of one: a sum beyond the number of
            rows makes the intervals of the extension those of as many measurements.

        Returns
        -------
        self
        """
        check_settings(self)
        labels = getattr(self.estimator, "experiment", None)
        check_outcomes(y, as_likelihood(getattr(self.estimator, "likelihood", "normal")))
        check_consistent_length(X, y)
        X, y, weights = without_gaps(X, y, sample_weight)
        X = complete_table(X, labels=labels)
        X, y, weights = counted_rows(X, y, weights)
        self._forget()
        self._weights = weights
        self.cautions_: list[Caution] = []
        check_columns(X, y, getattr(self.estimator, "simulation", None))
        random = check_random_state(self.random_state)
        # where the fit makes runs processes share them
        with nullcontext() if self.n_jobs is None else parallel_config(n_jobs=self.n_jobs):
            self.estimator_ = as_given(clone(self.estimator).fit(X, y, weights))
        check_each_output(self.estimator_.measured_[1], self.estimator_.simulation.outputs)
        own, excluded = tuple(self.causes), tuple(self.exclude)
        prepared = prepare(self.estimator_, own, excluded, int(self.max_causes))
        prepared.warn()
        model = prepared.problem.model
        check_rows(len(prepared.problem.y), model.columns, [*model.parameters, *model.constants])
        check_digits(prepared.problem)
        ranges = self.estimator_.simulation_.input_ranges
        self.cautions_ += copied_rows(prepared.problem.X, prepared.problem.y)
        self.cautions_ += doubtful_columns(prepared.problem, ranges)
        warn_if_slow(prepared.problem, self.cv)
        warn_if_rough(prepared.problem)
        try:
            with one_blas_thread(), doing("Search", bool(self.progress)):
                steps, verdict = self._search(prepared, random)
                self._extend(steps, verdict.same_curve, X, y)
            self.cautions_ += cautions_of_dispersion(prepared.problem, self._of_mean())
            self.cautions_ += cautions_of_rounding(
                self.estimator_.likelihood_, self.emulator_check_
            )
        except KeyboardInterrupt as stop:
            self._keep(prepared, stop)
            raise
        finally:
            warn_of(self.cautions_)
        self.n_features_in_ = self.estimator_.n_features_in_
        if hasattr(self.estimator_, "feature_names_in_"):
            self.feature_names_in_ = self.estimator_.feature_names_in_
        self.gain_: HeldOutGain | None = None
        self.gain_out_of_range_: HeldOutGain | None = None
        # of this fit, whatever set_params changes until the folds are run
        self._searched_with = own, excluded, int(self.max_causes)
        self._fold_random = deepcopy(random)
        if self.cv is not None:
            self._cross_validate(int(self.cv))
        return self

    def cross_validate(self, cv: int = 5) -> DiscrepancyDiagnosis:
        """Measure the gain on held-out rows, the search repeated without them.

        ``fit`` does it where ``cv`` is set. Apart from it the verdict can be read first:
        ``fit`` with ``cv=None``, then this. The same ``random_state`` gives the same folds either
        way.

        Parameters
        ----------
        cv : int, default=5
            Folds within the measured range, at least 2. Those beyond it are up to three.

        Returns
        -------
        self
            With ``gain_`` and ``gain_out_of_range_``.

        Raises
        ------
        NotFittedError
            Before ``fit``.
        TypeError, ValueError
            For a number of folds that is no whole number, or less than 2.

        Examples
        --------
        >>> import hybridsurrogate as hs
        >>> from hybridsurrogate.datasets import make_log_sin
        >>> case = make_log_sin(random_state=0)
        >>> model = hs.PowerScaledSurrogate(
        ...     case.simulator, surrogate=hs.ExactSurrogate(), random_state=0)
        >>> diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
        >>> diagnosis.fit(case.X, case.y).gain_ is None
        True
        >>> diagnosis.cross_validate(3).gain_ is None
        False
        """
        check_is_fitted(self)
        check_scalar(cv, "cv", Integral, min_val=2)
        self._cross_validate(int(cv))
        return self

    def _doubts_of(
        self, steps: Sequence[SearchStep], problem: Problem, verdict: str
    ) -> list[Caution]:
        """Return what makes a search doubtful: single rows, columns and their units."""
        first, ranges = steps[0], self.estimator_.simulation_.input_ranges
        found = with_rows(accepted(steps), steps)
        left_out = [
            one for cause in found if isinstance(cause, GrossError) for one in gross_errors(cause)
        ]
        if left_out:
            return left_out
        out = list(single_rows(first.search, first.chosen))
        if verdict != "adequate":
            out += better_columns(first.search, ranges, first.chosen)
        return out if verdict in ("named", "nearest") else [*out, *mirrored(problem)]

    def _forget(self) -> None:
        """Drop the results of an earlier fit: after an interrupt they would remain with the new."""
        for name in [name for name in vars(self) if name.endswith("_")]:
            delattr(self, name)

    def _search(
        self, prepared: Prepared, random_state: np.random.RandomState
    ) -> tuple[list[SearchStep], Verdict]:
        problem, emulator = trained_emulator(prepared.problem, self.estimator_)
        problem = on_working_rows(problem, self.estimator_.posterior_)
        settings = int(self.max_causes), self.false_alarm_rate, int(self.n_replicates)
        steps = forward_search(problem, prepared.causes, emulator, *settings, random_state)
        doubts: list[Caution] = []
        if is_exact(steps[0].search):
            steps = forward_search(
                blurred(problem), prepared.causes, emulator, *settings, random_state
            )
            doubts += exact(steps[0].search)
        test = steps[0].test
        assert test is not None  # only folds have none
        self.search_, self.p_value_ = steps[0].search, test.p_value
        self.emulator_check_ = check_emulator(
            self.search_, prepared.problem.model.basis, self.estimator_.simulation_
        )
        if self.emulator_check_ is not None:
            self.cautions_ += self.emulator_check_.cautions(self.estimator_.surrogate_)
        steps = backfitted(steps, self.search_.problem, prepared.causes)
        steps = with_correlated_noise(steps, prepared.causes, emulator)
        found = steps[0].conditional
        self.causes_ = cause_table(found, prepared.skipped)
        self.indistinguishable_ = credible_kinds(found)
        verdict = self._conclude(steps)
        doubts += self._doubts_of(steps, prepared.problem, verdict.word)
        first = steps[0].chosen.cause
        rests_on_it = any(one.about in ("data", "columns") for one in doubts)
        if verdict.word == "named" and rests_on_it and first is not None and first.changes_output:
            self.verdict_ = "nearest"
        self.probability_right_ = self._probability_right(steps[0], verdict.share)
        self.cautions_ += doubts
        ranges = self.estimator_.simulation_.input_ranges
        places = [next_measurement(step.conditional, ranges) for step in steps]
        most = max(range(len(steps)), key=lambda k: places[k].information)
        self.result_ = DiagnosisResult(
            tuple(steps),
            steps[most].conditional,
            test,
            self.false_alarm_rate,
            int(self.n_replicates),
        )
        self.next_measurement_ = places[most].place
        self.next_information_ = places[most].information
        return steps, verdict

    def _conclude(self, steps: Sequence[SearchStep]) -> Verdict:
        last = [step for step in steps if step.is_accepted][-1:]
        self.residual_check_ = None
        for step in last:
            self.residual_check_ = check_residuals(step.conditional, step.chosen)
        check, basis = self.emulator_check_, self.estimator_.posterior_.model.basis
        verdict = conclude(
            steps,
            self.false_alarm_rate,
            self.residual_check_,
            0.0 if check is None else check.hidden,
            not basis.is_simulation and bool(at_prior_ends(self.estimator_.posterior_)),
        )
        self.verdict_, self.concerns_ = verdict.word, verdict.concerns
        self.undecided_by_ = verdict.open
        self.smallest_detectable_ = None
        if not last:
            self.smallest_detectable_ = smallest_detectable(
                self.search_, steps[0].test, self.false_alarm_rate
            )
        return verdict

    def _of_mean(self) -> list[Posterior]:
        """Return the posterior before and, where the cause is in the mean, that after."""
        causes = accepted(self.result_.steps)
        of_any_shape = any(cause.is_process for cause in causes)
        after = [] if of_any_shape or not causes else [leading(self.extended_estimator_).posterior_]
        return [self.estimator_.posterior_, *after]

    def _probability_right(self, first: SearchStep, share: float) -> float | None:
        if self.verdict_ in ("adequate", "unexplained", "undecided"):
            return None
        wrong = 1 - float(first.conditional.probability[0])
        return wrong * probability_right(share, self.verdict_ == "nearest")

    def _extend(
        self, steps: Sequence[SearchStep], same_curve: tuple[str, ...], X: ArrayLike, y: ArrayLike
    ) -> None:
        causes, problem = accepted(steps), self.search_.problem
        self._rows = deepcopy((X, y))
        self.extended_estimator_ = extended(self.estimator_, steps, X, y, self._weights)
        found = leading(self.extended_estimator_)
        self.beta_scans_ = BetaScans(
            (self.estimator_, found), *self._rows, self.n_jobs, self._weights
        )
        posterior = found.posterior_
        self.at_prior_end_ = self._at_prior_end(causes, posterior)
        self.found_causes_ = [
            finding_of(step, k, posterior, () if k else same_curve) for k, step in enumerate(steps)
        ]
        self.best_cause_ = self.found_causes_[0]
        self.extended_simulator_ = extended_simulator(
            self.estimator_.simulation.simulator, causes, problem
        )
        first = steps[0].chosen.cause
        outputs = self.estimator_.simulation.outputs
        bands = estimate_discrepancies(self.search_, first)
        self.discrepancies_ = dict(zip(outputs, bands, strict=True))
        self.discrepancy_ = self.discrepancies_[
            first.output if isinstance(first, InOutput) else outputs[0]
        ]
        self.confounded_ = confounding(self.estimator_, found, self.estimator_.single_rows_[0])
        for sentence in sentences(confounded(self.confounded_)):
            warnings.warn(sentence, ConfoundingWarning, stacklevel=3)

    def _at_prior_end(self, causes: Sequence[Cause], posterior: Posterior) -> list[AtPriorEnd]:
        """Return what is at an end of its prior in the extended model, else in the calibrated."""
        replaced = {cause.replaces for cause in causes}
        found = at_prior_ends(posterior)
        before = at_prior_ends(self.estimator_.posterior_) if self.verdict_ == "undecided" else []
        every = {one.name: one for one in (*before, *found)}
        return [one for name, one in every.items() if name not in replaced]

    def _cross_validate(self, cv: int) -> None:
        X, y = self._rows[0], self.estimator_.measured_[1]
        own, excluded, max_causes = self._searched_with
        kinds = in_one_word([cause.kind for cause in self.found_causes_])
        refitted = Refit(
            clone(self.estimator_),
            own,
            excluded,
            searches(self.result_.steps),
            Pair(self.estimator_, self.extended_estimator_, kinds),
            max_causes,
            self.result_.false_alarm_rate,
        )
        within = random_folds(len(y), cv, deepcopy(self._fold_random))
        beyond = folds_beyond(self.estimator_.simulation, self.estimator_.measured_[0])
        try:
            with one_blas_thread():
                gains = cross_validated(
                    refitted, within, beyond, X, y, self.n_jobs, bool(self.progress), self._weights
                )
        except KeyboardInterrupt:
            warnings.warn(
                "The folds of the diagnosis were interrupted: there is no gain. All else is kept, "
                "as with cv=None.",
                DiagnosisWarning,
                stacklevel=3,
            )
            raise
        # the weights are tried when they are asked for
        self.gain_, self.gain_out_of_range_ = (
            gain and replace(gain, scan=FewScan(self.beta_scans_, out_of_range))
            for gain, out_of_range in zip(gains, (False, True), strict=True)
        )

    def _keep(self, prepared: Prepared, stop: KeyboardInterrupt) -> None:
        """Keep what an interrupted search had compared, with a warning."""
        if not hasattr(self, "search_") and isinstance(stop, InterruptedSearch) and stop.kept:
            self.search_ = stop.kept
        if hasattr(self, "search_") and not hasattr(self, "causes_"):
            left = not_reached(self.search_, prepared.causes)
            self.causes_ = cause_table(self.search_, [*left, *prepared.skipped])
        n = len(self.search_.candidates) - 1 if hasattr(self, "search_") else 0
        warnings.warn(
            f"The diagnosis was interrupted: {n} of {len(prepared.causes)} causes had been compared"
            f"{', and causes_ lists them' if n else ''}. There is no gain, and no report.",
            DiagnosisWarning,
            stacklevel=3,
        )
