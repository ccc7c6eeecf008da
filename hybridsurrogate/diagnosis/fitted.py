"""What a fitted diagnosis answers: predictions, scores, the simulation's weight, the report."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from numbers import Integral
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from sklearn import get_config
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils import check_consistent_length, check_scalar
from sklearn.utils.validation import check_is_fitted

from hybridsurrogate.arguments.description import described
from hybridsurrogate.arguments.scalars import check_flag
from hybridsurrogate.diagnosis.answers.experimental_design import (
    batch,
    costs_of,
    places_between,
    table_of,
)
from hybridsurrogate.diagnosis.answers.monitor import Monitor, joined, monitored
from hybridsurrogate.diagnosis.answers.next_runs import next_runs
from hybridsurrogate.diagnosis.answers.python_code import extended_model, python_source
from hybridsurrogate.diagnosis.answers.result import DiagnosisResult
from hybridsurrogate.diagnosis.search.evidence import Search
from hybridsurrogate.diagnosis.stored import restored, stored
from hybridsurrogate.diagnosis.validation.beta_scan import BetaScans, scan_beta, scan_folds
from hybridsurrogate.diagnosis.validation.gain import HeldOutGain, gain_from, pointwise
from hybridsurrogate.model.rows.measured_rows import without_gaps
from hybridsurrogate.numerics.atomic_file import check_writable, written_whole
from hybridsurrogate.simulation.arrays import as_numbers, complete_table
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


class FittedDiagnosis(RegressorMixin, BaseEstimator):
    """What `DiscrepancyDiagnosis` answers once it is fitted."""

    estimator_: Any
    extended_estimator_: Any
    beta_scans_: BetaScans
    result_: DiagnosisResult
    search_: Search
    progress: bool
    _rows: tuple[ArrayLike, ArrayLike]
    _weights: FloatArray | None
    _new: tuple[Any, FloatArray]

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
        from .report.report import short_html

        return short_html(self)

    def _repr_mimebundle_(self, **kwargs: Any) -> dict[str, str]:
        # scikit-learn's own prints every fitted attribute
        out = {"text/plain": repr(self)}
        if get_config()["display"] == "diagram":
            out["text/html"] = self._repr_html_inner()
        return out

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "n_features_in_")

    def gain_on(self, X_test: ArrayLike, y_test: ArrayLike) -> HeldOutGain:
        """Return the gain on a test set, from the fitted models before and after.

        Parameters
        ----------
        X_test : array-like of shape (n, n_columns)
        y_test : array-like of shape (n,)
        """
        check_is_fitted(self)
        y = self.measured_outputs(y_test, "y_test")
        before, after = self.estimator_, self.extended_estimator_
        return gain_from(pointwise(before, X_test, y), pointwise(after, X_test, y))

    def next_runs(self, n: int = 10) -> pd.DataFrame:
        """Return the runs that would reduce the uncertainty of the emulator most.

        At the measured rows, for the models before and after and for the alternatives. Run them and
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
        simulation = self.estimator_.simulation_
        models = self.estimator_, self.extended_estimator_
        names = [*simulation.input_names, *simulation.parameter_ranges]
        return next_runs(self.search_, [m.posterior_ for m in models], int(n), names)

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
        found, fitted = self.result_.asked, self.estimator_
        if places is None:
            rows = places_between(found, fitted.simulation_.input_ranges)
        else:
            rows = fitted.checked_rows(places)
        table = table_of(found, rows, fitted.experiments_)
        costs = costs_of(table, cost)
        chosen, bits = zip(*batch(found, rows, int(n), costs), strict=True)
        table = table.iloc[list(chosen)].reset_index(drop=True)
        return table.assign(information=bits, cost=costs[list(chosen)])

    def update(self, X: ArrayLike, y: ArrayLike) -> Monitor:
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
        labels = self.estimator_.experiment
        if len(self.estimator_.simulation.outputs) == 1:
            X, y, _ = without_gaps(X, y)
        X, y = complete_table(X, labels=labels), self.measured_outputs(y)
        check_consistent_length(X, y)
        self.extended_estimator_.checked_rows(X)
        known_X, known_y = complete_table(self._rows[0], labels=labels), self._rows[1]
        if hasattr(self, "monitor_"):
            X, y = joined(self._new[0], X), np.concatenate([self._new[1], y])
        self._new = joined(known_X[:0], X), y
        self.monitor_ = monitored(
            self.extended_estimator_,
            self.search_,
            (known_X, self.measured_outputs(known_y), self._weights),
            self._new,
            self.result_.false_alarm_rate,
        )
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
        given = X is None or y is None
        rows, values = self._rows if X is None or y is None else (X, y)
        grid = np.linspace(0, 1, 11) if betas is None else np.unique(as_numbers(betas, "betas"))
        labels = self.estimator_.experiment
        rows, values, _ = without_gaps(rows, values)
        rows, values = complete_table(rows, labels=labels), self.measured_outputs(values, "y")
        folds = scan_folds(values)
        scans, weights = self.beta_scans_, self._weights if given else None
        return scan_beta(
            scans.models, grid, folds, rows, values, scans.n_jobs, weights, bool(self.progress)
        )

    def measured_outputs(self, y: ArrayLike, word: str = "y") -> FloatArray:
        """Return outputs as the fitted models read them, (n,), or (n, k) with NaN of several.

        Parameters
        ----------
        y : array-like of shape (n,) or (n, k)
        word : str, default="y"
            What to call it in an error.
        """
        return self.estimator_.measured_outputs(y, word)

    def predict(self, X: ArrayLike, return_std: bool = False) -> Any:
        """Return predictions of the extended estimator.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
            The columns of the measured data.
        return_std : bool, default=False
            Also return the standard deviation of y, noise included.

        Returns
        -------
        mean : ndarray of shape (n,)
        std : ndarray of shape (n,)
            Only with ``return_std=True``.
        """
        check_is_fitted(self)
        return self.extended_estimator_.predict(X, return_std=return_std)

    def score(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> float:
        """Return the mean ELPD per row of the extended estimator.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
        y : array-like of shape (n,)
        sample_weight : array-like of shape (n,) or None
            Weights of the rows in the mean.
        """
        check_is_fitted(self)
        return self.extended_estimator_.score(X, y, sample_weight)

    def to_python(
        self,
        path: str | os.PathLike[str] | None = None,
        units: Mapping[str, str] | None = None,
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
        source = python_source(extended_model(self, units))
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
        from .report import make_report

        beta_scan, full = check_flag(beta_scan, "beta_scan"), check_flag(full, "full")
        return make_report(self, self._held_out(test), beta_scan, units, full)

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

        from .report.elements.view import view_of
        from .report.first_screen.picture import overview

        # before a figure is made
        view, held_out = view_of(self, units), self._held_out(test)
        if axes is None:
            axes = plt.subplots(2, 1, sharex=True, figsize=(7.2, 4.8), layout="constrained")[1]
        return overview(view, held_out, axes)
