"""Noise of which neighbouring measurements share a part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import UNIT_SD, Cause, Context, FloatArray, Rows, quantiles
from hybridsurrogate.effects.context import UNKNOWN, Axis
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.over_column import OverColumn
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.numerics.hilbert import BOUNDARY
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# pairs of waves
_N_PAIRS = 30
# and their longest period on the column scaled to [-1, 1]: half of what it leaves between the ends
# of the rows is more than two of the longest correlation lengths
_LONGEST_PERIOD = 2 * BOUNDARY


@dataclass(eq=False, repr=False)
class Autocorrelation(OverColumn):
    """Correlated noise along an ordered column, in addition to the independent noise.

    ``simulation + u(x)`` with u an Ornstein-Uhlenbeck process, the AR(1) process of unevenly spaced
    rows: standard deviation ``amplitude``, correlation ``exp(-distance / length)`` (Uhlenbeck and
    Ornstein 1930, Physical Review 36:823). It is written as a constant and thirty pairs of sines
    and cosines with independent normal coefficients: the exact Fourier series of the process made
    periodic well beyond the rows; faster parts count as independent noise. So its cost is linear in
    the rows, and a new row is predicted from its neighbours: far from all rows u has mean zero and
    its full standard deviation.

    ``unexplained`` is a smooth curve that the simulation misses, of at least a thirteenth of the
    measured span in length. This is rough (the paths have no slope anywhere) and soon forgets: the
    length is log-uniform from half a spacing of neighbouring rows to a twentieth of the span, but
    at least four spacings. What stays correlated for longer looks like a curve, and data at
    these rows cannot separate the two. The amplitude is log-uniform from 0.3 % to 100 % of the
    spread of the output; a search compares it as it does every other size.

    Parameters
    ----------
    column : str
        Any measured column whose order means something, such as a time or a row number.
    length, amplitude : frozen scipy.stats distribution or None, default=None
        Priors, in the units of the column and of the output.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.context import Axis
    >>> drift = hs.Autocorrelation("t", axis=Axis.of([0.0, 10.0]))
    >>> t = np.array([2.0, 3.0, 9.0])
    >>> columns = drift.columns({"t": t}, {"length": np.full(3, 1.0), "amplitude": np.ones(3)})
    >>> (columns @ columns.T)[0].round(2).tolist()
    [0.95, 0.37, 0.0]
    """

    kind = "noise"
    meaning = (
        "residuals of {output} are correlated between neighbouring measurements along {column}"
    )
    unknowns = ("length", "amplitude")
    is_process = True
    coefficient_sd = UNIT_SD
    coefficients = (
        "constant",
        *(f"{wave}_{k}" for k in range(1, _N_PAIRS + 1) for wave in ("cos", "sin")),
    )
    variant = "autocorrelation"
    # the simulation is right
    changes_output = False

    column: str
    length: Prior | None = None
    amplitude: Prior | None = None
    axis: Axis = UNKNOWN

    @property
    def name(self) -> str:
        """The kind and the column, and what is meant."""
        return f"noise({self.column}, autocorrelated)"

    def prepare(self, context: Context) -> Cause:
        """Fill in middle and span of the column and the priors."""
        axis, scale = self.along(context), context.scale
        longest = min(max(axis.span / 20, 4 * axis.spacing), axis.span / 8)
        shortest = min(axis.spacing / 2, longest / 4)
        return self.filled(
            axis=axis,
            length=self.length or frozen(stats.loguniform, shortest, longest),
            amplitude=self.amplitude or frozen(stats.loguniform, 0.003 * scale, scale),
        )

    def grid(self) -> dict[str, FloatArray]:
        """Return five lengths; the amplitude only scales the columns, as their size does."""
        return {"length": quantiles(self.length, 5)}

    def factors(self, X: Rows, theta: Rows) -> tuple[FloatArray, FloatArray]:
        """Return constant, cosines and sines, and the root of the variance of each wave."""
        # beyond the period's middle the waves would come back to the rows at the other end
        scaled = np.clip(self.scaled(X), -BOUNDARY, BOUNDARY)
        frequency = 2 * np.pi / _LONGEST_PERIOD * np.arange(_N_PAIRS + 1)
        # powers of the first wave: cosine and sine of one angle a row give all of them
        first = np.exp(1j * scaled * frequency[1])
        waves = np.cumprod(np.broadcast_to(first[:, None], (len(first), _N_PAIRS)), axis=1)
        of_rows = np.empty((len(first), 1 + 2 * _N_PAIRS))
        of_rows[:, 0], of_rows[:, 1::2], of_rows[:, 2::2] = 1.0, waves.real, waves.imag
        order = np.arange(len(frequency))
        rate = self.axis.span / (2 * np.reshape(theta["length"], (-1, 1)))
        # Fourier coefficients of exp(-rate distance) over half a period
        cut = 1 - (-1.0) ** order * np.exp(-rate * _LONGEST_PERIOD / 2)
        variance = np.where(order, 4, 2) / _LONGEST_PERIOD * rate / (rate**2 + frequency**2) * cut
        height = np.sqrt(variance) * np.reshape(theta["amplitude"], (-1, 1))
        return of_rows, np.hstack([height[:, :1], np.repeat(height[:, 1:], 2, axis=1)])

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{amplitude}**2 * np.exp(-np.abs({x} - {other}) / {length})",
            {"length": "{x}", "amplitude": "{y}"},
            {"x": self.column},
            arguments={"other": f"{self.column} of another row"},
            does="scatters",
            name="noise_covariance",
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            f"simulation, with noise of which a part of {values['amplitude']:.4g} is correlated "
            f"over {values['length']:.4g} units of {self.column}"
        )


register(
    Form(
        "noise: autocorrelation",
        Autocorrelation,
        lambda context: map(Autocorrelation, context.inputs[:1]),
        least_rows=8,
        least_distinct=12,
        headline="The errors of neighbouring measurements of {output} are correlated",
    )
)
