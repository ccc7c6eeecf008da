"""Step 2 under any likelihood: the measured world given each draw of the surrogate's unknowns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.conditional.sampler import MeasuredDraws
from hybridsurrogate.inference.sampling.differential_evolution import FROM_NEAR, Effort, moved_draws
from hybridsurrogate.likelihoods.base import Likelihood
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.prior_density import prior_log_density
from hybridsurrogate.types import FloatArray, Prior


def conditional_draws(
    model: MeasuredModel,
    X: FloatArray,
    y: FloatArray,
    weights: FloatArray,
    likelihood: Likelihood,
    noise_prior: Prior,
    u: FloatArray,
    c: FloatArray,
    a: FloatArray,
    random_state: np.random.RandomState,
    effort: Effort = FROM_NEAR,
) -> MeasuredDraws:
    """Draw (omega, theta, sigma, a) given each coefficient draw and its hyperparameters.

    Parameters
    ----------
    model : MeasuredModel
    X, y, weights : ndarray of shape (n, n_columns), (n,), (n,)
        Measured rows, y as measured.
    likelihood : Likelihood
    noise_prior : prior of sigma
    u, c, a : ndarray of shape (S, d), (S, p), (S, q)
        Draws of step 1: unknowns with hyperparameters, coefficients of surrogate and causes.
    random_state : RandomState
    effort : Effort

    Returns
    -------
    MeasuredDraws
    """
    m = model.n_unknowns
    hyper = u[:, m:-1]
    sd = model.column_sd

    def log_density(points: FloatArray, chains: NDArray[np.intp]) -> FloatArray:
        z, log_sigma, columns = points[:, :m], points[:, m], points[:, m + 1 :]
        sigma = np.exp(log_sigma)
        values = model.values(np.hstack([z, hyper[chains]]))
        parts = model.parts(X, values)
        eta = parts.known + (parts.features @ c[chains][..., None])[..., 0]
        eta = eta + (parts.columns @ (columns * sd)[..., None])[..., 0]
        with np.errstate(all="ignore"):
            log_likelihood = model.likelihood_of(likelihood, values)
            density = log_likelihood.log_density(y, eta, parts.noise * sigma[:, None]) @ weights
            prior = noise_prior.logpdf(sigma) + log_sigma
        out = density + prior + prior_log_density(z) + prior_log_density(columns)
        return np.where(np.isfinite(out), out, -np.inf)

    start = np.hstack([u[:, :m], u[:, -1:], a / sd])
    moved = moved_draws(log_density, start, random_state, effort)
    points = moved.points
    return MeasuredDraws(
        points[:, :m],
        np.exp(points[:, m]),
        points[:, m + 1 :] * sd,
        np.nan,
        moved.accepted,
        "moves",
    )
