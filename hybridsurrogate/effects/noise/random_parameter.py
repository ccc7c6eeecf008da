"""A parameter that differs between rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.effects.noise.noise_of_slope import NoiseOfSlope, trouble
from hybridsurrogate.effects.registry import Form, register


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

    @property
    def reads(self) -> tuple[str, ...]:
        """No measured column."""
        return ()

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return f"simulation, with {self.quantity} varying by {values['spread']:.4g} (sd) by row"


def _over_parameters(context: Context) -> Iterator[Cause]:
    return (RandomParameter(name) for name in (*context.parameters, *context.assumed))


register(
    Form(
        "random-parameter",
        RandomParameter,
        _over_parameters,
        meaning="the parameter {target} differs between rows: {output} scatters where it depends "
        "on {target}",
        least_rows=8,
        trouble=trouble,
        like=("noise", "input-error"),
        headline="{target} differs from row to row, by about {spread}",
        formula="eta; noise sigma √(1 + (ratio slope / usual)²), slope: d eta / dp, usual: its "
        "root mean square",
        priors="ratio: log-normal, median 2, sd of the log 1",
        estimates="spread (sd of p between rows), ratio (its noise against the other, at a usual "
        "slope)",
        left_out="fewer than 8 rows; p counts as much everywhere; several outputs",
    )
)
