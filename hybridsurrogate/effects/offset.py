"""A constant added to the simulation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hybridsurrogate.effects.base import Cause, FloatArray, Rows
from hybridsurrogate.effects.notation import SIMULATION, plus, signed


class Offset(Cause):
    """A constant added to the simulation, such as a zero error of the instrument.

    ``simulation + amplitude``, in the units of the output. On a logarithmic scale of the output a
    constant is a factor: `Gain`.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> hs.Offset().columns({"t": np.array([0.0, 4.0])}, {}).tolist()
    [[1.0], [1.0]]
    """

    kind = "offset"
    coefficients = ("amplitude",)

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return a column of ones."""
        return np.ones((len(next(iter(X.values()))), 1))

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return f"simulation {plus(values['amplitude'])}"

    def latex(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in LaTeX."""
        return f"{SIMULATION} {signed(values['amplitude'])}"
