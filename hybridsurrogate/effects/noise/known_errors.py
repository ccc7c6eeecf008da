"""Standard deviations that measured rows bring with them: error bars."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import ERROR, Declared, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.priors import frozen
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.types import Prior

# what may be done with the errors: see `RowErrors.kind`
KINDS = ("added", "scaled", "known")
# standard deviation of log sigma where sigma is fixed: samplers move in log sigma, and noise that
# is uncertain by a thousandth changes no estimate
_FIXED = 1e-3


@dataclass(frozen=True)
class RowErrors:
    """How rows with a column `ERROR` of standard deviations e scatter.

    The standard deviation of a row is ``sigma`` times its `factor`. With "known" it is e, with
    "scaled" e times an inferred factor, and with "added" ``sqrt(e^2 + s^2)``. There the jitter s is
    an unknown of the effect `Jitter`, or fixed, in ``jitter``.

    Attributes
    ----------
    kind : {"added", "scaled", "known"}
    typical : tuple of float
        Median error of each output, on the scale of eta: that of a row without the column.
    jitter : tuple of float
        Fixed standard deviations that are added in quadrature to those of each output.

    Examples
    --------
    >>> import numpy as np
    >>> errors = RowErrors("scaled", typical=(2.0,))
    >>> errors.unit, errors.factor({ERROR: np.array([1.0, 4.0])}, 2)
    (2.0, array([0.5, 2. ]))
    """

    kind: str
    typical: tuple[float, ...]
    jitter: tuple[float, ...] = ()

    @property
    def fixes_sigma(self) -> bool:
        """Whether sigma is the typical error, and no unknown."""
        return self.kind == "known" or (self.kind == "added" and not self.jitter)

    @cached_property
    def unit(self) -> float:
        """Noise of a typical row, of the first output, at a factor of one."""
        return float(np.hypot(self.typical[0], self.jitter[0] if self.jitter else 0.0))

    @property
    def least_sigma(self) -> float:
        """The least sigma that is possible."""
        return 0.0 if self.kind == "scaled" else self.typical[0]

    def of_rows(self, rows: Rows, n: int) -> FloatArray:
        """Return the errors of n rows; typical ones where the rows have no such column."""
        if ERROR in rows:
            return np.asarray(rows[ERROR])
        return np.broadcast_to(self._each(self.typical, rows), n)

    def factor(self, rows: Rows, n: int) -> FloatArray:
        """Return the noise of n rows over sigma."""
        errors = self.of_rows(rows, n)
        if self.jitter:
            errors = np.hypot(errors, self._each(self.jitter, rows))
        return errors / self.unit

    def noise_prior(self, prior: Prior, is_default: bool) -> Prior:
        """Return the prior of sigma, from the user's or that of noise without known errors.

        A factor on the errors is log-normal around one, with standard deviation 1 of its logarithm.
        """
        if self.fixes_sigma:
            return frozen(stats.lognorm, _FIXED, scale=self.unit)
        if self.kind == "scaled" and is_default:
            return frozen(stats.lognorm, 1.0, scale=self.unit)
        return prior

    def with_jitter(self, jitter: tuple[float, ...]) -> RowErrors:
        """Return the same with the jitter of each output fixed."""
        return replace(self, jitter=jitter)

    @staticmethod
    def _each(values: tuple[float, ...], rows: Rows) -> FloatArray:
        if len(values) == 1:
            return np.asarray(values[0])
        return np.asarray(values)[rows[OUTPUT].astype(np.intp)]


class Jitter(Declared):
    """Noise in addition to the known errors of rows; no fault, but part of every model of them.

    The standard deviation of a row is ``sqrt(e^2 + s^2)`` (Sharma 2017, Annual Review of Astronomy
    and Astrophysics 55:213, section 6), with a jitter s for each output.

    Parameters
    ----------
    errors : RowErrors
    prior : frozen scipy.stats distribution
        Of each jitter, on the scale of eta.
    outputs : tuple of str
        Names of several outputs; empty for a single one.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.stats import halfnorm
    >>> jitter = Jitter(RowErrors("added", (3.0,)), halfnorm(scale=5.0))
    >>> jitter.noise({ERROR: np.array([3.0, 8.0])}, {"jitter": np.full(2, 4.0)}).round(3)
    array([1.667, 1.118])
    """

    kind = "jitter"

    def __init__(self, errors: RowErrors, prior: Prior, outputs: tuple[str, ...] = ()):
        self.errors = errors
        self.prior = prior
        self.outputs = outputs

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the prior of the jitter of each output."""
        names = [f"jitter of {name}" for name in self.outputs] or ["jitter"]
        return dict.fromkeys(names, self.prior)

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the factor by which the jitter increases the noise of each row."""
        each = [theta[name] for name in self.parameters]
        jitter = each[0]
        if self.outputs:
            which = X[OUTPUT].astype(np.intp)
            jitter = np.stack(each)[which, np.arange(len(which))]
        return np.asarray(np.hypot(1.0, jitter / self.errors.of_rows(X, len(jitter))))

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code("", does="nothing")
