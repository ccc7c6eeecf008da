"""Measurements that are unlike the others: single gross errors, or a share of outliers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from math import comb
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hybridsurrogate.effects.base import (
    ROW,
    Cause,
    Context,
    Declared,
    FloatArray,
    Forms,
    Rows,
    quantiles,
)
from hybridsurrogate.effects.context import MAX_TRIED_ROWS
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.likelihoods.student_t import NARROWEST, WIDEST
from hybridsurrogate.numerics.digits import listing
from hybridsurrogate.numerics.digits import number as rounded
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# rows of which pairs are tried: those that the simulation misses most
_MAX_PAIRED_ROWS = 12


class GrossRow(NamedTuple):
    """A measurement that is a gross error.

    Attributes
    ----------
    number : int
        Of the row, counted from 1.
    at : tuple of (str, float)
        Its columns by name.
    measured : float
        Its output.
    predicted : float
        What the model predicts there from all other rows.
    """

    number: int
    at: tuple[tuple[str, float], ...]
    measured: float
    predicted: float = np.nan


@dataclass(eq=False, repr=False)
class GrossError(Declared):
    """One or two measurements are unlike all others, by any amount; the simulation is right.

    The mean-shift outlier model (Cook and Weisberg 1982, Residuals and Influence in Regression,
    section 2.2.2): each of the rows concerned has a separate shift, with a wide prior, so that
    the other rows are fitted as if these were left out. A search enumerates the row, each of n with
    probability 1 / n, or the pair of rows, each with 2 / (n (n - 1)); of many rows those that the
    simulation misses most. Where more than two rows are far off, see `Outliers`.

    An estimator with the detected rows leaves them out, wherever they stand in the data: it
    knows them by their inputs and output. It is no model of new measurements, which have no gross
    errors.

    Parameters
    ----------
    n_rows : {1, 2}, default=1
        Rows concerned, to be detected by a diagnosis.
    rows : tuple of GrossRow, default=()
        Those that are known. An estimator needs them.
    table : ndarray of shape (n, n_columns) or None, default=None
        The measured rows of a search.
    columns_of_table : tuple of str, default=()
    sets : ndarray of shape (m, n_rows) or None, default=None
        Positions of rows that are tried.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.noise.outliers import GrossRow
    >>> typo = hs.GrossError(rows=(GrossRow(2, (("t", 5.0),), 9999.0),))
    >>> typo.leaves_out({"t": np.array([4.0, 5.0])}, np.array([21.4, 9999.0])).tolist()
    [False, True]
    """

    kind = "gross-error"
    forms: ClassVar[Forms] = {("n_rows", 2): "two rows"}
    concerns = "data"
    # the simulation is right
    changes_output = False

    n_rows: int = 1
    rows: tuple[GrossRow, ...] = ()
    table: FloatArray | None = None
    columns_of_table: tuple[str, ...] = ()
    sets: NDArray[np.intp] | None = None

    @property
    def name(self) -> str:
        """The kind, and how many rows."""
        return f"{self.kind}({self.variant})" if self.variant else self.kind

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return which of all rows or pairs it is; those that are tried come first."""
        if self.rows or self.table is None:
            return {}
        n = comb(len(self.table), self.n_rows)
        return {"which": frozen(stats.uniform, loc=-0.5, scale=n)}

    @property
    def coefficients(self) -> tuple[str, ...]:  # type: ignore[override]
        """A shift for each row, none of excluded rows."""
        if self.rows or self.table is None:
            return ()
        return ("shift",) if self.n_rows == 1 else ("shift_1", "shift_2")

    @property
    def is_screened(self) -> bool:  # type: ignore[override]
        """Whether not all rows or pairs are tried."""
        if self.table is None or self.sets is None:
            return False
        return len(self.sets) < comb(len(self.table), self.n_rows)

    def prepare(self, context: Context) -> Cause:
        """Fill in the measured rows, and which of them are tried."""
        if self.n_rows not in (1, 2):
            raise ValueError(f"n_rows must be 1 or 2, got {self.n_rows!r}: more are `Outliers`.")
        if self.rows or self.table is not None:
            return self
        table = np.column_stack(list(context.X.values()))
        # those that the simulation misses most first
        likely = np.argsort(-np.abs(context.missed), kind="stable").tolist() or range(len(table))
        tried = sorted(likely[: MAX_TRIED_ROWS if self.n_rows == 1 else _MAX_PAIRED_ROWS])
        sets = np.array(list(combinations(tried, self.n_rows)), dtype=np.intp)
        return self.filled(table=table, columns_of_table=tuple(context.X), sets=sets)

    def grid(self) -> dict[str, FloatArray]:
        """Return one cell for each row or pair that is tried, and one for all others."""
        if self.rows or self.table is None:
            return {}
        assert self.sets is not None
        borders = np.arange(len(self.sets) + 1) - 0.5
        end = comb(len(self.table), self.n_rows) - 0.5
        if borders[-1] < end:
            borders = np.append(borders, end)
        return {"which": np.column_stack([borders[:-1], borders[1:]])}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return 1 in the row of each shift, 0 in all others: rows that were not measured, too."""
        first = np.asarray(next(iter(X.values())))
        if ROW not in X or self.table is None or self.sets is None:
            return np.zeros((len(first), len(self.coefficients)))
        position = np.asarray(X[ROW]).astype(np.intp)
        known = np.minimum(position, len(self.table) - 1)
        is_measured = position < len(self.table)
        for name, values in zip(self.columns_of_table, self.table.T, strict=True):
            is_measured = is_measured & (X[name] == values[known])
        which = np.round(theta["which"]).astype(np.intp)
        tried = which < len(self.sets)
        rows = self.sets[np.where(tried, which, 0)]
        here = (rows == position[:, None]) & (is_measured & tried)[:, None]
        return here.astype(float)

    def leaves_out(self, X: Rows, y: FloatArray) -> NDArray[np.bool_]:
        """Return which rows are those that are known."""
        out = np.zeros(len(y), dtype=bool)
        for row in self.rows:
            same = np.isclose(y, row.measured, rtol=1e-9, atol=0.0)
            for name, value in row.at:
                same &= np.isclose(X[name], value, rtol=1e-9, atol=0.0)
            out |= same
        return out

    def at(self, node: float) -> NDArray[np.intp]:
        """Return the positions of the rows that one value of ``which`` means.

        Parameters
        ----------
        node : float

        Returns
        -------
        ndarray of shape (n_rows,), or (0,) for rows that were not tried
        """
        assert self.sets is not None
        which = round(node)
        return self.sets[which] if which < len(self.sets) else self.sets[0, :0]

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return number, measured and predicted output of each row."""
        out = {}
        for k, row in enumerate(self.rows, start=1):
            end = "" if len(self.rows) == 1 else f"_{k}"
            out[f"row{end}"] = np.array([float(row.number)])
            out[f"measured{end}"] = np.array([row.measured])
            out[f"predicted{end}"] = np.array([row.predicted])
        return out

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code("", does="nothing")

    def formula(self, values: Mapping[str, float]) -> str:
        """Return in words which rows, and what is there."""
        rows = [self._in_words(values, end) for end in ("", "_1", "_2") if f"row{end}" in values]
        return f"simulation; {listing(rows)}"

    def _in_words(self, values: Mapping[str, float], end: str) -> str:
        number = round(values[f"row{end}"])
        at = next((dict(row.at) for row in self.rows if row.number == number), {})
        if not at and self.table is not None:
            at = dict(zip(self.columns_of_table, self.table[number - 1].tolist(), strict=True))
        place = ", ".join(f"{name} = {rounded(value)}" for name, value in at.items())
        return (
            f"row {number}{f' ({place})' if place else ''} is unlike the others: "
            f"{values[f'measured{end}']:.6g}, where the simulation predicts "
            f"{values[f'predicted{end}']:.4g}"
        )


def _trouble(cause: Cause, context: Context) -> str | None:
    if not context.gaussian:
        return "the likelihood is not normal, and rows far off are part of it"
    return None


register(
    Form(
        "gross-error",
        GrossError,
        lambda context: [GrossError()],
        meaning=(
            "one measurement of {output} is unlike the others: check that row, and correct it "
            "or leave it out"
        ),
        least_rows=8,
        trouble=_trouble,
        headline="One measurement of {output} is unlike all others",
    ),
    Form(
        "gross-error: two rows",
        GrossError,
        lambda context: [GrossError(2)],
        meaning=(
            "two measurements of {output} are unlike the others: check these rows, and correct "
            "them or leave them out"
        ),
        least_rows=8,
        trouble=_trouble,
        headline="Two measurements of {output} are unlike all others",
    ),
)


@dataclass(eq=False, repr=False)
class Outliers(Declared):
    """Heavy tails: a share of the measurements scatters much more; the simulation is right.

    Each measurement is, with probability ``share``, an outlier, whose standard deviation is 3 to
    30 times that of the others (log-uniform, for each outlier separately): Tukey's contaminated
    normal (1960, in Contributions to Probability and Statistics) with any size of outlier. Between
    these ends the density falls like one over the distance. The share is log-uniform from 1 to 40
    %.

    Rows are no longer Gaussian given the rest, so an estimator with this effect is fitted as one
    with a likelihood that is not normal. ``sigma`` is the noise of measurements that are not
    outliers. Under a log-normal likelihood far outliers have no useful mean and variance: `predict`
    returns the mean of measurements that are none, and a standard deviation for which outliers are
    normal on the logarithm; intervals, draws and scores are those of the model itself.

    Parameters
    ----------
    share : frozen scipy.stats distribution or None, default=None
        Prior of the share of outliers, within (0, 1).

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> hs.Outliers().prepare(context=None).formula({"share": 0.05})
    'simulation, and 5 % of the measurements scatter 3 to 30 times as much as the others'
    """

    kind = "noise"
    unknowns = ("share",)
    meaning = "a few measurements of {output} are far off, and carry little information"
    variant = "tails"
    name = "noise(outliers)"

    share: Prior | None = None

    def prepare(self, context: Context | None) -> Cause:
        """Fill in the prior."""
        share = frozen(stats.loguniform, 0.01, 0.4) if self.share is None else self.share
        return self.filled(share=share)

    def grid(self) -> dict[str, FloatArray]:
        """Return six quantiles: the share is known to a factor at best."""
        return {"share": quantiles(self.share, 6)}

    def outliers(self, theta: Rows) -> FloatArray:
        """Return the share of outliers."""
        return np.asarray(theta["share"])

    def code(self) -> Code:
        """Return the cause as Python."""
        ratio = WIDEST / NARROWEST
        wide = f"{NARROWEST:g} * {ratio:g} ** {{random}}.random({{n}})"
        return Code(
            "{sigma} * {factor} * {random}.standard_normal({n})",
            {"share": "1"},
            steps={"factor": f"np.where({{random}}.random({{n}}) < {{share}}, {wide}, 1)"},
            arguments={"random": "a numpy.random.Generator", "n": "how many rows"},
            does="scatters",
            name="noise_draws",
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            f"simulation, and {100 * values['share']:.2g} % of the measurements scatter "
            f"{NARROWEST:g} to {WIDEST:g} times as much as the others"
        )


register(
    Form(
        "noise: tails",
        Outliers,
        lambda context: [Outliers()],
        least_rows=8,
        headline="Some measurements of {output} are outliers",
    )
)
