"""Measured data that make a diagnosis doubtful: rows far off, copies, lost digits, wide counts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.stats import median_abs_deviation
from sklearn.utils import check_consistent_length

from hybridsurrogate.diagnosis.checks.caution import REPLICATES, SETTINGS, Caution
from hybridsurrogate.diagnosis.checks.simulation import EmulatorCheck
from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.context import BLUR
from hybridsurrogate.diagnosis.search.search import Search, predict_locally
from hybridsurrogate.effects.noise.outliers import GrossError
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.rows.measured_data import GivenRows, check_weights
from hybridsurrogate.model.statistics import emulator_posterior
from hybridsurrogate.numerics.digits import listing, number
from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE
from hybridsurrogate.priors import from_normal
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.types import FloatArray


def counted_rows(rows: GivenRows) -> GivenRows:
    """Return the rows that have a weight, their weights (None: all one), and their errors.

    Raises
    ------
    ValueError
        For weights that are unusable.
    """
    X, y, weights, _ = rows
    if weights is None or X is None or y is None:  # an estimator reports what is missing
        return rows._replace(weights=None)
    check_consistent_length(X, y)
    weights = check_weights(weights, len(X))
    if np.all(weights == 1.0):
        return rows._replace(weights=None)
    return rows._replace(weights=weights).take(np.flatnonzero(weights > 0))


def copied_rows(X: FloatArray, y: FloatArray) -> list[Caution]:
    """Return how many rows repeat an earlier one in input and output, unless that is no wonder.

    Rows with the same inputs are measurements made again. Where most of these differ in the output,
    those that agree are rounded.

    Parameters
    ----------
    X : ndarray of shape (n, n_columns)
    y : ndarray of shape (n,)
    """
    again = len(X) - len(np.unique(X, axis=0))
    alike = len(X) - len(np.unique(np.column_stack([X, y]), axis=0))
    if alike < SETTINGS.chance_sd or 2 * alike <= again:
        return []
    sentence = (
        f"{alike} of {len(X)} measured rows are copies of others, in every input and in the "
        "output. Copies count as measurements made again, so that the noise looks autocorrelated "
        "and causes look surer than they are: drop them, DataFrame.drop_duplicates(), unless each "
        "was measured."
    )
    return [Caution("data", sentence)]


def check_digits(problem: Problem) -> None:
    """Raise ValueError for data so far from zero that doubles represent little of their spread.

    What they lose must be less than the `NEGLIGIBLE` below which noise is rounding.
    """
    if np.ptp(problem.y) == 0:
        raise ValueError(
            f"All measured outputs are {problem.observed[0]:.12g}: there is no spread to diagnose. "
            "If they did differ, double precision does not resolve by how little: subtract a "
            "constant from measurements and simulation alike, before their digits are lost."
        )
    names = ["measured outputs", *(f"values of {name!r}" for name in problem.model.columns)]
    for what, values in zip(names, [problem.y, *problem.X.T], strict=False):
        sd, lost = float(np.std(values)), float(np.spacing(np.max(np.abs(values))))
        if np.ptp(values) > 0 and lost > NEGLIGIBLE * sd:
            raise ValueError(
                f"The {what} lie around {np.mean(values):g} with a standard deviation of {sd:g}, "
                f"but double precision represents such numbers to {lost:g} only, too little for a "
                "diagnosis. Subtract a constant from measurements and simulation alike, before "
                "their digits are lost."
            )


def mirrored(problem: Problem) -> list[Caution]:
    """Return whether the output is that of the simulation with the other sign."""
    model = problem.model
    if problem.likelihood.log_scale or not len(problem.good):
        return []
    coefficients = emulator_posterior(model.basis, problem.simulation).mean
    with np.errstate(over="ignore", invalid="ignore"):
        simulated = model.simulated(
            problem.X, from_normal(model.priors, problem.good), coefficients
        )[0][0]
        sizes = np.linalg.norm(simulated) * np.linalg.norm(problem.y)
        likeness = float(simulated @ problem.y) / sizes if sizes > 0 else 0.0
    # a cosine: positive where the simulation has anything of the output
    if not likeness < -SETTINGS.majority:
        return []
    return [
        Caution(
            "columns",
            "Even at its best fit the simulation has the other sign than the measured output: "
            f"the cosine between the two is {likeness:.2f}. No cause that is searched for changes "
            "a sign. Check the sign conventions of both, such as up or down, gain or loss.",
        )
    ]


def is_exact(result: Search) -> bool:
    """Return whether the simulation, alone or with a cause, misses no more than rounding.

    The noise of a fit is that of its rows: a curve of any shape may fit few rows exactly, and where
    noise differs between rows its scale is not that of each.
    """
    problem = result.problem
    rest = [
        w.fit.sigma
        for w in result.candidates
        if w.cause is None
        or (w.cause.changes_output and not w.cause.is_process and "noise" not in w.cause.acts_on)
    ]
    return problem.likelihood.gaussian and (
        min(rest) <= SETTINGS.chance_sd * NEGLIGIBLE * problem.scale
    )


def exact(result: Search) -> list[Caution]:
    """Return that measured data have no noise, of a search for which they were given some.

    Parameters
    ----------
    result : Search
    """
    alone = result.candidates[0].fit.sigma <= SETTINGS.chance_sd * BLUR * result.problem.scale
    what = "The simulation meets" if alone else "With a cause the simulation meets"
    return [
        Caution(
            "noise",
            f"{what} the measured output to about {NEGLIGIBLE:g} of its spread: the data are "
            "exact, as those of a computation are, and have no noise. Noise of "
            f"{BLUR:g} of the spread was added for the search. A cause of that size may go unseen: "
            "add noise as large as the differences that matter, and diagnose again.",
        )
    ]


def single_rows(result: Search, chosen: Candidate) -> list[Caution]:
    """Return which one or two rows a finding rests on, or which few are far off.

    Parameters
    ----------
    result : Search
        The first one.
    chosen : Candidate
        Of its candidates: the first cause, or nothing wrong.
    """
    problem = result.problem
    if problem.working_point is not None:
        return []
    cause = chosen.cause
    if cause is not None and cause.concerns == "data":
        return []
    null = predict_locally(result, result.candidates[0], problem.X)[0]
    found = null if cause is None else predict_locally(result, chosen, problem.X)[0]
    if cause is not None and cause.changes_output:
        explained = np.maximum((problem.y - null) ** 2 - (problem.y - found) ** 2, 0.0)
        explained = explained / problem.model.known_noise(problem.X) ** 2
        first = np.argsort(-explained)[:2]
        # one row suffices where it alone carries as much
        share = np.cumsum(explained[first]) / max(float(explained.sum()), np.finfo(float).tiny)
        if share[-1] > SETTINGS.nearly_all:
            rows = first[:1] if share[0] > SETTINGS.nearly_all else np.sort(first)
            few = "one row" if len(rows) == 1 else "two rows"
            what, them = _described(result, rows, null)
            then = "and diagnose without, before believing the cause"
            return [Caution("data", f"The cause rests on {few}: {what}. Check {them}, {then}.")]
    rows = _far_off(result, (problem.y - found) / problem.model.known_noise(problem.X))
    if not len(rows):
        return []
    few = "A few rows are" if len(rows) > 1 else "One row is"
    what, them = _described(result, rows, found)
    then = "and correct or leave out what is wrong"
    return [Caution("data", f"{few} unlike the others: {what}. Check {them}, {then}.")]


def gross_errors(cause: GrossError) -> list[Caution]:
    """Return which rows a diagnosis left out as unlike the others."""
    rows = [
        f"Row {row.number} ({_place(dict(row.at))}) is unlike the others: {row.measured:.6g}, "
        f"where the simulation predicts {row.predicted:.4g}; check it."
        for row in cause.rows
    ]
    if not rows:
        return []
    return [Caution("data", f"{' '.join(rows)} All else in this report is that of the other rows.")]


def _far_off(result: Search, missed: FloatArray) -> NDArray[np.intp]:
    """Return the rows whose residuals are far outside those of the others, if these are few."""
    problem, stacking = result.problem, result.problem.stacking
    of = np.zeros(len(missed)) if stacking is None else problem.X[:, stacking.at]
    far = np.zeros(len(missed), dtype=bool)
    for output in np.unique(of):
        here = of == output
        away = np.abs(missed[here] - np.median(missed[here]))
        sd = float(median_abs_deviation(missed[here], scale="normal"))
        sd = max(sd, SETTINGS.chance_sd * NEGLIGIBLE * problem.scale)
        far[here] = away > SETTINGS.outlying_sd * sd
    most = max(2, int(SETTINGS.outlying_share * len(missed)))
    rows = np.flatnonzero(far)
    return rows if len(rows) <= most else rows[:0]


def _described(result: Search, rows: NDArray[np.intp], simulated: FloatArray) -> tuple[str, str]:
    """Return what some rows are, and the word for them."""
    problem = result.problem
    inverse, columns = problem.likelihood.inverse, problem.model.columns
    out = []
    for i in rows:
        at = dict(zip(columns, problem.X[i].tolist(), strict=False))
        unit = 1.0
        which = f"row {i + 1}"
        if problem.stacking is not None:
            position = int(at.pop(OUTPUT))
            unit = float(problem.stacking.scale[position])
            which = f"the {problem.stacking.names[position]} at"
        values = [unit * float(v) for v in (problem.observed[i], inverse(simulated[i : i + 1])[0])]
        out.append(
            f"{which} ({_place(at)}), {values[0]:.6g} where the simulation has {values[1]:.4g}"
        )
    return listing(out), "it" if len(rows) == 1 else "them"


def _place(at: dict[str, float]) -> str:
    return ", ".join(f"{name} = {number(value)}" for name, value in at.items())


# a caution is raised in one of a hundred sets without overdispersion
_DISPERSION_LEVEL = 0.01


class Dispersion(NamedTuple):
    """How much counts scatter around the mean of neighbours, in variances that are allowed.

    Attributes
    ----------
    ratio : float
        One where the likelihood is right.
    p_value : float
        How often rows of the likelihood have as large a ratio.
    """

    ratio: float
    p_value: float


def cautions_of_dispersion(problem: Problem, posteriors: Sequence[Posterior]) -> list[Caution]:
    """Return a caution where counts scatter more than a Poisson or binomial likelihood allows.

    Parameters
    ----------
    problem : Problem
        Without effects, and before its rows are expanded.
    posteriors : sequence of Posterior
        Of the estimator without effects, and of others whose mean may be the right one: values
        have to scatter too much around each.
    """
    likelihood = problem.likelihood
    if not likelihood.remedy_of_scatter or not np.all(problem.weights == 1):
        return []
    found = None
    for posterior in posteriors:
        eta = posterior.eta(problem.X)[0]
        eta = np.mean(eta[np.isfinite(eta).all(axis=1)], axis=0)
        found = dispersion_of(likelihood, problem.X, eta, problem.observed)
        if found is None or found.p_value > _DISPERSION_LEVEL:
            return []
    assert found is not None  # there is one posterior at least
    return [
        Caution(
            "noise",
            f"The measured values scatter {found.ratio:.2g} times as much (in variance) around "
            f"their neighbours as a {likelihood.name} likelihood allows (p = {found.p_value:.3g})."
            " Intervals are too narrow, and noise may be taken for a fault of the simulation: "
            f"{likelihood.remedy_of_scatter}.",
        )
    ]


def cautions_of_rounding(likelihood: Likelihood, check: EmulatorCheck | None) -> list[Caution]:
    """Return a caution where runs may be rounded means, and may hide much.

    Parameters
    ----------
    likelihood : Likelihood
    check : EmulatorCheck or None
        Of an emulator through them.
    """
    if check is None or check.rounding is None or not check.hidden:
        return []
    return [
        Caution(
            "runs",
            "The simulated values are whole numbers, behind which effects of "
            f"{check.hidden:.2g} times the noise may hide. If they are rounded expected values, "
            f"give these as they are: a {likelihood.name} likelihood takes expected values as "
            "runs.",
        )
    ]


def dispersion_of(
    likelihood: Likelihood, X: FloatArray, eta: FloatArray, y: FloatArray
) -> Dispersion | None:
    """Return how much values scatter around the mean of neighbours, None where too few are near.

    Rows are paired with their neighbours. Each pair has the mean of the simulation, with eta
    shifted to match the pair's total, so a smooth error of the mean does not count. For Poisson
    counts that is the index of dispersion of two counts given their sum (Fisher 1950, Biometrics
    6:17). Replicates are drawn around these means.

    Parameters
    ----------
    likelihood : Likelihood
        Without a scale of the noise.
    X : ndarray of shape (n, n_columns)
    eta, y : ndarray of shape (n,)
        What the model predicts, and what was measured.
    """
    first, second = neighbours(X)
    if len(first) < SETTINGS.least_rows:
        return None
    pairs = np.stack([first, second])
    at, values = eta[pairs][:, None], y[pairs][:, None]  # (2, 1, pairs)
    squares, mean = _squares(likelihood, at, values)
    open_ = squares[0] > -np.inf
    if open_.sum() < SETTINGS.least_rows:
        return None
    random = np.random.RandomState(0)  # a fixed stream: the check is reproducible
    center = np.broadcast_to(mean[..., open_], (2, REPLICATES, int(open_.sum())))
    again = likelihood.sample(center, np.ones((1, 1, 1)), random)
    replicates, _ = _squares(likelihood, mean[..., open_], again)
    statistic, drawn = (_mean(each, SETTINGS.chance_sd**2) for each in (squares, replicates))
    p_value = (1 + np.sum(drawn >= statistic)) / (1 + REPLICATES)
    ratio = _mean(squares, np.inf)[0] / np.mean(_mean(replicates, np.inf))
    return Dispersion(float(ratio), float(p_value))


def _mean(squares: FloatArray, largest: float) -> FloatArray:
    """Return the mean over pairs that have a square, none above the largest, (R,).

    A pair across a jump counts no more than another.
    """
    has = np.isfinite(squares)
    total = np.sum(np.where(has, np.minimum(squares, largest), 0.0), axis=1)
    return np.asarray(total / np.maximum(has.sum(axis=1), 1))


def neighbours(X: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows of pairs of neighbours, each row in one pair at the most.

    Those that are nearest to each other, in columns of unit spread, and then among the rest.
    """
    moving = X[:, np.ptp(X, axis=0) > 0]
    # ties between equal distances are broken, always the same
    jitter = 1e-3 / len(X) * np.random.RandomState(0).standard_normal(moving.shape)
    places = moving / moving.std(axis=0) + jitter if moving.size else np.arange(len(X))[:, None]
    rest = np.arange(len(X))
    first, second, distance = [], [], []
    for _ in range(3):
        if len(rest) < 2:
            break
        apart, nearest = KDTree(places[rest]).query(places[rest], k=2)
        own = np.arange(len(rest))
        other = nearest[:, 1]
        paired = (other[other] == own) & (own < other)
        first.append(rest[own[paired]])
        second.append(rest[other[paired]])
        distance.append(apart[paired, 1])
        rest = np.setdiff1d(rest, np.concatenate([first[-1], second[-1]]))
    a, b, far = (np.concatenate(parts) for parts in (first, second, distance))
    near = far <= 3 * np.median(far)  # farther rows are no neighbours
    return a[near], b[near]


def _squares(
    likelihood: Likelihood, eta: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the squared standardised difference of each pair, and eta at the mean of the pair.

    ``eta`` (2, R, p) and ``y`` alike; squares (R, p) are minus infinity where a total is at an end
    of its range, where nothing can scatter.
    """
    sigma = np.ones((1, 1, 1))
    shift = np.zeros(np.broadcast_shapes(eta.shape, y.shape)[1:])
    for _ in range(8):  # Newton steps, of which the first two do nearly all
        gap = np.sum(y - likelihood.mean(eta + shift, sigma), axis=0)
        step = gap / np.sum(likelihood.variance(eta + shift, sigma), axis=0)
        shift = shift + np.clip(step, -2.0, 2.0)
    center = eta + shift
    mean, variance = likelihood.mean(center, sigma), likelihood.variance(center, sigma)
    met = np.abs(np.sum(y - mean, axis=0)) < 1e-3 * np.sum(mean, axis=0)
    met &= np.sum(variance, axis=0) > 1e-3
    squares = np.square(y[0] - mean[0]) * np.sum(1 / variance, axis=0)
    return np.where(met, squares, -np.inf), center
