"""An input whose recorded value is not exact."""

from __future__ import annotations

from collections.abc import Mapping

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.effects.context import trouble_with_labels
from hybridsurrogate.effects.noise.noise_of_slope import NoiseOfSlope, trouble
from hybridsurrogate.effects.registry import Form, over_inputs, register


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

    @property
    def concerns(self) -> str:
        """The measured input."""
        return "inputs"

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return f"simulation, with {self.quantity} off by {values['spread']:.4g} (sd) in every row"


def _trouble(cause: Cause, context: Context) -> str | None:
    return trouble_with_labels(cause.target or "", context) or trouble(cause, context)


register(
    Form(
        "input-error",
        InputError,
        over_inputs(InputError),
        meaning="the recorded {target} is not exact: {output} scatters where it is steep in "
        "{target}",
        least_rows=8,
        trouble=_trouble,
        like=("noise", "random-parameter"),
        headline="{target} is not exactly where the data have it: its error is about {spread}",
        call="`InputError(x)`",
        formula="eta; noise sigma √(1 + (ratio slope / usual)²), slope: d eta / dx, usual: its "
        "root mean square",
        priors="ratio: log-normal, median 2, sd of the log 1",
        estimates="spread (sd of x in a row), ratio (its noise against the other, at a usual "
        "slope)",
        left_out="fewer than 8 rows, or than 5 whole numbers one apart; as steep everywhere; "
        "several outputs",
    )
)
