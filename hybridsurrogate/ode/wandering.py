"""A parameter of a right-hand side that wanders in time, as smoothly as a Gaussian process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.numerics import hilbert
from hybridsurrogate.simulation.modification import Modification, Numbers
from hybridsurrogate.types import FloatArray

# the parameter changes by a factor of at most exp(5): beyond it no solver gets through
_MOST = 5.0


@dataclass(frozen=True)
class WanderingParameter(Modification):
    """A parameter p that becomes p exp(c(t)) in the right-hand side, c a sum of waves.

    Parameters
    ----------
    parameter : str
    low, high : float
        Times between which the curve c lives, see `numerics.hilbert`.
    n : int
        Waves of which it is a sum.
    prefix : str or None, default=None
        What the full names of the numbers begin with; None: the parameter and "process".
    """

    parameter: str
    low: float
    high: float
    n: int
    prefix: str | None = None

    @property
    def label(self) -> str:
        """The prefix, or the parameter and "process"."""
        return self.prefix or f"{self.parameter}_process"

    @property
    def neutral(self) -> dict[str, float]:
        """The waves at zero."""
        return dict.fromkeys(self.sizes, 0.0)

    @property
    def sizes(self) -> tuple[str, ...]:
        """The coefficients of the waves."""
        return wave_names(self.n)

    @property
    def is_in_time(self) -> bool:
        """It is a course in time."""
        return True

    def check(self, rates: Sequence[str], states: Sequence[str]) -> None:
        """Raise ValueError where the right-hand side does not take the parameter."""
        if self.parameter not in rates:
            raise ValueError(
                f"rhs has no parameter {self.parameter!r}; it has {list(rates)}."
                f"{did_you_mean(self.parameter, rates)}"
            )

    def factors(self, t: FloatArray, numbers: Numbers, step: float) -> dict[str, FloatArray]:
        """Return the factor on the parameter, (k, m)."""
        scaled = (2 * t[:, 0] - self.low - self.high) / (self.high - self.low)
        change = hilbert.waves(scaled, self.n) @ coefficients(numbers, self.n).T
        return {self.parameter: np.exp(np.clip(change, -_MOST, _MOST))}


def wave_names(n: int) -> tuple[str, ...]:
    """Return the names of the coefficients of n waves."""
    return tuple(f"wave_{k}" for k in range(1, n + 1))


def coefficients(numbers: Numbers, n: int) -> FloatArray:
    """Return the coefficients of n waves (m, n) of m draws."""
    return np.stack([np.asarray(numbers[name]) for name in wave_names(n)], axis=-1)
