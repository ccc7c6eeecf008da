"""A Gaussian approximation, at their mode, of coefficients whose rows have any likelihood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hybridsurrogate.inference.laplace.linear_predictor import Design
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.model.prior_density import prior_log_density
from hybridsurrogate.numerics.cholesky import log_det_of, nudged_cholesky
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class GaussianFit:
    """Gaussian approximation of v for J draws of all else; v is standard normal a priori.

    Attributes
    ----------
    design : Design
        Which v it is about.
    mode : ndarray of shape (J, r)
    factor : ndarray of shape (J, r, r)
        Cholesky factor of the precision.
    log_det : ndarray of shape (J,)
        Of the factor.
    height : ndarray of shape (J,)
        Log density at the mode, prior and rows.
    """

    design: Design
    mode: FloatArray
    factor: FloatArray
    log_det: FloatArray
    height: FloatArray

    def draw(self, e: FloatArray) -> FloatArray:
        """Return v for standard normal e (J, p); directions that are not kept stay e."""
        kept = self.design.kept
        transposed = np.swapaxes(self.factor, 1, 2)
        out = e.copy()
        out[:, kept] = self.mode + np.linalg.solve(transposed, e[:, kept, None])[..., 0]
        return out


def gaussian_fit(whole: Design, sigma: FloatArray, width_rounds: int) -> GaussianFit:
    """Return the approximation for noise scales sigma (J, 1).

    Where the density is rough, log density and derivatives are averaged over the distribution of
    eta in the approximation itself, in so many rounds. This makes it the variational one (Opper and
    Archambeau 2009, Neural Computation 21:786).
    """
    # inside, v holds the directions that are kept and nothing else
    design = Design(whole.parts, np.arange(len(whole.kept)))
    v: FloatArray = np.zeros((len(sigma), len(whole.kept)))
    if v.shape[1] and any(part.likelihood.rough for part in whole.parts):
        for _ in range(width_rounds):
            v, _ = _climb(design, sigma, v, SETTINGS.width_steps)
            design = design.widened(_factor(design, sigma, v))
    v, height = _climb(design, sigma, v, SETTINGS.newton_steps)
    factor = _factor(design, sigma, v)
    return GaussianFit(whole, v, factor, log_det_of(factor), height)


def _climb(
    design: Design, sigma: FloatArray, v: FloatArray, n_steps: int
) -> tuple[FloatArray, FloatArray]:
    """Climb from v (J, p) by Newton steps, halved where they overshoot; return mode, value."""
    v = v.copy()
    value = _smoothed_density(design, sigma, v)
    active = np.ones(len(v), dtype=bool)
    for _ in range(n_steps if v.shape[1] else 0):
        some = design.take(active)
        step = _newton_step(some, sigma[active], v[active])
        # a full step, a quarter and a sixteenth: the best of them counts
        trials = v[active] + step * np.array([1.0, 0.25, 1 / 16])[:, None, None]
        values = np.stack([_smoothed_density(some, sigma[active], t) for t in trials])
        values = np.where(np.isfinite(values), values, -np.inf)
        best = values.argmax(axis=0)
        index = np.arange(len(best))
        better = values[best, index] > value[active]
        gain = np.zeros(len(best))
        gain[better] = values[best, index][better] - value[active][better]
        climber = np.flatnonzero(active)
        v[climber[better]] = trials[best, index][better]
        value[climber[better]] = values[best, index][better]
        active[climber[~(gain > SETTINGS.newton_tolerance)]] = False
        if not active.any():
            break
    return v, value


def _smoothed_density(design: Design, sigma: FloatArray, v: FloatArray) -> FloatArray:
    return prior_log_density(v) + design.log_likelihood(sigma, v, smoothed=True)


def _newton_step(design: Design, sigma: FloatArray, v: FloatArray) -> FloatArray:
    gradient, hessian = -v, _identity(v)
    for part in design.parts:
        score, curvature = part.derivatives(sigma, v)
        gradient = gradient + part.back(score)
        hessian = hessian + part.gram(curvature)
    # rows far off may count so much that the prior is lost in rounding, and columns are alike
    factor = nudged_cholesky(hessian)
    half = np.linalg.solve(factor, gradient[..., None])
    return np.linalg.solve(np.swapaxes(factor, 1, 2), half)[..., 0]


def _factor(design: Design, sigma: FloatArray, v: FloatArray) -> FloatArray:
    hessian = _identity(v)
    if not v.shape[1]:
        return hessian
    for part in design.parts:
        hessian = hessian + part.gram(part.derivatives(sigma, v)[1])
    return nudged_cholesky(hessian)


def _identity(v: FloatArray) -> FloatArray:
    return np.broadcast_to(np.eye(v.shape[1]), (*v.shape, v.shape[1]))
