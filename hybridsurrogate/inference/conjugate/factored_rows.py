"""Features and columns that are products of a part of the rows and a part of the draws.

Their Gram matrices follow from one product of the rows' parts, so that rows need not be formed for
each draw.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.model.observation import MeasuredModel
from hybridsurrogate.priors import FloatArray


class FactoredRows(NamedTuple):
    """Rows [features, columns, y less what is known] of J draws and n rows.

    Attributes
    ----------
    formed : ndarray of shape (J, n, k)
        Those that are no products, y the last of them.
    of_rows : ndarray of shape (n, f)
    of_draws : ndarray of shape (J, f)
        The others are ``of_rows * of_draws``.
    """

    formed: FloatArray
    of_rows: FloatArray
    of_draws: FloatArray

    def gram(self, products: NDArray[np.bool_]) -> FloatArray:
        """Return Gram matrices (J, f + k, f + k); ``products`` (f + k,) says which are products."""
        formed, f = np.swapaxes(self.formed, 1, 2), self.of_rows.shape[1]
        out = np.empty((len(formed), len(products), len(products)))
        out[:, :f, :f] = self.of_rows.T @ self.of_rows
        out[:, :f, :f] *= self.of_draws[:, :, None]
        out[:, :f, :f] *= self.of_draws[:, None]
        out[:, f:, :f] = (formed @ self.of_rows) * self.of_draws[:, None]
        out[:, :f, f:] = np.swapaxes(out[:, f:, :f], 1, 2)
        out[:, f:, f:] = formed @ self.formed
        if products[:f].all():
            return out
        place = np.argsort(np.argsort(~products, kind="stable"))
        return out[:, place[:, None], place]


def are_products(model: MeasuredModel) -> NDArray[np.bool_]:
    """Return which of [features, columns, y] are products, (p + q + 1,)."""
    # noise of their own scales the rows of each draw differently
    by_cause = [e.factorises and not model.touches_noise for e in model.effects]
    features = np.full(len(model.basis.coefficient_mean), model.factorises)
    return np.array([*features, *(by_cause[k] for k, _ in model.column_names), False])


def factored_rows(
    model: MeasuredModel, X: FloatArray, y: FloatArray, values: FloatArray
) -> FactoredRows:
    """Return the rows X (n, n_columns), y (n,) for draws of the unknowns (J, ...)."""
    J, n = len(values), len(y)
    of_rows, of_draws = _column_factors(model, X, values)
    factors = model.factors(X, values)
    if factors is None:
        known, features, _ = model.simulated(X, values)
    else:
        known, features = factors.known, np.empty((J, n, 0))
        of_rows = np.hstack([factors.of_inputs, of_rows])
        of_draws = np.hstack([factors.of_parameters, of_draws])
    formed = [k for k, effect in enumerate(model.effects) if not effect.factorises]
    rest = np.broadcast_to(y - known, (J, n))[..., None]
    rows = np.concatenate([features, model.added_by(formed, X, values), rest], axis=2)
    return FactoredRows(rows, of_rows, of_draws)


def _column_factors(
    model: MeasuredModel, X: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return `Cause.factors` of the causes that have some, (n, f) and (J, f)."""
    rows = {name: X[:, k] for k, name in enumerate(model.columns)}
    of_rows: list[FloatArray] = [np.empty((len(X), 0))]
    of_draws: list[FloatArray] = [np.empty((len(values), 0))]
    for effect, own in zip(model.effects, model.theta(values), strict=True):
        factors = effect.factors(rows, own) if effect.factorises else None
        if factors is not None:
            of_rows.append(factors[0])
            of_draws.append(factors[1])
    return np.hstack(of_rows), np.hstack(of_draws)
