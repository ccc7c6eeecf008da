"""Whether an extension stays right as measurements come in: a test that may stop at any time.

Each new measurement has its quantile under the prediction of the extension given all before it.
While the extension is right these are independent and uniform (Rosenblatt 1952, Annals of
Mathematical Statistics 23:470), whatever its parameters. Against it stands a change that begins at
some measurement: a shift, or a wider spread. The ratio of the two is a martingale while nothing has
changed, and so exceeds 1 / a with probability a at most, at any time (Ville's inequality; Ramdas,
Gruenwald, Vovk and Shafer 2023, Statistical Science 38:576).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import special
from sklearn.base import clone
from sklearn.utils import check_consistent_length

from hybridsurrogate.diagnosis.answers.experimental_design import rows_as_table
from hybridsurrogate.diagnosis.search.candidate import MIN_PROBABILITY
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.estimators.averaged import AveragedSurrogate
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.likelihoods import Likelihood, TransformedNormal
from hybridsurrogate.model.posterior import MIN_EFFECTIVE, SOME_DRAWS
from hybridsurrogate.model.rows.measured_data import GivenRows, new_errors, without_gaps
from hybridsurrogate.numerics.linear_algebra import LARGE_BLOCK, blocks
from hybridsurrogate.simulation.arrays import as_numbers, complete_table
from hybridsurrogate.types import FloatArray

# prior standard deviation of a shift, and factor of a wider spread, in those of the prediction: a
# mixture with 3 and 4 sees shifts of 0.5 to 4 and factors of 1.5 to 8 later
_SHIFT, _SPREAD = 1.0, 2.0


@dataclass(frozen=True)
class Monitor:
    """Whether new measurements agree with an extension.

    Attributes
    ----------
    table : pandas.DataFrame
        One row a new measurement, in their order: the columns of X, of several outputs "output",
        "y", "deviation" (standard normal while the extension is right, given all measurements
        before) and "e_value" (odds that something changed, against nothing). It ends with the
        measurement that raised the alarm.
    alarm_at : int or None
        Position of the new measurement at which the evidence that something changed passed
        one over the rate of false alarms.
    since : int or None
        Position of the new measurement from which it most probably changed.
    false_alarm_rate : float
        The probability that a right extension ever raises an alarm is at most this.
    """

    table: pd.DataFrame
    alarm_at: int | None
    since: int | None
    false_alarm_rate: float

    @property
    def holds(self) -> bool:
        """Whether the extension counts as right so far."""
        return self.alarm_at is None

    def __str__(self) -> str:
        # rows of several outputs of which none was measured carry no information
        n, odds = len(self.table), float(self.table["e_value"].iloc[-1]) if len(self.table) else 1.0
        if self.alarm_at is None or self.since is None:
            return (
                f"The extension holds over {n} new measurements: the odds that something changed "
                f"are {odds:.3g} to one, where {1 / self.false_alarm_rate:g} to one would be an "
                "alarm."
            )
        late = self.table["deviation"].iloc[self.since :]
        return (
            f"The extension no longer holds: at new measurement {self.alarm_at} (counted from 0) "
            f"the odds that something changed are {odds:.3g} to one. It most probably began at "
            f"measurement {self.since}; from there measurements lie {late.mean():+.2g} standard "
            "deviations from the prediction on average, with a spread of "
            f"{late.std(ddof=0):.2g}. Fit the diagnosis again with them."
        )


def monitored(
    estimator: PowerScaledSurrogate | AveragedSurrogate,
    found: Search,
    known: GivenRows,
    new: GivenRows,
    false_alarm_rate: float,
) -> Monitor:
    """Return whether new measurements agree with a fitted estimator.

    Parameters
    ----------
    estimator : PowerScaledSurrogate or AveragedSurrogate
        Fitted. The weights of what is averaged follow the new measurements.
    found : Search
        Of the diagnosis.
    known : GivenRows
        Measured data that the estimator was fitted to.
    new : GivenRows
        Further ones, in the order in which they came.
    false_alarm_rate : float
    """
    parts: list[FloatArray] = []
    first, limit = 0, np.log(1 / false_alarm_rate)
    models: list[Any] = [estimator]
    shares: FloatArray = np.ones(1)
    if isinstance(estimator, AveragedSurrogate):
        models, shares = estimator.estimators_, estimator.weights_
    while True:
        # rows at a time, so that memory stays bounded
        n_draws = sum(one.posterior_.n_draws for one in models)
        some = new.take(slice(first, first + max(LARGE_BLOCK // n_draws, 1)))
        deviation, n_rows, shares = _deviations(models, shares, some)
        parts.append(deviation)
        first += n_rows
        odds, began = log_odds(np.concatenate(parts))
        if first >= len(new.y) or np.any(odds >= limit):
            break
        so_far = joined(known, new.take(slice(first)))
        kept = np.flatnonzero(shares > MIN_PROBABILITY)
        models = [clone(models[k]).fit(*so_far) for k in map(int, kept)]
        shares = shares[kept]
    passed = np.flatnonzero(odds >= limit)
    end = int(passed[0]) + 1 if len(passed) else len(odds)
    table = rows_as_table(found, estimator.checked_rows(new.X), estimator.data_.experiments)
    y = np.ravel(new.y)
    table = table.assign(y=y)[np.isfinite(y)].iloc[:end]
    table = table.assign(deviation=np.concatenate(parts)[:end], e_value=np.exp(odds[:end]))
    since = int(began[end - 1]) if len(passed) else None
    alarm_at = end - 1 if len(passed) else None
    return Monitor(table.reset_index(drop=True), alarm_at, since, false_alarm_rate)


def followed(
    before: Any,
    after: PowerScaledSurrogate | AveragedSurrogate,
    X: ArrayLike,
    y: ArrayLike,
    y_err: Any,
    earlier: GivenRows,
) -> GivenRows:
    """Return new rows as the fitted models read them, after those that came earlier.

    Parameters
    ----------
    before, after : estimator
        Fitted.
    X, y : array-like of shape (n, n_columns), (n,) or (n, n_outputs)
    y_err : float, str, array-like of the shape of y, or None
        Of a fit with errors; None: their median.
    earlier : GivenRows
        Without any where none came.
    """
    X, y_err = new_errors(X, y_err, before.data_)
    if len(before.simulation.outputs) == 1:
        X, y, _, y_err = without_gaps(X, y, None, y_err)
    X, values = complete_table(X, labels=before.experiment), before.measured_outputs(y)
    check_consistent_length(X, values)
    after.checked_rows(X, y_err, values)
    if earlier.y_err is not None:
        given = as_numbers(before.data_.usual_errors if y_err is None else y_err, "y_err")
        y_err = np.broadcast_to(given, (len(values), *before.data_.y_err.shape[1:]))
    return joined(earlier, GivenRows(X, values, None, y_err))


def joined(first: GivenRows, second: GivenRows) -> GivenRows:
    """Return the rows of two sets, one after the other, in the form of the first."""
    X = second.X
    if not isinstance(first.X, pd.DataFrame):
        X = np.concatenate([as_numbers(first.X, "X"), as_numbers(X, "X")])
    else:
        if not isinstance(X, pd.DataFrame):
            X = pd.DataFrame(as_numbers(X, "X"), columns=first.X.columns)
        X = pd.concat([first.X, X], ignore_index=True)
    weights = first.weights
    if weights is not None:
        weights = np.concatenate([weights, np.ones(len(second.y))])
    y_err = None if first.y_err is None else np.concatenate([first.y_err, second.y_err])
    return GivenRows(X, np.concatenate([first.y, second.y]), weights, y_err)


def _deviations(
    models: Sequence[PowerScaledSurrogate], shares: FloatArray, new: GivenRows
) -> tuple[FloatArray, int, FloatArray]:
    """Return the deviation of each measurement, and the rows after which the draws are used up.

    And the share of each model by then. Draws are weighted by the measurements before, by
    importance sampling.
    """
    model, values = models[0], new.y
    rows = model.checked_rows(new.X, new.y_err, values)
    width = 1
    if model.data_.stacking is not None:
        width, values = len(model.data_.stacking.names), model.data_.stacking.values(values)
    there = np.flatnonzero(np.isfinite(values))
    likelihood, values = model.posterior_.likelihood, values[there]
    likelihood.check(values, "new")
    draws = [one.posterior_.eta(rows[there]) for one in models]
    eta, sigma = (np.concatenate(parts) for parts in zip(*draws, strict=True))
    counts = [len(part) for part, _ in draws]
    log_density = likelihood.log_density(values, eta, sigma)
    # a value impossible under every draw does not change the weights
    log_density = np.maximum(log_density, -1e8)
    prior = np.repeat(np.log(shares / shares.sum()) - np.log(counts), counts)
    log_weight = np.tile(prior[:, None], (1, len(there) + 1))
    log_weight[:, 1:] += np.cumsum(log_density, axis=1)
    weight = special.softmax(log_weight, axis=0)
    worth = 1 / np.sum(weight[:, :-1] ** 2, axis=0)
    # draws are made anew, with the measurements so far, where they are worth fewer
    least = min(MIN_EFFECTIVE, counts[0] / 2)
    # a whole row of outputs at a time, and the first row in any case
    spent = there[worth < least] // width
    spent = spent[spent > 0]
    n_rows = int(spent[0]) if len(spent) else len(new.y)
    used = there // width < n_rows
    below = _below(likelihood, values[used], eta[:, used], sigma[:, used])
    share = np.sum(weight[:, :-1][:, used] * below, axis=0)
    ends = np.cumsum([0, *counts[:-1]])
    by_then = np.add.reduceat(weight[:, int(np.count_nonzero(used))], ends)
    tiny = 1e-9
    return np.asarray(special.ndtri(np.clip(share, tiny, 1 - tiny))), n_rows, by_then


def _below(likelihood: Likelihood, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the probability of less than y under each draw, (S, n); of counts half of that of y.

    Counts as large as y have their probability split by chance, which leaves quantiles uniform.
    """
    if isinstance(likelihood, TransformedNormal):
        return np.asarray(special.ndtr((likelihood.working(y) - eta) / sigma))
    random = np.random.RandomState(0)
    split = random.uniform(size=len(y))
    total = np.zeros(eta.shape)
    for _ in range(SOME_DRAWS):
        drawn = likelihood.sample(eta, sigma, random)
        total += (drawn < y) + split * (drawn == y)
    # never quite none or all
    return (total + 0.5) / (SOME_DRAWS + 1)


def log_odds(z: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the log odds of a change against none after each deviation, and where it began.

    With prior probability 1 / (k (k + 1)) it begins at the k-th; from there the deviations are
    shifted, by a normal number, or wider.

    Parameters
    ----------
    z : ndarray of shape (n,)

    Returns
    -------
    odds : ndarray of shape (n,)
    began : ndarray of int of shape (n,)
        The most probable beginning.
    """
    n = len(z)
    total, squares = (np.concatenate([[0.0], np.cumsum(part)]) for part in (z, z**2))
    k = np.arange(1, n + 1)
    prior = -np.log(k) - np.log(k + 1)
    odds, began = np.empty(n), np.empty(n, dtype=np.intp)
    for some in blocks(n, 2 * n):
        t = k[some][:, None]
        count = t - k + 1
        possible = count > 0
        count = np.maximum(count, 0)
        moved, square = total[t] - total[k - 1], squares[t] - squares[k - 1]
        width = 1 + count * _SHIFT**2
        shifted = 0.5 * (_SHIFT**2 * moved**2 / width - np.log(width))
        wider = 0.5 * square * (1 - _SPREAD**-2) - count * np.log(_SPREAD)
        ratio = np.logaddexp(shifted, wider) - np.log(2)
        terms = np.where(possible, prior + ratio, -np.inf)
        # it may begin later: the rest of the prior
        later = -np.log(t[:, 0] + 1)
        odds[some] = np.logaddexp(special.logsumexp(terms, axis=1), later)
        began[some] = np.argmax(terms, axis=1)
    return odds, began
