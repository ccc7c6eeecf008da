"""A parameter that does not stay constant."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy import special, stats

from hybridsurrogate.arguments import check_choice
from hybridsurrogate.effects.base import (
    Cause,
    Context,
    Declared,
    FloatArray,
    Rows,
    of_wave,
    quantiles,
)
from hybridsurrogate.effects.context import (
    LONGEST_PERIOD,
    MAX_TRIED_ROWS,
    UNKNOWN,
    Axis,
    period_nodes,
)
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.likelihoods.base import MAX_ETA
from hybridsurrogate.priors import frozen, prior_sd
from hybridsurrogate.types import Prior

# the simulation runs at every period that is tried
_MAX_CYCLES = 25


class _Shape(NamedTuple):
    """One way to drift: its sizes, zero where nothing drifts, and the shift they bring about.

    Of one that multiplies, that of the parameter's logarithm.
    """

    sizes: tuple[str, ...]
    shift: Callable[[FloatArray, Rows], FloatArray]
    code: str
    units: Mapping[str, str]
    multiplies: bool = False


def _periodic(x: FloatArray, theta: Rows) -> FloatArray:
    phase = 2 * np.pi * x / theta["period"]
    return theta["sine"] * np.sin(phase) + theta["cosine"] * np.cos(phase)


_SHAPES = {
    "linear": _Shape(
        ("slope",),
        lambda x, theta: theta["slope"] * x,
        "{slope} * ({x} - {center})",
        {"slope": "{of} / {x}"},
    ),
    "exponential": _Shape(
        ("rate",),
        lambda x, theta: np.clip(theta["rate"] * x, -MAX_ETA, MAX_ETA),
        "np.exp({rate} * ({x} - {center}))",
        {"rate": "1 / {x}"},
        multiplies=True,
    ),
    "step": _Shape(
        ("change",),
        lambda x, theta: np.where(x >= theta["location"], theta["change"], 0.0),
        "{change} * ({x} >= {location})",
        {"change": "{of}", "location": "{x}"},
    ),
    "logistic": _Shape(
        ("change",),
        lambda x, t: t["change"] * special.expit((x - t["location"]) / t["width"]),
        "{change} * logistic(({x} - {location}) / {width})",
        {"change": "{of}", "location": "{x}", "width": "{x}"},
    ),
    "periodic": _Shape(
        ("sine", "cosine"),
        _periodic,
        "{sine} * np.sin({angle}) + {cosine} * np.cos({angle})",
        {"sine": "{of}", "cosine": "{of}", "period": "{x}"},
    ),
}


@dataclass(eq=False, repr=False)
class ParameterDrift(Declared):
    """A parameter that changes over a column instead of staying constant.

    The simulation is run with ``parameter + shift(x)``:

    - ``shape="linear"``: ``slope (x - center)``;
    - ``shape="exponential"``: it is ``parameter exp(rate (x - center))``, which never changes sign,
      as rates over the temperature (Arrhenius 1889, Zeitschrift für physikalische Chemie 4:226);
    - ``shape="step"``: ``change`` from x = location on;
    - ``shape="logistic"``: ``change / (1 + exp(-(x - location) / width))``;
    - ``shape="periodic"``: ``amplitude sin(2 pi (x - center) / period + phase)``.

    Change and amplitude are in units of the parameter, the slope in those per unit of the column,
    the rate per unit of the column, location, width and period in those of the column. Sizes have a
    Cauchy prior (Student-t with one degree of freedom): over the measured rows the parameter
    changes by about its prior's standard deviation, or by much less or more. The location is
    uniform over the measured rows. The width is log-uniform from half the distance of neighbouring
    rows (at most a twentieth of the span) to a quarter of the span. The period is log-uniform from
    four distances of neighbouring rows (at least a 25th of the span) to twice their span.

    Parameters
    ----------
    parameter : str
        A parameter of the simulation.
    column : str
        Any measured column.
    shape : {"linear", "exponential", "step", "logistic", "periodic"}, default="linear"
    slope : frozen scipy.stats distribution or None, default=None
        Prior of the slope, or of whatever the size of the shape is.
    center : float or None, default=None
        Where a linear or exponential drift leaves the parameter as it is. None: the middle of the
        measured rows.
    others : dict of name to frozen scipy.stats distribution, or None, default=None
        Priors of location, width or period. None: as above, from the measured rows.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Raises
    ------
    ValueError
        When prepared for a name that is no parameter, a shape that is none, or for an exponential
        drift of a parameter whose prior has both signs.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> drift = hs.ParameterDrift("rate", "t", center=1.0)
    >>> _, omega = drift.inputs({"t": np.array([0.0, 3.0])}, {"rate": 5.0}, {"slope": 0.5})
    >>> omega["rate"].tolist()
    [4.5, 6.0]
    """

    kind = "parameter-drift"
    about = "parameter"

    parameter: str
    column: str
    shape: str = "linear"
    slope: Prior | None = None
    center: float | None = None
    others: Mapping[str, Prior] | None = None
    axis: Axis = UNKNOWN

    @property
    def reads(self) -> tuple[str, ...]:
        """The column over which the parameter drifts."""
        return (self.column,)

    @property
    def variant(self) -> str:
        """The shape, and over which column."""
        return f"{self.shape} over {self.column}"

    @property
    def name(self) -> str:
        """The kind, the parameter and the column over which it drifts."""
        shape = "" if self.shape == "linear" else f", {self.shape}"
        return f"{self.kind}({self.parameter} over {self.column}{shape})"

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the priors of the sizes, and of where or how fast."""
        return {**dict.fromkeys(_SHAPES[self.shape].sizes, self.slope), **(self.others or {})}

    def prepare(self, context: Context) -> Cause:
        """Fill in the pivot and the priors."""
        prior = context.parameter(self.parameter)
        check_choice(self.shape, "shape", list(_SHAPES))
        if _SHAPES[self.shape].multiplies and prior.support()[0] < 0 < prior.support()[1]:
            raise ValueError(
                f"shape={self.shape!r} multiplies {self.parameter!r}, whose prior has values of "
                "both signs: use shape='linear', or a prior of one sign."
            )
        axis = context.axis(self.column)
        span, spacing, location = axis.span, axis.spacing, axis.location_prior
        size = prior_sd(prior)
        if self.shape in ("linear", "exponential"):
            size /= span
        if _SHAPES[self.shape].multiplies:
            size /= abs(float(prior.ppf(0.5)))
        shortest = float(np.clip(4 * spacing, span / _MAX_CYCLES, span))
        defaults: dict[str, dict[str, Prior]] = {
            "linear": {},
            "exponential": {},
            "step": {"location": location},
            "logistic": {
                "location": location,
                "width": frozen(stats.loguniform, 0.5 * min(spacing, 0.1 * span), 0.25 * span),
            },
            "periodic": {"period": frozen(stats.loguniform, shortest, LONGEST_PERIOD * span)},
        }
        return self.filled(
            slope=frozen(stats.t, 1, scale=size) if self.slope is None else self.slope,
            others={**defaults[self.shape], **(self.others or {})},
            axis=self.axis if self.axis.is_known else axis,
        )

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Shift or multiply the parameter, row by row."""
        # places are where they are; slopes and phases are counted from the middle
        x = X[self.column] - (0.0 if "location" in theta else self.pivot)
        shape, value = _SHAPES[self.shape], omega[self.parameter]
        shift = shape.shift(x, theta)
        moved = value * np.exp(shift) if shape.multiplies else value + shift
        return X, {**omega, self.parameter: moved}

    def start(self) -> dict[str, float]:
        """Return sizes of zero."""
        return dict.fromkeys(_SHAPES[self.shape].sizes, 0.0)

    def grid(self) -> dict[str, FloatArray]:
        """Return gaps or locations, locations and widths, or periods evenly spaced in frequency.

        The simulation runs at every node, so there are fewer than for a curve that is added.
        """
        others = self.others or {}
        if self.shape == "step" and len(self.axis.rows) <= MAX_TRIED_ROWS:
            return {"location": self.axis.gaps(others["location"])}
        shares = {"location": 24 if self.shape == "step" else 16, "width": 4}
        nodes = {
            name: quantiles(prior, shares[name]) for name, prior in others.items() if name in shares
        }
        if "period" in others:
            nodes["period"] = period_nodes(others["period"], 4, self.axis.span)
        return nodes

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return size and place; of a periodic drift amplitude and period."""
        return of_wave(theta)

    def shown(self) -> Code:
        """Return the expression, of a wave with its amplitude and an unknown phase."""
        if self.shape != "periodic":
            return self.code()
        wave = "{of} + {amplitude} * np.sin(2 * np.pi * {x} / {period} + {phase})"
        return replace(self.code(), expression=wave, numbers={"amplitude": "{of}", "period": "{x}"})

    @property
    def extents(self) -> Mapping[str, float]:
        """How far the measured rows reach along the column."""
        return {self.column: self.axis.span}

    @property
    def pivot(self) -> float:
        """Where a steady drift leaves the parameter as it is, and a wave has phase zero."""
        return self.axis.center if self.center is None else self.center

    def code(self) -> Code:
        """Return the cause as Python."""
        shape = _SHAPES[self.shape]
        located = "location" in shape.units
        angle = {"angle": "2 * np.pi * ({x} - {center}) / {period}"}
        return Code(
            f"{{of}} {'*' if shape.multiplies else '+'} {shape.code}",
            shape.units,
            {"x": self.column},
            {} if located else {"center": self.pivot},
            steps=angle if self.shape == "periodic" else {},
            does="moves",
            of=self.parameter,
        )


def _over_inputs(shape: str) -> Callable[[Context], Iterator[Cause]]:
    def propose(context: Context) -> Iterator[Cause]:
        for column in context.inputs:
            # a rate that changes in time does so inside the dynamics, and a start is of one moment
            inside = (*context.rates, *context.starts) if column == context.inputs[0] else ()
            for parameter in context.parameters:
                if parameter not in inside:
                    yield ParameterDrift(parameter, column, shape)

    return propose


def _over_extras(context: Context) -> list[Cause]:
    pairs = product(context.extras, context.parameters)
    return [ParameterDrift(parameter, column) for column, parameter in pairs]


def _lacking(context: Context) -> Iterator[tuple[str | None, str]]:
    if not context.parameters:
        yield None, "the simulation has no parameters"
    for parameter in context.starts:
        yield parameter, f"over {context.inputs[0]}: it sets the initial state and nothing else"
    if context.parameters and not context.extras:
        yield None, "over extras: no measured column apart from the inputs"


register(
    Form(
        "parameter-drift",
        ParameterDrift,
        _over_inputs("linear"),
        meaning="the parameter {target} changes over {column} instead of staying constant",
        least_distinct=3,
        lacking=_lacking,
        headline="{target} changes over {column}, and the simulation keeps it constant",
    ),
    Form(
        "parameter-drift: exponential",
        ParameterDrift,
        # of parameters that are never negative
        lambda context: (
            drift.filled(shape="exponential")
            for drift in (*_over_inputs("linear")(context), *_over_extras(context))
            if context.parameters[str(drift.target)].support()[0] >= 0
        ),
        least_distinct=3,
    ),
)
register(
    Form(
        "parameter-drift: step",
        ParameterDrift,
        _over_inputs("step"),
        least_distinct=6,
        headline=(
            "{target} {change:rises|falls} by {change:size} at {column} = "
            "{location}, and the simulation keeps it constant"
        ),
    ),
    Form("parameter-drift: logistic", ParameterDrift, _over_inputs("logistic"), least_distinct=8),
    Form(
        "parameter-drift: periodic",
        ParameterDrift,
        _over_inputs("periodic"),
        least_distinct=8,
        headline=(
            "{target} goes up and down with a period of {period}, and the "
            "simulation keeps it constant"
        ),
    ),
    Form("parameter-drift: over extras", ParameterDrift, _over_extras),
)
