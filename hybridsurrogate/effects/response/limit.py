"""A limit that the measured output does not pass."""

from __future__ import annotations

import numpy as np
from scipy import stats

from hybridsurrogate.effects.axis import UNMEASURED, OutputScale
from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Rows, quantiles
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


class Limit(Declared):
    """The output stops at a limit that the simulation exceeds: an overflow, the end of a scale.

    ``min(simulation, limit)``, or with ``below=True`` ``max(simulation, limit)``, as in censored
    regression (Tobin 1958, Econometrica 26:24), but with noise on what is read at the limit. The
    limit is in units of the output. On its scale, the logarithm where the likelihood takes it, the
    prior is normal, with mean and standard deviation of the measured output.

    Parameters
    ----------
    below : bool, default=False
        Whether nothing is below the limit, as under a detection limit, instead of above.
    limit : frozen scipy.stats distribution or None, default=None
        Prior of the limit, on the scale of eta.
    measured : OutputScale
        Where the measured output lies; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> values, slopes = hs.Limit().response(np.array([1.0, 5.0]), {}, {"limit": 3.0})
    >>> values.tolist(), slopes.tolist()
    ([1.0, 3.0], [1.0, 0.0])
    """

    kind = "limit"
    unknowns = ("limit",)

    def __init__(
        self,
        below: bool = False,
        limit: Prior | None = None,
        measured: OutputScale = UNMEASURED,
    ):
        self.below = below
        self.limit = limit
        self.measured = measured

    @property
    def variant(self) -> str:
        """On which side nothing is, where it is not the usual one."""
        return "below" if self.below else ""

    def prepare(self, context: Context) -> Cause:
        """Fill in the prior from where the output is."""
        measured = self.measured if self.measured.is_known else context.measured
        limit = self.limit or frozen(stats.norm, loc=context.location, scale=context.scale)
        return self.filled(limit=limit, measured=measured)

    def grid(self) -> dict[str, FloatArray]:
        """Return quantiles of the limit."""
        return {"limit": quantiles(self.limit, 50)}

    def response(
        self, simulated: FloatArray, X: Rows, theta: Rows
    ) -> tuple[FloatArray, FloatArray]:
        """Return the output as far as the limit, with slope one there and zero beyond."""
        beyond = simulated < theta["limit"] if self.below else simulated > theta["limit"]
        return np.where(beyond, theta["limit"], simulated), np.where(beyond, 0.0, 1.0)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the limit in units of the output."""
        limit = self.measured.unit * np.asarray(theta["limit"])
        return {"limit": np.exp(limit) if self.measured.is_log else limit}

    def code(self) -> Code:
        """Return the cause as Python."""
        if not self.measured.is_log:
            return self.shown()
        return Code(self._end("np.log({limit})"), {"limit": "{plain}"}, does="responds")

    def shown(self) -> Code:
        """Return the limit of the output itself."""
        return Code(self._end("{limit}"), {"limit": "{y}"}, does="responds")

    def _end(self, limit: str) -> str:
        return f"np.{'maximum' if self.below else 'minimum'}({{simulated}}, {limit})"


register(
    Form(
        "limit",
        Limit,
        lambda context: [Limit()],
        meaning="measured {output} stays at a limit where the simulation goes beyond, as where "
        "something overflows or a sensor is at the end of its scale",
        least_rows=8,
        like=("saturation", "response"),
        headline="{output} stops at {limit}, and the simulation goes beyond",
        priors="limit: normal, mean and sd of the measured output",
        estimates="limit",
        left_out="fewer than 8 rows",
    )
)
register(
    Form(
        "limit: below",
        Limit,
        lambda context: [Limit(below=True)],
        meaning="measured {output} stays at a limit where the simulation goes below, as at the "
        "least that a sensor can read",
        least_rows=8,
        headline="{output} does not fall below {limit}, and the simulation does",
        call="`Limit(below=True)`",
        formula="max(eta, limit)",
        priors="the same",
        estimates="limit",
        left_out="the same",
    )
)
