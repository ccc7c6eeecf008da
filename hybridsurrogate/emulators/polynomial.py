"""A surrogate that is linear in its coefficients as an emulator: what it misses is its error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from hybridsurrogate.emulators.left_out import LeftOut
from hybridsurrogate.model.statistics import emulator_posterior, statistics_of_runs
from hybridsurrogate.surrogates.basis import Basis
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class LinearEmulator:
    """Coefficients given the runs, and the size of what they leave.

    Attributes
    ----------
    basis : Basis
    mean : ndarray of shape (p,)
    covariance : ndarray of shape (p, p)
        Of the coefficients, in units of ``sd`` squared.
    sd : float
        Root mean square of what the polynomial misses in runs that are left out.
    left_out : LeftOut
    """

    basis: Basis
    mean: FloatArray
    covariance: FloatArray
    sd: float
    left_out: LeftOut

    def predict(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (n,) at rows of inputs and parameters.

        A polynomial that misses the simulation does so between the runs as at them: what it misses
        is part of the error.
        """
        features = self.basis.features(X, omega)
        leverage = np.einsum("np,pq,nq->n", features, self.covariance, features)
        known = self.basis.known(X, omega) + features @ self.mean
        return known, self.sd * np.sqrt(1 + leverage)


def fit_linear(basis: Basis, X: FloatArray, omega: FloatArray, y: FloatArray) -> LinearEmulator:
    """Return the emulator of a linear basis without hyperparameters.

    Parameters
    ----------
    basis : Basis
    X, omega, y : ndarray of shape (n, n_inputs), (n, n_parameters), (n,)
    """
    features, target = basis.features(X, omega), y - basis.known(X, omega)
    scale = float(np.std(y))
    mean = emulator_posterior(basis, statistics_of_runs(basis, X, omega, y, scale)).mean
    residual = target - features @ mean
    prior = np.diag(basis.coefficient_sd**-2.0)
    variance = max(float(np.mean(residual**2)), (1e-9 * scale) ** 2, 1e-300)
    covariance = cho_solve(cho_factor(features.T @ features + variance * prior), np.eye(len(mean)))
    # a row given all others: Sherman and Morrison's formula
    leverage = np.einsum("np,pq,nq->n", features, covariance, features)
    left = residual / np.maximum(1 - leverage, 1e-6)
    # of so many terms, or of those that were chosen for these runs, residuals are too small: errors
    # of runs that are left out have the size of others
    sd = float(np.sqrt(np.mean(left**2 * np.maximum(1 - leverage, 1e-6))))
    spread = sd / np.sqrt(np.maximum(1 - leverage, 1e-6))
    return LinearEmulator(
        basis, mean, covariance, sd, LeftOut(np.arange(len(y)), y, y - left, spread)
    )
