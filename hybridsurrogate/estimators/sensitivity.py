"""Which parameters the simulation's output depends on: Sobol indices of a fitted surrogate."""

from __future__ import annotations

import inspect
from numbers import Integral
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats
from sklearn.utils.validation import check_is_fitted

from hybridsurrogate.arguments import check_flag, check_number, random_generator
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.numerics.linear_algebra import SINGULAR
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.types import FloatArray

# scipy 1.15 renamed the argument
_RNG = "rng" if "rng" in inspect.signature(stats.sobol_indices).parameters else "random_state"


def sobol_indices(
    estimator: PowerScaledSurrogate,
    X: ArrayLike,
    *,
    after: bool = False,
    n: int = 1024,
    random_state: Any = None,
) -> pd.DataFrame:
    """Return how much of the output's variance is due to each parameter, at rows of inputs.

    The output is that of the fitted surrogate, without causes and noise. The first-order index of
    a parameter is the share of the variance that would go if it were known. The total index is the
    share that would remain if all others were known (Saltelli and others 2010, Computer Physics
    Communications 181:259, as `scipy.stats.sobol_indices`).

    Parameters
    ----------
    estimator : PowerScaledSurrogate
        Fitted.
    X : array-like of shape (n_rows, n_columns)
        Rows as for ``predict``; several times of a curve give the indices over time.
    after : bool, default=False
        Parameters are drawn from the marginals of their posterior, as if these were independent,
        and not from their priors.
    n : int, default=1024
        Draws, a power of two; the simulation is evaluated n (n_parameters + 2) times a row.
    random_state : int, RandomState or None, default=None

    Returns
    -------
    pandas.DataFrame of n_rows * n_parameters rows
        The columns of X, ``parameter``, ``first`` and ``total``; NaN where the output is constant.

    Raises
    ------
    ValueError
        Without parameters, for an n that is no power of two, or a surrogate whose own constants
        are not linear.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.stats import uniform
    >>> import hybridsurrogate as hs
    >>> simulator = hs.Simulator(
    ...     lambda t, rise, fall: rise * t - fall * t**2, {"t": (0, 1)},
    ...     {"rise": uniform(0, 2), "fall": uniform(0, 1)})
    >>> model = hs.PowerScaledSurrogate(simulator.run(64, random_state=0), random_state=0)
    >>> t = np.linspace(0.1, 0.9, 9)[:, None]
    >>> y = t[:, 0] + 0.05 * np.random.default_rng(0).normal(size=9)
    >>> table = hs.sobol_indices(model.fit(t, y), [[0.5]], random_state=0)
    >>> table[["parameter", "first"]].round(2)
      parameter  first
    0      rise   0.94
    1      fall   0.06
    """
    check_is_fitted(estimator)
    check_number(n, "n", Integral, min_val=2)
    check_flag(after, "after")
    if n & (n - 1):
        raise ValueError(f"n must be a power of two, got {n}.")
    posterior = estimator.posterior_
    model, names = posterior.model, list(posterior.model.parameters)
    if not names:
        raise ValueError("The simulation has no parameters: indices need at least one.")
    if model.basis.known_depends_on_hyper:
        raise ValueError(
            f"{type(estimator.surrogate_).__name__} is not linear in its constants: take another "
            "surrogate, such as Kriging()."
        )
    rows = estimator.checked_rows(X)
    inputs, c = rows[:, : model.n_inputs], posterior.coefficients.mean(axis=0)
    constants = list(model.constants.values())

    def outputs(points: FloatArray) -> FloatArray:
        omega = np.column_stack([points.T, np.tile(constants, (points.shape[1], 1))])
        return model.basis.outer_output(inputs, omega, c).T

    priors = list(model.parameters.values())
    if after:
        priors = [_marginal(posterior.values[:, k]) for k in range(len(names))]
    first, total = _indices(outputs, priors, int(n), random_generator(random_state))
    table = pd.DataFrame(np.repeat(rows, len(names), axis=0), columns=list(model.columns))
    if estimator.data_.stacking is not None:
        which = table.pop(OUTPUT).to_numpy(dtype=int)
        table["output"] = np.array(estimator.data_.stacking.names)[which]
    table["parameter"] = np.tile(names, len(rows))
    table["first"], table["total"] = first.ravel(), total.ravel()
    return table


def _indices(
    outputs: Any, priors: list[Any], n: int, generator: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return first-order and total indices (n_rows, n_parameters)."""
    if len(priors) == 1:  # all there is; scipy fails with a single output
        first, total = np.ones((2, *outputs(np.array([[priors[0].median()]])).shape))
    else:
        with np.errstate(invalid="ignore", divide="ignore"):
            found = stats.sobol_indices(func=outputs, n=n, dists=priors, **{_RNG: generator})
        first, total = found.first_order, found.total_order
    middle = outputs(np.array([[prior.median()] for prior in priors]))[:, 0]
    tried = outputs(np.array([prior.ppf(np.linspace(0.05, 0.95, 7)) for prior in priors]))
    # outputs that vary by no more than rounding do not depend on anything
    constant = np.ptp(tried, axis=1) <= SINGULAR * np.maximum(np.abs(middle), 1e-300)
    shape = len(middle), len(priors)
    pair = (np.where(constant[:, None], np.nan, p.reshape(shape)) for p in (first, total))
    first, total = pair
    return first, total


def _marginal(draws: FloatArray) -> Any:
    """Return the distribution of draws, as scipy's are."""
    bins = min(max(len(draws) // 20, 5), 100)
    return stats.rv_histogram(np.histogram(draws, bins=bins), density=False)
