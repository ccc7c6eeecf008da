"""A parameter that wanders over an input: which one would have to vary, and how."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.numerics import hilbert
from hybridsurrogate.ode.wandering import WanderingParameter, coefficients, wave_names
from hybridsurrogate.priors import frozen, prior_sd
from hybridsurrogate.types import Prior

# waves, and the shortest length scale that so many resolve (Riutort-Mayol et al. 2023, Statistics
# and Computing 33:17, eq. 17: 1.75 times the boundary over the length)
_N_WAVES, _SHORTEST, _LONGEST = 10, 0.27, 2.0
# nodes of the length scale, each of which runs the simulation
_N_LENGTHS = 4
# the usual change of a parameter that keeps its sign, as a factor: halving and doubling
_USUAL = 0.7
# places of the table of a curve
_PLACES = 121


class ParameterProcess(Declared):
    """A parameter that wanders over an input, as smoothly as a Gaussian process.

    The catch-all of parameters, as `GaussianProcessDiscrepancy` is that of outputs: compared with
    it and with other parameters, it says *which* parameter would have to vary, and how. What it
    finds carries over to outputs and inputs that were not measured.

    A parameter whose prior has one sign becomes ``p exp(amplitude c(x))``, any other one ``p +
    amplitude c(x)``. The curve c is a Gaussian process of unit variance over the input scaled to
    [-1, 1], with a squared-exponential kernel (`numerics.hilbert`). In an `OdeSimulator` a
    parameter of the right-hand side that wanders in time does so inside the dynamics.

    Parameters
    ----------
    parameter : str
        A parameter of the simulation.
    over : str or None, default=None
        An input; None: the first one.
    amplitude : frozen scipy.stats distribution or None, default=None
        Prior of the standard deviation of the change: in logarithms of a parameter of one sign,
        else in its units. None: half-normal, with scale 0.7 or the parameter's prior standard
        deviation, so that the process is shrunk to nothing.
    length_scale : frozen scipy.stats distribution or None, default=None
        Prior on the scaled input. None: log-uniform from 0.27 to 2.
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
    >>> theta = {"amplitude": 0.5, "length_scale": 1.0, **{f"wave_{k}": 0.0 for k in range(1, 11)}}
    >>> theta = {name: np.full(3, value) for name, value in theta.items()}
    >>> rows = {"t": np.array([0.0, 5.0, 10.0])}
    >>> rate.inputs(rows, {"rate": np.full(3, 2.0)}, theta)[1]["rate"].tolist()
    [2.0, 2.0, 2.0]
    >>> theta["wave_1"] += 1.0
    >>> rate.inputs(rows, {"rate": np.full(3, 2.0)}, theta)[1]["rate"].round(2).tolist()
    [2.34, 3.69, 2.34]
    """

    kind = "parameter-process"
    about = "parameter"
    is_process = True

    def __init__(
        self,
        parameter: str,
        over: str | None = None,
        amplitude: Prior = None,
        length_scale: Prior = None,
        ends: tuple[float, float] | None = None,
        inside: bool = False,
        factor: bool = True,
    ):
        self.parameter = parameter
        self.over = over
        self.amplitude = amplitude
        self.length_scale = length_scale
        self.ends = ends
        self.inside = inside
        self.factor = factor

    @property
    def reads(self) -> tuple[str, ...]:
        """The input over which the parameter wanders."""
        return (self.over,) if self.over else ()

    @property
    def variant(self) -> str:
        """Over which input."""
        return f"over {self.over}"

    @property
    def name(self) -> str:
        """The kind, the parameter and the input."""
        return f"{self.kind}({self.parameter} over {self.over})"

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the priors of amplitude and length scale, and of the waves."""
        waves = dict.fromkeys(wave_names(_N_WAVES), frozen(stats.norm))
        return {"amplitude": self.amplitude, "length_scale": self.length_scale, **waves}

    def prepare(self, context: Context) -> Cause:
        """Fill in the input, its range and the priors."""
        if self.parameter not in context.parameters:
            raise ValueError(
                f"{self.parameter!r} is not a parameter of the simulation; these are: "
                f"{list(context.parameters)}.{did_you_mean(self.parameter, context.parameters)}"
            )
        over = self.over or context.inputs[0]
        if over not in context.inputs:
            raise ValueError(
                f"{over!r} is not an input of the simulation; these are: {list(context.inputs)}."
                f"{did_you_mean(over, context.inputs)}"
            )
        axis, prior = context.axis(over), context.parameters[self.parameter]
        inside = self.parameter in context.rates and over == context.inputs[0]
        low, high = prior.support()
        factor = inside or low >= 0 or high <= 0
        scale = _USUAL if factor else prior_sd(prior)
        return self.filled(
            over=over,
            amplitude=self.amplitude or frozen(stats.halfnorm, scale=scale),
            length_scale=self.length_scale or frozen(stats.loguniform, _SHORTEST, _LONGEST),
            ends=self.ends or (axis.origin, axis.origin + axis.span),
            inside=inside,
            factor=factor,
        )

    @property
    def modification(self) -> WanderingParameter | None:
        """The change of the right-hand side, where it is one."""
        low, high = self.ends or (0.0, 1.0)
        return WanderingParameter(self.parameter, low, high, _N_WAVES) if self.inside else None

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Move the parameter, row by row, or inside the dynamics."""
        change = self.modification
        if change is not None:
            return X, {**omega, **{change.full(name): theta[name] for name in change.neutral}}
        moved = self._moved(omega[self.parameter], self._change(X[self.over or ""], theta))
        return X, {**omega, self.parameter: moved}

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
        change = coefficients(theta, _N_WAVES) @ hilbert.waves(self._scaled(x), _N_WAVES).T
        size = np.asarray(theta["amplitude"])[:, None]
        return self._moved(np.asarray(parameter)[:, None], size * change)

    def _scaled(self, x: FloatArray) -> FloatArray:
        low, high = self.ends or (0.0, 1.0)
        return (2 * np.asarray(x) - low - high) / ((high - low) or 1.0)

    def _change(self, x: FloatArray, theta: Rows) -> FloatArray:
        waves = hilbert.waves(self._scaled(x), _N_WAVES)
        return np.asarray(
            theta["amplitude"] * np.einsum("nk,nk->n", waves, coefficients(theta, _N_WAVES))
        )

    def _moved(self, parameter: FloatArray, change: FloatArray) -> FloatArray:
        return np.asarray(parameter * np.exp(change) if self.factor else parameter + change)

    def start(self) -> dict[str, float]:
        """Return waves of zero."""
        return dict.fromkeys(wave_names(_N_WAVES), 0.0)

    def grid(self) -> dict[str, FloatArray]:
        """Return one wide amplitude, from which the waves are followed, and a few lengths."""
        lengths = np.asarray(self.length_scale.ppf((np.arange(_N_LENGTHS) + 0.5) / _N_LENGTHS))
        wide = float(self.amplitude.ppf(0.95))
        return {"amplitude": np.array([[0.0, 2 * wide]]), "length_scale": lengths}

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the amplitude and the length scale."""
        return {name: np.asarray(theta[name]) for name in ("amplitude", "length_scale")}

    def code(self) -> Code:
        """Return the cause as Python: its mean curve as a table."""
        low, high = self.ends or (0.0, 1.0)
        change = "np.interp({x}, {grid0}, {table0})"
        moved = f"np.exp({change})" if self.factor else change
        own = f"{{of}} * {moved}" if self.factor else f"{{of}} + {moved}"
        return Code(
            moved.replace("{x}", "{t}") if self.inside else own,
            columns={} if self.inside else {"x": self.over or ""},
            grids={"grid0": (low, high, _PLACES)},
            tables=self._tables,
            does="scales rate" if self.inside else "moves",
            of=self.parameter,
        )

    def _tables(self, theta: Rows, of_columns: Rows) -> dict[str, FloatArray]:
        """Return the mean change over the input."""
        grid = np.linspace(*(self.ends or (0.0, 1.0)), _PLACES)
        curves = coefficients(theta, _N_WAVES) @ hilbert.waves(self._scaled(grid), _N_WAVES).T
        return {"table0": np.mean(np.asarray(theta["amplitude"])[:, None] * curves, axis=0)}

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        by = (
            f"a factor of exp(+-{values['amplitude']:.3g})"
            if self.factor
            else (f"+-{values['amplitude']:.3g}")
        )
        return f"simulation with {self.parameter} wandering over {self.over} by {by}"


register(
    Form(
        "parameter-process",
        ParameterProcess,
        meaning="the parameter {target} wanders over the input instead of staying constant",
        least_distinct=8,
        like=("parameter-drift", "unexplained"),
        headline="{target} wanders, and the simulation keeps it constant",
        call="`ParameterProcess(p, over=x)`",
        formula="eta(p exp(amplitude c(x))), or eta(p + amplitude c(x))",
        priors="amplitude: half-normal, 0.7 or prior sd of p; length scale on [-1, 1]: "
        "log-uniform, 0.27 to 2",
        estimates="amplitude, length_scale",
        left_out="not compared unless passed",
    )
)
