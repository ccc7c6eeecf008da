"""The cause that a parameter changes in time, inside the dynamics of an ODE."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import USUAL_CHANGE, Cause, Context, FloatArray, quantiles
from hybridsurrogate.effects.context import period_nodes
from hybridsurrogate.effects.dynamics.dynamic import NEEDS_ODE, Dynamic
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.ode.dynamics import TimeVaryingParameter
from hybridsurrogate.priors import frozen, prior_sd, truncated_normal
from hybridsurrogate.types import Prior

_NODES = {"location": 20, "width": 4, "duration": 4}
# of what is known to a per cent halving and doubling are not ordinary: in units of its prior
_CHANGE_PER_DOUBT = 3.0

# what formulas have instead: a step in the dynamics is as steep as the solver resolves
_SHOWN = {
    "step": "1 + {amount} * ({t} >= {location})",
    "periodic": "1 + {amplitude} * np.sin(2 * np.pi * {t} / {period} + {phase})",
}
# the factor on the parameter by shape, and the units of its numbers
_CODE = {
    "step": (
        "1 + {amount} / 2 * (1 + np.tanh(({t} - {location}) / {step}))",
        {"amount": "1", "location": "{t}"},
    ),
    "ramp": (
        "1 + {amount} * np.minimum(np.maximum(({t} - {location}) / {duration}, 0), 1)",
        {"amount": "1", "location": "{t}", "duration": "{t}"},
    ),
    "logistic": (
        "1 + {amount} * logistic(({t} - {location}) / {width})",
        {"amount": "1", "location": "{t}", "width": "{t}"},
    ),
    "exponential": ("np.exp({rate} * ({t} - {center}))", {"rate": "1 / {t}"}),
    "periodic": (
        "1 + {sine} * np.sin({angle}) + {cosine} * np.cos({angle})",
        {"sine": "1", "cosine": "1", "period": "{t}"},
    ),
}


@dataclass(eq=False, repr=False)
class DynamicDrift(Dynamic):
    """A parameter that changes in time inside the dynamics of an `OdeSimulator`.

    In the right-hand side the parameter p becomes p (1 + amount s(t)), and the solution follows.
    `ParameterDrift`, in contrast, runs the simulation for each row with a constant parameter.

    Parameters
    ----------
    parameter : str
        Or an assumed constant; the right-hand side must take it.
    shape : {"logistic", "step", "ramp", "exponential", "periodic"}
        The course s(t), as in `hybridsurrogate.ode.dynamics.TimeVaryingParameter`. A logistic
        course is nearly a step where its width is small, and nearly a line where it is large.
    column : str or None, default=None
        The time; None: the first input.
    prefix : str or None, default=None
        What the names of the numbers begin with in an extended simulator; only needed where one
        parameter has two changes of one shape.
    priors : dict of name to prior, optional
        Of the numbers below, where the defaults do not fit.
    center : float or None, default=None
        Time at which a periodic change has phase zero, and an exponential one has p itself. None:
        the middle of the measured rows for the former, the first of them for the latter.

    Notes
    -----
    Priors of the numbers by default:

    - amount, the relative change: log(1 + amount) is normal with standard deviation s = 0.7, so
      that halving and doubling are ordinary, and p keeps its sign. What is known well is not
      expected to change much: s is at most three times the relative standard deviation of p's
      prior;
    - rate of an exponential change: Student-t with 3 degrees of freedom, whose scale is s over the
      span;
    - location: uniform over the measured times;
    - duration: log-uniform between two distances of neighbouring rows and half the span; width:
      the same, from half a distance on, as from 10 to 90 % a logistic course takes 4.4 widths;
    - period: log-uniform between the shortest that the rows resolve and twice the span;
    - sine, cosine, relative: normal(0, s / 2) cut to [-s, s], so that p keeps its sign.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> decay = hs.OdeSimulator(
    ...     lambda t, state, rate: -rate * state, initial_state=[8.0],
    ...     observe=lambda state: state[0], inputs={"t": (0, 10)}, states="n",
    ...     parameters={"rate": hs.truncated_normal(0.5, 0.2, 0, 2)})
    >>> t = np.linspace(0.5, 10, 20)
    >>> y = 8 * np.exp(-0.4 * np.minimum(t, 5)) * (1 + 0.02 * np.cos(40 * t))
    >>> model = hs.PowerScaledSurrogate(
    ...     decay, surrogate=hs.ExactSurrogate(), likelihood="lognormal",
    ...     effects=[hs.DynamicDrift("rate", "step")], n_draws=200, random_state=0)
    >>> model = model.fit(t[:, None], y)
    >>> float(model.posterior_.estimates(0)["amount"].mean().round(1))  # the decay stops
    -1.0
    """

    kind = "parameter-drift"
    about = "parameter"

    parameter: str
    shape: str = "logistic"
    column: str | None = None
    prefix: str | None = None
    priors: Mapping[str, Prior] | None = None
    center: float | None = None

    @property
    def variant(self) -> str:
        """The course, and that it is one inside the dynamics."""
        return f"{self.shape} inside the dynamics"

    @property
    def name(self) -> str:
        """The kind, the parameter, and its course in time."""
        return f"{self.kind}({self.parameter} in the dynamics, {self.shape} over {self.column})"

    @property
    def modification(self) -> TimeVaryingParameter:
        """The change of the right-hand side."""
        return TimeVaryingParameter(self.parameter, self.shape, self.prefix, self.center or 0.0)

    def prepare(self, context: Context) -> Cause:
        """Fill in the priors from the measured times."""
        if not context.states:
            raise ValueError(NEEDS_ODE.format(f"DynamicDrift({self.parameter!r})"))
        if self.parameter not in context.rates:
            raise ValueError(
                f"{self.parameter!r} is no parameter or assumed constant of the right-hand side; "
                f"these are: {list(context.rates)}."
            )
        time = context.inputs[0]
        if self.column not in (None, time):
            raise ValueError(f"The time of the simulation is {time!r}, not {self.column!r}.")
        axis = context.axis(time)
        span, spacing = axis.span, axis.spacing
        # a logistic course takes 4.4 widths from 10 to 90 %: as sudden as the shortest ramp
        shortest = min(2 * spacing, 0.25 * span)
        size = _ordinary_change(context, self.parameter)
        defaults = {
            "amount": frozen(stats.lognorm, size, loc=-1.0),
            "rate": frozen(stats.t, 3, scale=size / span),
            "sine": truncated_normal(0.0, size / 2, -size, size),
            "cosine": truncated_normal(0.0, size / 2, -size, size),
            "location": axis.location_prior,
            "width": frozen(stats.loguniform, 0.25 * shortest, 0.5 * span),
            "duration": frozen(stats.loguniform, shortest, 0.5 * span),
            "period": axis.period_prior,
        }
        center = axis.origin + span / 2 * (self.shape == "periodic")
        center = center if self.center is None else self.center
        return self.completed(context, defaults, column=time, center=center)

    def grid(self) -> dict[str, FloatArray]:
        """Return locations and widths, or periods evenly spaced in frequency."""
        priors = self.parameters
        nodes = {name: quantiles(priors[name], n) for name, n in _NODES.items() if name in priors}
        return nodes | ({"period": period_nodes(priors["period"])} if "period" in priors else {})

    def shown(self) -> Code:
        """Return the factor on the parameter; of a wave with an unknown phase."""
        code = self.code()
        return replace(
            code,
            expression=_SHOWN.get(self.shape, code.expression),
            numbers={**code.numbers, "amplitude": "1"},
            columns={"t": self.column or "time"},
        )

    @property
    def extents(self) -> Mapping[str, float]:
        """How uncertain the place of a change is before it is fitted."""
        prior = self.parameters.get("location")
        return {} if prior is None else {self.column or "time": prior_sd(prior)}

    def code(self) -> Code:
        """Return the cause as Python."""
        course, units = _CODE[self.shape]
        centred = self.shape in ("exponential", "periodic")
        return Code(
            course,
            units,
            constants={"center": self.modification.center} if centred else {},
            steps={"angle": "2 * np.pi * ({t} - {center}) / {period}"} if "period" in units else {},
            does="scales rate",
            of=self.parameter,
        )


def _ordinary_change(context: Context, name: str) -> float:
    """Return the standard deviation of log p by which a parameter or constant p may change."""
    prior = context.parameters.get(name) or context.assumed[name].prior
    low, middle, high = prior.ppf([0.16, 0.5, 0.84])
    relative = (high - low) / 2 / abs(middle) if middle else np.inf
    return float(min(USUAL_CHANGE, _CHANGE_PER_DOUBT * relative))


def _inside(shape: str) -> Callable[[Context], Iterator[Cause]]:
    # a step is a steep logistic course, a ramp is within a twentieth of one
    return lambda context: (DynamicDrift(rate, shape) for rate in context.rates)


register(
    Form("parameter-drift: inside", DynamicDrift, _inside("logistic")),
    Form("parameter-drift: inside, ramp", DynamicDrift),
    Form("parameter-drift: inside, exponential", DynamicDrift, _inside("exponential")),
    Form("parameter-drift: inside, periodic", DynamicDrift, _inside("periodic")),
)
