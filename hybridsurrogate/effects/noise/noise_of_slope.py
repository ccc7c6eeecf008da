"""Noise where the simulation is steep: inexact inputs, parameters that differ between rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import (
    NOISE_SD,
    SLOPE,
    Cause,
    Context,
    Declared,
    FloatArray,
    Rows,
    quantiles,
)
from hybridsurrogate.effects.context import trouble_with_labels
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.registry import Form, over_inputs, register
from hybridsurrogate.numerics.linear_algebra import NEGLIGIBLE
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# |slope| that varies by less, as a share of its mean, makes noise like any other
_MIN_VARIATION = 0.1


@dataclass(eq=False, repr=False)
class NoiseOfSlope(Declared):
    """Noise from a quantity ``q`` of the simulation that differs between rows.

    To first order around the simulation's output (Fuller 1987, Measurement Error Models, section
    3.1), ``eta(q + s e) = eta(q) + s e d eta / d q`` with e standard normal. The variance
    of a row is ``sigma^2 + (s d eta / d q)^2 = sigma^2 (1 + (ratio slope / usual)^2)``. ``usual``
    is the root mean square of the slope over the measured rows.

    Attributes
    ----------
    quantity : str
        The input or parameter.
    ratio : frozen scipy.stats distribution or None
        Prior of ``s usual / sigma``.
    usual : float or None
        On the scale of eta per unit of q.
    step : float or None
        A usual change of q, of which a thousandth is the step of differences.
    """

    about = "quantity"
    unknowns = ("ratio",)

    quantity: str
    ratio: Prior | None = None
    usual: float | None = None
    step: float | None = None

    @property
    def follows_slope(self) -> tuple[str, float]:  # type: ignore[override]
        """The input or parameter, and a usual change of it."""
        assert self.step is not None
        return self.quantity, self.step

    def prepare(self, context: Context) -> Cause:
        """Fill in the usual slope, the usual change and the prior."""
        usual = self.usual
        if usual is None:
            usual = float(np.sqrt(np.mean(_slopes_of(self, context) ** 2)))
        step = context.usual_change(self.quantity) if self.step is None else self.step
        # from a third of the other noise to ten times it
        prior = self.ratio or frozen(stats.lognorm, 1.0, scale=2.0)
        return self.filled(ratio=prior, usual=usual, step=step)

    def grid(self) -> dict[str, FloatArray]:
        """Return nine quantiles of the ratio."""
        return {"ratio": quantiles(self.ratio, 9)}

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the factor on the noise scale."""
        assert self.usual is not None
        # where the simulation fails nothing is known of its slope
        relative = np.abs(np.nan_to_num(X[SLOPE], posinf=0.0, neginf=0.0)) / self.usual
        return np.sqrt(1 + np.minimum(theta["ratio"] * relative, 1 / NEGLIGIBLE) ** 2)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the standard deviation of the quantity, in its unit, and the ratio."""
        assert self.usual is not None
        ratio = np.asarray(theta["ratio"])
        return {"spread": ratio * theta[NOISE_SD] / self.usual, "ratio": ratio}

    def code(self) -> Code:
        """Return the cause as Python."""
        over = f"slope of the simulated output over {self.quantity}"
        return Code(
            "np.sqrt({sigma}**2 + ({spread} * {slope}) ** 2)",
            {"spread": "{of}"},
            of=self.quantity,
            arguments={"slope": over},
            does="scatters",
            name="noise_sd",
        )


def _slopes_of(cause: NoiseOfSlope, context: Context) -> FloatArray:
    """Return the slope of the simulation at the measured rows.

    Raises
    ------
    ValueError
        If the simulation has no such input or parameter, or does not change with it.
    """
    context.usual_change(cause.quantity)
    slope = context.slopes.get(cause.quantity)
    if slope is None or not np.any(slope):
        raise ValueError(
            f"{type(cause).__name__}({cause.quantity!r}) needs a simulation of one output that "
            f"changes with {cause.quantity}."
        )
    return slope


def trouble(cause: Cause, context: Context) -> str | None:
    """Return why such noise cannot be separated from any other."""
    assert isinstance(cause, NoiseOfSlope)
    if labels := trouble_with_labels(cause.quantity, context):
        return labels
    try:
        size = np.abs(_slopes_of(cause, context))
    except ValueError as error:
        return str(error).rstrip(".")
    if np.std(size) < _MIN_VARIATION * np.mean(size):
        return f"the simulation is as steep over {cause.quantity} everywhere: noise like any other"
    return None


class InputError(NoiseOfSlope):
    """An input that is off by a random amount in every row: noise where the simulation is steep.

    To first order (Fuller 1987, Measurement Error Models, section 3.1) the variance of a row is
    ``sigma^2 + (s d eta / d x)^2``, with s the standard deviation of the input's error. It is
    written ``sigma^2 (1 + (ratio slope / usual)^2)`` with ``usual`` the root mean square of the
    slope over the measured rows. At a usual slope the input's error is ``ratio`` times the other
    noise. The ratio is log-normal with median 2 and standard deviation 1 of its logarithm.

    The slope is that of the simulation with what earlier causes make of it, at the row and at the
    parameters of each draw. An emulator's coefficients are fixed at their estimate from the runs.

    Parameters
    ----------
    quantity : str
        An input of the simulation.
    ratio : frozen scipy.stats distribution or None, default=None
        Prior of the ratio.
    usual : float or None, default=None
        Root mean square of the slope, on the scale of eta per unit of the input.
    step : float or None, default=None
        A quarter of the span of the input; a thousandth of it is the step of differences.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> late = hs.InputError("t", usual=2.0, step=1.0)
    >>> late.noise({hs.SLOPE: np.array([0.0, 2.0, 20.0])}, {"ratio": 1.0}).round(2).tolist()
    [1.0, 1.41, 10.05]
    """

    kind = "input-error"
    concerns = "inputs"

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return f"simulation, with {self.quantity} off by {values['spread']:.4g} (sd) in every row"


register(
    Form(
        "input-error",
        InputError,
        over_inputs(InputError),
        meaning=(
            "the recorded {target} is not exact: {output} scatters where it is steep in {target}"
        ),
        least_rows=8,
        trouble=trouble,
        headline="{target} is not exactly where the data have it: its error is about {spread}",
    )
)


class RandomParameter(NoiseOfSlope):
    """A parameter that varies at random from row to row: noise where the simulation depends on it.

    The embedded discrepancy of Sargsyan, Najm and Ghanem (2015, International Journal of Chemical
    Kinetics 47:246), to first order: the variance of a row is
    ``sigma^2 + (s d eta / d p)^2``, with s the standard deviation of the parameter between rows.
    It is written ``sigma^2 (1 + (ratio slope / usual)^2)`` with ``usual`` the root mean square of
    the slope over the measured rows. The ratio is log-normal with median 2 and standard deviation 1
    of its logarithm.

    The slope is that of the simulation with what earlier causes make of it, at the row and at the
    parameters of each draw. An emulator's coefficients are fixed at their estimate from the runs.

    Parameters
    ----------
    quantity : str
        A parameter or an assumed constant of the simulation.
    ratio : frozen scipy.stats distribution or None, default=None
        Prior of the ratio.
    usual : float or None, default=None
        Root mean square of the slope, on the scale of eta per unit of the parameter.
    step : float or None, default=None
        Prior standard deviation of the parameter; a thousandth of it is the step of differences.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> gusts = hs.RandomParameter("wind", usual=2.0, step=1.0)
    >>> gusts.noise({hs.SLOPE: np.array([0.0, -2.0])}, {"ratio": 1.0}).round(2).tolist()
    [1.0, 1.41]
    """

    kind = "random-parameter"
    reads = ()  # no measured column

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return f"simulation, with {self.quantity} varying by {values['spread']:.4g} (sd) by row"


register(
    Form(
        "random-parameter",
        RandomParameter,
        lambda context: map(RandomParameter, (*context.parameters, *context.assumed)),
        meaning=(
            "the parameter {target} differs between rows: {output} scatters where it depends "
            "on {target}"
        ),
        least_rows=8,
        trouble=trouble,
        headline="{target} differs from row to row, by about {spread}",
    )
)
