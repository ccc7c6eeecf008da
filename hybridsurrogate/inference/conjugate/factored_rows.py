"""Gram matrices of rows and draws, and features that are products of a part of each.

Gram matrices of such features follow from one product of the rows' parts: rows are not formed for
each draw, and are not read again where all of them are products.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.numerics.linear_algebra import nudged_cholesky
from hybridsurrogate.types import FloatArray


def whitened(gram: FloatArray, whitening: FloatArray) -> FloatArray:
    """Return Gram matrices of ``features @ whitening``, for whitening (J, p, r)."""
    size = whitening.shape[2] + 1
    out = np.empty((len(gram), size, size))
    transposed = np.swapaxes(whitening, 1, 2)
    out[:, :-1, :-1] = transposed @ gram[:, :-1, :-1] @ whitening
    out[:, :-1, -1:] = transposed @ gram[:, :-1, -1:]
    out[:, -1:, :-1] = np.swapaxes(out[:, :-1, -1:], 1, 2)
    out[:, -1, -1] = gram[:, -1, -1]
    return out


def posterior_factor(
    gram: FloatArray, noise_precision: FloatArray, mean: FloatArray, precision: FloatArray
) -> FloatArray:
    """Return the Cholesky factor of [[Lambda, b], [b', c]] for each draw; gram is overwritten.

    Its last row is (L^-1 b)' and the root of c - b' Lambda^-1 b, so one factorisation gives the
    determinant, the quadratic form and the conditional mean of the coefficients. NaN where the
    Gram matrix is not finite.

    Parameters
    ----------
    gram : ndarray of shape (J, p + 1, p + 1)
    noise_precision : ndarray of shape (J,)
    mean, precision : ndarray of shape (p,)
        Of the coefficients' prior.
    """
    gram *= noise_precision[:, None, None]
    prior = np.diag(np.append(precision, precision @ mean**2))
    prior[-1, :-1] = prior[:-1, -1] = precision * mean
    gram += prior
    # a simulation may fail for some parameters: those are impossible, not an error
    broken = ~np.isfinite(gram.sum(axis=(1, 2)))
    gram[broken] = np.eye(gram.shape[1])
    factor = nudged_cholesky(gram)
    factor[broken] = np.nan
    return factor


@dataclass(frozen=True)
class FactoredRows:
    """Rows [features, columns, y minus the fixed mean], each a product or formed for each draw.

    Attributes
    ----------
    model : MeasuredModel
    X, y, root : ndarray of shape (n, n_columns), (n,), (n,)
        Measured rows, y on the scale of eta, and roots of their weights.
    """

    model: MeasuredModel
    X: FloatArray
    y: FloatArray
    root: FloatArray

    @cached_property
    def products(self) -> NDArray[np.bool_]:
        """Which of the rows' columns are products, (p + q + 1,)."""
        model = self.model
        # noise that differs between rows scales those of each draw differently
        by_cause = [e.factorises and not model.touches_noise for e in model.effects]
        features = np.full(len(model.basis.coefficient_mean), model.factorises)
        columns = (by_cause[k] for k, _ in model.column_names)
        return np.array([*features, *columns, model.factorises])

    @cached_property
    def of_rows(self) -> FloatArray:
        """The rows' part of the products, (n, f), times the roots of the weights."""
        # it is the same for all draws: one of them will do, in the middle of the priors
        middle = self.model.values(np.zeros((1, len(self.model.all_priors))))
        parts, _ = _column_factors(self.model, self.X, middle)
        factors = self.model.factors(self.X, middle)
        if factors is not None:
            # what is known does not depend on the draw either
            parts = np.column_stack([factors.of_inputs, parts, self.y - factors.known])
        return parts * self.root[:, None]

    def of_draws(self, values: FloatArray) -> FloatArray:
        """Return the draws' part of the products, (J, f)."""
        _, parts = _column_factors(self.model, self.X[:1], values)
        factors = self.model.factors(self.X[:1], values)
        if factors is None:
            return parts
        return np.column_stack([factors.of_parameters, parts, np.ones(len(values))])

    def formed(self, values: FloatArray) -> FloatArray:
        """Return the columns that are no products, (J, n, k), times the roots of the weights."""
        model, J, n = self.model, len(values), len(self.y)
        chosen = [k for k, effect in enumerate(model.effects) if not effect.factorises]
        pieces = [model.added(self.X, values, chosen)]
        if not model.factorises:
            known, features, _ = model.simulated(self.X, values)
            rest = np.broadcast_to(self.y - known, (J, n))[..., None]
            pieces = [features, *pieces, rest]
        return np.concatenate(pieces, axis=2) * self.root[:, None]

    @cached_property
    def compressed(self) -> FloatArray:
        """R (r, f) of ``of_rows`` = Q R: sums of squares of what is linear in rows are as of R's.

        Equal columns stay equal, which rounding in a decomposition of both would not leave them.
        """
        distinct, group = np.unique(self.of_rows, axis=1, return_inverse=True)
        _, R = np.linalg.qr(distinct)
        return R[:, group.ravel()]

    @cached_property
    def _squares(self) -> FloatArray:
        """Products of the rows' parts, (p + q + 1, p + q + 1), zero for what is formed."""
        size, at = len(self.products), np.flatnonzero(self.products)
        out = np.zeros((size, size))
        out[at[:, None], at] = self.of_rows.T @ self.of_rows
        return out

    def gram(self, values: FloatArray) -> FloatArray:
        """Return Gram matrices (J, p + q + 1, p + q + 1) for draws of the unknowns (J, ...)."""
        of_draws = self.of_draws(values)
        every = np.zeros((len(values), len(self.products)))
        every[:, self.products] = of_draws
        out = self._squares * every[:, :, None]
        out *= every[:, None]
        if of_draws.shape[1] < every.shape[1]:
            rows = self.formed(values)
            formed = np.swapaxes(rows, 1, 2)
            across = np.empty((len(values), rows.shape[2], every.shape[1]))
            across[:, :, self.products] = (formed @ self.of_rows) * of_draws[:, None]
            across[:, :, ~self.products] = formed @ rows
            out[:, ~self.products] = across
            out[:, :, ~self.products] = np.swapaxes(across, 1, 2)
        return out


def _column_factors(
    model: MeasuredModel, X: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return `Cause.factors` of the causes that have some, (n, f) and (J, f)."""
    of_rows: list[FloatArray] = [np.empty((len(X), 0))]
    of_draws: list[FloatArray] = [np.empty((len(values), 0))]
    for k, effect in enumerate(model.effects):
        if effect.factorises:
            factors = model.added_factors(k, X, values)
            of_rows.append(factors[0])
            of_draws.append(factors[1])
    return np.hstack(of_rows), np.hstack(of_draws)
