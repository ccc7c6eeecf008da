"""A periodic curve over one column."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Forms, Rows
from hybridsurrogate.effects.context import (
    LONGEST_PERIOD,
    UNKNOWN,
    Axis,
    highest_frequency,
    period_nodes,
)
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.over_column import OverColumn
from hybridsurrogate.effects.registry import Form, over_columns, over_inputs, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# more periods than this in the measured span are looked for only where a prior says so; with an
# overtone those of the overtone
_MAX_CYCLES, _MAX_OVERTONE_CYCLES = 2500, 100


@dataclass(eq=False, repr=False)
class Periodic(OverColumn):
    """A sine of unknown period, amplitude and phase over one column, perhaps with an overtone.

    ``simulation + amplitude sin(2 pi x / period + phase)``, with ``harmonics=2`` also
    ``+ overtone sin(4 pi x / period + phase_2)``: a wave whose crests and troughs differ. The
    period is in units of the column, the amplitudes in those of the output. The period is
    log-uniform between the shortest that the rows resolve (two distances of even rows, a fifth of
    two mean distances of irregular ones, at least a 2500th of their span) and twice their span;
    with an overtone four distances, at least a fiftieth of the span. Linear in
    sine and cosine at a given period, as in a Lomb-Scargle periodogram (Scargle 1982, Astrophysical
    Journal 263:835).

    Parameters
    ----------
    column : str
        Any measured column.
    period : frozen scipy.stats distribution or None, default=None
        Prior of the period.
    harmonics : {1, 2}, default=1
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.context import Axis
    >>> wave = hs.Periodic("t", axis=Axis.of([-4.0, 4.0]))
    >>> wave.columns({"t": np.array([0.0, 1.0])}, {"period": 4.0}).round(3).tolist()
    [[0.0, 1.0], [1.0, 0.0]]
    """

    kind = "periodic"
    forms: ClassVar[Forms] = {("harmonics", 2): "overtone"}
    unknowns = ("period",)

    column: str
    period: Prior | None = None
    harmonics: int = 1
    axis: Axis = UNKNOWN

    @property
    def coefficients(self) -> tuple[str, ...]:  # type: ignore[override]
        """Sine and cosine, and those of the overtone."""
        return ("sine", "cosine", "overtone_sine", "overtone_cosine")[: 2 * self.harmonics]

    def prepare(self, context: Context) -> Cause:
        """Fill in the prior of the period from the measured rows."""
        if self.harmonics not in (1, 2):
            raise ValueError(f"harmonics must be 1 or 2, got {self.harmonics!r}.")
        axis = self.along(context)
        if self.harmonics == 1:
            shortest = 1 / highest_frequency(axis.rows, _MAX_CYCLES)
        else:
            n = max(len(axis.rows), 4)
            shortest = 2 * axis.span * max(2.0 / (n - 1), 1.0 / _MAX_OVERTONE_CYCLES)
        period = self.period or frozen(stats.loguniform, shortest, LONGEST_PERIOD * axis.span)
        return self.filled(axis=axis, period=period)

    def grid(self) -> dict[str, FloatArray]:
        """Return periods evenly spaced in frequency, five per independent (highest) frequency."""
        return {"period": period_nodes(self.period, 5 * self.harmonics, self.axis.span)}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return sines and cosines around the middle of the measured rows."""
        phase = 2 * np.pi * (X[self.column] - self.pivot) / theta["period"]
        sine, cosine = np.sin(phase), np.cos(phase)
        waves = [sine, cosine]
        if self.harmonics == 2:  # of the double angle
            waves += [2 * sine * cosine, 1 - 2 * sine**2]
        return np.stack(waves, axis=-1)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return period, amplitude and a peak, and the last two of the overtone."""
        period = np.asarray(theta["period"])
        first = self._crest(coefficients["sine"], coefficients["cosine"], period)
        out = {"period": period, "amplitude": first[0], "peak": first[1]}
        if self.harmonics == 2:
            pair = coefficients["overtone_sine"], coefficients["overtone_cosine"]
            out["overtone"], out["overtone_peak"] = self._crest(*pair, period / 2)
        return out

    def _crest(
        self, sine: FloatArray, cosine: FloatArray, period: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return a wave's amplitude, and where it peaks next to the middle of the rows."""
        turn = np.asarray(cosine + 1j * np.asarray(sine))
        # one and the same peak in all draws
        typical = np.angle(np.mean(turn / np.maximum(np.abs(turn), 1e-300)))
        angle = typical + np.angle(turn * np.exp(-1j * typical))
        return np.abs(turn), self.pivot + period * angle / (2 * np.pi)

    def code(self) -> Code:
        """Return the cause as Python."""
        whole = "{amplitude} * np.cos({angle})"
        steps = {"angle": "2 * np.pi * ({x} - {peak}) / {period}"}
        numbers = {"period": "{x}", "amplitude": "{y}", "peak": "{x}"}
        if self.harmonics == 2:
            whole += " + {overtone} * np.cos({overtone_angle})"
            steps["overtone_angle"] = "2 * np.pi * ({x} - {overtone_peak}) / ({period} / 2)"
            numbers |= {"overtone": "{y}", "overtone_peak": "{x}"}
        return Code(whole, numbers, {"x": self.column}, steps=steps)


register(
    Form(
        "periodic",
        Periodic,
        over_columns(Periodic),
        meaning="a regular wave over {column} is in the data and not in the simulation",
        least_distinct=8,
        headline=(
            "The simulation misses a cycle of {output}: {amplitude:around} with a period of "
            "{period}"
        ),
    ),
    Form(
        "periodic: overtone",
        Periodic,
        over_inputs(lambda column: Periodic(column, harmonics=2)),
        least_distinct=12,
    ),
)
