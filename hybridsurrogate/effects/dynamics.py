"""Causes inside the dynamics of an ODE: a parameter that changes in time, a term left out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.dynamics import MissingTerm, Modification, TimeVaryingParameter
from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.notation import SIMULATION, minus, number, signed, where, word
from hybridsurrogate.priors import Prior, truncated_normal

_N_LOCATIONS, _N_WIDTHS = 20, 4
_NEEDS_ODE = (
    "{}: causes inside the dynamics need simulation=OdeSimulator(...), or runs of one, and "
    "surrogate=ExactSurrogate(): an emulator knows no right-hand side."
)


class _Dynamic(Cause):
    """A cause that modifies the right-hand side, and sets the numbers of the modification."""

    priors: Mapping[str, Prior] | None

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The priors of the modification's numbers."""
        return self.priors or {}

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Run the simulation with other numbers in its right-hand side."""
        change = self.modification
        assert change is not None
        return X, {**omega, **{change.full(name): theta[name] for name in change.neutral}}

    def start(self) -> dict[str, float]:
        """Return sizes of zero."""
        assert self.modification is not None
        return dict.fromkeys(self.modification.sizes, 0.0)

    def _free_prefix(self, context: Context, change: Modification) -> str:
        """Return a prefix that no number has which is a parameter already."""
        prefix, k = change.label, 1
        while any(name.startswith(f"{prefix}_") for name in context.parameters):
            k += 1
            prefix = f"{change.label}_{k}"
        return prefix


class DynamicDrift(_Dynamic):
    """A parameter that changes in time inside the dynamics of an `OdeSimulator`.

    In the right-hand side the parameter p becomes p (1 + amount s(t)), and the solution follows,
    where `ParameterDrift` runs the simulation anew for each row with a constant parameter.

    Parameters
    ----------
    parameter : str
        Or an assumed constant; the right-hand side must take it.
    shape : {"logistic", "step", "ramp", "periodic"}
        The course s(t), as in `hybridsurrogate.dynamics.TimeVaryingParameter`. A logistic course
        is nearly a step where its width is small, and nearly a line where it is large.
    column : str or None, default=None
        The time; None: the first input.
    prefix : str or None, default=None
        What the names of the numbers begin with in an extended simulator; only needed where one
        parameter has two changes of one shape.
    priors : dict of name to prior, optional
        Of the numbers below, where the defaults do not fit.
    center : float or None, default=None
        Time at which a periodic change has phase zero; None: the middle of the measured rows.

    Notes
    -----
    Priors of the numbers by default:

    - amount, the relative change: log(1 + amount) is normal with standard deviation 0.7, so that
      halving and doubling are ordinary, and p keeps its sign;
    - location: uniform over the measured times;
    - duration: log-uniform between two distances of neighbouring rows and half the span; width:
      the same, from half a distance on, as from 10 to 90 % a logistic course takes 4.4 widths;
    - period: log-uniform between the shortest that the rows resolve and twice the span;
    - sine, cosine, relative: normal(0, 0.35) cut to [-0.7, 0.7], so that p keeps its sign.

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

    def __init__(
        self,
        parameter: str,
        shape: str = "logistic",
        column: str | None = None,
        prefix: str | None = None,
        priors: Mapping[str, Prior] | None = None,
        center: float | None = None,
    ):
        self.parameter = parameter
        self.shape = shape
        self.column = column
        self.prefix = prefix
        self.priors = priors
        self.center = center

    @property
    def target(self) -> str:  # type: ignore[override]
        """The parameter concerned."""
        return self.parameter

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
        change = self.modification
        if not context.states:
            raise ValueError(_NEEDS_ODE.format(f"DynamicDrift({self.parameter!r})"))
        if self.parameter not in context.rates:
            raise ValueError(
                f"{self.parameter!r} is no parameter or assumed constant of the right-hand side; "
                f"these are: {list(context.rates)}."
            )
        time = context.inputs[0]
        if self.column not in (None, time):
            raise ValueError(f"The time of the simulation is {time!r}, not {self.column!r}.")
        distinct = np.unique(context.column(time))
        low, span = float(distinct[0]), float(np.ptp(distinct)) or 1.0
        spacing = span / max(len(distinct) - 1, 1)
        # a logistic course takes 4.4 widths from 10 to 90 %: as sudden as the shortest ramp
        shortest = min(2 * spacing, 0.25 * span)
        defaults = {
            "amount": stats.lognorm(0.7, loc=-1.0),
            "sine": truncated_normal(0.0, 0.35, -0.7, 0.7),
            "cosine": truncated_normal(0.0, 0.35, -0.7, 0.7),
            "location": stats.uniform(low, span),
            "width": stats.loguniform(0.25 * shortest, 0.5 * span),
            "duration": stats.loguniform(shortest, 0.5 * span),
            "period": stats.loguniform(2.0 * span / max(len(distinct) - 1, 3), 2.0 * span),
        }
        given = self.priors or {}
        unknown = sorted(given.keys() - change.neutral.keys())
        if unknown:
            raise ValueError(
                f"A {self.shape} change has no {unknown[0]!r}: {list(change.neutral)}."
            )
        return DynamicDrift(
            self.parameter,
            self.shape,
            time,
            self.prefix or self._free_prefix(context, change),
            {name: given.get(name, defaults[name]) for name in change.neutral},
            self.center if self.center is not None else low + span / 2,
        )

    def grid(self) -> dict[str, FloatArray]:
        """Return locations and widths, or periods evenly spaced in frequency."""
        share = (np.arange(_N_LOCATIONS) + 0.5) / _N_LOCATIONS
        nodes = {}
        for name, prior in self.parameters.items():
            if name == "location":
                nodes[name] = np.asarray(prior.ppf(share))
            elif name in ("width", "duration"):
                nodes[name] = np.asarray(prior.ppf((np.arange(_N_WIDTHS) + 0.5) / _N_WIDTHS))
            elif name == "period":
                low, high = prior.ppf([0.0, 1.0])
                # twice the high end is about four spans: five periods per independent frequency
                n = int(np.ceil(2.5 * high * (1 / low - 1 / high))) + 1
                nodes[name] = 1 / np.linspace(1 / low, 1 / high, max(n, 8))
        return nodes

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the relative change and when it happens, or period and relative amplitude."""
        if self.shape != "periodic":
            return dict(theta)
        amplitude = np.hypot(theta["sine"], theta["cosine"])
        return {"period": np.asarray(theta["period"]), "amplitude": amplitude}

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        if self.shape == "periodic":
            return (
                f"simulation with {self.parameter} swinging by {100 * values['amplitude']:.3g} % "
                f"with period {values['period']:.4g} in {self.column}"
            )
        verb = "falling" if values["amount"] < 0 else "rising"
        extra = [f"{k} {values[k]:.3g}" for k in values if k in ("width", "duration")]
        place = "from" if self.shape == "ramp" else "around"
        return (
            f"simulation with {self.parameter} {verb} by {100 * abs(values['amount']):.3g} % "
            f"{place} {self.column} = {values['location']:.4g} "
            f"({', '.join([self.shape, *extra])})"
        )

    def latex(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in LaTeX."""
        name, time = word(self.parameter), self.column or "time"
        if self.shape == "periodic":
            angle = rf"\frac{{2 \pi \, {word(time)}}}{{{number(values['period'])}}}"
            share = f"+ {number(values['amplitude'], 3)}"
            course = rf"\sin\left({angle} + \varphi\right)"
        else:
            distance = minus(time, values["location"], 4)
            share = signed(values["amount"], 3)
            course = where(time, r"\geq", values["location"], 4)
            if self.shape == "logistic":
                width = number(values["width"], 3)
                course = rf"\frac{{1}}{{1 + \exp\left(-{distance} / {width}\right)}}"
            elif self.shape == "ramp":
                duration = number(values["duration"], 3)
                course = rf"\min\left(1, \max\left(0, {distance} / {duration}\right)\right)"
        changed = rf"{name} \left(1 {share} \, {course}\right)"
        return rf"{SIMULATION}, \quad {name} \to {changed}"


class DynamicTerm(_Dynamic):
    """A term missing from the slope of a state of an `OdeSimulator`: rate, or rate times state.

    Parameters
    ----------
    state : str
    form : {"constant", "proportional"}
    prefix : str or None, default=None
        As in `DynamicDrift`.
    priors : dict of name to prior, optional
        Of the rate. By default Student-t with 3 degrees of freedom around zero, whose scale is one
        over the span of the measured times, times the typical size of the state (its root mean
        square at the medians of the priors) where the form is constant: over the measured rows the
        state gains about as much as it holds, or much less or more.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> tank = hs.OdeSimulator(
    ...     lambda t, state, rate: -rate * state, initial_state=[8.0],
    ...     observe=lambda state: state[0], inputs={"t": (0, 10)}, states="level",
    ...     parameters={"rate": hs.truncated_normal(0.5, 0.1, 0, 1)})
    >>> t = np.linspace(0.5, 10, 20)
    >>> y = 2 + 6 * np.exp(-0.5 * t) + 0.02 * np.cos(40 * t)  # one unit flows in all the time
    >>> model = hs.PowerScaledSurrogate(
    ...     tank, surrogate=hs.ExactSurrogate(), effects=[hs.DynamicTerm("level", "constant")],
    ...     n_draws=200, random_state=0).fit(t[:, None], y)
    >>> float(model.posterior_.estimates(0)["rate"].mean().round(1))
    1.0
    """

    kind = "missing-term"

    def __init__(
        self,
        state: str,
        form: str = "constant",
        prefix: str | None = None,
        priors: Mapping[str, Prior] | None = None,
    ):
        self.state = state
        self.form = form
        self.prefix = prefix
        self.priors = priors

    @property
    def target(self) -> str:  # type: ignore[override]
        """The state concerned."""
        return self.state

    @property
    def variant(self) -> str:
        """Whether the term is constant or proportional to the state."""
        return self.form

    @property
    def name(self) -> str:
        """The kind, the state, and the form of the term."""
        return f"{self.kind}({self.state}, {self.form})"

    @property
    def modification(self) -> MissingTerm:
        """The change of the right-hand side."""
        return MissingTerm(self.state, self.form, self.prefix)

    def prepare(self, context: Context) -> Cause:
        """Fill in the prior of the rate from the measured times and the size of the state."""
        change = self.modification
        if not context.states:
            raise ValueError(_NEEDS_ODE.format(f"DynamicTerm({self.state!r})"))
        if self.state not in context.states:
            raise ValueError(
                f"There is no state {self.state!r}; the states are {list(context.states)}."
            )
        scale = 1 / (float(np.ptp(context.column(context.inputs[0]))) or 1.0)
        if self.form == "constant":
            scale *= context.states[self.state]
        return DynamicTerm(
            self.state,
            self.form,
            self.prefix or self._free_prefix(context, change),
            self.priors or {"rate": stats.t(3, scale=scale)},
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        term = f"{values['rate']:+.4g}" + ("" if self.form == "constant" else f" {self.state}")
        return f"simulation with {term} in the slope of {self.state}"

    def latex(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in LaTeX."""
        state = word(self.state)
        term = signed(values["rate"]) + ("" if self.form == "constant" else rf" \, {state}")
        slope = rf"\frac{{d}}{{dt}} {state}"
        return rf"{SIMULATION}, \quad {slope} \to {slope} {term}"
