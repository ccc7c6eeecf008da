"""What a fitted diagnosis answers: predictions, scores, the simulation's weight, the report."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted

from hybridsurrogate.arrays import as_outputs, complete_table
from hybridsurrogate.diagnosis.averaging import averaged_over
from hybridsurrogate.diagnosis.forward import Step
from hybridsurrogate.diagnosis.gain import Gain, gain_from, pointwise
from hybridsurrogate.diagnosis.rehearsal import accepted
from hybridsurrogate.diagnosis.trust import BetaScans, scan_beta, scan_folds
from hybridsurrogate.estimators.averaged import AveragedSurrogate


class FittedDiagnosis(RegressorMixin, BaseEstimator):
    """What `DiscrepancyDiagnosis` answers once it is fitted."""

    estimator_: Any
    extended_estimator_: Any
    _scans: BetaScans
    _steps: tuple[Step, ...]
    _rows: tuple[ArrayLike, ArrayLike]

    @cached_property
    def averaged_estimator_(self) -> AveragedSurrogate:
        """Predictions averaged over the causes, by their probabilities."""
        check_is_fitted(self)
        *earlier, last = self._steps
        return averaged_over(last.beside, self.estimator_, accepted(earlier), *self._rows)

    @property
    def beta_scan_(self) -> pd.DataFrame | None:
        """`beta_scan` at a few weights; None where it makes no sense or takes minutes."""
        check_is_fitted(self)
        return self._scans.within

    @property
    def beta_scan_out_of_range_(self) -> pd.DataFrame | None:
        """The same on the rows behind ``gain_out_of_range_``; None without them."""
        check_is_fitted(self)
        return self._scans.beyond

    def gain_on(self, X_test: ArrayLike, y_test: ArrayLike, averaged: bool = False) -> Gain:
        """Return the gain on a test set, from the fitted models before and after.

        Parameters
        ----------
        X_test : array-like of shape (n, n_columns)
        y_test : array-like of shape (n,)
        averaged : bool, default=False
            The model after is ``averaged_estimator_`` instead of ``extended_estimator_``.
        """
        check_is_fitted(self)
        y = as_outputs(y_test, "y_test")
        after = self.averaged_estimator_ if averaged else self.extended_estimator_
        return gain_from(pointwise(self.estimator_, X_test, y), pointwise(after, X_test, y))

    def beta_scan(self, X: ArrayLike, y: ArrayLike, betas: ArrayLike | None = None) -> pd.DataFrame:
        """Return held-out ELPD against beta, before and after the extension.

        How far the best beta rises (the largest of those that are as good) is how far trust in the
        simulation rises once its fault is named. Three folds, the cause held fixed, importance
        draws alone: seconds for a polynomial, minutes for a surrogate with hyperparameters.

        Parameters
        ----------
        X, y
            Measured data, as for ``fit``.
        betas : array-like, in any order, default=0, 0.1, ..., 1

        Returns
        -------
        pandas.DataFrame
            Columns beta, before, after, and before_error and after_error: the standard error of
            each score's difference from that at the best weight, paired by rows.
        """
        check_is_fitted(self)
        grid = np.linspace(0, 1, 11) if betas is None else np.unique(np.asarray(betas, dtype=float))
        X, y = complete_table(X), as_outputs(y)
        return scan_beta(self._scans.models, grid, scan_folds(y), X, y, self._scans.n_jobs)

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

    def report(self, test: tuple[ArrayLike, ArrayLike] | None = None) -> Any:
        """Return the report: prints as text, shows as HTML, ``.save("report.html")``.

        Parameters
        ----------
        test : (X_test, y_test) or None
            Rows held back, for example beyond the measured range, to be drawn and scored too.
        """
        check_is_fitted(self)
        from .report import make_report

        return make_report(self, test)
