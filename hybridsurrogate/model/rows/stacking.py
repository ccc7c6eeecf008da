"""Measured rows of several outputs as rows of one output each, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.simulation.arrays import as_numbers, check_size
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True, eq=False)
class Stacking:
    """How rows of several outputs are laid out as rows of one.

    The outputs of a row follow each other, each divided by its scale.

    Attributes
    ----------
    names : tuple of str
    scale : ndarray of shape (k,)
        Standard deviation of each measured output; ones where the likelihood needs y as it is.
    at : int
        Position of the column `OUTPUT`.
    """

    names: tuple[str, ...]
    scale: FloatArray
    at: int

    def rows(self, X: FloatArray) -> FloatArray:
        """Return rows (n k, n_columns + 1) of X (n, n_columns)."""
        k = len(self.names)
        which = np.tile(np.arange(k, dtype=float), len(X))
        return np.insert(np.repeat(X, k, axis=0), self.at, which, axis=1)

    def values(self, Y: FloatArray) -> FloatArray:
        """Return outputs (n k,) of Y (n, k); NaN where none was measured."""
        return (Y / self.scale).ravel()

    def back(self, values: FloatArray) -> FloatArray:
        """Return values (..., n k) on the scale of the stacked outputs as (..., n, k) of Y's."""
        k = len(self.names)
        return values.reshape(*values.shape[:-1], -1, k) * self.scale

    def log_scale(self, X: FloatArray) -> FloatArray:
        """Return the log of the scale of each stacked row (n,): a density of y has less by it."""
        return np.log(self.scale)[X[:, self.at].astype(np.intp)]


class Conditional(NamedTuple):
    """Rows of several outputs, each given others of its measurement, whose errors are correlated.

    With correlations C C' of the errors, C lower triangular, the density of a measurement is that
    of its first output, of the second given the first, and so on: residuals diag(C) C^-1 r are
    independent, with standard deviations diag(C) (the modified Cholesky decomposition; Pourahmadi
    1999, Biometrika 86:677).

    Attributes
    ----------
    members : ndarray of int of shape (g, k)
        Rows of each measurement, by output; -1: it was not measured.
    weight : ndarray of shape (J, g or 1, k, k)
        Of the residuals, one on the diagonal.
    sd : ndarray of shape (J, g or 1, k)
        Factor on the noise of each row that is left.
    """

    members: NDArray[np.intp]
    weight: FloatArray
    sd: FloatArray

    @classmethod
    def of(
        cls, members: NDArray[np.intp], correlation: FloatArray, scale: FloatArray, all_others: bool
    ) -> Conditional:
        """Return them for correlations (J, g or 1, k, k) and standard deviations (J or 1, n).

        Given the outputs before or, with ``all_others``, given all others.
        """
        there = members >= 0
        if not there.all():
            # what was not measured is independent
            both = there[:, :, None] & there[:, None]
            correlation = np.where(both, correlation, np.eye(members.shape[1]))
        inverse = np.linalg.inv(np.linalg.cholesky(correlation))
        if all_others:
            inverse = np.swapaxes(inverse, -2, -1) @ inverse
        diagonal = np.diagonal(inverse, axis1=-2, axis2=-1)
        own = np.where(there, scale[:, members], 1.0)
        weight = inverse / diagonal[..., None] * own[..., :, None] / own[..., None, :]
        return cls(members, weight, diagonal ** (-0.5 if all_others else -1.0))

    def residuals(self, rows: FloatArray) -> FloatArray:
        """Return what is linear in residuals (J or 1, n, m), each less what the others predict."""
        J, _, m = rows.shape
        padded = np.concatenate([rows, np.zeros((J, 1, m))], axis=1)
        mixed = self.weight @ padded[:, self.members]
        out = np.tile(rows, (len(mixed) // J, 1, 1))
        there = self.members >= 0
        out[:, self.members[there]] = mixed[:, there]
        return out

    def noise(self, factor: FloatArray, n: int) -> FloatArray:
        """Return factors (J, n or 1) on the noise of n rows, less what the others predict."""
        there, J = self.members >= 0, max(len(factor), len(self.sd))
        out = np.array(np.broadcast_to(factor, (J, n)))
        out[:, self.members[there]] *= np.broadcast_to(self.sd, (J, *there.shape))[:, there]
        return out

    def correlated(self, noise: FloatArray) -> FloatArray:
        """Return independent normal numbers (J, n) as rows of unit scale have them together."""
        J = len(noise)
        padded = np.concatenate([noise, np.zeros((J, 1))], axis=1)[:, self.members]
        root = np.linalg.inv(self.weight) * self.sd[..., None, :]
        there, out = self.members >= 0, noise.copy()
        out[:, self.members[there]] = (root @ padded[..., None])[..., 0][:, there]
        return out


def members_of(number: FloatArray, output: FloatArray, k: int) -> NDArray[np.intp]:
    """Return the rows (g, k) of each measurement, by output; rows without a number are of none."""
    there = np.flatnonzero(np.isfinite(number))
    which, group = np.unique(number[there], return_inverse=True)
    members = np.full((len(which), k), -1)
    members[group.ravel(), output[there].astype(np.intp)] = there
    return members


def as_several(y: Any, names: Sequence[str], word: str = "y") -> FloatArray:
    """Return outputs (n, k), NaN where one was not measured; columns of a DataFrame by name.

    Raises
    ------
    ValueError
        For another shape, a missing column or infinite values.
    """
    if isinstance(y, pd.DataFrame) and all(isinstance(name, str) for name in y.columns):
        missing = [name for name in names if name not in y.columns]
        if missing:
            raise ValueError(
                f"{word} lacks the outputs {missing}; its columns are {list(y.columns)}. Fill a "
                "column with NaN for what was not measured."
                f"{did_you_mean(missing, y.columns)}"
            )
        y = y[list(names)]
    values = as_numbers(y, word)
    if values.ndim != 2 or values.shape[1] != len(names):
        raise ValueError(
            f"{word} must have shape (n, {len(names)}), a column for each of the outputs "
            f"{', '.join(names)} with NaN for what was not measured, got {values.shape}."
        )
    if np.isinf(values).any():
        raise ValueError(f"Input {word} contains infinity.")
    check_size(values, word)
    return values


def stacking_of(Y: FloatArray, names: Sequence[str], at: int, scaled: bool) -> Stacking:
    """Return how measured outputs Y (n, k) are stacked; ValueError for one never measured."""
    there = np.isfinite(Y)
    # the noise of an output takes two values to be estimated
    few = [name for name, n in zip(names, there.sum(axis=0), strict=True) if n < 2]
    if few:
        raise ValueError(
            f"The output {few[0]!r} has fewer than 2 measured values: leave it out of the "
            "simulation's outputs, or measure it."
        )
    scale = np.ones(len(names))
    if scaled:
        sd = np.nanstd(Y, axis=0)
        size = np.nanmax(np.abs(Y), axis=0)
        scale = np.where(sd > 1e-14 * size, sd, np.where(size > 0, size, 1.0))
    return Stacking(tuple(names), scale, at)
