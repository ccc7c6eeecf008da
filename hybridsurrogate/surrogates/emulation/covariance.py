"""The covariance of a simulation's outputs, learned from runs, and predictions given them.

Outputs of two runs are as alike as the surrogate's terms make them, their prior variances times one
learned share, plus a Matern 5/2 process over inputs and parameters, plus what differs from run to
run. The most likely numbers are taken (Rasmussen and Williams 2006, section 5.4.1, equations 5.8
and 5.9), the variance of the process in closed form.

A stationary process has the same variance where a simulation is steep as where it is flat.
Leave-one-out errors of the runs show the difference: near a steep end of a range they are several
times what they should be.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dpstrf
from scipy.optimize import minimize

from hybridsurrogate.numerics.linear_algebra import (
    NEGLIGIBLE,
    blocks,
    in_turn,
    nudged_cholesky,
)
from hybridsurrogate.surrogates.basis import Basis
from hybridsurrogate.types import FloatArray

# the covariance is learned from at most so many runs, drawn at random, as files of runs are often
# in order (of runs that are curves fewer: each is as much as hundreds of rows), and the process is
# conditioned on at most so many
_LEARNED_ROWS, _LEARNED_RUNS, MAX_RUNS, MAX_CURVES = 500, 200, 5000, 2000
# of a spread, or of a nugget: what is less is none of what is looked for
_MINOR_SHARE = 0.01


class Places(NamedTuple):
    """Points as a process sees them.

    Attributes
    ----------
    halves : Apart
        Of squared distances in lengths.
    terms : ndarray of shape (n, p)
        Times their sd; p is 0 where the runs have no use for them.
    """

    halves: Apart
    terms: FloatArray

    def alike(self, others: Places) -> FloatArray:
        """Return covariances (n, m) in units of the process's variance."""
        out = alike(self.halves, others.halves)
        if self.terms.shape[1]:
            out += self.terms @ others.terms.T
        return out

    def weighted_in_turn(self, others: Places, weights: FloatArray) -> FloatArray:
        """Return sums (n,) of covariances times weights (J, m), the first for the first n / J."""
        out = weighted_in_turn(self.halves, others.halves, weights)
        if self.terms.shape[1]:
            out += in_turn(self.terms, weights @ others.terms)
        return out

    def weighted(
        self, others: Places, weights: FloatArray, shape: tuple[int, int, int]
    ) -> FloatArray:
        """Return sums of covariances times weights (m, k), shape (n, k), terms left out.

        Rows are of ``shape``: nodes, short moves of which the first is none, and measured rows.
        Along the moves these sums follow their slopes.
        """
        points = self.points.reshape(*shape, -1)
        first = np.arange(len(self.terms)).reshape(shape)[:, 0].ravel()
        value, slopes = weighted(self.of(first).halves, others.halves, weights)
        nodes, _, n = shape
        moved = points - points[:, :1]
        along = np.einsum("tmnd,tnkd->tmnk", moved, slopes.reshape(nodes, n, *slopes.shape[1:]))
        return (value.reshape(nodes, 1, n, -1) + along).reshape(len(self.terms), -1)

    @property
    def points(self) -> FloatArray:
        """Stretched inputs and parameters in lengths of the process, (n, d)."""
        return self.halves.right[:, :-2]

    def variances(self) -> FloatArray:
        """Return variances (n,)."""
        return 1 + np.sum(self.terms**2, axis=1)

    def of(self, chosen: NDArray[np.intp] | slice) -> Places:
        """Return some of the points."""
        left, right = self.halves
        return Places(Apart(left[chosen], right[chosen]), self.terms[chosen])

    def joined(self, others: Places) -> Places:
        """Return both."""
        halves = (np.concatenate(pair) for pair in zip(self.halves, others.halves, strict=True))
        return Places(Apart(*halves), np.concatenate([self.terms, others.terms]))


class Runs(NamedTuple):
    """Runs that a process is conditioned on: their places, and outputs less their prior mean.

    Of shapes (n, ...) and (n, k).
    """

    places: Places
    residual: FloatArray


@dataclass(frozen=True)
class Process:
    """Covariance of a simulation's outputs at inputs and parameters.

    Attributes
    ----------
    trend : Basis or None
    ranges : ndarray of shape (n_inputs + n_parameters, 2)
        Of the runs.
    covariance : Covariance
    term_sd : ndarray of shape (p,)
        Prior sd of the trend's coefficients in units of the process's; p is 0 where the runs have
        no use for its terms.
    """

    trend: Basis | None
    ranges: FloatArray
    covariance: Covariance
    term_sd: FloatArray

    def places(self, X: FloatArray, omega: FloatArray) -> Places:
        """Return rows of inputs and parameters as the process sees them."""
        points = bent(between(np.hstack([X, omega]), self.ranges), self.covariance.bends)
        terms = np.empty((len(X), 0))
        if self.trend is not None and len(self.term_sd):
            terms = self.trend.features(X, omega) * self.term_sd
        return Places(Apart.of(points / self.covariance.lengths), terms)

    def prior_mean(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the trend at its prior mean, (n,)."""
        if self.trend is None:
            return np.zeros(len(X))
        known = self.trend.known(X, omega)
        if np.any(self.trend.coefficient_mean):
            known = known + self.trend.features(X, omega) @ self.trend.coefficient_mean
        return known

    def some(self, X: FloatArray, omega: FloatArray, eta: FloatArray, most: int = MAX_RUNS) -> Runs:
        """Return the runs that are used, of runs with outputs eta (n,) or (n, k)."""
        chosen = used_rows(len(eta), most if eta.ndim == 1 else MAX_CURVES)
        X, omega = X[chosen], omega[chosen]
        outputs = eta[chosen].reshape(len(chosen), -1)
        return Runs(self.places(X, omega), outputs - self.prior_mean(X, omega)[:, None])


def used_rows(n: int, most: int = MAX_RUNS) -> NDArray[np.intp]:
    """Return the rows of n runs that are used, at random."""
    return np.random.default_rng(0).permutation(n)[:most]


def process_through(
    trend: Basis | None,
    ranges: FloatArray,
    X: FloatArray,
    omega: FloatArray,
    eta: FloatArray,
    noise: float = 0.0,
) -> Process:
    """Return the most likely covariance of outputs.

    Parameters
    ----------
    trend : Basis or None
        Without hyperparameters; None: nothing but the process.
    ranges : ndarray of shape (n_inputs + n_parameters, 2)
        Of the runs.
    X, omega, eta : ndarray of shape (n, n_inputs), (n, n_parameters), (n,)
        Runs; of outputs (n, k) the covariance that they share but for its size.
    noise : float, default=0.0
        Least standard deviation of what differs from run to run, such as rounding.
    """
    chosen = used_rows(len(eta), _LEARNED_ROWS if eta.ndim == 1 else _LEARNED_RUNS)
    X, omega = X[chosen], omega[chosen]
    mean, terms = np.zeros(len(X)), np.empty((len(X), 0))
    if trend is not None:
        features = trend.features(X, omega)
        mean = trend.known(X, omega) + features @ trend.coefficient_mean
        terms = features * trend.coefficient_sd
    residual = eta[chosen].reshape(len(chosen), -1) - mean[:, None]
    arrays = between(np.hstack([X, omega]), ranges), terms, residual
    least = noise**2 / max(float(np.var(residual)), np.finfo(float).tiny) if noise else 0.0
    covariance = _learned(*(array.tobytes() for array in arrays), len(chosen), least)
    if trend is None:
        return Process(None, ranges, covariance, np.empty(0))
    size = float(np.mean(np.sum(terms**2, axis=1)))
    used = slice(None if covariance.share else 0)
    term_sd = np.sqrt(covariance.share / max(size, 1e-300)) * trend.coefficient_sd[used]
    return Process(trend, ranges, covariance, term_sd)


@lru_cache(maxsize=8)
def _learned(points: bytes, terms: bytes, residual: bytes, n: int, least: float) -> Covariance:
    """Return `learned`: folds and grids over beta ask for the same runs again and again."""
    arrays = (np.frombuffer(array).reshape(n, -1) for array in (points, terms, residual))
    places, features, outputs = arrays
    return learned(places, features, outputs, least)


class Conditioned(NamedTuple):
    """A process given its runs.

    Attributes
    ----------
    weights : ndarray of shape (n, k)
        Of the runs, for each output.
    whiten : ndarray of shape (n, n)
        Inverse of the lower factor of their covariance in units of the process's variance.
    sd : ndarray of shape (k,)
        Of the process.
    misses : ndarray of shape (n,)
        Squared leave-one-out errors of the runs, in units of their variance; of several outputs
        the sums of both.
    left_out : ndarray of shape (n, k)
        Outputs less what all other runs predict for them.
    precision : ndarray of shape (n,)
        One over the variance of these, in units of the process's.
    centers : ndarray of shape (m,)
        The runs that ``weights`` and ``whiten`` are of, if not all.
    """

    weights: FloatArray
    whiten: FloatArray
    sd: FloatArray
    misses: FloatArray
    left_out: FloatArray
    precision: FloatArray
    centers: NDArray[np.intp] | slice = slice(None)


def conditioned(
    matrix: FloatArray, nugget: FloatArray | float, residual: FloatArray
) -> Conditioned:
    """Return a process given runs with covariance (n, n) and outputs (n, k) less their mean.

    ``nugget`` is that of all, or of each (n,).
    """
    n = len(residual)
    lower = nudged_cholesky((matrix + nugget * np.eye(n))[None])[0]
    whiten: FloatArray = solve_triangular(lower, np.eye(n), lower=True)
    weights = whiten.T @ (whiten @ residual)
    return Conditioned(weights, whiten, *_left_out(residual, weights, np.sum(whiten**2, axis=0)))


def _left_out(
    residual: FloatArray, weights: FloatArray, precision: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return ``sd`` to ``precision`` of `Conditioned`, from the diagonal (n,) of the precision."""
    # leave-one-out errors in units of their sd (Rasmussen and Williams 5.12): 1 on average where
    # the covariance is right
    deviation = weights**2 / precision[:, None]
    squares = np.maximum(np.sum(residual * weights, axis=0), np.sum(deviation, axis=0))
    variance = squares / len(residual)
    # outputs that are all the same vary by nothing
    misses = np.sum(deviation, axis=1) / max(float(np.sum(variance)), 1e-300)
    return np.sqrt(variance), misses, weights / precision[:, None], precision


def condensed(
    matrix: FloatArray, nugget: float, residual: FloatArray, shares: FloatArray
) -> Conditioned:
    """Return `conditioned` by fewer runs, where these give all others better than the nugget does.

    The nugget of each run is that of all times its share (n,).

    All runs inform the weights of those few, as in the projected process of Rasmussen and Williams
    2006, equations 8.26 and 8.27: 500 of 2,000 curves of two parameters, a quarter of the time of
    a prediction, a sixteenth of that of its error.
    """
    # where others leave no more of a run, it is none of those that a prediction is made of: of
    # 2,000 curves the mean then moved by at most 0.07 of its error, which is the same; at a tenth
    # of a nugget by one and a half of them
    lower, order, m, _ = dpstrf(matrix, tol=_MINOR_SHARE * nugget * np.min(shares), lower=1)
    if 2 * m > len(matrix):
        return conditioned(matrix, nugget * shares, residual)
    order, one = order - 1, np.eye(m)
    root = np.sqrt(shares[order, None])
    # in units of each run's noise
    factor, outputs = np.tril(lower[:, :m]) / root, residual[order] / root
    precision = cholesky(factor.T @ factor + nugget * one, lower=True)
    white = solve_triangular(precision, factor.T, lower=True)
    fit = white @ outputs
    whiten = solve_triangular(factor[:m] * root[:m], one, lower=True)
    weights = whiten.T @ solve_triangular(precision, fit, lower=True, trans=1)
    # of what few runs give, the share that is known; its eigenvalues go from _MINOR_SHARE to 1
    known = cholesky(one - nugget * cho_solve((precision, True), one), lower=True)
    of_all = (outputs - white.T @ fit) / nugget, (1 - np.sum(white**2, axis=0)) / nugget
    own = of_all[0] / root, of_all[1] / shares[order]
    sd, misses, left_out, diagonal = _left_out(residual[order], *own)
    back = np.argsort(order)
    of_runs = misses[back], left_out[back], diagonal[back]
    return Conditioned(weights, known.T @ whiten, sd, *of_runs, order[:m])


def weights_of(matrix: FloatArray, nugget: FloatArray | float, residual: FloatArray) -> FloatArray:
    """Return the weights (n, k) of `conditioned` alone: a third of its time."""
    lower = nudged_cholesky((matrix + nugget * np.eye(len(residual)))[None])[0]
    return np.asarray(cho_solve((lower, True), residual))


# the weight of a run falls by a factor e for so many runs that lie between; the prior that errors
# are as the process predicts, in runs. Without, 90 % intervals of 76 such emulators cover 0.9
# (standard error 0.2) points less, and log densities are 0.04 (0.02) lower
_NEIGHBOUR_RUNS, _PRIOR_RUNS = 3.0, 2.0


class LocalError(NamedTuple):
    """Factors on the error along each axis.

    Attributes
    ----------
    places : ndarray of shape (d, n)
        Coordinates of the runs, in order.
    factors : ndarray of shape (d, n)
        There, at least 1.
    """

    places: FloatArray
    factors: FloatArray

    @classmethod
    def of(cls, points: FloatArray, misses: FloatArray) -> LocalError:
        """Return factors for runs.

        Parameters
        ----------
        points : ndarray of shape (n, d)
        misses : ndarray of shape (n,)
            Squared errors in units of their variance.
        """
        order = np.argsort(points, axis=0, kind="stable").T
        ranks = np.arange(len(misses))
        near = np.exp(-np.abs(ranks[:, None] - ranks) / _NEIGHBOUR_RUNS)
        # the mean of an inverse-gamma belief about the variance, updated by the runs around
        square = (_PRIOR_RUNS + misses[order] @ near) / (_PRIOR_RUNS + np.sum(near, axis=0))
        places = np.take_along_axis(points.T, order, axis=1)
        return cls(places, np.sqrt(np.maximum(square, 1.0)))

    def at(self, points: FloatArray) -> FloatArray:
        """Return the largest factor of all axes at points (m, d), shape (m,)."""
        along = [np.interp(*axis) for axis in zip(points.T, self.places, self.factors, strict=True)]
        return np.max(along, axis=0, initial=1.0)


# sd of the normal priors of each log length and each bend; the means are half the range, and none
_PRIOR_SD = 2.0
# an input without influence has the longest length: at 50 errors of the borehole function are twice
# as large from 1,000 runs
_LENGTHS, _SHARES, _MAX_BEND = (0.05, 1000.0), (1e-3, 1e5), 8.0
# the least nugget is there for the digits alone
LEAST_NUGGET = 1e-7
_NUGGETS = (LEAST_NUGGET, 10.0)
# logarithms of nugget and share to start from: with others, rougher or with more of the terms, 71
# of 76 fits to runs of 12 simulations are the same, and errors by less than a thousandth
_START = (-9.0, -2.0)
_ROOT = np.sqrt(5.0)
# runs among which the most likely numbers are searched, and steps from there with all runs
_SEARCHED_RUNS, _POLISHING_STEPS = 200, 15


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
    return np.where(np.abs(bends) < NEGLIGIBLE, NEGLIGIBLE, bends)


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
    limits += [(-_MAX_BEND, _MAX_BEND)] * d
    few = min(len(points), _SEARCHED_RUNS)

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
        args, options = (gram, len(points)), {"maxiter": _POLISHING_STEPS}
        end = minimize(
            deviance, best, args, method="L-BFGS-B", jac=True, bounds=limits, options=options
        )
        return np.asarray(end.x)

    def place(nugget: float, share: float, lengths: FloatArray) -> FloatArray:
        return np.array([*lengths, nugget, share, *np.zeros(d)])

    # along one axis, mostly time, outputs may come and go many times: few runs then have two peaks
    uneven = [place(*_START, lengths) for lengths in np.where(np.eye(d) > 0, -2.0, 1.0)]
    first = min(uneven, key=lambda z: deviance(z, none, few)[0])
    even = np.zeros(d)
    alone = most_likely([place(*_START, even), first], none)
    if terms.shape[1]:
        together = most_likely([place(*_START, even), alone], gram)
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
    spread = variance / diagonal[:, None] + (_MINOR_SHARE * np.std(residual, axis=0)) ** 2
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
    # every pair once: a third of the time of all n^2 differences
    one, other = np.triu_indices(n, 1)
    weight = 5 / 3 * steep[one, other]
    moves = _bent_by(points, z[d + 2 :]) / lengths
    apart, moved = (a.take(one, axis=0) - a.take(other, axis=0) for a in (places, moves))
    slope = np.concatenate(
        [
            weight @ apart**2,
            [0.5 * nugget * np.trace(inner), 0.5 * share * np.sum(inner * gram)],
            -weight @ (apart * moved),
        ]
    )
    precision = np.concatenate(
        [np.full(d, _PRIOR_SD**-2.0), np.zeros(2), np.full(d, _PRIOR_SD**-2.0)]
    )
    return float(value + 0.5 * precision @ z**2), slope + precision * z
