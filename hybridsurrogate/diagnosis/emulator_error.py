"""The emulator's own error, learned from the simulation runs and taken out of the search.

A polynomial that misses the simulation by a curve would otherwise have that curve blamed on the
simulation. The residuals of the runs tell the curve: a Gaussian process through them corrects the
emulator, as in polynomial-chaos Kriging (Schoebi, Sudret and Wiart 2015, International Journal
for Uncertainty Quantification 5:171), and what it misses in turn (leave-one-out) scales the
uncertainty that remains.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Kernel, WhiteKernel

from hybridsurrogate.inference.blocks import blocks
from hybridsurrogate.inference.linearised import Belief
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.simulation import SimulationData
from hybridsurrogate.surrogates.base import Basis

# length scales are learned from at most this many runs; all runs up to the second limit correct
_LEARN, _CORRECT = 200, 1000


@dataclass(frozen=True)
class CorrectedBasis(Basis):
    """A basis plus the mean of a Gaussian process through the residuals of the runs.

    Attributes
    ----------
    basis : Basis
    ranges : ndarray of shape (n_inputs + n_parameters, 2)
        Of the runs.
    lengths : ndarray of shape (n_inputs + n_parameters,)
        Of the process's squared-exponential kernel, where ranges go from -1 to 1.
    runs : ndarray of shape (n_runs, n_inputs + n_parameters)
        In units of the lengths.
    weights : ndarray of shape (n_runs,)
    """

    basis: Basis
    ranges: FloatArray
    lengths: FloatArray
    runs: FloatArray
    weights: FloatArray

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        """Return the basis's known part plus the correction."""
        return self.basis.known(X, omega) + self._correction(X, omega)

    def output(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the basis's output plus the correction."""
        return self.basis.output(X, omega, c) + self._correction(X, omega)

    def outer(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return known part and features of all inputs for all parameters."""
        known, features = self.basis.outer(X, omega)
        return known + self._outer_correction(X, omega), features

    def outer_output(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the output of all inputs for all parameters."""
        return self.basis.outer_output(X, omega, c) + self._outer_correction(X, omega)

    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the basis's features."""
        return self.basis.features(X, omega)

    def _correction(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        points = self._scaled(np.hstack([X, omega]), slice(None))
        pieces = blocks(len(points), len(self.runs))
        return np.concatenate([_alike(points[k], self.runs) @ self.weights for k in pieces])

    def _outer_correction(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return (J, n): the kernel is a product of one of the inputs and one of the parameters."""
        inputs, parameters = slice(0, X.shape[1]), slice(X.shape[1], None)
        of_inputs = _alike(self._scaled(X, inputs), self.runs[:, inputs])
        of_parameters = _alike(self._scaled(omega, parameters), self.runs[:, parameters])
        return (of_parameters * self.weights) @ of_inputs.T

    def _scaled(self, points: FloatArray, columns: slice) -> FloatArray:
        """Return some coordinates of points in units of the lengths."""
        low, high = self.ranges[columns].T
        # beyond the runs the process knows nothing and would fade to zero: hold it at the edge
        held = 2 * (np.clip(points, low, high) - low) / (high - low) - 1
        return held / self.lengths[columns]


def _alike(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return exp(-|a_i - b_k|^2 / 2) for rows of a (n, d) and b (m, d)."""
    # as one product of matrices: a b' - |a|^2 / 2 - |b|^2 / 2
    left = np.column_stack([a, -0.5 * np.sum(a**2, axis=1), np.ones(len(a))])
    right = np.column_stack([b, np.ones(len(b)), -0.5 * np.sum(b**2, axis=1)])
    exponent = left @ right.T
    return np.exp(exponent, out=exponent)


def correct_emulator(
    basis: Basis, belief: Belief, simulation: SimulationData, run_eta: FloatArray
) -> tuple[Basis, Belief]:
    """Return basis and belief with the emulator's error corrected.

    Parameters
    ----------
    basis : Basis
    belief : Belief
        From the simulation alone.
    simulation : SimulationData
    run_eta : ndarray of shape (n_runs,)
        Outputs of the runs on the scale of eta.
    """
    residual = run_eta - basis.known(simulation.X, simulation.omega)
    residual = residual - basis.features(simulation.X, simulation.omega) @ belief.mean
    before = float(np.sqrt(np.mean(residual**2)))
    if before < 1e-6 * np.std(run_eta):
        return basis, belief  # exact to rounding: nothing to correct
    ranges = np.array(
        [*simulation.input_ranges.values(), *simulation.parameter_ranges.values()], dtype=float
    )
    low, high = ranges.T
    points = 2 * (np.hstack([simulation.X, simulation.omega]) - low) / (high - low) - 1
    points, residual = points[:_CORRECT], residual[:_CORRECT]
    kernel = _learned_kernel(points[:_LEARN], residual[:_LEARN])
    smooth, nugget = kernel.k1, kernel.k2.noise_level
    covariance = smooth(points) + (nugget + 1e-10 * before**2) * np.eye(len(points))
    factor = cho_factor(covariance, lower=True)
    weights = cho_solve(factor, residual)
    inverse = cho_solve(factor, np.eye(len(points)))
    left_out = weights / np.diagonal(inverse)  # leave-one-out error (Rasmussen and Williams 5.12)
    after = float(np.sqrt(np.mean(left_out**2)))
    if after >= before:
        return basis, belief
    lengths, variance = smooth.k2.length_scale, smooth.k1.constant_value
    corrected = CorrectedBasis(
        basis.coefficient_mean,
        basis.coefficient_sd,
        basis,
        ranges,
        lengths,
        points / lengths,
        variance * weights,
    )
    return corrected, Belief(belief.mean, belief.factor * (after / before))


def _learned_kernel(points: FloatArray, residual: FloatArray) -> Kernel:
    variance = float(np.mean(residual**2))
    kernel = ConstantKernel(variance, (1e-3 * variance, 1e4 * variance)) * RBF(
        np.full(points.shape[1], 0.5), (0.02, 20.0)
    ) + WhiteKernel(0.1 * variance, (1e-8 * variance, 2 * variance))
    process = GaussianProcessRegressor(kernel)
    with warnings.catch_warnings():
        # a length scale at its bound means an input that does not matter
        warnings.simplefilter("ignore", ConvergenceWarning)
        return process.fit(points, residual).kernel_
