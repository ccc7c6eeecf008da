"""Runs predicted from all others, in closed form: how good an emulator is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.spatial import cKDTree

from hybridsurrogate.emulators.conditioned import KrigedBasis, KrigedCurves
from hybridsurrogate.surrogates.emulation.process import used_rows
from hybridsurrogate.types import FloatArray

# places of one run, in lengths of the process
_SAME = 1e-9


class LeftOut(NamedTuple):
    """Outputs, and what an emulator of all other runs predicts for them.

    Attributes
    ----------
    rows : ndarray of shape (n,)
        Which of the runs' rows.
    y, mean, sd : ndarray of shape (n,)
    """

    rows: NDArray[np.intp]
    y: FloatArray
    mean: FloatArray
    sd: FloatArray

    @property
    def q2(self) -> float:
        """1 - sum (y - mean)^2 / sum (y - average)^2: 1 where every run is predicted exactly."""
        total = np.sum((self.y - np.mean(self.y)) ** 2)
        return float(1 - np.sum((self.y - self.mean) ** 2) / total) if total else 1.0

    @property
    def pit(self) -> FloatArray:
        """Where each output lies in its predictive distribution, (n,): uniform if that is right."""
        return np.asarray(stats.norm.cdf(self.y, self.mean, np.maximum(self.sd, 1e-300)))

    def coverage(self, level: float = 0.9) -> float:
        """Return the share of outputs in their central intervals."""
        return float(np.mean(np.abs(self.pit - 0.5) <= level / 2))


def of_process(basis: KrigedBasis, y: FloatArray) -> LeftOut:
    """Return the runs of a process, each given all others (Rasmussen and Williams 2006, 5.12).

    Parameters
    ----------
    basis : KrigedBasis
        With the error of all its runs.
    y : ndarray of shape (n,)
        Outputs of all runs.
    """
    rows = used_rows(len(y))
    y = y[rows]
    precision = np.sum(basis.whiten**2, axis=0)
    sd = basis.sd * basis.local.at(basis.runs.points) / np.sqrt(precision)
    return LeftOut(rows, y, y - basis.weights / precision, sd)


def of_curves(basis: KrigedCurves, X: FloatArray, omega: FloatArray, y: FloatArray) -> LeftOut:
    """Return the rows of runs that are curves, each curve given all others.

    Parameters
    ----------
    basis : KrigedCurves
    X, omega, y : ndarray of shape (n, n_inputs), (n, n_parameters), (n,)
    """
    emulator = basis.emulator
    none = np.empty((len(X), 0))
    places = emulator.process.places(none, np.hstack([basis.of_runs(X), omega])).points
    # those that the process is conditioned on, if there are more
    apart, run = cKDTree(emulator.runs.points).query(places)
    used = np.flatnonzero(apart < _SAME)
    X, omega, y, run = X[used], omega[used], y[used], run[used]
    precision = np.sum(emulator.whiten**2, axis=0)
    _, curves, missed = emulator.components.at(X[:, emulator.along])
    error = np.sum(curves * (emulator.weights / precision[:, None])[run], axis=1)
    scale = (emulator.local.at(emulator.runs.points) / np.sqrt(precision))[run]
    sd = np.hypot(scale * np.sqrt(np.sum((curves * emulator.sd) ** 2, axis=1)), missed)
    return LeftOut(used, y, emulator.output(X, omega) - error, sd)
