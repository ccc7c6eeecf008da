"""A periodic curve over one column."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.notation import SIMULATION, number, word
from hybridsurrogate.effects.over_column import LONGEST_PERIOD, OverColumn
from hybridsurrogate.priors import Prior, frozen

# more periods than this in the measured span are looked for only where a prior says so
_MOST_CYCLES = 100


class Periodic(OverColumn):
    """A sine of unknown period, amplitude and phase over one column, perhaps with an overtone.

    ``simulation + amplitude sin(2 pi x / period + phase)``, with ``harmonics=2`` also
    ``+ overtone sin(4 pi x / period + phase_2)``: a wave whose crests and troughs differ. The
    period is in units of the column, the amplitudes in those of the output. The period is
    log-uniform between the shortest that the rows resolve (two distances of neighbouring rows, four
    with an overtone), or a hundredth of their span (a fiftieth) where that is longer, and twice
    their span: with rows without end there would be no end of periods to try. Linear in
    sine and cosine at a given period, as in a Lomb-Scargle periodogram (Scargle 1982, Astrophysical
    Journal 263:835).

    Parameters
    ----------
    column : str
        Any measured column.
    period : frozen scipy.stats distribution or None, default=None
        Prior of the period.
    harmonics : {1, 2}, default=1
    center, span : float or None, default=None
        Where the phase is counted from, and the span of the measured rows.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> wave = hs.Periodic("t", center=0.0, span=8.0)
    >>> wave.columns({"t": np.array([0.0, 1.0])}, {"period": 4.0}).round(3).tolist()
    [[0.0, 1.0], [1.0, 0.0]]
    """

    kind = "periodic"

    def __init__(
        self,
        column: str,
        period: Prior | None = None,
        harmonics: int = 1,
        center: float | None = None,
        span: float | None = None,
    ):
        super().__init__(column, center, span)
        self.period = period
        self.harmonics = harmonics

    @property
    def variant(self) -> str:
        """Whether there is an overtone."""
        return "overtone" if self.harmonics == 2 else ""

    @property
    def coefficients(self) -> tuple[str, ...]:  # type: ignore[override]
        """Sine and cosine, and those of the overtone."""
        return ("sine", "cosine", "overtone_sine", "overtone_cosine")[: 2 * self.harmonics]

    def prepare(self, context: Context) -> Cause:
        """Fill in the prior of the period from the measured rows."""
        if self.harmonics not in (1, 2):
            raise ValueError(f"harmonics must be 1 or 2, got {self.harmonics!r}.")
        prepared = super().prepare(context)
        if self.period is None:
            distinct = np.unique(context.column(self.column))
            n = max(len(distinct), 4)
            span = float(np.ptp(distinct)) or 1.0
            shortest = self.harmonics * span * max(2.0 / (n - 1), 1.0 / _MOST_CYCLES)
            prepared.period = frozen(stats.loguniform, shortest, LONGEST_PERIOD * span)
        return prepared

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The prior of the period."""
        return {"period": self.period}

    def grid(self) -> dict[str, FloatArray]:
        """Return periods evenly spaced in frequency, five per independent (highest) frequency."""
        assert self.span is not None
        assert self.period is not None
        low, high = self.period.ppf([0.0, 1.0])
        n = int(np.ceil(5 * self.harmonics * self.span * (1 / low - 1 / high))) + 1
        return {"period": 1 / np.linspace(1 / low, 1 / high, max(n, 8))}

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return sines and cosines around the middle of the measured rows."""
        assert self.center is not None
        phase = 2 * np.pi * (X[self.column] - self.center) / theta["period"]
        sine, cosine = np.sin(phase), np.cos(phase)
        waves = [sine, cosine]
        if self.harmonics == 2:  # of the double angle
            waves += [2 * sine * cosine, 1 - 2 * sine**2]
        return np.stack(waves, axis=-1)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return period, amplitude, and the amplitude of the overtone."""
        amplitude = np.hypot(coefficients["sine"], coefficients["cosine"])
        out = {"period": np.asarray(theta["period"]), "amplitude": amplitude}
        if self.harmonics == 2:
            pair = (coefficients["overtone_sine"], coefficients["overtone_cosine"])
            out["overtone"] = np.hypot(*pair)
        return out

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        text = (
            f"simulation + {values['amplitude']:.4g} "
            f"sin(2 pi {self.column} / {values['period']:.5g} + phase)"
        )
        if "overtone" in values:
            half = values["period"] / 2
            text += f" + {values['overtone']:.4g} sin(2 pi {self.column} / {half:.5g} + phase_2)"
        return text

    def latex(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in LaTeX."""
        period = values["period"]
        text = SIMULATION + self._wave(values["amplitude"], period, r"\varphi")
        if "overtone" in values:
            text += self._wave(values["overtone"], period / 2, r"\varphi_{2}")
        return text

    def _wave(self, amplitude: float, period: float, phase: str) -> str:
        angle = rf"\frac{{2 \pi \, {word(self.column)}}}{{{number(period, 5)}}} + {phase}"
        return rf" + {number(amplitude)} \sin\left({angle}\right)"
