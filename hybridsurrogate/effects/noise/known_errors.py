"""Standard deviations and covariances that measured rows bring with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from hybridsurrogate.effects.base import ERROR, UNIT_SD, Cause, Context, Declared, FloatArray, Rows
from hybridsurrogate.effects.context import MAX_EXPERIMENTS, position_among
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.over_column import OverExperiments
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE, SINGULAR
from hybridsurrogate.priors import frozen
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.types import Prior

# what may be done with the errors: see `RowErrors.kind`
KINDS = ("added", "scaled", "known")
# standard deviation of log sigma where sigma is fixed: samplers move in log sigma, and noise that
# is uncertain by a thousandth changes no estimate
_FIXED_LOG_SD = 1e-3


@dataclass(frozen=True)
class RowErrors:
    """How rows with a column `ERROR` of standard deviations e scatter.

    The standard deviation of a row is ``sigma`` times its `factor`. With "known" it is e, with
    "scaled" e times an inferred factor, and with "added" ``sqrt(e^2 + s^2)``. There the jitter s is
    an unknown of the effect `Jitter`, or fixed, in ``jitter``.

    Attributes
    ----------
    kind : {"added", "scaled", "known"}
    typical : tuple of float
        Median error of each output, on the scale of eta: that of a row without the column.
    jitter : tuple of float
        Fixed standard deviations that are added in quadrature to those of each output.

    Examples
    --------
    >>> import numpy as np
    >>> errors = RowErrors("scaled", typical=(2.0,))
    >>> errors.unit, errors.factor({ERROR: np.array([1.0, 4.0])}, 2)
    (2.0, array([0.5, 2. ]))
    """

    kind: str
    typical: tuple[float, ...]
    jitter: tuple[float, ...] = ()

    @property
    def fixes_sigma(self) -> bool:
        """Whether sigma is the typical error, and no unknown."""
        return self.kind == "known" or (self.kind == "added" and not self.jitter)

    @cached_property
    def unit(self) -> float:
        """Noise of a typical row, of the first output, at a factor of one."""
        return float(np.hypot(self.typical[0], self.jitter[0] if self.jitter else 0.0))

    @property
    def least_sigma(self) -> float:
        """The least sigma that is possible."""
        return 0.0 if self.kind == "scaled" else self.typical[0]

    def of_rows(self, rows: Rows, n: int) -> FloatArray:
        """Return the errors of n rows; typical ones where the rows have no such column."""
        if ERROR in rows:
            return np.asarray(rows[ERROR])
        return np.broadcast_to(self._each(self.typical, rows), n)

    def factor(self, rows: Rows, n: int) -> FloatArray:
        """Return the noise of n rows over sigma."""
        errors = self.of_rows(rows, n)
        if self.jitter:
            errors = np.hypot(errors, self._each(self.jitter, rows))
        return errors / self.unit

    def noise_prior(self, prior: Prior, is_default: bool) -> Prior:
        """Return the prior of sigma, from the user's or that of noise without known errors.

        A factor on the errors is log-normal around one, with standard deviation 1 of its logarithm.
        """
        if self.fixes_sigma:
            return frozen(stats.lognorm, _FIXED_LOG_SD, scale=self.unit)
        if self.kind == "scaled" and is_default:
            return frozen(stats.lognorm, 1.0, scale=self.unit)
        return prior

    def with_jitter(self, jitter: tuple[float, ...]) -> RowErrors:
        """Return the same with the jitter of each output fixed."""
        return replace(self, jitter=jitter)

    @staticmethod
    def _each(values: tuple[float, ...], rows: Rows) -> FloatArray:
        if len(values) == 1:
            return np.asarray(values[0])
        return np.asarray(values)[rows[OUTPUT].astype(np.intp)]


@dataclass(eq=False, repr=False)
class Jitter(Declared):
    """Noise in addition to the known errors of rows; no fault, but part of every model of them.

    The standard deviation of a row is ``sqrt(e^2 + s^2)`` (Sharma 2017, Annual Review of Astronomy
    and Astrophysics 55:213, section 6), with a jitter s for each output.

    Parameters
    ----------
    errors : RowErrors
    prior : frozen scipy.stats distribution
        Of each jitter, on the scale of eta.
    outputs : tuple of str
        Names of several outputs; empty for a single one.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.stats import halfnorm
    >>> jitter = Jitter(RowErrors("added", (3.0,)), halfnorm(scale=5.0))
    >>> jitter.noise({ERROR: np.array([3.0, 8.0])}, {"jitter": np.full(2, 4.0)}).round(3)
    array([1.667, 1.118])
    """

    kind = "jitter"

    errors: RowErrors
    prior: Prior
    outputs: tuple[str, ...] = ()

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the prior of the jitter of each output."""
        names = [f"jitter of {name}" for name in self.outputs] or ["jitter"]
        return dict.fromkeys(names, self.prior)

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the factor by which the jitter increases the noise of each row."""
        each = [theta[name] for name in self.parameters]
        jitter = each[0]
        if self.outputs:
            which = X[OUTPUT].astype(np.intp)
            jitter = np.stack(each)[which, np.arange(len(which))]
        return np.asarray(np.hypot(1.0, jitter / self.errors.of_rows(X, len(jitter))))

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code("", does="nothing")


class _Part(NamedTuple):
    """Errors that rows of one output share, in its unit; of a single output without a name."""

    position: int
    name: str
    unit: float
    spread: Any
    covariance: FloatArray | None

    def named(self, word: str) -> str:
        """Return a word, of several outputs with the output's name."""
        return f"{self.name}: {word}" if self.name else word

    @property
    def is_unknown(self) -> bool:
        """Whether the spread is estimated."""
        return self.covariance is None and not isinstance(self.spread, float | int)

    def root(self, k: int) -> FloatArray:
        """Return a root (k, k) of the covariance, independent where it is of a spread.

        A value that was not measured, the last, has the mean variance of all others.
        """
        root = np.eye(k)
        if self.covariance is not None:
            values, vectors = np.linalg.eigh(self.covariance)
            root[:-1, :-1] = vectors * np.sqrt(np.maximum(values, 0.0))
            root[-1, -1] = np.sqrt(np.mean(np.diag(self.covariance)))
        return root

    def height(self, theta: Rows) -> FloatArray:
        """Return what the root is multiplied by for each draw, (J, 1), or for all, (1, 1)."""
        known = 1.0 if self.covariance is not None else self.spread
        return np.reshape(np.asarray(theta.get(self.named("spread"), known), dtype=float), (-1, 1))


@dataclass(eq=False, repr=False)
class SharedErrors(OverExperiments):
    """Errors that rows share, in addition to the error of each row; no fault, but part of the data.

    Rows with the value k of a column have ``simulation + e_k``: a batch, a run or a sensor that was
    off as a whole. A priori the errors e are Gaussian, and they are integrated out:

    - without ``covariance`` they are independent, of standard deviation ``spread``, which is
      estimated. A priori it is half-Cauchy, its scale that of the output (Gelman 2006, Bayesian
      Analysis 1:515, section 7.1);
    - with ``covariance`` they have that one. With one value a row it is any covariance of rows, and
      the fit is that of generalised least squares (Aitken 1936, Proceedings of the Royal Society of
      Edinburgh 55:42); `of_rows` splits a covariance into ``y_err`` and this effect.

    Of several outputs each has errors of its own, independent of those of the others. Give spreads
    and covariances by output, ``spread={"height": 0.5, "flow": None}``: outputs that are not named
    have none; with neither argument all have some.

    Give it to an estimator, ``effects=[hs.SharedErrors("run")]``. ``by_experiment={"y": "spread"}``
    is the same for the column that ``experiment`` names, y being the output. Held-out rows are
    predicted given the others that share their errors. A value that was not measured has an error
    of mean zero: it widens intervals.

    Parameters
    ----------
    column : str
        A measured column that the simulation ignores.
    spread : frozen scipy.stats distribution, float, None, or dict of these by output, default=None
        Prior of the spread, or its value where it is known, in units of the output (of its
        logarithm under a log-normal likelihood).
    covariance : array-like of shape (k, k), DataFrame, None, or dict of these, default=None
        Between the errors of the values 0, 1, ..., k - 1 of the column, or of those in the index of
        a DataFrame, in squared units of the output. It may be singular: one error that all share.
    levels : tuple of float, default=()
        Values of the column. Empty: those of the measured rows, or of the covariance.
    labels : tuple of str or None, default=None
        What to call them. None: as they are, or as ``experiment`` names them.
    outputs : tuple of (int, str, float), default=()
        Of several outputs those with such errors: position, name and unit. Empty: from the names.

    Raises
    ------
    ValueError
        When a model is fitted: for a covariance that is none, has no value for a measured row, or
        under a likelihood that is not normal on its scale; for one number for several outputs.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> errors = hs.SharedErrors("run", spread=0.5, levels=(1.0, 2.0))
    >>> columns, height = errors.factors({"run": np.array([1.0, 1.0, 2.0])}, {})
    >>> (columns * height @ (columns * height).T).tolist()
    [[0.25, 0.25, 0.0], [0.25, 0.25, 0.0], [0.0, 0.0, 0.25]]
    """

    kind = "shared-errors"
    about = "column"
    coefficient_sd = UNIT_SD
    # what was measured is off
    changes_output = False
    by_output = True

    column: str
    spread: Any = None
    covariance: Any = None
    levels: tuple[float, ...] = ()
    labels: tuple[str, ...] | None = None
    outputs: tuple[tuple[int, str, float], ...] = ()

    @classmethod
    def of_rows(cls, covariance: Any, column: str) -> tuple[Any, SharedErrors]:
        """Return the error of each row alone, for ``y_err``, and what rows share.

        The two add up to the covariance. A row alone has the largest share of its variance that
        leaves a covariance: the smallest eigenvalue of the correlations.

        Parameters
        ----------
        covariance : array-like of shape (n, n), or dict of these by output
            Positive definite, in squared units of y.
        column : str
            The column of X that numbers the rows 0, 1, ..., n - 1.

        Returns
        -------
        y_err : ndarray of shape (n,), or DataFrame with a column of each output
        effect : SharedErrors

        Raises
        ------
        ValueError
            For a matrix that is not square, symmetric, finite and positive definite.

        Examples
        --------
        >>> import hybridsurrogate as hs
        >>> y_err, effect = hs.SharedErrors.of_rows([[4.0, 1.0], [1.0, 4.0]], "row")
        >>> y_err.round(3).tolist(), effect.covariance.round(3).tolist()
        ([1.732, 1.732], [[1.0, 1.0], [1.0, 1.0]])
        """
        if isinstance(covariance, Mapping):
            parts = {name: cls.of_rows(one, column) for name, one in covariance.items()}
            errors = pd.DataFrame({name: alone for name, (alone, _) in parts.items()})
            shared = {name: one.covariance for name, (_, one) in parts.items()}
            return errors, cls(column, covariance=shared)
        matrix = _checked(covariance)
        sd = np.sqrt(np.diag(matrix))
        share = float(np.linalg.eigvalsh(matrix / np.outer(sd, sd))[0]) if sd.all() else 0.0
        if not share > SINGULAR:
            raise ValueError(
                "The covariance of rows is not positive definite: each row needs an error of its "
                "own. Give that as y_err, and what rows share as SharedErrors(..., covariance=)."
            )
        return np.sqrt(share) * sd, cls(column, covariance=matrix - share * np.diag(sd**2))

    def prepare(self, context: Context) -> Cause:
        """Fill in the values of the column, and the prior of the spread or the covariance."""
        if self.column in context.inputs:
            raise ValueError(
                f"{self.name}: rows that share an error need a column of labels that the "
                "simulation ignores, and this is one of its inputs."
            )
        if not context.outputs:
            return self._of_one(context, self.spread, self.covariance, 1.0)
        if self.outputs:
            return self
        outputs = self._outputs_in(context)
        spread, covariance = self.spread or {}, self.covariance or {}
        parts = [
            self._of_one(context, spread.get(name), covariance.get(name), unit)
            for _, name, unit in outputs
        ]
        levels = {one.levels for one in parts}
        if len(levels) > 1:
            raise ValueError(
                f"The covariances of {self.name} must be of the same values of {self.column}."
            )
        names = [name for _, name, _ in outputs]
        return parts[0].filled(
            spread={name: one.spread for name, one in zip(names, parts, strict=True)},
            covariance={name: one.covariance for name, one in zip(names, parts, strict=True)},
            outputs=outputs,
        )

    def _outputs_in(self, context: Context) -> tuple[tuple[int, str, float], ...]:
        """Return position, name and unit of the outputs that have such errors."""
        given = [one for one in (self.spread, self.covariance) if one is not None]
        if not all(isinstance(one, Mapping) for one in given):
            first = context.outputs[0]
            raise ValueError(
                f"{self.name}: outputs have units of their own, {', '.join(context.outputs)}; give "
                f"spread or covariance by output, {{{first!r}: ...}}."
            )
        named = [name for one in given for name in one]
        if unknown := [name for name in named if name not in context.outputs]:
            raise ValueError(
                f"{self.name}: there is no output {unknown[0]!r}; there are "
                f"{', '.join(context.outputs)}.{did_you_mean(unknown, context.outputs)}"
            )
        return tuple(
            (k, name, own.scale)
            for k, (name, own) in enumerate(zip(context.outputs, context.of_outputs, strict=True))
            if name in named or not given
        )

    def _of_one(self, context: Context, spread: Any, covariance: Any, unit: float) -> SharedErrors:
        """Return the effect of one output."""
        found = context.axis(self.column).rows
        labels = self.labels or context.names.get(self.column)
        if covariance is None:
            if spread is None:
                spread = frozen(stats.halfcauchy, scale=context.scale * unit)
            elif isinstance(spread, float | int) and not 0 < spread < np.inf:
                raise ValueError(f"{self.name} needs a spread that is positive, got {spread!r}.")
            levels = self.levels_in(context, labels)
            return self.filled(spread=spread, covariance=None, levels=levels, labels=labels)
        if spread is not None:
            raise ValueError(f"{self.name} has a spread or a covariance, not both.")
        if not context.gaussian:
            raise ValueError(
                f"{self.name}: a covariance of errors needs a likelihood that is normal on its "
                'scale, "normal" or "lognormal". Under others an error of each batch can be '
                "estimated: leave out the covariance."
            )
        if self.levels:
            return self
        matrix = _checked(covariance)
        of_matrix = self._levels_of(covariance, labels)
        there = np.flatnonzero(~np.isnan(of_matrix))
        order = there[np.argsort(of_matrix[there])]
        known = of_matrix[order].tolist()
        if absent := sorted({*found.tolist()} - {*known}):
            raise ValueError(
                f"The covariance of {self.name} is of {len(matrix)} values and has none for "
                f"{self.column} = {absent[0]:.12g} of the measured rows: number these from zero, "
                "or give a DataFrame whose index has the values of the column."
            )
        return self.filled(
            spread=None,
            covariance=matrix[np.ix_(order, order)],
            levels=tuple(known),
            labels=None if labels is None else tuple(labels[int(level)] for level in known),
        )

    def _levels_of(self, covariance: Any, labels: tuple[str, ...] | None) -> FloatArray:
        """Return the value of the column that each row of a covariance is of, NaN: of no row."""
        if not isinstance(covariance, pd.DataFrame):
            return np.arange(len(covariance), dtype=float)
        index = covariance.index
        if pd.api.types.is_numeric_dtype(index):
            return np.asarray(index, dtype=float)
        known = {name: float(k) for k, name in enumerate(labels or ())}
        levels = np.array([known.get(str(name), np.nan) for name in index])
        if absent := [name for name in known if name not in {*map(str, index)}]:
            raise ValueError(
                f"The covariance of {self.name} has no {absent[0]!r}; its index is {list(index)}."
                f"{did_you_mean(absent, map(str, index))}"
            )
        return levels

    @property
    def _parts(self) -> list[_Part]:
        """What rows of each output share."""
        if not self.outputs:
            return [_Part(0, "", 1.0, self.spread, self.covariance)]
        return [_Part(*one, self.spread[one[1]], self.covariance[one[1]]) for one in self.outputs]

    @property
    def coefficients(self) -> tuple[str, ...]:  # type: ignore[override]
        """One name for each value of the column, one that was not measured included."""
        names = (*self.names_of_levels, self.another)
        return tuple(one.named(name) for one in self._parts for name in names)

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the prior of each spread that is unknown."""
        return {one.named("spread"): one.spread for one in self._parts if one.is_unknown}

    def factors(self, X: Rows, theta: Rows) -> tuple[FloatArray, FloatArray]:
        """Return a root of the covariance at each row, and its height."""
        which, k = position_among(self.levels, X[self.column]), len(self.levels) + 1
        rows = [one.root(k)[which] for one in self._parts]
        if self.outputs:
            rows = [
                own * (X[OUTPUT] == one.position)[:, None]
                for own, one in zip(rows, self._parts, strict=True)
            ]
        heights = [one.height(theta) / one.unit for one in self._parts]
        J = max(map(len, heights))
        return np.hstack(rows), np.hstack([np.tile(h, (J // len(h), k)) for h in heights])

    def grid(self) -> dict[str, FloatArray]:
        """Nothing is enumerated: a search has the spread at its estimate."""
        return {}

    def at_estimate(self, spreads: Mapping[str, float]) -> Cause:
        """Return the same with spreads that are known, by the names of their priors."""
        if not self.outputs:
            return self.filled(spread=spreads.get("spread", self.spread))
        fixed = {one.name: spreads.get(one.named("spread"), one.spread) for one in self._parts}
        return self.filled(spread=fixed)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return spreads, and the error of each value of the column unless they are many."""
        out = {name: np.asarray(theta[name]) for name in self.parameters}
        if len(self.levels) > MAX_EXPERIMENTS:
            return out
        names = (*self.names_of_levels, self.another)
        for one in self._parts:
            drawn = np.column_stack([coefficients[one.named(name)] for name in names])
            each = (one.height(theta) * drawn) @ one.root(len(names)).T
            out |= dict(zip(map(one.named, self.names_of_levels), each.T, strict=False))
        return out

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code("", does="nothing")

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return f"simulation, measured with errors that rows of one {self.column} share"


def correlations(
    covariance: Any, there: NDArray[np.bool_], names: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """Return standard deviations (n, k) and correlations (n, k, k) of the errors of outputs.

    Parameters
    ----------
    covariance : array-like of shape (n, k, k), or (k, k) for all rows
        In squared units of the outputs; of an output that was not measured anything.
    there : ndarray of bool of shape (n, k)
        What was measured.
    names : sequence of str
        Of the outputs.

    Raises
    ------
    ValueError
        For another shape, and for a matrix that is not finite, symmetric and positive definite.

    Examples
    --------
    >>> sd, matrix = correlations([[4.0, 3.0], [3.0, 9.0]], np.ones((1, 2), dtype=bool), ["a", "b"])
    >>> sd.tolist(), matrix.tolist()
    ([[2.0, 3.0]], [[[1.0, 0.5], [0.5, 1.0]]])
    """
    n, k = there.shape
    try:
        given = np.asarray(covariance, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"y_err must be numbers: {error}") from error
    if given.shape not in ((k, k), (n, k, k)):
        raise ValueError(
            f"y_err of shape {given.shape} is no covariance of the {k} outputs {', '.join(names)} "
            f"in {n} rows: give shape ({k}, {k}) for all rows, or ({n}, {k}, {k})."
        )
    both = there[:, :, None] & there[:, None]
    matrices = np.where(both, given, np.eye(k))
    finite = np.isfinite(matrices.reshape(n, -1)).all(axis=1)
    safe = np.where(finite.reshape(n, 1, 1), matrices, np.eye(k))
    gap = np.abs(safe - np.swapaxes(safe, 1, 2))
    symmetric = (gap <= NEGLIGIBLE * np.abs(safe).max(axis=(1, 2), keepdims=True)).all(axis=(1, 2))
    sd = np.sqrt(np.maximum(np.diagonal(safe, axis1=1, axis2=2), 0.0))
    unit = np.where(sd > 0, sd, 1.0)
    matrix = (safe + np.swapaxes(safe, 1, 2)) / 2 / unit[:, :, None] / unit[:, None]
    definite = (sd > 0).all(axis=1) & (np.linalg.eigvalsh(matrix)[:, 0] > SINGULAR)
    for i in map(int, np.flatnonzero(~(finite & symmetric & definite))[:1]):
        of = f" in row {i + 1}" if given.ndim > 2 else ""
        try:
            _checked(matrices[i])
        except ValueError as error:
            raise ValueError(f"y_err{of}: {error}") from None
        raise ValueError(
            f"y_err{of} is not positive definite: the errors of one output would follow from those "
            "of the others. Add the variance of what each output has alone to the diagonal."
        )
    return sd, matrix


def _checked(covariance: Any) -> FloatArray:
    """Return a covariance (k, k) as numbers; raise ValueError for what is none."""
    try:
        matrix = np.asarray(covariance, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"covariance must be a matrix of numbers: {error}") from error
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not matrix.size:
        raise ValueError(f"covariance must be a square matrix, got shape {matrix.shape}.")
    if len(bad := np.argwhere(~np.isfinite(matrix))):
        raise ValueError(
            f"covariance has {len(bad)} values that are NaN or infinite, the first in row "
            f"{bad[0][0] + 1}, column {bad[0][1] + 1}."
        )
    least = NEGLIGIBLE * np.max(np.abs(matrix))
    if len(bad := np.argwhere(np.abs(matrix - matrix.T) > least)):
        k, j = bad[0]
        raise ValueError(
            f"covariance is not symmetric: {matrix[k, j]:g} in row {k + 1}, column {j + 1}, and "
            f"{matrix[j, k]:g} the other way round."
        )
    smallest = float(np.linalg.eigvalsh(matrix)[0])
    if smallest < -len(matrix) * least:
        raise ValueError(
            f"covariance is not positive definite: its smallest eigenvalue is {smallest:.3g}. No "
            "errors have such covariances; look for rounded numbers or variances that are too "
            "small for the covariances next to them."
        )
    return (matrix + matrix.T) / 2
