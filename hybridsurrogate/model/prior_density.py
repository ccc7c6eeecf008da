"""The prior of the unknowns ``u = [z, log sigma]``, z being standard normal coordinates."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.types import FloatArray, Prior


def prior_log_density(z: FloatArray) -> FloatArray:
    """Return the log density of standard normal coordinates (J, k), without its constant."""
    return -0.5 * np.einsum("jk,jk->j", z, z)


def prior_of_unknowns(u: FloatArray, noise_prior: Prior) -> FloatArray:
    """Return the log density of u (J, d), without the constant of z."""
    sigma = np.exp(u[:, -1])
    with np.errstate(divide="ignore"):
        return prior_log_density(u[:, :-1]) + noise_prior.logpdf(sigma) + u[:, -1]
