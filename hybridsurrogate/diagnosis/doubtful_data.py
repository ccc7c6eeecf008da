"""Measured data of which a diagnosis had better not be believed: copies, and no noise."""

from __future__ import annotations

import warnings

import numpy as np

from hybridsurrogate.diagnosis.evidence import Search
from hybridsurrogate.diagnosis.fits import FLOOR
from hybridsurrogate.exceptions import DiagnosisWarning
from hybridsurrogate.priors import FloatArray

# one or two rows may agree by chance where the output is rounded
_FEWEST = 3
# the search knows no noise below the floor; what a few times more leaves open is no better known
_NEAR = 3.0


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
    return alike if alike >= _FEWEST and 2 * alike > again else 0


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


def warn_if_exact(found: Search) -> None:
    """Warn the caller of ``fit`` where the simulation alone misses too little to be diagnosed."""
    least = FLOOR * found.problem.scale
    if found.weighed[0].sigma > _NEAR * least:
        return
    warnings.warn(
        f"The simulation meets the measured output to about {FLOOR:g} of its spread. Smaller noise "
        "is not searched for, so that a cause of that size may go unseen or get the wrong name. "
        "Such data come from a computation: add noise as large as the differences that matter, "
        "and diagnose again.",
        DiagnosisWarning,
        stacklevel=4,
    )
