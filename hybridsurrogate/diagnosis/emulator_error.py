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

from hybridsurrogate.inference.linearised import Belief
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.simulation import SimulationData
from hybridsurrogate.surrogates.base import Basis

# length scales are learned from at most this many runs; all runs up to the second limit correct
_LEARN, _CORRECT = 200, 1000


@dataclass(frozen=True)
class CorrectedBasis(Basis):
    """A basis plus the mean of a Gaussian process through the residuals of the runs."""

    basis: Basis
    ranges: FloatArray
    runs: FloatArray
    weights: FloatArray
    kernel: Kernel

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        """Return the basis's known part plus the correction."""
        low, high = self.ranges.T
        # beyond the runs the process knows nothing and would fade to zero: hold it at the edge
        points = 2 * (np.clip(np.hstack([X, omega]), low, high) - low) / (high - low) - 1
        block = max(1, 4_000_000 // len(self.runs))
        correction = [
            self.kernel(points[k : k + block], self.runs) @ self.weights
            for k in range(0, len(points), block)
        ]
        return self.basis.known(X, omega) + np.concatenate(correction)

    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the basis's features."""
        return self.basis.features(X, omega)


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
    corrected = CorrectedBasis(
        basis.coefficient_mean, basis.coefficient_sd, basis, ranges, points, weights, smooth
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
