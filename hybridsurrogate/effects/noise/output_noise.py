"""Noise that differs between several outputs: no fault, but part of every model of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Declared, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.priors import frozen
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.types import Prior

# standard deviation of the log of a ratio: one output may be read fifty times as well as another
_SD = 2.0


class OutputNoise(Declared):
    """Separate noise for each of several outputs, relative to that of the first.

    Outputs are in units of their measured standard deviations, and ratios log-normal around one.

    Parameters
    ----------
    outputs : sequence of str
    ratios : sequence of float or None, default=None
        Known ratios, the first one; None: inferred.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.effects.noise.output_noise import OutputNoise
    >>> noise = OutputNoise(("level", "flow"))
    >>> list(noise.parameters)
    ['noise of flow']
    >>> noise.noise({"output_of_row": np.array([0.0, 1.0])}, {"noise of flow": np.full(2, 3.0)})
    array([1., 3.])
    """

    kind = "noise-of-outputs"

    def __init__(self, outputs: Sequence[str], ratios: Sequence[float] | None = None):
        self.outputs = outputs
        self.ratios = ratios

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the ratios of the other outputs, unless they are known."""
        if self.ratios is not None:
            return {}
        return {f"noise of {name}": frozen(stats.lognorm, _SD) for name in self.outputs[1:]}

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the ratio of each row's output."""
        which = X[OUTPUT].astype(np.intp)
        if self.ratios is not None:
            return np.asarray(self.ratios, dtype=float)[which]
        each = np.stack([np.ones(len(which)), *(theta[name] for name in self.parameters)])
        return np.asarray(each[which, np.arange(len(which))])

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code("", does="nothing")

    def log_prior(self) -> float:
        """Return the log prior density of known ratios, of their logarithms."""
        assert self.ratios is not None
        return float(np.sum(stats.norm.logpdf(np.log(self.ratios[1:]), scale=_SD)))
