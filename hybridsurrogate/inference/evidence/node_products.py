"""Inner products from which the evidence of a linearised model follows at every node.

All rows enter by products of responses, slopes and columns: matrix products over all nodes and
responses at once, and no array of responses times nodes times rows. A covariance of the rows,
``sigma^2 I + V V'``, subtracts from each of them a product of what they have along V, so that
several covariances along the same directions share all work over rows.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from hybridsurrogate.inference.evidence.linearised import Linearised
from hybridsurrogate.numerics.cholesky import log_det_of, nudged_cholesky
from hybridsurrogate.types import FloatArray


class Covariances(NamedTuple):
    """K covariances ``sigma^2 I + V V'`` of the rows, as their inverses.

    ``sigma^2 (sigma^2 I + V_k V_k')^-1 = I - E_k E_k'`` with ``E_k = directions * weights_k``.

    Attributes
    ----------
    directions : ndarray of shape (n, r)
    weights : ndarray of shape (K, r)
    log_det : ndarray of shape (K,)
        Log determinants of ``(I + V_k V_k' / sigma^2)^(1/2)``.
    """

    directions: FloatArray
    weights: FloatArray
    log_det: FloatArray


def known_covariance(U: FloatArray, sigma: float) -> Covariances:
    """Return the covariance sigma^2 I + U U' for U (n, r)."""
    r = U.shape[1]
    if not r:
        return Covariances(U, np.ones((1, 0)), np.zeros(1))
    factor = nudged_cholesky((sigma**2 * np.eye(r) + U.T @ U)[None])
    log_det = log_det_of(factor) - r * np.log(sigma)
    return Covariances(U @ np.linalg.inv(factor[0]).T, np.ones((1, r)), log_det)


def scaled_covariances(basis: FloatArray, sizes: FloatArray, sigma: float) -> Covariances:
    """Return the covariances sigma^2 I + size^2 B B' for a basis B (n, r) and K sizes."""
    eigenvalue, vector = np.linalg.eigh(basis.T @ basis)
    # with B'B = V diag(lambda) V' the inverse is I - B V diag(1 / (sigma^2 / size^2 + lambda)) V'B'
    eigenvalue = np.maximum(eigenvalue, 0.0)
    ridge = (sigma / sizes[:, None]) ** 2
    log_det = 0.5 * np.sum(np.log1p(eigenvalue / ridge), axis=1)
    return Covariances(basis @ vector, 1 / np.sqrt(ridge + eigenvalue), log_det)


class Products(NamedTuple):
    """What the evidence of R responses at T nodes depends on, parameters integrated out.

    M is 1 where the nodes share the simulation, else T.

    Attributes
    ----------
    squares : ndarray of shape (M, R)
        Squares that the simulation's parameters leave, those of their prior included.
    log_det : ndarray of shape (M,)
        Of the covariance of the rows and of the precision of the parameters.
    along : ndarray of shape (T, R, q)
        Products of the columns with the residuals of a fit of the parameters.
    inner : ndarray of shape (T, q, q)
        Products of the columns with each other, after the projection on the parameters' slopes.
    squared : ndarray of shape (T,)
        Squares of the columns before that.
    """

    squares: FloatArray
    log_det: FloatArray
    along: FloatArray
    inner: FloatArray
    squared: FloatArray


def node_products(
    parts: Linearised, responses: FloatArray, sigma: float, covariances: Covariances
) -> Iterator[Products]:
    """Return the products under each of the covariances.

    Parameters
    ----------
    parts : Linearised
        Of unit noise; its own known covariance is not looked at.
    responses : ndarray of shape (R, n)
    sigma : float
    covariances : Covariances
    """
    seen = _seen(parts, responses, sigma)
    H = np.swapaxes(parts.H, 1, 2)
    plain = _Blocks.of(seen.rows, H, seen.shared)
    squared = np.einsum("tkk->t", plain.columns)
    projected = [_along(values, covariances.directions) for values in (seen.rows, H, seen.shared)]
    for weight, log_det in zip(covariances.weights, covariances.log_det, strict=True):
        blocks = plain
        if weight.size:
            blocks = plain.less(_Blocks.of(*(values * weight for values in projected)))
        yield _without_parameters(seen, blocks, sigma, float(log_det), squared)


class _Seen(NamedTuple):
    """Responses as they are at every node: ``shared_r - own_m' u_r``, and the slopes G.

    A response minus the mean may be large and almost in the span of the parameters. Its squares
    would lose all digits. So it is counted from a fit, the parameters at ``start_m @ u_r``: the
    residual of a good node is of the size of the noise.

    Attributes
    ----------
    shared : ndarray of shape (R, n)
    rows : ndarray of shape (M, k + d, n)
        Own parts, then slopes.
    u : ndarray of shape (R, k)
    start : ndarray of shape (M, d, k)
    """

    shared: FloatArray
    rows: FloatArray
    u: FloatArray
    start: FloatArray


def _seen(parts: Linearised, responses: FloatArray, sigma: float) -> _Seen:
    mean, G = parts.mean, np.swapaxes(parts.G, 1, 2)
    M, d, n = G.shape
    # one node that does not fail
    at = int(np.argmax(np.isfinite(mean).all(axis=1)))
    if len(responses) == 1:
        shared, u = np.zeros((1, n)), np.ones((1, 1))
        own = (mean - responses)[:, None]
        start = np.zeros((M, d, 1))
    else:
        left = responses - mean[at]
        fit = _coefficients(G[at][None], sigma)[0] @ (G[at] @ left.T)  # (d, R)
        shared, u = left - fit.T @ G[at], np.vstack([np.ones(len(left)), fit]).T
        own = np.concatenate([(mean - mean[at])[:, None], G - G[at]], axis=1)
        start = np.broadcast_to(np.eye(d, d + 1, 1), (M, d, d + 1))
    # the projection of a node's part on its slopes is taken out
    move = _coefficients(G, sigma) @ (G @ np.swapaxes(own, 1, 2))  # (M, d, k)
    own = own - np.swapaxes(move, 1, 2) @ G
    return _Seen(shared, np.concatenate([own, G], axis=1), u, start - move)


def _coefficients(G: FloatArray, sigma: float) -> FloatArray:
    """Return (G G' + sigma^2 I)^-1 of slopes G (M, d, n)."""
    d = G.shape[1]
    inverse = np.linalg.inv(nudged_cholesky(G @ np.swapaxes(G, 1, 2) + sigma**2 * np.eye(d)))
    return np.swapaxes(inverse, 1, 2) @ inverse


def _along(values: FloatArray, directions: FloatArray) -> FloatArray:
    """Return values (..., n) along the directions (n, r), (..., r)."""
    flat = values.reshape(-1, values.shape[-1]) @ directions
    return flat.reshape(*values.shape[:-1], directions.shape[1])


class _Blocks(NamedTuple):
    """Products of rows S (M, s, n), columns H (T, q, n) and shared parts of responses (R, n)."""

    rows: FloatArray  # (M, s, s)
    across: FloatArray  # (T, s, q)
    columns: FloatArray  # (T, q, q)
    shared: FloatArray  # (R,)
    shared_rows: FloatArray  # (M, R, s)
    shared_columns: FloatArray  # (T, R, q)

    @classmethod
    def of(cls, S: FloatArray, H: FloatArray, shared: FloatArray) -> _Blocks:
        (M, s, n), (T, q, _), R = S.shape, H.shape, len(shared)
        if M == 1:
            across = np.swapaxes((H.reshape(-1, n) @ S[0].T).reshape(T, q, s), 1, 2)
        else:
            across = S @ np.swapaxes(H, 1, 2)
        if not shared.any():  # of one response all is its own
            with_rows, with_columns = np.zeros((M, R, s)), np.zeros((T, R, q))
        else:
            with_rows = (shared @ S.reshape(-1, n).T).reshape(R, M, s).transpose(1, 0, 2)
            with_columns = (shared @ H.reshape(-1, n).T).reshape(R, T, q).transpose(1, 0, 2)
        return cls(
            S @ np.swapaxes(S, 1, 2),
            across,
            H @ np.swapaxes(H, 1, 2),
            np.einsum("rn,rn->r", shared, shared),
            with_rows,
            with_columns,
        )

    def less(self, other: _Blocks) -> _Blocks:
        return _Blocks(*(a - b for a, b in zip(self, other, strict=True)))


def _without_parameters(
    seen: _Seen, blocks: _Blocks, sigma: float, log_det: float, squared: FloatArray
) -> Products:
    """Integrate the parameters out: they have a standard normal prior around zero."""
    u, k = seen.u, seen.u.shape[1]
    d = blocks.rows.shape[1] - k
    own = blocks.rows[:, :k, :k]
    squares = blocks.shared - 2 * np.sum(blocks.shared_rows[:, :, :k] * u, axis=2)
    squares = squares + np.sum((u @ own) * u, axis=2)
    along = blocks.shared_columns - u @ blocks.across[:, :k]
    inner = blocks.columns
    if d:
        g = u @ np.swapaxes(seen.start, 1, 2)  # (M, R, d)
        right = blocks.shared_rows[:, :, k:] - u @ blocks.rows[:, :k, k:] - sigma**2 * g
        factor = nudged_cholesky(blocks.rows[:, k:, k:] + sigma**2 * np.eye(d))
        inverse = np.linalg.inv(factor)
        right = right @ np.swapaxes(inverse, 1, 2)
        across = inverse @ blocks.across[:, k:]  # (T, d, q)
        squares = squares + sigma**2 * np.sum(g**2, axis=2) - np.sum(right**2, axis=2)
        along = along - right @ across
        inner = inner - np.swapaxes(across, 1, 2) @ across
        log_det = log_det + log_det_of(factor) - d * np.log(sigma)
    return Products(
        squares, np.broadcast_to(np.asarray(log_det), (len(squares),)), along, inner, squared
    )
