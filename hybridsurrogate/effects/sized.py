"""A cause whose size has the prior of a search: a scale mixture over several orders."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hybridsurrogate.effects.base import Cause, FloatArray, Rows, Wrapped
from hybridsurrogate.priors import from_normal, frozen, to_normal
from hybridsurrogate.types import Prior


class Sized(Wrapped):
    """A prepared cause, its coefficients and slopes in units of one unknown size.

    The size, the root mean square of what the cause changes over the measured rows, is log-uniform
    between two ends. Given the size, coefficients of columns are normal. So is the displacement of
    a parameter such as a gain from its neutral value, in standard normal coordinates and to first
    order, up to the width of the parameter's prior.

    Parameters
    ----------
    cause : Cause
        Prepared.
    low, high : float
        Ends of the size, on the scale of eta.
    rows : dict of name to ndarray of shape (n,)
        Measured rows.
    slopes : sequence of float
        Root mean square of the output's slope along each of ``cause.start()``, in standard normal
        coordinates.
    """

    def __init__(
        self,
        cause: Cause,
        low: float,
        high: float,
        rows: Rows,
        slopes: tuple[float, ...] = (),
    ):
        super().__init__(cause)
        self.low = low
        self.high = high
        self.rows = rows
        self.slopes = slopes

    coefficient_sd = 1.0
    hierarchy = None

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """Those of the cause, displacements in units of the size, and the size."""
        normal = frozen(stats.norm)
        own = {k: normal if k in self._neutral else p for k, p in self.cause.parameters.items()}
        return {**own, "size": frozen(stats.loguniform, self.low, self.high)}

    @property
    def _neutral(self) -> dict[str, float]:
        """Standard normal coordinates at which the cause changes nothing."""
        start = self.cause.start()
        return {k: float(to_normal([self.cause.parameters[k]], [v])[0]) for k, v in start.items()}

    def _own(self, theta: Rows) -> dict[str, FloatArray]:
        own = {name: theta[name] for name in self.cause.parameters}
        for slope, (name, neutral) in zip(self.slopes, self._neutral.items(), strict=True):
            reach = np.minimum(theta["size"] / slope, 1.0)
            z = neutral + reach * theta[name]
            own[name] = from_normal([self.cause.parameters[name]], z[:, None])[:, 0]
        return own

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Return those of the cause."""
        return self.cause.inputs(X, omega, self._own(theta))

    def gain(self, X: Rows, theta: Rows) -> FloatArray | float:
        """Return that of the cause."""
        return self.cause.gain(X, self._own(theta))

    def response(
        self, simulated: FloatArray, X: Rows, theta: Rows
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return what the cause makes of the output."""
        return self.cause.response(simulated, X, self._own(theta))

    def noise(self, X: Rows, theta: Rows) -> FloatArray | float:
        """Return that of the cause."""
        return self.cause.noise(X, self._own(theta))

    def start(self) -> dict[str, float]:
        """Return nothing: displacements are in units of the size."""
        return {}

    def grid(self) -> dict[str, FloatArray]:
        """Return quantiles of the priors in these units."""
        return Cause.grid(self)

    def rows_of(self, X: Rows) -> dict[str, NDArray[np.bool_]]:
        """Return nothing: the size concerns all rows."""
        return {}

    def columns(self, X: Rows, theta: Rows) -> FloatArray | None:
        """Return the cause's columns in units of the size."""
        own = self._own(theta)
        columns = self.cause.columns(X, own)
        if columns is None:
            return None
        # theta is the same in all rows of a draw, and draws come one after the other
        size, m = theta["size"], len(next(iter(self.rows.values())))
        first = np.concatenate([[True], np.any([v[1:] != v[:-1] for v in theta.values()], axis=0)])
        draw = np.cumsum(first) - 1
        J = int(draw[-1]) + 1
        rows = {name: np.tile(values, J) for name, values in self.rows.items()}
        once = {name: np.repeat(np.asarray(values)[first], m) for name, values in own.items()}
        measured = self.cause.columns(rows, once)
        assert measured is not None
        mean_square = np.mean(measured.reshape(J, m, -1) ** 2, axis=1)
        if self.cause.is_process:
            mean_square = np.sum(mean_square, axis=1, keepdims=True)
        rms = np.sqrt(np.maximum(mean_square, np.finfo(float).tiny))
        return columns * (size[:, None] / rms[draw])

    def factors(self, X: Rows, theta: Rows) -> None:
        """Return None: a column in units of the size is no product."""

    @property
    def factorises(self) -> bool:
        """No."""
        return False
