"""Leave-one-out predictive densities of a two-step, power-scaled posterior.

Where row i has power alpha in step 1, leaving it out reweights the draws by p(y_i | .)^-alpha and
not by p(y_i | .)^-1 as for an ordinary posterior (Vehtari, Gelman and Gabry 2017, Statistics and
Computing 27:1413). In step 2 the row counts in full, for each draw of the coefficients by itself:
there its leave-one-out density is the harmonic mean over draws of what step 2 infers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, special

from hybridsurrogate.numerics.psis import khat_limit, pareto_smooth
from hybridsurrogate.types import FloatArray


class PointwiseLoo(NamedTuple):
    """Log predictive density of each row given the others, (n,), and whether it is reliable.

    Attributes
    ----------
    log_density : ndarray of shape (n,)
    khat : ndarray of shape (n,)
        Pareto k-hat.
    failed : ndarray of shape (n,)
        Rows whose k-hat is above the limit for so many draws: each needs a separate fit.
    """

    log_density: FloatArray
    khat: FloatArray
    failed: NDArray[np.bool_]


def pointwise_loo(
    first: FloatArray,
    powers: FloatArray,
    second: FloatArray,
    weights: FloatArray,
    removed: FloatArray | None = None,
    some: NDArray[np.intp] | None = None,
) -> PointwiseLoo:
    """Return leave-one-out densities from log likelihoods of draws.

    Parameters
    ----------
    first : ndarray of shape (S, n)
        Log likelihood of each row under the draws of step 1.
    powers : ndarray of shape (n,)
        Power of each row in step 1.
    second : ndarray of shape (S, M, n)
        The same under M draws of step 2 for each draw of the coefficients, or for ``some``. Without
        a second step: ``first[:, None]``.
    weights : ndarray of shape (n,)
        Power of each row in step 2; zero without a second step.
    removed : ndarray of shape (S, M, n) or None, default=None
        Log of what leaving the row out takes from the density of a draw in step 2. None:
        ``weights * second``. Where Gaussian coefficients are integrated out, ``second`` is the
        density of the row given the others and the draw.
    some : ndarray of int or None, default=None
        The draws of step 1 that ``second`` and ``removed`` hold; None: all.

    Examples
    --------
    A normal mean with a flat prior: leaving out y_1 = 0 of (0, 1) predicts it by N(1, 2).

    >>> random = np.random.RandomState(0)
    >>> mean = random.normal(0.5, np.sqrt(0.5), 100_000)[:, None]
    >>> log_likelihood = -0.5 * (np.array([0.0, 1.0]) - mean) ** 2 - 0.5 * np.log(2 * np.pi)
    >>> one, zero = np.ones(2), np.zeros(2)
    >>> loo = pointwise_loo(log_likelihood, one, log_likelihood[:, None], zero)
    >>> bool(abs(loo.log_density[0] - (-0.5 * np.log(4 * np.pi) - 0.25)) < 0.01)
    True
    """
    n = first.shape[1]
    removed = weights * second if removed is None else removed
    # step 2: E[p / q] / E[1 / q] over its draws, where q = p^w is what the row gave
    held_out = special.logsumexp(second - removed, axis=1)
    held_out = held_out - special.logsumexp(-removed, axis=1)
    log_density, khat = np.empty(n), np.empty(n)
    for i in range(n):
        smoothed, k = pareto_smooth(-powers[i] * first[:, i]) if powers[i] else (0 * first[:, i], 0)
        khat[i] = k
        if weights[i]:
            khat[i] = max(k, pareto_smooth(-removed[..., i].ravel())[1])
        kept = smoothed if some is None else smoothed[some]
        log_density[i] = special.logsumexp(kept + held_out[:, i]) - special.logsumexp(kept)
    # a row without power in step 1 has the draws of step 2 as one sample
    limits = khat_limit(len(first)), khat_limit(second.shape[0] * second.shape[1])
    return PointwiseLoo(log_density, khat, khat > np.where(powers > 0, *limits))


def stacking_weights(log_density: ArrayLike, weights: FloatArray | None = None) -> FloatArray:
    """Return the weights of predictive densities whose mixture predicts held-out rows best.

    ``argmax_w sum_i v_i log sum_k w_k p_k(y_i)`` on the simplex, which is concave in w (Yao,
    Vehtari, Simpson and Gelman 2018, Bayesian Analysis 13:917, eq. 4).

    Parameters
    ----------
    log_density : array-like of shape (n, k)
        Log densities of held-out rows. A row that is impossible under every model is left out.
    weights : ndarray of shape (n,) or None, default=None
        v, of the rows; None: all equal.

    Returns
    -------
    ndarray of shape (k,)

    Examples
    --------
    >>> stacking_weights([[0.0, -2.0], [-2.0, 0.0]]).round(6).tolist()
    [0.5, 0.5]
    """
    values = np.asarray(log_density, dtype=float)
    top = np.max(values, axis=1)
    possible = np.isfinite(top)
    density = np.exp(values[possible] - top[possible, None])
    of_row = np.ones(len(density)) if weights is None else weights[possible]
    even = np.full(values.shape[1], 1 / values.shape[1])
    if not of_row.sum():
        return even

    def mixture(w: FloatArray) -> FloatArray:
        return np.maximum(density @ w, np.finfo(float).tiny)

    found = optimize.minimize(
        lambda w: -(of_row @ np.log(mixture(w))) / of_row.sum(),
        even,
        jac=lambda w: -(of_row / mixture(w)) @ density / of_row.sum(),
        method="SLSQP",
        bounds=[(0, 1)] * len(even),
        constraints={"type": "eq", "fun": lambda w: w.sum() - 1},
        options={"ftol": 1e-14, "maxiter": 1000},
    ).x
    return np.asarray(found / found.sum())
