"""Where and how much the simulation is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.diagnosis.search.search import (
    Search,
    local_posterior,
    measured_and_other,
    predict_locally,
)
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.simulation.variables import MAX_LEVELS
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class Discrepancy:
    """Where and how much the simulation is wrong, on the scale of eta.

    Attributes
    ----------
    grid : ndarray of shape (m, n_columns)
        Rows that vary one input over its measured range, the other columns at their medians.
    column : str
        The input that varies.
    mean, lower, upper : ndarray of shape (m,)
        Measured minus simulated, with a pointwise 90 % band.
    residual : ndarray of shape (n,)
        Measured minus simulated at the measured rows; like the curve's, this simulation has
        parameters that were estimated together with the curve.
    """

    grid: FloatArray
    column: str
    mean: FloatArray
    lower: FloatArray
    upper: FloatArray
    residual: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __repr__(self) -> str:
        share = f"{100 * self.share_outside:.0f} % of the range outside a 90 % band around zero"
        return f"Discrepancy(over {self.column}, {len(self.mean)} places; {share})"

    @property
    def share_outside(self) -> float:
        """Share of the range in which the band excludes zero."""
        return float(np.mean(self._outside))

    @property
    def _outside(self) -> NDArray[np.bool_]:
        return (self.lower > 0) | (self.upper < 0)

    def stretches(self, values: FloatArray) -> list[tuple[float, float, int]]:
        """Return where the band excludes zero: ends and sign of every stretch.

        Parameters
        ----------
        values : ndarray of shape (m,)
            The column that varies, on the grid.
        """
        sign = np.where(self._outside, np.sign(self.mean), 0).astype(int)
        cuts = np.flatnonzero(np.diff(sign)) + 1
        pieces = np.split(np.arange(len(sign)), cuts)
        return [
            (float(values[p[0]]), float(values[p[-1]]), int(sign[p[0]]))
            for p in pieces
            if sign[p[0]]
        ]


class Third(NamedTuple):
    """A third of the measured range of one column, or one of its few values, and what lies there.

    Attributes
    ----------
    column : str
    low, high : float
        Its ends; rows at the upper end belong to the next third. A value is both ends.
    share : float
        Of the sum of squares of the discrepancy over all measured rows.
    rows : float
        Share of the measured rows that lie in it.
    """

    column: str
    low: float
    high: float
    share: float
    rows: float


def estimate_discrepancy(result: Search, cause: Cause | None, output: int) -> Discrepancy:
    """Return the smooth discrepancy of one output over one input, by the catch-all process.

    In the output's units where these are not logarithmic; over the input over which the cause acts,
    else the first.
    """
    problem, stacking = result.problem, result.problem.stacking
    inputs = problem.model.columns[: problem.model.n_inputs]
    column = next((name for name in (cause.reads if cause else ()) if name in inputs), inputs[0])
    smooth = [w for w in result.candidates if w.cause and w.cause.kind == "unexplained"]
    process = smooth[output]
    here = np.ones(len(problem.X), dtype=bool)
    if stacking is not None:
        here = problem.X[:, stacking.at] == output
    X = problem.as_places(problem.X)
    own = X[here]
    k = problem.model.columns.index(column)
    grid = np.repeat(np.median(own, axis=0)[None], 200, axis=0)
    grid[:, k] = np.linspace(own[:, k].min(), own[:, k].max(), len(grid))
    # the size that the residuals themselves suggest, so that noise is not drawn as a curve
    plain = predict_locally(result, result.candidates[0], X)[0]
    residual = (problem.y - plain)[here]
    size = float(np.clip(np.std(residual), result.sizes[0], result.sizes[-1]))
    measured, rows = measured_and_other(result, process, np.vstack([grid, X]))
    local = local_posterior(result, process, measured, size)
    first, n = measured.first, len(grid)
    H = rows.design[:n, first:]
    mean = H @ local.mean[first:]
    sd = np.sqrt(np.einsum("nk,kl,nl->n", H, local.covariance[first:, first:], H))
    simulated = rows.offset[n:] + rows.design[n:, :first] @ local.mean[:first]
    left, unit = (problem.y - simulated)[here], 1.0
    grid = grid[:, : len(problem.model.columns)]
    if stacking is not None:
        unit = float(stacking.scale[output])
        grid = np.delete(grid, stacking.at, axis=1)
    low, high = (mean + special.ndtri(tail) * sd for tail in (0.05, 0.95))
    return Discrepancy(grid, column, unit * mean, unit * low, unit * high, unit * left)


def shares_of_thirds(
    X: FloatArray, delta: FloatArray, columns: Sequence[str], labels: Sequence[str] = ()
) -> list[Third]:
    """Return which part of a discrepancy lies in each third of each column's measured range.

    Of a column with a few values, or of labels: at each of them.

    Parameters
    ----------
    X : ndarray of shape (n, n_columns)
        Measured rows.
    delta : ndarray of shape (n,)
        The discrepancy there.
    columns : sequence of str
        Names of the columns of X; columns with a single value have no thirds.
    labels : sequence of str
        Those that label experiments.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.diagnosis.answers.discrepancy import shares_of_thirds
    >>> t = np.linspace(0, 6, 7)
    >>> thirds = shares_of_thirds(t[:, None], 1.0 * (t > 4), ["t"])
    >>> [(third.low, third.high, third.share) for third in thirds]
    [(0.0, 2.0, 0.0), (2.0, 4.0, 0.0), (4.0, 6.0, 1.0)]
    """
    square = delta**2 / max(float(np.sum(delta**2)), 1e-300)
    out = []
    for name, values in zip(columns, X.T, strict=True):
        if np.ptp(values) == 0:
            continue
        levels = np.unique(values)
        if len(levels) <= MAX_LEVELS or name in labels:
            ends, part = np.repeat(levels, 2), np.searchsorted(levels, values)
        else:
            ends = np.repeat(np.linspace(levels[0], levels[-1], 4), 2)[1:-1]
            part = np.digitize(values, ends[[2, 4]])
        for k, (low, high) in enumerate(ends.reshape(-1, 2).tolist()):
            inside = part == k
            share, rows = float(square[inside].sum()), float(np.mean(inside))
            out.append(Third(name, low, high, share, rows))
    return out
