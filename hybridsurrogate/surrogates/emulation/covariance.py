"""The covariance of a simulation's outputs: the surrogate's terms and a process, learned from runs.

Outputs of two runs are as alike as the surrogate's terms make them, their prior variances times one
learned share, plus a Matern 5/2 process over inputs and parameters, plus what differs from run to
run. The most likely numbers are taken (Rasmussen and Williams 2006, section 5.4.1, equations 5.8
and 5.9), the variance of the process in closed form.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize

from hybridsurrogate.numerics.blocks import blocks
from hybridsurrogate.types import FloatArray

# sd of the normal priors of each log length and each bend; the means are half the range, and none
_LENGTH_SD, _BEND_SD = 2.0, 2.0
# an input without influence has the longest length: at 50 errors of the borehole function are twice
# as large from 1,000 runs
_LENGTHS, _NUGGETS, _SHARES, _MOST_BENT = (0.05, 1000.0), (1e-7, 10.0), (1e-3, 1e5), 8.0
# logarithms of nugget and share to start from: smooth with some of the terms, rough with most
_STARTS = ((-9.0, -2.0), (-4.0, 2.0), (-9.0, 6.0))
_ROOT = np.sqrt(5.0)
# runs among which the most likely numbers are searched, and steps from there with all runs
_SEARCHED, _POLISH = 200, 15
# of the outputs' spread, to which runs are predicted
_DIGITS = 0.01
# a smaller bend is as good as none
_STRAIGHT = 1e-6


class Covariance(NamedTuple):
    """Covariance of outputs in units of the process's variance.

    Attributes
    ----------
    lengths : ndarray of shape (d,)
        Of the process, where ranges go from -1 to 1.
    bends : ndarray of shape (d,)
        The simulation changes exp(-bend) times as fast at the end of a range as at its beginning.
    nugget : float
        Variance of what differs from run to run.
    share : float
        Variance of the terms on average over the runs; 0 where they are of no use.
    """

    lengths: FloatArray
    bends: FloatArray
    nugget: float
    share: float


class Apart(NamedTuple):
    """Squared distances of points as one product of matrices, |a - b|^2 = left @ right'.

    Attributes
    ----------
    left, right : ndarray of shape (n, d + 2)
    """

    left: FloatArray
    right: FloatArray

    @classmethod
    def of(cls, points: FloatArray) -> Apart:
        """Return the halves for points (n, d)."""
        squares, one = np.sum(points**2, axis=1), np.ones(len(points))
        left = np.column_stack([-2 * points, squares, one])
        return cls(left, np.column_stack([points, one, squares]))

    def squares(self, right: FloatArray) -> FloatArray:
        """Return squared distances (n, m) to points given by their right halves."""
        product: FloatArray = self.left @ right.T
        return np.maximum(product, 0.0, out=product)


def alike(points: Apart, others: Apart) -> FloatArray:
    """Return Matern 5/2 correlations (n, m) of points apart in lengths."""
    out = np.empty((len(points.left), len(others.right)))
    for piece, r, fading in _distances(points, others):
        _correlation(r, fading, out[piece])
    return out


def weighted_in_turn(points: Apart, others: Apart, weights: FloatArray) -> FloatArray:
    """Return sums (n,) of correlations times weights (J, m), the first for the first n / J."""
    each = len(points.left) // len(weights)
    out = np.empty(len(points.left))
    for piece, r, fading in _distances(points, others):
        own = weights[np.arange(piece.start, piece.stop) // each]
        out[piece] = np.einsum("nm,nm->n", _correlation(r, fading, np.empty_like(r)), own)
    return out


def weighted(points: Apart, others: Apart, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return sums of correlations with m others times their weights (m, k), and slopes.

    Returns
    -------
    sums, slopes : ndarray of shape (n, k), (n, k, d)
    """
    d, k = points.right.shape[1] - 2, weights.shape[1]
    places = others.right[:, :d]
    each = np.hstack([weights, (weights[:, :, None] * places[:, None]).reshape(len(places), -1)])
    out, slopes = np.empty((len(points.left), k)), np.empty((len(points.left), k, d))
    for piece, r, fading in _distances(points, others):
        near = (1 + r) * fading
        sums = near @ each
        r *= r
        r *= fading
        out[piece] = sums[:, :k] + r @ weights / 3
        # the derivative of a correlation is -5/3 (1 + r) exp(-r) times the difference of places
        own = points.right[piece, None, :d]
        slopes[piece] = 5 / 3 * (sums[:, k:].reshape(len(sums), k, d) - sums[:, :k, None] * own)
    return out, slopes


def _correlation(r: FloatArray, fading: FloatArray, out: FloatArray) -> FloatArray:
    """Fill out with (1 + r + r^2 / 3) exp(-r), Rasmussen and Williams 2006, equation 4.17."""
    np.multiply(r, 1 / 3, out=out)
    out += 1
    out *= r
    out += 1
    out *= fading
    return out


def _distances(points: Apart, others: Apart) -> Iterator[tuple[slice, FloatArray, FloatArray]]:
    """Yield rows, their distances r (k, m) to others times the root of 5, and exp(-r).

    Some rows at a time, in the same two arrays: they stay in the processor's cache, and no memory
    is asked for again and again.
    """
    right = np.ascontiguousarray(others.right.T)
    pieces = blocks(len(points.left), right.shape[1])
    most = pieces[0].stop if pieces else 0
    both = np.empty((2, most, right.shape[1]))
    for piece in pieces:
        r, fading = both[:, : piece.stop - piece.start]
        np.matmul(points.left[piece], right, out=r)
        np.sqrt(np.maximum(r, 0.0, out=r), out=r)
        r *= _ROOT
        np.exp(np.negative(r, out=fading), out=fading)
        yield piece, r, fading


def between(points: FloatArray, ranges: FloatArray) -> FloatArray:
    """Map ranges (d, 2) to [0, 1]; points beyond, where nothing is known, are held at the edge."""
    low, high = ranges.T
    return (np.clip(points, low, high) - low) / (high - low)


def bent(points: FloatArray, bends: FloatArray) -> FloatArray:
    """Return points (n, d) from 0 to 1 stretched where the simulation changes fast, -1 to 1.

    The map is log(1 + (exp(b) - 1) u) / b for each coordinate, as warped inputs (Snoek and others
    2014, Proceedings of Machine Learning Research 32:1674) with one number each: the logarithm of
    the distance from somewhere beyond the range, at which levels, powers and saturating curves are
    steep.
    """
    bends = _at_least_straight(bends)
    return 2 * np.log1p(np.expm1(bends) * points) / bends - 1


def _bent_by(points: FloatArray, bends: FloatArray) -> FloatArray:
    """Return the slopes of `bent` in the bends."""
    bends = _at_least_straight(bends)
    inner = np.expm1(bends) * points
    return 2 * (np.exp(bends) * points / (1 + inner) - np.log1p(inner) / bends) / bends


def _at_least_straight(bends: FloatArray) -> FloatArray:
    return np.where(np.abs(bends) < _STRAIGHT, _STRAIGHT, bends)


def learned(
    points: FloatArray, terms: FloatArray, residual: FloatArray, least_nugget: float = 0.0
) -> Covariance:
    """Return the most likely covariance.

    Parameters
    ----------
    points : ndarray of shape (n, d)
        Inputs and parameters of the runs, from 0 to 1.
    terms : ndarray of shape (n, p)
        The surrogate's features times the prior sd of their coefficients, p may be 0.
    residual : ndarray of shape (n, k)
        Outputs less their prior mean. Several have the same covariance but for its size, as in
        Conti and O'Hagan 2010 (Journal of Statistical Planning and Inference 140:640), and count
        by their standard deviations: small ones are rough, and matter less.
    least_nugget : float, default=0.0
        In units of the variance of the outputs: what is known to differ from run to run.
    """
    d = points.shape[1]
    if not residual.any():  # nothing to learn from
        return Covariance(np.ones(d), np.zeros(d), _NUGGETS[0], 0.0)
    # columns of zeros say nothing, and have no logarithm
    residual = residual[:, np.any(residual, axis=0)]
    counts = np.std(residual, axis=0)
    counts = counts / np.max(counts) if np.max(counts) else np.ones(len(counts))
    gram = terms @ terms.T
    gram /= max(float(np.trace(gram)) / len(gram), 1e-300)
    none = np.zeros_like(gram)
    nuggets = np.clip(max(_NUGGETS[0], least_nugget), *_NUGGETS), _NUGGETS[1]
    ranges = [_LENGTHS] * d + [nuggets, _SHARES]
    limits = [(math.log(low), math.log(high)) for low, high in ranges]
    limits += [(-_MOST_BENT, _MOST_BENT)] * d
    few = min(len(points), _SEARCHED)

    def deviance(z: FloatArray, gram: FloatArray, n: int) -> tuple[float, FloatArray]:
        return _badness(z, points[:n], gram[:n, :n], residual[:n], counts)

    def most_likely(places: list[FloatArray], gram: FloatArray) -> FloatArray:
        ends = [
            minimize(deviance, place, (gram, few), method="L-BFGS-B", jac=True, bounds=limits)
            for place in places
        ]
        best = min(ends, key=lambda end: end.fun).x
        if few == len(points):
            return np.asarray(best)
        args, options = (gram, len(points)), {"maxiter": _POLISH}
        end = minimize(
            deviance, best, args, method="L-BFGS-B", jac=True, bounds=limits, options=options
        )
        return np.asarray(end.x)

    def place(nugget: float, share: float, lengths: FloatArray) -> FloatArray:
        return np.array([*lengths, nugget, share, *np.zeros(d)])

    # along one axis, mostly time, outputs may come and go many times: few runs then have two peaks
    uneven = [place(*_STARTS[0], lengths) for lengths in np.where(np.eye(d) > 0, -2.0, 1.0)]
    first = min(uneven, key=lambda z: deviance(z, none, few)[0])
    even = np.zeros(d)
    alone = most_likely([place(*_STARTS[0], even), first], none)
    if terms.shape[1]:
        starts = [place(*start, even) for start in _STARTS]
        together = most_likely([*starts, alone], gram)
        share = float(np.exp(together[d + 1]))
        seen = [
            _left_out_density(z, points, g, residual, counts)
            for z, g in ((together, gram), (alone, none))
        ]
        if share > 2 * _SHARES[0] and seen[0] > seen[1]:
            return _covariance(together, share)
    return _covariance(alone, 0.0)


def _covariance(z: FloatArray, share: float) -> Covariance:
    d = len(z) // 2 - 1
    return Covariance(np.exp(z[:d]), z[d + 2 :], float(np.exp(z[d])), share)


def _left_out_density(
    z: FloatArray, points: FloatArray, gram: FloatArray, residual: FloatArray, counts: FloatArray
) -> float:
    """Return the leave-one-out log predictive density of the runs, with a scatter added.

    A likelihood is dominated by runs where a simulation is smooth, by digits that no measurement
    has. With a scatter of a hundredth of the outputs' spread, those runs dominate that are hard to
    predict (Rasmussen and Williams 2006, section 5.4.2).
    """
    n, d = points.shape
    halves = Apart.of(bent(points, z[d + 2 :]) / np.exp(z[:d]))
    matrix = alike(halves, halves) + np.exp(z[d + 1]) * gram + np.exp(z[d]) * np.eye(n)
    try:
        lower = cholesky(matrix, lower=True)
    except np.linalg.LinAlgError:
        return -np.inf
    whiten = solve_triangular(lower, np.eye(n), lower=True)
    weights, diagonal = whiten.T @ (whiten @ residual), np.sum(whiten**2, axis=0)
    squares = weights**2 / diagonal[:, None]
    variance = np.maximum(np.sum(residual * weights, axis=0), np.sum(squares, axis=0)) / n
    spread = variance / diagonal[:, None] + (_DIGITS * np.std(residual, axis=0)) ** 2
    missed = (weights / diagonal[:, None]) ** 2 / spread
    return float(-0.5 * np.sum(counts * (np.log(spread) + missed)))


def _badness(
    z: FloatArray, points: FloatArray, gram: FloatArray, residual: FloatArray, counts: FloatArray
) -> tuple[float, FloatArray]:
    """Return minus the log posterior density of logarithms and bends, and its slopes.

    Of outputs ``residual`` (n, k), whose log densities are multiplied by ``counts`` (k,).
    """
    n, d = points.shape
    lengths, nugget, share = np.exp(z[:d]), np.exp(z[d]), np.exp(z[d + 1])
    places = bent(points, z[d + 2 :]) / lengths
    halves = Apart.of(places)
    distance = _ROOT * np.sqrt(halves.squares(halves.right))
    fading = np.exp(-distance)
    process = (1 + distance * (1 + distance / 3)) * fading
    try:
        lower = cholesky(process + nugget * np.eye(n) + share * gram, lower=True)
    except np.linalg.LinAlgError:
        return 1e10, np.zeros_like(z)
    inverse = cho_solve((lower, True), np.eye(n))
    weights = inverse @ residual
    variance = np.sum(residual * weights, axis=0) / n
    total = float(np.sum(counts))
    value = 0.5 * n * counts @ np.log(variance) + total * np.sum(np.log(np.diagonal(lower)))
    inner = total * inverse - (weights * counts / variance) @ weights.T
    steep = inner * (1 + distance) * fading
    apart = places.T[:, :, None] - places.T[:, None]
    moves = (_bent_by(points, z[d + 2 :]) / lengths).T
    moved = moves[:, :, None] - moves[:, None]
    slope = np.concatenate(
        [
            5 / 6 * np.einsum("ij,dij->d", steep, apart**2),
            [0.5 * nugget * np.trace(inner), 0.5 * share * np.sum(inner * gram)],
            -5 / 6 * np.einsum("ij,dij->d", steep, apart * moved),
        ]
    )
    precision = np.concatenate(
        [np.full(d, _LENGTH_SD**-2.0), np.zeros(2), np.full(d, _BEND_SD**-2.0)]
    )
    return float(value + 0.5 * precision @ z**2), slope + precision * z
