"""Importance sampling: Student-t proposals around modes, adapted, reweighted, moved.

Densities take a batch of points (J, d) and return (J,), so every step below is one call.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.inference.sampling.modes import (
    PROPOSAL_SCALE,
    Gaussian,
    LogDensity,
    NothingPossibleError,
    standard_student,
    standard_student_draws,
)
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.model.posterior import MIN_EFFECTIVE_EACH
from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE, SINGULAR
from hybridsurrogate.numerics.psis import KHAT_LIMIT, level_smooth, pareto_smooth
from hybridsurrogate.priors import Z_LIMIT
from hybridsurrogate.types import FloatArray

# each with twice the proposals of the one before: in all as many as an ensemble's steps, at most
_MAX_ROUNDS = 7
# of the log of a chi-squared variable with one degree of freedom
_LOG_CHI2_MEAN = float(special.digamma(0.5) + np.log(2))
_LOG_CHI2_VARIANCE = np.pi**2 / 2


@dataclass(frozen=True)
class Bent:
    """A Student-t proposal in which all axes follow the first few on a bent course.

    Given those before it each of the first axes has a centre quadratic and a log width linear in
    them, and so have all others given the first, correlated as they are: a triangular map of a
    Student-t (Parno and Marzouk 2018, SIAM/ASA Journal on Uncertainty Quantification 6:645).

    Attributes
    ----------
    mean : ndarray of shape (d,)
    axes : ndarray of shape (d, d)
        In its columns, each as long as the points spread that it was fitted to; the one that the
        others follow best is the first.
    courses : tuple of _Course
        Of each of the first axes, and of all others.
    log_mass : float
        Of the density that is proposed for.
    """

    mean: FloatArray
    axes: FloatArray
    courses: tuple[_Course, ...]
    log_mass: float

    def draws(self, n: int, random_state: np.random.RandomState) -> FloatArray:
        """Draw n points."""
        y = PROPOSAL_SCALE * standard_student_draws((n, len(self.axes)), random_state)
        for one in self.courses:
            centre, width = one.given(y)
            y[:, one.axes] = centre + width * (y[:, one.axes] @ one.factor.T)
        return self.mean + y @ self.axes.T

    def log_density(self, x: FloatArray) -> FloatArray:
        """Return the log density (J,) at points (J, d)."""
        y = np.linalg.solve(self.axes, (x - self.mean).T).T
        squares = np.zeros(len(x))
        log_det = np.full(len(x), np.linalg.slogdet(self.axes)[1])
        for one in self.courses:
            centre, width = one.given(y)
            off = np.linalg.inv(one.factor) @ ((y[:, one.axes] - centre) / width).T
            squares += np.einsum("kj,kj->j", off, off) / PROPOSAL_SCALE**2
            log_det += np.log(PROPOSAL_SCALE * np.diag(one.factor)).sum()
            log_det += np.log(width).sum(axis=1)
        return standard_student(squares, len(self.axes)) - log_det


class _Course(NamedTuple):
    """The course of some axes, one after the other, over those before them."""

    axes: slice
    centres: FloatArray
    widths: FloatArray
    factor: FloatArray

    def given(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return centres and widths of these axes at points of which those before are known."""
        terms = _terms(y[:, : self.axes.start])
        # lines that are extrapolated reach any place and any width: as far as priors do
        log_width = terms[:, : len(self.widths)] @ self.widths
        width = np.exp(np.clip(log_width, 2 * np.log(SINGULAR), np.log(Z_LIMIT)))
        return np.clip(terms @ self.centres, -Z_LIMIT, Z_LIMIT), width


def _terms(y: FloatArray) -> FloatArray:
    """Return 1, the columns of y (J, k) and their products; y as far as priors reach."""
    y = np.clip(y, -Z_LIMIT, Z_LIMIT)
    rows, columns = np.triu_indices(y.shape[1])
    return np.hstack([np.ones((len(y), 1)), y, y[:, rows] * y[:, columns]])


Component = Gaussian | Bent


def mixture_points(
    components: Sequence[Component], n: int, random_state: np.random.RandomState
) -> FloatArray:
    """Draw n points from a mixture of Student-t proposals.

    Components weigh as much as their masses, but at least a twentieth (of many: half of an equal
    share), so that a small mode far away gets enough points to estimate its mass.
    """
    cumulative = np.concatenate([[0.0], np.cumsum(_shares(components))])
    counts = np.diff(np.round(n * cumulative).astype(int))
    drawn = [one.draws(k, random_state) for one, k in zip(components, counts, strict=True)]
    return np.concatenate(drawn)


def mixture_log_density(components: Sequence[Component], points: FloatArray) -> FloatArray:
    """Return the log density of that mixture at points (J, d)."""
    terms = np.log(_shares(components))[:, None] + _log_densities(components, points)
    out: FloatArray = np.logaddexp.reduce(terms, axis=0)
    return out


def _log_densities(components: Sequence[Component], x: FloatArray) -> FloatArray:
    """Return the log densities (K, J) of K proposals at points (J, d)."""
    return np.array([one.log_density(x) for one in components])


def _shares(components: Sequence[Component]) -> FloatArray:
    mass = np.array([g.log_mass for g in components])
    least = min(SETTINGS.min_proposed, 0.5 / len(components))
    share = np.maximum(np.exp(mass - np.logaddexp.reduce(mass)), least)
    return share / share.sum()


def matched(points: FloatArray, weight: FloatArray, components: list[Gaussian]) -> list[Gaussian]:
    """Return each component moved to the moments of the points that it is responsible for."""
    share = _responsible(points, weight, components)
    mass = share.sum(axis=1)
    moved = [
        moment_match(points, own / m, g) if m > SETTINGS.min_mode_share else g
        for own, m, g in zip(share, mass, components, strict=True)
    ]
    return [
        replace(g, log_mass=float(np.log(max(m, SETTINGS.min_mode_share))))
        for g, m in zip(moved, mass, strict=True)
    ]


def slices(points: FloatArray, weight: FloatArray, components: list[Gaussian]) -> list[Gaussian]:
    """Return proposals along each component: slices of its points across their longest axis."""
    out = []
    for own, g in zip(_responsible(points, weight, components), components, strict=True):
        if own.sum() <= SETTINGS.min_mode_share:
            continue
        axis = np.linalg.eigh(g.factor @ g.factor.T)[1][:, -1]
        order = np.argsort(points @ axis)
        part = np.minimum(
            SETTINGS.bending_axes * np.cumsum(own[order]) / own.sum(), SETTINGS.bending_axes - 1
        ).astype(int)
        for k in range(SETTINGS.bending_axes):
            inside = order[part == k]
            m = own[inside].sum()
            if m > SETTINGS.min_mode_share:
                one = moment_match(points[inside], own[inside] / m, g)
                out.append(replace(one, log_mass=float(np.log(m))))
    return out


def bent(points: FloatArray, weight: FloatArray, components: list[Gaussian]) -> list[Bent]:
    """Return proposals that bend as the points do that each component is responsible for.

    Two for each, which share its mass: some courses bend along an unknown, others along a principal
    axis of the points.
    """
    out = []
    for own, one in zip(_responsible(points, weight, components), components, strict=True):
        mass = own.sum()
        if mass > SETTINGS.min_mode_share:
            counted = own > SINGULAR * own.max()
            of_it = points[counted], own[counted] / mass
            # of the root: eigenvalues of the covariance along a thin bend are less than rounding
            axes, sd, _ = np.linalg.svd(one.factor)
            unknowns = np.diag(np.linalg.norm(one.factor, axis=1))
            out += [_bent(*of_it, one, scaled) for scaled in (unknowns, axes * sd)]
    return out


def _bent(points: FloatArray, weight: FloatArray, around: Gaussian, axes: FloatArray) -> Bent:
    """Return the bends that weighted points (J, d) have."""
    y = np.linalg.solve(axes, (points - around.mean).T).T
    order = _order(y, weight)
    y = y[:, order]
    first = min(SETTINGS.bending_axes, len(order))
    parts = [slice(j, j + 1) for j in range(first)]
    if first < len(order):
        parts.append(slice(first, len(order)))
    courses = tuple(_course(y, weight, part) for part in parts)
    return Bent(around.mean, axes[:, order], courses, around.log_mass)


def _course(y: FloatArray, weight: FloatArray, axes: slice) -> _Course:
    """Return the course of some axes of weighted points: regressions under priors of unit width.

    The log width is half the regression of the log squared residuals, whose mean and variance under
    a normal are those of log chi2(1).
    """
    effective = float(1 / np.sum(weight**2))
    terms, values = _terms(y[:, : axes.start]), y[:, axes]
    linear = terms[:, : axes.start + 1]
    loose = _regressed(terms, values, weight, np.zeros(values.shape[1]))
    variance = weight @ (values - terms @ loose) ** 2
    centres = _regressed(terms, values, weight, variance / effective)
    # an axis that those before it determine leaves none
    residuals = values - terms @ centres
    squares = residuals**2 + SINGULAR**2
    squares += NEGLIGIBLE * (weight @ squares)
    logs = np.log(squares) - _LOG_CHI2_MEAN
    pull = np.full(values.shape[1], _LOG_CHI2_VARIANCE / effective)
    widths = 0.5 * _regressed(linear, logs, weight, pull)
    left = weight @ (squares * np.exp(-2 * (linear[:, 1:] @ widths[1:])))
    widths[0] = 0.5 * np.log(left)
    scaled = residuals / np.exp(linear @ widths)
    around = Gaussian(np.zeros(len(left)), np.eye(len(left)), 0.0)
    factor = moment_match(scaled, weight, around).factor
    # as in `moment_match`, for points that are few next to the coefficients
    widths[0] += 0.5 * np.log(1 + 2 * terms.shape[1] / effective)
    return _Course(axes, centres, widths, factor)


def _regressed(
    terms: FloatArray, values: FloatArray, weight: FloatArray, pull: FloatArray
) -> FloatArray:
    """Return coefficients (p, k) of terms (J, p), each column of values by weighted least squares.

    All but the first are pulled to zero, in each column by another strength.
    """
    weighted = (terms * weight[:, None]).T
    penalty = np.eye(terms.shape[1]) * (pull + SINGULAR)[:, None, None]
    penalty[:, 0, 0] = 0.0
    right = (weighted @ values).T[:, :, None]
    out: FloatArray = np.linalg.solve(weighted @ terms + penalty, right)[:, :, 0].T
    return out


def _order(y: FloatArray, weight: FloatArray) -> NDArray[np.intp]:
    """Return the order of axes: next is the one that the rest follow best with those before it."""
    # a thousand points show the order: looked for in all, it takes a third of the time of a fit
    share = np.cumsum(weight) / np.sum(weight)
    some = (np.arange(SETTINGS.min_proposals) + 0.5) / SETTINGS.min_proposals
    y = y[np.minimum(np.searchsorted(share, some), len(y) - 1)]
    equal = np.full(len(y), 1 / len(y))
    order: list[int] = []
    rest = list(range(y.shape[1]))
    while len(rest) > 1 and len(order) < SETTINGS.bending_axes:
        left = []
        for k in rest:
            terms = _terms(y[:, [*order, k]])
            others = y[:, [j for j in rest if j != k]]
            off = others - terms @ _regressed(terms, others, equal, np.zeros(others.shape[1]))
            left.append(np.sum(np.log(equal @ off**2 + SINGULAR**2)))
        order.append(rest.pop(int(np.argmin(left))))
    return np.array([*order, *rest])


def _responsible(points: FloatArray, weight: FloatArray, components: list[Gaussian]) -> FloatArray:
    """Share the weights of points (J,) among components, (K, J)."""
    mass = np.array([g.log_mass for g in components])
    log_terms = mass[:, None] + _log_densities(components, points)
    return weight * np.exp(log_terms - np.logaddexp.reduce(log_terms, axis=0))


def moment_match(points: FloatArray, weight: FloatArray, fallback: Gaussian) -> Gaussian:
    """Return the Gaussian with the weighted moments of points, kept away from collapse."""
    d = points.shape[1]
    mean = weight @ points
    centred = points - mean
    covariance = (centred * weight[:, None]).T @ centred
    effective = 1 / np.sum(weight**2)
    share = effective / (effective + 2 * d)
    covariance = share * covariance + (1 - share) * fallback.factor @ fallback.factor.T
    covariance += SINGULAR * np.trace(covariance) / d * np.eye(d)
    return Gaussian(mean, np.linalg.cholesky(covariance), fallback.log_mass)


@dataclass(frozen=True)
class Proposals:
    """Points (J, d) and the log density (J,) that they were drawn from."""

    points: FloatArray
    log_density: FloatArray


@dataclass(frozen=True)
class ImportanceDraws:
    """Resampled draws and how reliable they are.

    Attributes
    ----------
    draws : ndarray of shape (n_draws, d)
    khat : float
        Shape of the Pareto tail of the weights; above 0.7 the draws are unreliable.
    effective_draws : float
        1 / sum of squared normalised weights.
    log_evidence : float
        Log of the mean weight, an estimate of the log normalising constant.
    log_evidence_error : float
        Its standard error, from the spread of the weights.
    proposals : Proposals
        Of all rounds.
    """

    draws: FloatArray
    khat: float
    effective_draws: float
    log_evidence: float
    log_evidence_error: float
    proposals: Proposals


def importance_draws(
    log_density: LogDensity,
    components: list[Gaussian],
    n_proposals: int,
    n_draws: int,
    random_state: np.random.RandomState,
    max_rounds: int = 6,
    n_noise: int = 0,
    modes: Sequence[Gaussian] = (),
) -> ImportanceDraws:
    """Draw from a density through Student-t proposals with Pareto-smoothed weights.

    The last ``n_noise`` dimensions of the density get normal proposals, whose width is adapted with
    the rest: with every other one a Student-t, 18 posteriors of counts and heavy tails had 91
    (standard error 32) fewer effective draws, and the same k-hat.

    Where fewer than a tenth of the proposals are effective, or the tail of the weights is bad, the
    next round has proposals at the weighted mean and covariance of each one's share of the draws
    (Cappe, Douc, Guillin, Marin and Robert 2008, Statistics and Computing 18:447), and of slices
    of it along its longest axis, which follow a bend. The draws of all rounds get their weights
    from the mixture of all proposals, so that none is lost (Cornuet, Marin, Mira and Robert 2012,
    Scandinavian Journal of Statistics 39:798).

    Where there are several ``modes``, the weights near each of them have a separate k-hat, and the
    largest counts: good draws at one mode do not show the mass of another.

    See Also
    --------
    growing_draws : More proposals each round, for a density whose tails are found step by step.
    """
    rounds: list[_Round] = []
    scale = 1.0
    # with coefficients among the unknowns each value is optimised: what can be trusted is enough
    good = KHAT_LIMIT if n_noise else SETTINGS.adapted_khat
    weighted = _NONE
    for _ in range(max_rounds):
        drawn = mixture_points(components, n_proposals, random_state)
        noise = scale * random_state.standard_normal((n_proposals, n_noise))
        rounds.append(_Round(np.hstack([drawn, noise]), components, scale))
        weighted = _with_last(log_density, weighted, rounds, n_noise, modes)
        enough = weighted.effective >= SETTINGS.min_effective_share * n_proposals
        if enough and weighted.khat <= good:
            break
        shaped = weighted.points[:, : weighted.points.shape[1] - n_noise]
        components = matched(shaped, weighted.weight, components)
        if len(components) <= SETTINGS.bending_axes:
            components = [*components, *slices(shaped, weighted.weight, components)]
        if n_noise:
            squares = np.sum(weighted.points[:, -n_noise:] ** 2, axis=1)
            spread = np.sqrt(weighted.weight @ squares / n_noise)
            scale = float(np.clip(spread, 0.5, 2.0))
    return _resampled(weighted, n_draws, random_state)


def growing_draws(
    log_density: LogDensity,
    before: ImportanceDraws,
    modes: Sequence[Gaussian],
    defence: Gaussian,
    n_proposals: int,
    random_state: np.random.RandomState,
) -> ImportanceDraws:
    """Draw again through bends fitted to unreliable draws, with twice the proposals each round.

    Until as many are effective as there are draws and k-hat is as good as that of adapted Gaussians
    or, after a few rounds, their spread is steady. Along a narrow bend each round reaches farther
    into the tails than the one before.

    Parameters
    ----------
    log_density : callable
    before : ImportanceDraws
    modes : sequence of Gaussian
        Each gets a proposal that bends, and a few as it is: there may be a peak on a plain.
        Weights near it have a separate k-hat.
    defence : Gaussian
        Proposals as wide as the priors, some in each round, which bound the weights of a heavy
        tail (Hesterberg 1995, Technometrics 37:185).
    n_proposals : int
        Of the first round.
    random_state : RandomState

    Returns
    -------
    ImportanceDraws
    """
    n_draws = len(before.draws)
    points, weight = before.draws, np.full(n_draws, 1 / n_draws)
    around, few = list(modes), [defence, *(replace(mode, log_mass=-np.inf) for mode in modes)]
    rounds: list[_Round] = []
    weighted, spread = _NONE, np.full(points.shape[1], np.inf)
    for k in range(_MAX_ROUNDS):
        around = matched(points, weight, around)
        components: list[Component] = [*few, *bent(points, weight, around)]
        drawn = mixture_points(components, n_proposals * 2**k, random_state)
        rounds.append(_Round(drawn, components, 1.0))
        weighted = _with_last(log_density, weighted, rounds, 0, modes)
        points, weight = weighted.points, weighted.weight
        before_it, spread = spread, np.sqrt(weight @ (points - weight @ points) ** 2)
        # early rounds agree by chance: draws with 0.54 of the spread of a bend, at a k-hat of 0.59
        is_steady = k + 1 >= SETTINGS.few_rounds and np.all(
            np.abs(spread - before_it) <= SETTINGS.converged_spread * spread
        )
        enough = KHAT_LIMIT if is_steady else SETTINGS.adapted_khat
        if weighted.khat <= enough and weighted.effective >= n_draws:
            break
    return _resampled(weighted, n_draws, random_state)


@dataclass(frozen=True)
class _Weighted:
    """Points (J, d) of all rounds, log densities (J,) and what they weigh."""

    points: FloatArray
    target: FloatArray
    mixed: FloatArray
    weight: FloatArray
    khat: float

    @property
    def effective(self) -> float:
        return float(1 / np.sum(self.weight**2))


_NONE = _Weighted(np.empty((0, 0)), np.empty(0), np.empty(0), np.empty(0), np.inf)


def _with_last(
    log_density: LogDensity,
    before: _Weighted,
    rounds: Sequence[_Round],
    n_noise: int,
    modes: Sequence[Gaussian],
) -> _Weighted:
    """Return the points of all rounds with the last one's, weighted by the mixture of all."""
    target = np.append(before.target, log_density(rounds[-1].points))
    if not np.isfinite(target).any():
        raise NothingPossibleError(
            "Almost everywhere near its mode the posterior is impossible: a prior with hard "
            "ends may be too narrow. Widen it, or take one without ends."
        )
    points = np.concatenate([one.points for one in rounds])
    mixed = _mixed(before.mixed, rounds, points, n_noise)
    shaped = points[:, : points.shape[1] - n_noise]
    smoothed, khat = _smoothed(target - mixed, shaped, modes)
    weight: FloatArray = np.exp(smoothed - special.logsumexp(smoothed))
    return _Weighted(points, target, mixed, weight, khat)


def _resampled(
    weighted: _Weighted, n_draws: int, random_state: np.random.RandomState
) -> ImportanceDraws:
    index = _systematic_resample(weighted.weight, n_draws, random_state)
    log_proposal = weighted.mixed - np.log(len(weighted.points))
    return ImportanceDraws(
        weighted.points[index],
        weighted.khat,
        weighted.effective,
        *log_mean(weighted.target - log_proposal),
        Proposals(weighted.points, log_proposal),
    )


def log_mean(log_weight: FloatArray) -> tuple[float, float]:
    """Return the log of the mean weight and its standard error, by the spread of the weights."""
    value = float(special.logsumexp(log_weight) - np.log(len(log_weight)))
    relative = np.exp(log_weight - value)
    return value, float(np.std(relative) / np.sqrt(len(relative)))


class _Round(NamedTuple):
    """Points (J, d + n_noise) of one round, and what they were drawn from."""

    points: FloatArray
    components: Sequence[Component]
    scale: float


def _mixed(
    before: FloatArray, rounds: Sequence[_Round], points: FloatArray, n_noise: int
) -> FloatArray:
    """Return the log of the summed densities of all points drawn (J,), the last round's added.

    ``before`` holds it for the points and the densities of the rounds before.
    """
    old, new = points[: len(before)], points[len(before) :]
    added = np.logaddexp(before, _round_log_density(rounds[-1], old, n_noise))
    terms = [_round_log_density(one, new, n_noise) for one in rounds]
    return np.concatenate([added, special.logsumexp(terms, axis=0)])


def _round_log_density(one: _Round, points: FloatArray, n_noise: int) -> FloatArray:
    d = points.shape[1] - n_noise
    squares = np.einsum("jk,jk->j", points[:, d:], points[:, d:])
    shaped = mixture_log_density(one.components, points[:, :d])
    # of n_noise normal variables of that scale
    constant = n_noise * np.log(one.scale * np.sqrt(2 * np.pi))
    return np.log(len(one.points)) + shaped - 0.5 * squares / one.scale**2 - constant


def _smoothed(
    log_weight: FloatArray, points: FloatArray, modes: Sequence[Gaussian]
) -> tuple[FloatArray, float]:
    """Return log weights of points (J, d), smoothed in the cell of each mode; the largest k-hat."""
    nearest = np.zeros(len(points))
    if len(modes) > 1:
        nearest = _log_densities(modes, points).argmax(axis=0)
    out, khats = log_weight.copy(), []
    for k in range(max(len(modes), 1)):
        cell = np.flatnonzero(nearest == k)
        khats.append(np.inf)
        if np.count_nonzero(np.isfinite(log_weight[cell])) >= MIN_EFFECTIVE_EACH:
            out[cell], khats[-1] = level_smooth(log_weight[cell])
    return out, max(khats)


def _systematic_resample(
    weight: FloatArray, n: int, random_state: np.random.RandomState
) -> NDArray[np.intp]:
    """Return n indices with the given probabilities, in random order."""
    positions = (np.arange(n) + random_state.uniform()) / n
    cumulative = np.cumsum(weight)
    index = np.searchsorted(cumulative / cumulative[-1], positions)
    return random_state.permutation(np.minimum(index, len(weight) - 1))


def matched_draws(
    log_density: LogDensity,
    proposals: Proposals,
    n_draws: int,
    random_state: np.random.RandomState,
    n_noise: int = 0,
) -> ImportanceDraws:
    """Draw from a density through proposals made for another, moved by moment matching.

    Affine maps of the proposals towards the weighted moments, one after the other (mean, scales,
    covariance), each kept where it makes k-hat smaller (Paananen, Piironen, Burkner and Vehtari
    2021, Statistics and Computing 31:16, algorithm 2).

    Parameters
    ----------
    log_density : callable
    proposals : Proposals
    n_draws : int
    random_state : RandomState
    n_noise : int, default=0
        Dimensions at the end that are standard normal in the proposals and stay as they are.

    Returns
    -------
    ImportanceDraws
        Its k-hat shows whether the draws are reliable.
    """
    d = proposals.points.shape[1] - n_noise
    log_weight = log_density(proposals.points) - proposals.log_density
    smoothed, khat = pareto_smooth(log_weight)
    for how in ("mean", "scales", "covariance"):
        weight = np.exp(smoothed - special.logsumexp(smoothed))
        effective = 1 / np.sum(weight**2)
        if khat <= KHAT_LIMIT and effective >= SETTINGS.min_matched_share * len(weight):
            break
        moved = _moved(proposals, weight, d, how)
        new_weight = log_density(moved.points) - moved.log_density
        new_smoothed, new_khat = pareto_smooth(new_weight)
        if new_khat < khat:
            proposals, log_weight, smoothed, khat = moved, new_weight, new_smoothed, new_khat
    weight = np.exp(smoothed - special.logsumexp(smoothed))
    index = _systematic_resample(weight, n_draws, random_state)
    return ImportanceDraws(
        proposals.points[index],
        khat,
        float(1 / np.sum(weight**2)),
        *log_mean(log_weight),
        proposals,
    )


def _moved(proposals: Proposals, weight: FloatArray, d: int, how: str) -> Proposals:
    """Return proposals mapped so that their plain moments are their weighted ones."""
    points = proposals.points[:, :d]
    plain, target = points.mean(axis=0), weight @ points
    factor: FloatArray = np.eye(d)
    if how != "mean":
        wanted = ((points - target) * weight[:, None]).T @ (points - target)
        present = np.cov(points.T, bias=True).reshape(d, d)
        if how == "scales" or np.linalg.eigvalsh(wanted)[0] < 1e-10 * np.trace(wanted):
            factor = np.diag(np.sqrt(np.diag(wanted) / np.diag(present)))
        else:
            factor = np.linalg.cholesky(wanted) @ np.linalg.inv(np.linalg.cholesky(present))
    out = proposals.points.copy()
    out[:, :d] = target + (points - plain) @ factor.T
    return Proposals(out, proposals.log_density - np.linalg.slogdet(factor)[1])
