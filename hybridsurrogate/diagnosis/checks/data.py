"""Measured data of which a diagnosis had better not be believed: copies, lost digits, no noise."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.utils import check_consistent_length

from hybridsurrogate.diagnosis.checks.settings import SETTINGS
from hybridsurrogate.diagnosis.search.evidence import Search
from hybridsurrogate.diagnosis.search.local_fit import FLOOR
from hybridsurrogate.diagnosis.validation.folds import rows_of
from hybridsurrogate.exceptions import DiagnosisWarning
from hybridsurrogate.inference.conjugate.emulator_posterior import emulator_posterior
from hybridsurrogate.priors import FloatArray, from_normal
from hybridsurrogate.problem.problem import Problem
from hybridsurrogate.problem.rows import check_weights


def counted_rows(
    X: Any, y: Any, sample_weight: ArrayLike | None
) -> tuple[Any, Any, FloatArray | None]:
    """Return the rows that have a weight, and their weights; None where all weights are one.

    Parameters
    ----------
    X, y : array-like of shape (n, n_columns), (n,) or (n, n_outputs)
    sample_weight : array-like of shape (n,) or None

    Raises
    ------
    ValueError
        For weights that are unusable.
    """
    if sample_weight is None or X is None or y is None:  # an estimator says what is missing
        return X, y, None
    check_consistent_length(X, y)
    weights = check_weights(sample_weight, len(X))
    if np.all(weights == 1.0):
        return X, y, None
    kept = np.flatnonzero(weights > 0)
    return rows_of(X)(kept), rows_of(y)(kept), weights[kept]


def copies(X: FloatArray, y: FloatArray) -> int:
    """Return how many rows repeat an earlier one in input and output, 0 where that is no wonder.

    Rows with the same inputs are measurements made again. Where most of these differ in the output,
    those that agree are rounded.

    Parameters
    ----------
    X : ndarray of shape (n, n_columns)
    y : ndarray of shape (n,)
    """
    again = len(X) - len(np.unique(X, axis=0))
    alike = len(X) - len(np.unique(np.column_stack([X, y]), axis=0))
    return alike if alike >= SETTINGS.fewest_rows and 2 * alike > again else 0


def warn_of_copies(X: FloatArray, y: FloatArray) -> None:
    """Warn the caller of ``fit`` of rows that are in the data twice."""
    n = copies(X, y)
    if n:
        warnings.warn(
            f"{n} of {len(X)} measured rows are copies of others, in every input and in the "
            "output. Copies count as measurements made again, so that the noise looks "
            "autocorrelated and causes look surer than they are: drop them, "
            "DataFrame.drop_duplicates(), unless each was measured.",
            DiagnosisWarning,
            stacklevel=3,
        )


def check_digits(problem: Problem) -> None:
    """Raise ValueError for data so far from zero that doubles hold little of their spread.

    What they lose must be less than the `FLOOR` below which noise is rounding.
    """
    if np.ptp(problem.y) == 0:
        raise ValueError(
            f"All measured outputs are {problem.observed[0]:.12g}: there is no spread to diagnose. "
            "If they did differ, double precision does not hold by how little: subtract a constant "
            "from measurements and simulation alike, before their digits are lost."
        )
    names = ["measured outputs", *(f"values of {name!r}" for name in problem.model.columns)]
    for what, values in zip(names, [problem.y, *problem.X.T], strict=True):
        sd, lost = float(np.std(values)), float(np.spacing(np.max(np.abs(values))))
        if np.ptp(values) > 0 and lost > FLOOR * sd:
            raise ValueError(
                f"The {what} lie around {np.mean(values):g} with a standard deviation of {sd:g}, "
                f"but double precision holds such numbers to {lost:g} only, too little for a "
                "diagnosis. Subtract a constant from measurements and simulation alike, before "
                "their digits are lost."
            )


def warn_if_mirrored(problem: Problem) -> None:
    """Warn the caller of ``fit`` where the output is that of the simulation with the other sign."""
    model = problem.model
    if problem.likelihood.log_scale or not len(problem.good):
        return
    coefficients = emulator_posterior(model.basis, problem.simulation).mean
    with np.errstate(over="ignore", invalid="ignore"):
        simulated = model.simulated(
            problem.X, from_normal(model.priors, problem.good), coefficients
        )[0][0]
        sizes = np.linalg.norm(simulated) * np.linalg.norm(problem.y)
        likeness = float(simulated @ problem.y) / sizes if sizes > 0 else 0.0
    # a cosine: positive where the simulation has anything of the output
    if likeness < -SETTINGS.mirrored:
        warnings.warn(
            "Even at its best fit the simulation has the other sign than the measured output: "
            f"the cosine between the two is {likeness:.2f}. No cause that is searched for changes "
            "a sign. Check the sign conventions of both, such as up or down, gain or loss.",
            DiagnosisWarning,
            stacklevel=3,
        )


def warn_if_exact(result: Search) -> None:
    """Warn the caller of ``fit`` where the simulation alone misses too little to be diagnosed."""
    least = FLOOR * result.problem.scale
    if result.candidates[0].sigma > SETTINGS.near_floor * least:
        return
    warnings.warn(
        f"The simulation meets the measured output to about {FLOOR:g} of its spread. Smaller noise "
        "is not searched for, so that a cause of that size may go unseen or get the wrong name. "
        "Such data come from a computation: add noise as large as the differences that matter, "
        "and diagnose again.",
        DiagnosisWarning,
        stacklevel=4,
    )
