"""Where the runs show that the variance of a process is too small.

A stationary process has the same variance where a simulation is steep as where it is flat.
Leave-one-out errors of the runs show the difference: near a steep end of a range they are several
times what they should be.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hybridsurrogate.types import FloatArray

# the weight of a run falls by a factor e for so many runs that lie between; the prior that errors
# are as the process predicts, in runs
_NEIGHBOURS, _BELIEF = 3.0, 2.0


class LocalError(NamedTuple):
    """Factors on the error along each axis.

    Attributes
    ----------
    places : ndarray of shape (d, n)
        Coordinates of the runs, in order.
    factors : ndarray of shape (d, n)
        There, at least 1.
    """

    places: FloatArray
    factors: FloatArray

    @classmethod
    def of(cls, points: FloatArray, misses: FloatArray) -> LocalError:
        """Return factors for runs.

        Parameters
        ----------
        points : ndarray of shape (n, d)
        misses : ndarray of shape (n,)
            Squared errors in units of their variance.
        """
        order = np.argsort(points, axis=0, kind="stable").T
        ranks = np.arange(len(misses))
        near = np.exp(-np.abs(ranks[:, None] - ranks) / _NEIGHBOURS)
        # the mean of an inverse-gamma belief about the variance, updated by the runs around
        square = (_BELIEF + misses[order] @ near) / (_BELIEF + np.sum(near, axis=0))
        places = np.take_along_axis(points.T, order, axis=1)
        return cls(places, np.sqrt(np.maximum(square, 1.0)))

    def at(self, points: FloatArray) -> FloatArray:
        """Return the largest factor of all axes at points (m, d), shape (m,)."""
        along = [np.interp(*axis) for axis in zip(points.T, self.places, self.factors, strict=True)]
        return np.max(along, axis=0, initial=1.0)
