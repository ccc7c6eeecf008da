"""Jumps at several places, each of which decays: what recovers after every rest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import comb, log

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows, quantiles
from hybridsurrogate.effects.context import UNKNOWN, Axis
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.over_column import OverColumn
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.numerics.digits import listing
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# one jump is a step or a decay; more than twenty, or one in six rows, are a curve
_MIN_JUMPS, _MAX_JUMPS, _ROWS_EACH = 2, 20, 6
# places that are tried, evenly spread over the rows (of a tenth of them 12 of 40 sets have another
# cause), and decay lengths
_N_PLACES, _N_SCALES = 600, 8


@dataclass(eq=False, repr=False)
class RecurringJumps(OverColumn):
    """Jumps at several places of a column, each of which decays over the same length.

    ``simulation + sum_k jump_k exp(-(x - place_k) / scale)`` from each place on: a battery that
    recovers after every rest, a stock that is topped up. The jumps have separate sizes, of
    either sign. Their number and places come from the measured rows: orthogonal matching pursuit
    (Pati, Rezaiifar and Krishnaprasad 1993, Asilomar Conference on Signals 27:40) along what the
    simulation misses, whose parameters are fitted along. With P places all numbers K up to the most
    are equally probable before the data, and of each all sets: the evidence at the detected set
    counts ``1 / (most C(P, K))`` times, as if no other set explained anything. So it is a lower
    bound.

    Parameters
    ----------
    column : str
        Any measured column.
    places : tuple of float, default=()
        Where jumps are known to be; none: they are detected.
    scale : frozen scipy.stats distribution or None, default=None
        Prior of the length after which 37 % of a jump is left; positive. None: log-uniform from the
        distance of neighbouring rows to half the span.
    n_tried : int, default=0
        Places among which the places were detected; zero: they are known.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> rests = hs.RecurringJumps("cycle", places=(2.0, 5.0))
    >>> rows = {"cycle": np.array([1.0, 2.0, 4.0, 5.0])}
    >>> rests.columns(rows, {"scale": 2.0}).round(2).tolist()
    [[0.0, 0.0], [1.0, 0.0], [0.37, 0.0], [0.22, 1.0]]
    """

    kind = "recurring-jumps"
    unknowns = ("scale",)

    column: str
    places: tuple[float, ...] = ()
    scale: Prior | None = None
    n_tried: int = 0
    axis: Axis = UNKNOWN

    @property
    def coefficients(self) -> tuple[str, ...]:  # type: ignore[override]
        """One jump a place."""
        return tuple(f"jump_{k}" for k in range(1, len(self.places) + 1))

    @property
    def is_screened(self) -> bool:  # type: ignore[override]
        """Whether places were detected."""
        return self.n_tried > 0

    @property
    def log_prior_of_choice(self) -> float:  # type: ignore[override]
        """The logarithm of the probability of the number of jumps and of their places."""
        if not self.n_tried:
            return 0.0
        return -log(_MAX_JUMPS) - log(comb(self.n_tried, len(self.places)))

    def prepare(self, context: Context) -> Cause:
        """Fill in the axis, the prior of the scale, and number and places of the jumps."""
        axis = self.along(context)
        given = self.scale or frozen(stats.loguniform, axis.spacing, axis.span / 2)
        if self.places:
            return self.filled(axis=axis, scale=given)
        places, n_tried = _detected(self.column, axis, given, context)
        return self.filled(axis=axis, scale=given, places=places, n_tried=n_tried)

    def grid(self) -> dict[str, FloatArray]:
        """Return lengths evenly spaced on a logarithmic scale."""
        return {"scale": quantiles(self.parameters["scale"], _N_SCALES)}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the remaining share of each jump."""
        return _decayed(X[self.column], np.array(self.places), np.asarray(theta["scale"]))

    def code(self) -> Code:
        """Return the cause as Python."""
        numbers = range(1, len(self.places) + 1)
        part = "{{jump_{0}}} * np.exp(-np.maximum({{x}} - {1!r}, 0) / {{scale}}) * ({{x}} >= {1!r})"
        steps = {
            f"part_{k}": part.format(k, float(place))
            for k, place in zip(numbers, self.places, strict=True)
        }
        return Code(
            " + ".join(f"{{{name}}}" for name in steps),
            {"scale": "{x}"} | dict.fromkeys(self.coefficients, "{y}"),
            {"x": self.column},
            steps=steps,
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        jumps = [
            f"{values[name]:+.3g} at {place:.6g}"
            for name, place in zip(self.coefficients, self.places, strict=True)
        ]
        return (
            f"simulation + jumps over {self.column} that decay over {values['scale']:.4g}: "
            f"{listing(jumps)}"
        )


def _decayed(x: FloatArray, places: FloatArray, scale: FloatArray) -> FloatArray:
    """Return the remaining shares (n, k) of jumps at places (k,)."""
    since = x[:, None] - places
    return np.where(since >= 0, np.exp(-np.maximum(since, 0) / np.reshape(scale, (-1, 1))), 0.0)


def _detected(
    column: str, axis: Axis, scale: Prior, context: Context
) -> tuple[tuple[float, ...], int]:
    """Return the places of the jumps, and among how many they were looked for."""
    x, missed = context.column(column), np.asarray(context.missed)
    # the first row has no other before it
    tried = axis.rows[1 :: max(1, len(axis.rows) // _N_PLACES)]
    most = min(_MAX_JUMPS, len(x) // _ROWS_EACH)
    if len(missed) != len(x) or most < _MIN_JUMPS:
        return (), 0
    # what the simulation's parameters follow is no jump
    slopes = [context.slopes[name] for name in context.parameters if name in context.slopes]
    free = np.linalg.qr(np.column_stack(slopes))[0] if slopes else np.empty((len(x), 0))
    best, found = -np.inf, np.empty(0, dtype=np.intp)
    for length in quantiles(scale, _N_SCALES).tolist():
        shapes = _decayed(x, tried, np.array(length))
        before = -np.inf
        for chosen in _path(shapes, missed, free, most):
            k = len(chosen)
            left = _without(np.column_stack([free, shapes[:, chosen]]), missed)
            # the Bayesian information criterion, and what a set of places costs
            fit = -0.5 * len(x) * log(max(float(left @ left), np.finfo(float).tiny))
            value = fit - 0.5 * k * log(len(x)) - log(comb(len(tried), k))
            if k >= _MIN_JUMPS and value > best:
                best, found = value, chosen
            if k > _MIN_JUMPS and value <= before:
                break
            before = max(before, value)
    return tuple(np.sort(tried[found]).tolist()), len(tried)


def _path(
    shapes: FloatArray, missed: FloatArray, free: FloatArray, most: int
) -> Iterator[NDArray[np.intp]]:
    """Yield sets of shapes, each with one more than the one before it."""
    chosen: list[int] = []
    for _ in range(most):
        chosen.append(_next(shapes, missed, free, chosen))
        # what was chosen alone may lie elsewhere with the others
        for k in range(len(chosen)):
            chosen[k] = _next(shapes, missed, free, chosen[:k] + chosen[k + 1 :])
        yield np.array(chosen)


def _next(shapes: FloatArray, missed: FloatArray, free: FloatArray, chosen: list[int]) -> int:
    """Return the shape that explains most of the residual of those that are chosen."""
    known = np.column_stack([free, shapes[:, chosen]])
    left, others = _without(known, missed), _without(known, shapes)
    size = np.sum(others**2, axis=0)
    # what is chosen leaves rounding
    new = size > 1e-8 * np.sum(shapes**2, axis=0)
    gain = np.where(new, (left @ others) ** 2 / np.where(new, size, 1.0), -1.0)
    return int(np.argmax(gain))


def _without(columns: FloatArray, values: FloatArray) -> FloatArray:
    """Return values (n,) or (n, k) without their part along columns."""
    basis = np.linalg.qr(columns)[0]
    return values - basis @ (basis.T @ values)


def _trouble(cause: Cause, context: Context) -> str | None:
    assert isinstance(cause, RecurringJumps)
    prepared = cause.prepare(context)
    return None if prepared.coefficients else "too few rows for jumps at several places"


register(
    Form(
        "recurring-jumps",
        RecurringJumps,
        meaning="{output} jumps at several places of {column}, and each jump decays",
        least_rows=12,
        least_distinct=12,
        trouble=_trouble,
        headline="{output} jumps again and again over {column}, and each jump decays over {scale}",
    )
)
