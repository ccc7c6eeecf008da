"""The simulation as its runs tell it: the surrogate's terms and a process through what they miss.

A polynomial that misses the simulation by a curve would otherwise have that curve blamed on the
simulation, and one with more terms than runs says anything between them. So a search takes the
surrogate's terms as the trend of a Gaussian process, as in polynomial-chaos Kriging (Schoebi,
Sudret and Wiart 2015, International Journal for Uncertainty Quantification 5:171), and learns from
the runs how much of each it takes. What is still unknown between the runs is part of the
covariance of the measured rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from hybridsurrogate.diagnosis.covariance import Apart, Covariance, alike, bent, learned
from hybridsurrogate.inference.blocks import blocks
from hybridsurrogate.inference.cholesky import nudged_cholesky
from hybridsurrogate.inference.linearised import Belief
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.simulation import SimulationData
from hybridsurrogate.surrogates.base import Basis

# the covariance is learned from at most this many runs; as many as the second limit are used,
# drawn at random, as files of runs are often in order
_LEARN, _RUNS = 200, 500
# what is left of a variance when its factor has enough columns, in shares of the largest
_NEGLIGIBLE = 1e-4


@dataclass(frozen=True)
class KrigedBasis(Basis):
    """The most probable simulation given its runs, without free coefficients, and its error.

    Attributes
    ----------
    basis : Basis
        The surrogate's.
    c : ndarray of shape (p,)
        Coefficients of its terms; p is 0 where the runs have no use for them.
    ranges : ndarray of shape (n_inputs + n_parameters, 2)
        Of the runs.
    runs : ndarray of shape (n_runs, n_inputs + n_parameters + 2)
        Right halves of their distances.
    terms : ndarray of shape (n_runs, p)
        Times ``term_sd``.
    term_sd : ndarray of shape (p,)
        Prior sd of the coefficients in units of the process's.
    covariance : Covariance
    weights : ndarray of shape (n_runs,)
        Of the process.
    whiten : ndarray of shape (n_runs, n_runs)
        Inverse of the lower factor of the runs' covariance in units of the process's variance.
    sd : float
        Of the process.
    """

    basis: Basis
    c: FloatArray
    ranges: FloatArray
    runs: FloatArray
    terms: FloatArray
    term_sd: FloatArray
    covariance: Covariance
    weights: FloatArray
    whiten: FloatArray
    sd: float

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        """Return the terms plus the process."""
        if len(self.c):
            return self.basis.output(X, omega, self.c) + self._process(X, omega)
        return self.basis.known(X, omega) + self._process(X, omega)

    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return no features."""
        return np.empty((len(X), 0))

    def output(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the terms plus the process."""
        return self.known(X, omega)

    def outer_output(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the output of all inputs for all parameters."""
        rows, points = np.tile(X.T, (1, len(omega))).T, np.repeat(omega.T, len(X), axis=1).T
        process = self._process(rows, points).reshape(len(omega), len(X))
        if len(self.c):
            return self.basis.outer_output(X, omega, self.c) + process
        return self.basis.known(rows, points).reshape(process.shape) + process

    def error(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return F (n, r): the covariance of what is unknown of the simulation is F F'."""
        points, terms = self._halves(X, omega), self._terms(X, omega)
        white = (alike(points.squares(self.runs)) + terms @ self.terms.T) @ self.whiten.T

        def column(k: int) -> FloatArray:
            own = alike(points.squares(points.right[k]))
            return own + terms @ terms[k] - white @ white[k]

        diagonal = 1 + np.sum(terms**2, axis=1) - np.sum(white**2, axis=1)
        return self.sd * _factor(np.maximum(diagonal, 0.0), column)

    def _process(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        return np.concatenate(
            [
                alike(self._halves(X[k], omega[k]).squares(self.runs)) @ self.weights
                for k in blocks(len(X), len(self.runs))
            ]
        )

    def _terms(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        if not len(self.c):
            return np.empty((len(X), 0))
        return self.basis.features(X, omega) * self.term_sd

    def _halves(self, X: FloatArray, omega: FloatArray) -> Apart:
        points = _between(np.hstack([X, omega]), *self.ranges.T)
        return Apart.of(bent(points, self.covariance.bends) / self.covariance.lengths)


def _between(points: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Map ranges to [0, 1]: beyond the runs nothing is known, the process is held at the edge."""
    return (np.clip(points, low, high) - low) / (high - low)


def _factor(diagonal: FloatArray, column: Callable[[int], FloatArray]) -> FloatArray:
    """Return F (n, r) with F F' the covariance: Cholesky's, largest variance first, cut short.

    Covariances of smooth curves need few columns, and only these are asked for (Harbrecht, Peters
    and Schneider 2012, Applied Numerical Mathematics 62:428).
    """
    left = diagonal.copy()
    least = _NEGLIGIBLE * float(np.max(diagonal, initial=0.0))
    columns = np.empty((min(len(left), 32), len(left)))
    for r in range(len(left)):
        k = int(np.argmax(left))
        if left[k] <= least:
            return columns[:r].T.copy()
        if r == len(columns):  # many rows of a smooth curve need no square of their number
            columns = np.concatenate([columns, np.empty_like(columns)])
        columns[r] = (column(k) - columns[:r, k] @ columns[:r]) / np.sqrt(left[k])
        left -= columns[r] ** 2
    return columns[: len(left)].T.copy()


def krige(
    basis: Basis, belief: Belief, simulation: SimulationData, run_eta: FloatArray
) -> tuple[Basis, Belief]:
    """Return the simulation as its runs tell it, and the belief about its coefficients.

    Parameters
    ----------
    basis : Basis
        The surrogate's.
    belief : Belief
        About its coefficients, from the runs.
    simulation : SimulationData
    run_eta : ndarray of shape (n_runs,)
        Outputs of the runs on the scale of eta.

    Returns
    -------
    KrigedBasis and the belief about no coefficients; what was given where that fits all runs.
    """
    features = basis.features(simulation.X, simulation.omega)
    residual = run_eta - basis.known(simulation.X, simulation.omega)
    missed = float(np.sqrt(np.mean((residual - features @ belief.mean) ** 2)))
    # exact to rounding; with as many terms as runs that says nothing
    if missed < 1e-6 * np.std(run_eta) and len(run_eta) > features.shape[1]:
        return basis, belief
    chosen = np.random.default_rng(0).permutation(len(residual))[:_RUNS]
    residual, features = (residual - features @ basis.coefficient_mean)[chosen], features[chosen]
    n = len(residual)
    ranges = np.array(
        [*simulation.input_ranges.values(), *simulation.parameter_ranges.values()], dtype=float
    )
    runs = _between(np.hstack([simulation.X, simulation.omega])[chosen], *ranges.T)
    terms = features * basis.coefficient_sd
    covariance = learned(runs[:_LEARN], terms[:_LEARN], residual[:_LEARN])
    size = float(np.mean(np.sum(terms[:_LEARN] ** 2, axis=1)))
    relative = np.sqrt(covariance.share / max(size, 1e-300))
    used = slice(None if covariance.share or np.any(basis.coefficient_mean) else 0)
    c, term_sd = basis.coefficient_mean[used], relative * basis.coefficient_sd[used]
    terms = relative * terms[:, used]
    halves = Apart.of(bent(runs, covariance.bends) / covariance.lengths)
    matrix = alike(halves.squares(halves.right)) + terms @ terms.T
    matrix += covariance.nugget * np.eye(n)
    lower = nudged_cholesky(matrix[None])[0]
    whiten: FloatArray = solve_triangular(lower, np.eye(n), lower=True)
    weights = whiten.T @ (whiten @ residual)
    # leave-one-out errors in units of their sd (Rasmussen and Williams 5.12): 1 on average where
    # the covariance is right
    deviation = weights**2 / np.sum(whiten**2, axis=0)
    variance = max(float(residual @ weights), float(np.sum(deviation))) / n
    kriged = KrigedBasis(
        np.empty(0),
        np.empty(0),
        basis,
        c + term_sd * (terms.T @ weights),
        ranges,
        halves.right,
        terms,
        term_sd,
        covariance,
        weights,
        whiten,
        float(np.sqrt(variance)),
    )
    return kriged, Belief(np.empty(0), np.empty((0, 0)))
