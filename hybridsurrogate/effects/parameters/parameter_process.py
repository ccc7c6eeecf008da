"""A parameter that wanders over an input: which one would have to vary, and how."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import USUAL_CHANGE, Cause, Context, Declared, FloatArray, Rows
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.output.processes import PLACES_OF_CURVE, scaled
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.numerics import hilbert
from hybridsurrogate.ode.dynamics import WanderingParameter, coefficients, wave_names
from hybridsurrogate.priors import frozen, prior_sd
from hybridsurrogate.types import Prior

# the shortest reaches from peak to trough over 4 % of the range; with 30 fits take thrice as long,
# with 12 scores of 20 courses are 0.13 nats a row (standard error 0.06) lower
_N_WAVES = 24
# of the input scaled to [-1, 1]: a parameter that jumps to another level at random has this
# correlation if it jumps twice in the range, on average. Of twice the length, three of four fast
# courses are those of the wrong parameter
_LENGTH = 1.0


@dataclass(eq=False, repr=False)
class ParameterProcess(Declared):
    """A parameter that wanders over an input, smoothly or in jumps.

    The catch-all of parameters, as `GaussianProcessDiscrepancy` is that of outputs: compared with
    it and with other parameters, it says *which* parameter would have to vary, and how. What it
    finds carries over to outputs and inputs that were not measured.

    A parameter whose prior has one sign becomes ``p exp(c(x))``, any other one ``p + c(x)``. The
    curve c is a sum of cosines over the input (`numerics.hilbert`), with the spectrum of an
    exponential kernel of length 1 on the input scaled to [-1, 1] (Rasmussen and Williams 2006,
    Gaussian Processes for Machine Learning, equation 4.15 with nu = 1/2): that of a parameter that
    jumps to another level at random, on average twice in the range. The mean of c over the range is
    zero, which leaves the level to p, and beyond the range it stays as at the ends. The size and
    the length of a process, as unknowns, lie on a bent ridge with its waves, on which ensembles do
    not converge in 10,000 steps. In an `OdeSimulator` a parameter of the right-hand side that
    wanders in time does so inside the dynamics.

    Parameters
    ----------
    parameter : str
        A parameter of the simulation.
    over : str or None, default=None
        An input; None: the first one.
    scale : float or None, default=None
        Usual change: in logarithms of a parameter of one sign, else in its units. None: 0.7, or the
        parameter's prior standard deviation.
    ends : (float, float) or None, default=None
        Of the input that is scaled to [-1, 1]; None: those of the measured rows.
    inside : bool, default=False
        Whether the parameter wanders inside the dynamics; `prepare` finds out.
    factor : bool, default=True
        Whether the change is a factor; `prepare` finds out.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> rate = hs.ParameterProcess("rate", "t", ends=(0.0, 10.0))
    >>> theta = {f"wave_{k}": np.zeros(3) for k in range(1, 25)}
    >>> rows = {"t": np.array([0.0, 5.0, 10.0])}
    >>> rate.inputs(rows, {"rate": np.full(3, 2.0)}, theta)[1]["rate"].tolist()
    [2.0, 2.0, 2.0]
    >>> theta["wave_1"] += 1.0
    >>> rate.inputs(rows, {"rate": np.full(3, 2.0)}, theta)[1]["rate"].round(1).tolist()
    [5.4, 2.0, 0.7]
    """

    kind = "parameter-drift"
    about = "parameter"
    is_process = True

    parameter: str
    over: str | None = None
    scale: float | None = None
    ends: tuple[float, float] | None = None
    inside: bool = False
    factor: bool = True

    @property
    def reads(self) -> tuple[str, ...]:
        """The input over which the parameter wanders."""
        return (self.over,) if self.over else ()

    @property
    def variant(self) -> str:
        """That it is a process, and over which input."""
        return f"process over {self.over}"

    @property
    def name(self) -> str:
        """The kind, the parameter and the input."""
        return f"{self.kind}({self.parameter} over {self.over}, process)"

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the priors of the waves, the shorter the smaller."""
        scale = USUAL_CHANGE if self.scale is None else self.scale
        sizes = (scale * spectrum(_N_WAVES)).tolist()
        priors = [frozen(stats.norm, scale=size) for size in sizes]
        return dict(zip(wave_names(_N_WAVES), priors, strict=True))

    def prepare(self, context: Context) -> Cause:
        """Fill in the input, its range and the priors."""
        prior = context.parameter(self.parameter)
        over = self.over or context.inputs[0]
        if over not in context.inputs:
            raise ValueError(
                f"{over!r} is not an input of the simulation; these are: {list(context.inputs)}."
                f"{did_you_mean(over, context.inputs)}"
            )
        axis = context.axis(over)
        inside = self.parameter in context.rates and over == context.inputs[0]
        low, high = prior.support()
        factor = bool(inside or low >= 0 or high <= 0)
        scale = USUAL_CHANGE if factor else prior_sd(prior)
        return self.filled(
            over=over,
            scale=scale if self.scale is None else self.scale,
            ends=self.ends or (axis.origin, axis.origin + axis.span),
            inside=inside,
            factor=factor,
        )

    @property
    def modification(self) -> WanderingParameter | None:
        """The change of the right-hand side, where it is one."""
        low, high = self._ends
        return WanderingParameter(self.parameter, low, high, _N_WAVES) if self.inside else None

    @property
    def _ends(self) -> tuple[float, float]:
        return self.ends or (0.0, 1.0)

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Move the parameter, row by row, or inside the dynamics."""
        change = self.modification
        if change is not None:
            return X, {**omega, **{change.full(name): theta[name] for name in change.neutral}}
        waves = hilbert.cosines(scaled(X[self.over or ""], *self._ends), _N_WAVES)
        change = np.einsum("nk,nk->n", waves, coefficients(theta, _N_WAVES))
        return X, {**omega, self.parameter: self._moved(omega[self.parameter], change)}

    def course(self, x: FloatArray, parameter: FloatArray, theta: Rows) -> FloatArray:
        """Return the parameter over the input.

        Parameters
        ----------
        x : ndarray of shape (m,)
        parameter : ndarray of shape (J,)
            Draws of the parameter itself.
        theta : dict of name to ndarray of shape (J,)
            Draws of the process.

        Returns
        -------
        ndarray of shape (J, m)
        """
        return self._moved(np.asarray(parameter)[:, None], self._curves(x, theta))

    def _curves(self, x: FloatArray, theta: Rows) -> FloatArray:
        return coefficients(theta, _N_WAVES) @ hilbert.cosines(scaled(x, *self._ends), _N_WAVES).T

    def _moved(self, parameter: FloatArray, change: FloatArray) -> FloatArray:
        return np.asarray(parameter * np.exp(change) if self.factor else parameter + change)

    def start(self) -> dict[str, float]:
        """Return waves of zero."""
        return dict.fromkeys(wave_names(_N_WAVES), 0.0)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the standard deviation of the curve over the measured range."""
        curves = self._curves(np.linspace(*self._ends, PLACES_OF_CURVE), theta)
        return {"amplitude": np.std(curves, axis=1)}

    def code(self) -> Code:
        """Return the cause as Python: its mean curve as a table."""
        change = "np.interp({x}, {grid0}, {table0})"
        moved = f"np.exp({change})" if self.factor else change
        own = f"{{of}} * {moved}" if self.factor else f"{{of}} + {moved}"
        return Code(
            moved.replace("{x}", "{t}") if self.inside else own,
            columns={} if self.inside else {"x": self.over or ""},
            grids={"grid0": (*self._ends, PLACES_OF_CURVE)},
            tables=self._tables,
            does="scales rate" if self.inside else "moves",
            of=self.parameter,
        )

    def _tables(self, theta: Rows, of_columns: Rows) -> dict[str, FloatArray]:
        """Return the mean change over the input."""
        grid = np.linspace(*self._ends, PLACES_OF_CURVE)
        return {"table0": np.mean(self._curves(grid, theta), axis=0)}

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        by = f"+-{values['amplitude']:.3g}"
        by = f"a factor of exp({by})" if self.factor else by
        return f"simulation with {self.parameter} wandering over {self.over} by {by}"


def spectrum(n: int) -> FloatArray:
    """Return standard deviations (n,) of n cosines."""
    scaled = _LENGTH * np.pi / 2 * np.arange(1, n + 1)
    return np.asarray(np.sqrt(2 * _LENGTH / (1 + scaled**2)))


register(
    Form(
        "parameter-drift: process",
        ParameterProcess,
        least_distinct=8,
        headline="{target} wanders, and the simulation keeps it constant",
    )
)
