"""From measured data to a named cause, an extended model and its gain."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from numbers import Integral
from typing import TYPE_CHECKING, Any, NoReturn

import pandas as pd
from numpy.typing import ArrayLike
from sklearn import get_config
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils import check_consistent_length, check_random_state, check_scalar
from sklearn.utils.validation import check_is_fitted

from hybridsurrogate.arguments import check_flag, described
from hybridsurrogate.diagnosis.answers.discrepancy import Discrepancy
from hybridsurrogate.diagnosis.answers.experimental_design import next_measurements, next_runs
from hybridsurrogate.diagnosis.answers.finding import CauseFinding, parameter_course
from hybridsurrogate.diagnosis.answers.monitor import Monitor, followed, monitored
from hybridsurrogate.diagnosis.checks.caution import Caution
from hybridsurrogate.diagnosis.checks.columns import check_usable_columns
from hybridsurrogate.diagnosis.checks.data import counted_rows
from hybridsurrogate.diagnosis.checks.parameters import checked_settings
from hybridsurrogate.diagnosis.checks.simulation import EmulatorCheck
from hybridsurrogate.diagnosis.fitting.diagnose import InterruptedDiagnosis, diagnose, with_gain
from hybridsurrogate.diagnosis.fitting.result import DiagnosisResult
from hybridsurrogate.diagnosis.fitting.sensitivity import prior_sensitivity
from hybridsurrogate.diagnosis.search.residuals import ResidualCheck
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.diagnosis.source.python_code import extended_model, python_source
from hybridsurrogate.diagnosis.stored import restored, stored
from hybridsurrogate.diagnosis.validation.beta_scan import BetaScans
from hybridsurrogate.diagnosis.validation.gain import HeldOutGain, gain_on
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.estimators.averaged import leading
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.exceptions import DiagnosisWarning
from hybridsurrogate.inference.procedure import AtPriorEnd
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.model.rows.measured_data import (
    GivenRows,
    check_outcomes,
    taken_out,
    without_gaps,
)
from hybridsurrogate.numerics.atomic_file import check_writable, written_whole
from hybridsurrogate.simulation.arrays import complete_table
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hybridsurrogate.diagnosis.report.report import Report

# names of earlier versions, and what stands in their place
_FORMER = {
    "averaged_estimator_": "extended_estimator_ is the average",
    "averaged_estimator": "extended_estimator_ is the average",
    "beta_scan_": "it takes fits, and so is a method, beta_scan()",
    "beta_scan_out_of_range_": "it takes fits, and so is a method, beta_scan(out_of_range=True)",
}


class DiscrepancyDiagnosis(RegressorMixin, BaseEstimator):
    """Find out what a simulation gets wrong, name the cause, extend the model, measure the gain.

    Parameters
    ----------
    estimator : PowerScaledSurrogate
        The model before, with its simulation. Its ``effects``, if any, are what is known to be
        wrong already, such as ``Step("year", location=norm(1983.1, 0.1))``: a part of "nothing is
        wrong", in whose addition causes are searched, and kept in the extended model.
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
    max_causes : int or None, default=None
        How many causes are accepted, one after the other, each with the same control of false
        alarms. None: a further one is searched, up to three, where residual structure remains:
        a curve of any shape or correlated noise would explain more, or `residual_check_` fails.
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
    detectable_ : pandas.DataFrame or None
        Where no cause was detected: the smallest cause of each kind that would have been, in nine
        of ten data sets like these. Columns: "kind", "size" (as in `detectability`; NaN where none
        that was tried would have been) and "change" (its largest change of a row without noise, on
        the scale of eta: the height of a step). For rates of detection and names, or other rows,
        see `detectability`.
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
        What `beta_scan` tries at a few weights when it is first asked for. Its methods
        `best_beta_before` and `best_beta_after` return the best weight of the simulation.
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
        a `Remainder` beyond the measured range; one by a curve of any shape leaves rows there to
        the estimator before. The first estimator, ``estimators_[0]``, has the accepted causes, and
        ``posterior_`` is its posterior. Where the verdict is "adequate", this is the estimator
        before.
    extended_simulator_ : Simulator or None
        The simulation with the cause in it; None when there are only runs, or nothing to add.
    confounded_ : pandas.DataFrame
        For each accepted cause and each parameter: the correlation of the cause's estimates with
        the parameter, the parameter's shift when the cause was added, its uncertainty then, and
        the share of the cause's curve that it could absorb. A `ConfoundingWarning` reports a
        pair where the correlation is at least 0.9, the parameter keeps half of its prior
        uncertainty, and it could absorb half of the curve.
    gain_ : HeldOutGain or None
        On held-out rows within the measured range, the search repeated in each fold.
    gain_out_of_range_ : HeldOutGain or None
        The same beyond it: the last 40 % of the rows in three blocks, each predicted from all rows
        before it. None where rows are few, or have no order: of several inputs without an
        `OdeSimulator`, none by which they come sorted.
    at_prior_end_ : list of AtPriorEnd
        Parameters of the extended model, and where the verdict is "undecided" of the one before,
        that the data push against the end of their prior. The detected cause may replace what the
        prior excludes.
    next_measurement_ : dict of str to float or str
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
        All of these in one frozen object, with every search and the settings of this fit, which
        `set_params` does not change.

    Notes
    -----
    An interrupted ``fit`` (KeyboardInterrupt) keeps its results: ``search_`` and ``causes_`` list
    the causes that were compared by then. A `DiagnosisWarning` reports it, and the interrupt is
    raised. The diagnosis does not count as fitted, unless only folds remained: then only the gain
    is missing. A ``fit`` that raises an error leaves the results of an earlier one.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> model = hs.PowerScaledSurrogate(
    ...     case.simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    >>> diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
    >>> diagnosis.fit(case.X, case.y).best_cause_.kind
    'periodic'
    """

    result_: DiagnosisResult
    estimator_: Any
    search_: Search
    p_value_: float
    causes_: pd.DataFrame
    indistinguishable_: list[str]
    emulator_check_: EmulatorCheck | None
    next_measurement_: dict[str, Any]
    next_information_: float
    verdict_: str
    concerns_: str | None
    undecided_by_: str | None
    probability_right_: float | None
    residual_check_: ResidualCheck | None
    smallest_detectable_: float | None
    detectable_: pd.DataFrame | None
    extended_estimator_: Any
    extended_simulator_: Simulator | None
    best_cause_: CauseFinding
    found_causes_: list[CauseFinding]
    discrepancies_: dict[str, Discrepancy]
    discrepancy_: Discrepancy
    confounded_: pd.DataFrame
    at_prior_end_: list[AtPriorEnd]
    beta_scans_: BetaScans
    cautions_: list[Caution]
    gain_: HeldOutGain | None
    gain_out_of_range_: HeldOutGain | None
    refinement_: pd.DataFrame
    monitor_: Monitor
    n_features_in_: int
    _new: GivenRows

    def __init__(
        self,
        estimator: PowerScaledSurrogate | None = None,
        causes: Sequence[Cause] = (),
        exclude: Sequence[str] = (),
        false_alarm_rate: float = 0.05,
        n_replicates: int = 200,
        cv: int | None = 5,
        max_causes: int | None = None,
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

    def __getattr__(self, name: str) -> NoReturn:
        # a notebook asks for the value of every attribute that there is: none may take a fit
        text = f"{type(self).__name__!r} object has no attribute {name!r}"
        if name in _FORMER:
            text += f": {_FORMER[name]}"
        raise AttributeError(text, name=name, obj=self)

    def __getstate__(self) -> dict[str, Any]:
        # for pickle, joblib and skops, which stores no tables of pandas
        return dict(stored(dict(super().__getstate__())))

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(restored(state))

    def _repr_html_inner(self) -> str:
        if not self.__sklearn_is_fitted__():
            return str(super()._repr_html_inner())
        from hybridsurrogate.diagnosis.report.report import short_html

        return short_html(self.result_, repr(self))

    def _repr_mimebundle_(self, **kwargs: Any) -> dict[str, str]:
        # scikit-learn's own prints every fitted attribute
        out = {"text/plain": repr(self)}
        if get_config()["display"] == "diagram":
            out["text/html"] = self._repr_html_inner()
        return out

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "n_features_in_")

    def fit(
        self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None, y_err: Any = None
    ) -> DiscrepancyDiagnosis:
        """Diagnose measured data.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
            May carry columns that the simulation ignores: by name (DataFrame) or after its inputs
            (array). They are compared as missing inputs, and other causes may act along them.
            Columns of text are labels, such as of batches.
        y : array-like of shape (n,), or (n, n_outputs) of a simulation of several outputs
            With NaN for what was not measured: of one output such rows are excluded, with a
            warning.
        sample_weight : array-like of shape (n,) or None, default=None
            As the estimator's: powers of the likelihoods of single rows, a weight of zero leaves a
            row out. The search takes each row for one measurement whose noise has a variance
            divided by its weight, relative to the mean weight; the gain is a weighted mean. Give
            precisions, such as the counts behind means, a mean of one: a sum beyond the number of
            rows makes the intervals of the extension those of as many measurements.
        y_err : float, str, array-like of the shape of y, or None, default=None
            As the estimator's: known standard deviations of the measurements, or covariances of
            several outputs, with which its ``noise`` says what else is inferred. A search infers
            further noise ("added") with the share of the known errors in it fixed at what fits
            without a cause.

        Returns
        -------
        self
        """
        params: dict[str, Any] = self.get_params(deep=False)
        settings = checked_settings(**params, text=repr(self))
        labels = getattr(self.estimator, "experiment", None)
        check_outcomes(y, as_likelihood(getattr(self.estimator, "likelihood", "normal")))
        X, y_err = taken_out(X, y_err)
        check_consistent_length(X, y)
        rows = GivenRows(*without_gaps(X, y, sample_weight, y_err))
        rows = counted_rows(rows._replace(X=complete_table(rows.X, labels=labels)))
        simulation = getattr(self.estimator, "simulation", None)
        check_usable_columns(rows.X, rows.y, simulation, labels)
        random = check_random_state(self.random_state)
        try:
            result = diagnose(self.estimator, rows, settings, random)
        except InterruptedDiagnosis as stop:
            known = {"search_": stop.search, "causes_": stop.causes}
            self._set({} if stop.search is None else known)
            warnings.warn(stop.sentence, DiagnosisWarning, stacklevel=2)
            raise
        self._set(result.attributes())
        if settings.cv is not None:
            self._add_gain(settings.cv)
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
        self._add_gain(int(cv))
        return self

    def gain_on(self, X_test: ArrayLike, y_test: ArrayLike, y_err: Any = None) -> HeldOutGain:
        """Return the gain on a test set, from the fitted models before and after.

        Parameters
        ----------
        X_test : array-like of shape (n, n_columns)
        y_test : array-like of shape (n,)
        y_err : float, str, array-like of the shape of y_test, or None, default=None
            Their errors, where ``fit`` had some. None: the median of those.
        """
        check_is_fitted(self)
        y = self.measured_outputs(y_test, "y_test")
        return gain_on(self.estimator_, self.extended_estimator_, X_test, y, y_err)

    def next_runs(self, n: int = 10) -> pd.DataFrame:
        """Return the runs that would reduce the uncertainty of the emulator most.

        At the measured rows, for the models before and after and for the alternatives. A run that
        will probably fail, as the runs that did show, counts as little as it informs. Run them and
        add them to the data (`SimulationData.with_rows`), or let `refine` do both.

        Parameters
        ----------
        n : int, default=10

        Returns
        -------
        pandas.DataFrame of n rows
            Inputs, parameters and assumed constants; where runs are curves without the input along
            which they are.

        Raises
        ------
        ValueError
            Where the simulation is run itself, or its emulator has no uncertainty.
        """
        check_is_fitted(self)
        check_scalar(n, "n", Integral, min_val=1)
        simulation = self.estimator_.data_.simulation
        models = self.estimator_, self.extended_estimator_
        return next_runs(self.search_, [m.posterior_ for m in models], int(n), simulation)

    def next_measurements(
        self,
        n: int = 5,
        places: ArrayLike | None = None,
        cost: ArrayLike | Callable[[pd.DataFrame], ArrayLike] | None = None,
    ) -> pd.DataFrame:
        """Return where to take n further measurements together, to separate the alternatives.

        Each in turn is the place that informs most, for its cost, about which alternative is true.
        Those before it are taken as measured, on average over their possible values. Beyond the
        measured range every alternative has a remainder as large as its effect (`Remainder`), so
        its predictions there count for less.

        Parameters
        ----------
        n : int, default=5
            Measurements; a place may be measured more than once.
        places : array-like of shape (m, n_columns), default=None
            Where a measurement is possible, with the columns of the measured data. None: at up to
            400 places within the ranges that were simulated.
        cost : array-like of shape (m,) or callable, default=None
            Of one measurement at each place, of several outputs of each output in turn; a callable
            takes the table of places and returns their costs. None: all cost the same.

        Returns
        -------
        pandas.DataFrame of n rows
            In the order in which they were chosen: the measured columns, of several outputs which
            "output", "information" (expected further reduction of the uncertainty about which
            alternative is true, in bits, to about 0.02) and "cost".

        Raises
        ------
        ValueError
            For costs that are not positive and finite, or not one for each place.

        Examples
        --------
        >>> import hybridsurrogate as hs
        >>> from hybridsurrogate.datasets import make_log_sin
        >>> case = make_log_sin(random_state=0)
        >>> model = hs.PowerScaledSurrogate(
        ...     case.simulator, surrogate=hs.ExactSurrogate(), random_state=0)
        >>> diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
        >>> following = diagnosis.fit(case.X, case.y).next_measurements(3)
        >>> list(following)
        ['x', 'information', 'cost']
        """
        check_is_fitted(self)
        check_scalar(n, "n", Integral, min_val=1)
        return next_measurements(self.result_.asked, self.estimator_, int(n), places, cost)

    def update(self, X: ArrayLike, y: ArrayLike, y_err: Any = None) -> Monitor:
        """Test whether the extension is still right, as measurements come in.

        A test that may be looked at after every measurement: a right extension ever raises an alarm
        with probability ``false_alarm_rate`` at most. It looks for a shift, or a wider spread, that
        begins at some measurement and lasts. Nothing is fitted anew but the extension's numbers;
        after an alarm diagnose again, with the new measurements.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
            New rows, in the order in which they were measured, after those of earlier calls.
        y : array-like of shape (n,), or (n, n_outputs) of several outputs
        y_err : float, str, array-like of the shape of y, or None, default=None
            Their errors, where ``fit`` had some. None: the median of those.

        Returns
        -------
        Monitor
            Of all new measurements since ``fit``; also ``monitor_``.

        Examples
        --------
        >>> import hybridsurrogate as hs
        >>> from hybridsurrogate.datasets import make_log_sin
        >>> case = make_log_sin(random_state=0)
        >>> model = hs.PowerScaledSurrogate(
        ...     case.simulator, surrogate=hs.ExactSurrogate(), random_state=0)
        >>> diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
        >>> now = diagnosis.fit(case.X, case.y).update(case.X_in[:20], case.y_in[:20] + 5.0)
        >>> now.holds
        False
        """
        check_is_fitted(self)
        before, after, result = self.estimator_, self.extended_estimator_, self.result_
        rows = result.rows
        known = rows._replace(
            X=complete_table(rows.X, labels=before.experiment), y=self.measured_outputs(rows.y)
        )
        earlier = self._new if hasattr(self, "monitor_") else known.take(slice(0))
        self._new = followed(before, after, X, y, y_err, earlier._replace(weights=None))
        rate = result.settings.false_alarm_rate
        self.monitor_ = monitored(after, self.search_, known, self._new, rate)
        return self.monitor_

    def beta_scan(
        self,
        X: ArrayLike | None = None,
        y: ArrayLike | None = None,
        betas: ArrayLike | None = None,
        *,
        out_of_range: bool = False,
    ) -> pd.DataFrame | None:
        """Return held-out ELPD against beta, before and after the extension.

        How far the best beta rises (the largest of those that are as good) is how far trust in the
        simulation rises once its fault is named. Three folds, the cause held fixed, importance
        draws alone: seconds for a polynomial, minutes for a surrogate with hyperparameters.

        Parameters
        ----------
        X, y : array-like of shape (n, n_columns), (n,), or None
            Measured data, as for ``fit``. None: those of ``fit``, at five weights from 0.05 to
            0.95, tried when first asked for.
        betas : array-like, in any order, default=0, 0.1, ..., 1
        out_of_range : bool, default=False
            On the rows of ``gain_out_of_range_`` instead: of the measured data at the five
            weights.

        Returns
        -------
        pandas.DataFrame or None
            Columns beta, before, after, and before_error and after_error: the standard error of
            each score's difference from that at the best weight, paired by rows. At the five
            weights None where there is no weight to choose, as of a simulation that is itself run.
            None too where it takes minutes (hyperparameters or more than 100 coefficients), and
            out of range without such rows.
        """
        check_is_fitted(self)
        if (X is None) != (y is None):
            raise ValueError("beta_scan takes X and y, or neither for the data of fit.")
        if check_flag(out_of_range, "out_of_range") and not (X is None and betas is None):
            raise ValueError(
                "out_of_range=True scans the data of fit at five weights: leave out X, y and betas."
            )
        if X is None and betas is None:
            return self.beta_scans_.few(out_of_range, bool(self.progress))
        return self.beta_scans_.own(X, y, betas, bool(self.progress))

    def sensitivity(self) -> pd.DataFrame:
        """Return the verdict under priors that are halved and doubled: whether it rests on one.

        The odds of "nothing is wrong", the standard deviation of every parameter and the largest
        size of an effect are changed in turn, to first order around the fits of the search. It
        takes about as long as one look at the catalogue. How sensitive an estimate is:
        ``arviz.psens`` of ``extended_estimator_.to_arviz()``.

        Returns
        -------
        pandas.DataFrame
            Columns ``prior``, ``factor``, ``verdict``, ``cause``, ``probability`` (of this kind),
            ``nothing`` (probability that nothing is wrong) and ``changes``: whether verdict or
            cause differ from the first row, under the priors as given.

        Examples
        --------
        >>> import hybridsurrogate as hs
        >>> from hybridsurrogate.datasets import make_log_sin
        >>> case = make_log_sin(random_state=0)
        >>> model = hs.PowerScaledSurrogate(
        ...     case.simulator, surrogate=hs.ExactSurrogate(), random_state=0)
        >>> diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
        >>> table = diagnosis.fit(case.X, case.y).sensitivity()
        >>> len(table), bool(table["changes"][0])
        (7, False)
        """
        check_is_fitted(self)
        return prior_sensitivity(self.result_)

    def parameter_course(self, n: int = 101) -> pd.DataFrame:
        """Return the parameter that would have to vary, over the input along which it wanders.

        Of a detected `ParameterProcess`; the most probable explanation counts.

        Parameters
        ----------
        n : int, default=101
            Places over the measured range.

        Returns
        -------
        pandas.DataFrame
            Columns parameter, over (the input), x, mean, lower and upper (90 % band at each place),
            and constant: the mean without the cause. `plotting.plot_parameter_course` draws it.

        Raises
        ------
        ValueError
            Where no parameter wanders.

        Examples
        --------
        >>> import numpy as np
        >>> import hybridsurrogate as hs
        >>> from hybridsurrogate.plotting import plot_parameter_course
        >>> simulator = hs.Simulator(
        ...     lambda t, height: height * np.sin(t), inputs={"t": (0, 9)},
        ...     parameters={"height": hs.truncated_normal(3, 1, 0.1, 9)})
        >>> t, random = np.linspace(0, 9, 60), np.random.default_rng(0)
        >>> heights = 3 * np.exp(0.4 * np.sin(t**2 / 10))
        >>> y = heights * np.sin(t) + 0.1 * random.standard_normal(60)
        >>> model = hs.PowerScaledSurrogate(
        ...     simulator, surrogate=hs.ExactSurrogate(), random_state=0)
        >>> diagnosis = hs.DiscrepancyDiagnosis(
        ...     model, causes=[hs.ParameterProcess("height")], cv=None, random_state=0)
        >>> course = diagnosis.fit(t[:, None], y).parameter_course()
        >>> plot_parameter_course(course).get_ylabel()
        'height'
        """
        check_is_fitted(self)
        check_scalar(n, "n", Integral, min_val=2)
        table = parameter_course(self.estimator_, leading(self.extended_estimator_), int(n))
        if table.empty:
            raise ValueError(
                f"No parameter wanders: the verdict is {self.verdict_!r}, with the cause "
                f"{self.best_cause_.kind!r}. Whether one would have to is compared where you pass "
                'it: causes=[hs.ParameterProcess("rate"), ...].'
            )
        return table

    def measured_outputs(self, y: ArrayLike, word: str = "y") -> FloatArray:
        """Return outputs as the fitted models read them, (n,), or (n, k) with NaN of several.

        Parameters
        ----------
        y : array-like of shape (n,) or (n, k)
        word : str, default="y"
            What to call it in an error.
        """
        return self.estimator_.measured_outputs(y, word)

    def predict(self, X: ArrayLike, return_std: bool = False, y_err: Any = None) -> Any:
        """Return predictions of the extended estimator.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
            The columns of the measured data.
        return_std : bool, default=False
            Also return the standard deviation of y, noise included.
        y_err : float, str, array-like of the shape of y, or None, default=None
            Errors of measurements there, where ``fit`` had some. None: the median of those.

        Returns
        -------
        mean : ndarray of shape (n,)
        std : ndarray of shape (n,)
            Only with ``return_std=True``.
        """
        check_is_fitted(self)
        return self.extended_estimator_.predict(X, return_std=return_std, y_err=y_err)

    def score(
        self,
        X: ArrayLike,
        y: ArrayLike,
        sample_weight: ArrayLike | None = None,
        y_err: Any = None,
        below: ArrayLike | None = None,
        above: ArrayLike | None = None,
    ) -> float:
        """Return the mean ELPD per row of the extended estimator.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
        y : array-like of shape (n,), or (n, k) of several outputs
        sample_weight : array-like of shape (n,) or None
            Weights of the rows in the mean.
        y_err : float, str, array-like of the shape of y, or None, default=None
            As in ``predict``.
        below, above : float, array-like of shape (n,), (k,) or (n, k), or None, default=None
            Limits of the instrument at these rows, of several outputs of each: a y at its limit or
            beyond counts with the probability of that. None: those of the likelihood.
        """
        check_is_fitted(self)
        return self.extended_estimator_.score(X, y, sample_weight, y_err, below, above)

    def to_python(
        self, path: str | os.PathLike[str] | None = None, units: Mapping[str, str] | None = None
    ) -> str | None:
        """Write the extended model as a separate Python module, or return its source.

        Its function ``extended`` takes your simulation, measured columns and, with their estimates
        as defaults, the parameters; each cause is a separate function. Of an `OdeSimulator` it
        takes ``rhs`` and ``observe``, and solves the changed equations by scipy. It contains the
        detected causes, not the average over all explanations.

        Parameters
        ----------
        path : str, path or None, default=None
            The file; None: the source is returned.
        units : mapping of name to str or None, default=None
            Units of measured columns, outputs and parameters, such as ``{"co2": "ppm"}``; without
            them a column's name stands for its unit.

        Returns
        -------
        str or None
            None where a file was written.

        Raises
        ------
        OSError
            Where no such file can be written; one that is there is replaced as a whole.
        ValueError, TypeError
            For units of what there is not, and for a user-defined cause or likelihood that
            has no expression.

        Examples
        --------
        >>> import hybridsurrogate as hs
        >>> from hybridsurrogate.datasets import make_log_sin
        >>> case = make_log_sin(random_state=0)
        >>> model = hs.PowerScaledSurrogate(
        ...     case.simulator, surrogate=hs.ExactSurrogate(), random_state=0)
        >>> diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
        >>> source = diagnosis.fit(case.X, case.y).to_python()
        >>> "def periodic(" in source, "def extended(" in source
        (True, True)
        """
        check_is_fitted(self)
        if path is not None:
            check_writable(path)
        source = python_source(extended_model(self.result_, units))
        if path is None:
            return source
        with written_whole(path) as part:
            part.write_text(source, encoding="utf-8")
        return None

    def report(
        self,
        test: tuple[ArrayLike, ArrayLike] | None = None,
        beta_scan: bool = False,
        units: Mapping[str, str] | None = None,
        full: bool = False,
    ) -> Report:
        """Return the report: prints as text, shows as HTML, ``.save("report.html")``.

        Parameters
        ----------
        test : (X_test, y_test) or None, default=None
            Rows held out, for example beyond the measured range, to be drawn and scored too.
        beta_scan : bool, default=False
            Also report ``beta_scan()``, within the measured range and beyond it, which takes
            longer than all else in the report. Scans that were tried before are reported anyway.
        units : dict of str to str or None, default=None
            Units of columns, outputs and parameters, such as ``{"co2": "ppm"}``.
        full : bool, default=False
            Whether the text has the details too; HTML always has them, folded.

        Returns
        -------
        Report

        Raises
        ------
        ValueError
            For units of unknown columns.
        """
        check_is_fitted(self)
        from hybridsurrogate.diagnosis.report.report import make_report

        beta_scan, full = check_flag(beta_scan, "beta_scan"), check_flag(full, "full")
        return make_report(self.result_, self._held_out(test), beta_scan, units, full)

    def _held_out(self, test: Any) -> tuple[Any, FloatArray] | None:
        """Return held-out rows and outputs; TypeError where these are no pair."""
        if test is None:
            return None
        if not isinstance(test, tuple | list) or len(test) != 2:
            raise TypeError(f"test must be a pair (X_test, y_test), got {described(test)}.")
        return test[0], self.measured_outputs(test[1], "y_test")

    def plot(
        self,
        test: tuple[ArrayLike, ArrayLike] | None = None,
        units: Mapping[str, str] | None = None,
        axes: Sequence[Axes] | None = None,
    ) -> list[Axes]:
        """Draw the one picture of the report: data, simulation and extended model, residuals.

        Parameters
        ----------
        test : (X_test, y_test) or None, default=None
            Rows held out.
        units : dict of str to str or None, default=None
            Units of columns and outputs, for the labels.
        axes : sequence of two matplotlib Axes, default=None
            Where to draw, predictions above residuals; None: on a new pyplot figure.

        Returns
        -------
        list of two matplotlib Axes
        """
        check_is_fitted(self)
        import matplotlib.pyplot as plt

        from hybridsurrogate.diagnosis.report.details.pictures import overview
        from hybridsurrogate.diagnosis.report.elements.view import view_of

        # before a figure is made
        view, held_out = view_of(self.result_, units), self._held_out(test)
        if axes is None:
            axes = plt.subplots(2, 1, sharex=True, figsize=(7.2, 4.8), layout="constrained")[1]
        return overview(view, held_out, axes)

    def _set(self, found: Mapping[str, Any]) -> None:
        """Put what was found in place of all that an earlier fit found."""
        for name in [name for name in vars(self) if name.endswith("_")]:
            delattr(self, name)
        for name, value in found.items():
            setattr(self, name, value)

    def _add_gain(self, cv: int) -> None:
        try:
            result = with_gain(self.result_, cv, self.n_jobs, bool(self.progress))
        except KeyboardInterrupt:
            warnings.warn(
                "The folds of the diagnosis were interrupted: there is no gain. All else is kept, "
                "as with cv=None.",
                DiagnosisWarning,
                stacklevel=3,
            )
            raise
        self.result_ = result
        self.gain_, self.gain_out_of_range_ = result.gain, result.gain_out_of_range
