"""The cause that a term is missing from the dynamics of an ODE, for all experiments or each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.context import period_nodes
from hybridsurrogate.effects.dynamics.dynamic import Dynamic
from hybridsurrogate.effects.expressions import Code, LevelTable
from hybridsurrogate.effects.over_column import OverExperiments
from hybridsurrogate.effects.registry import Form, needs, register
from hybridsurrogate.ode.dynamics import MissingTerm
from hybridsurrogate.priors import frozen
from hybridsurrogate.simulation.variables import MAX_LEVELS
from hybridsurrogate.types import Prior

# a level in the middle of the state's range leaves about a quarter of it above
_THRESHOLD_FACTOR = 4.0
# what formulas have instead: a power without its sign, a wave with an unknown phase
_SHOWN = {
    "seasonal": "{amplitude} * np.sin(2 * np.pi * {t} / {period} + {phase})",
    "power": "{rate} * {size} * ({state} / {size}) ** {exponent}",
    "saturating": "{rate} * {state} / ({half} + {state})",
}
# the term by form, and the units of its numbers
_CODE = {
    "constant": ("{rate}", {"rate": "{state} / {t}"}),
    "proportional": ("{rate} * {state}", {"rate": "1 / {t}"}),
    "seasonal": (
        "{sine} * np.sin({angle}) + {cosine} * np.cos({angle})",
        {"sine": "{state} / {t}", "cosine": "{state} / {t}", "period": "{t}"},
    ),
    "power": (
        "{rate} * np.copysign({size} * np.abs({state} / {size}) ** {exponent}, {state})",
        {"rate": "1 / {t}", "exponent": "1"},
    ),
    "saturating": (
        "{rate} * {state} / ({half} + np.abs({state}))",
        {"rate": "{state} / {t}", "half": "{state}"},
    ),
    "threshold": (
        "{rate} * np.maximum({state} - {level}, 0)",
        {"rate": "1 / {t}", "level": "{state}"},
    ),
    "product": ("{rate} * {state} * {other}", {"rate": "1 / ({other} {t})"}),
}


@dataclass(eq=False, repr=False)
class DynamicTerm(Dynamic):
    """A term missing from the slope of a state of an `OdeSimulator`.

    Parameters
    ----------
    state : str
    form : {"constant", "proportional", "seasonal", "power", "saturating", "threshold", "product"}
        What the term is, x being the state:

        - constant: ``rate``;
        - proportional: ``rate x``;
        - seasonal: a forcing from outside, ``sine sin(a) + cosine cos(a)`` with
          ``a = 2 pi (t - center) / period``;
        - power: ``rate size (|x| / size)^exponent`` with the sign of x: crowding, or the outflow
          of a tank;
        - saturating: ``rate x / (half + |x|)`` (Michaelis and Menten 1913);
        - threshold: ``rate max(x - level, 0)``: what flows over, or acts from a level on;
        - product: ``rate x`` times another state.
    prefix : str or None, default=None
        As in `DynamicDrift`.
    priors : dict of name to prior, optional
        Of the numbers below, where the defaults do not fit.
    center : float or None, default=None
        Time at which the seasonal forcing has phase zero. None: the middle of the measured rows.
    size : float or None, default=None
        Typical size of the state. None: as below.
    other : str or None, default=None
        The other state of a product.

    Notes
    -----
    Priors of the numbers by default, where the typical size of a state is its root mean square at
    the medians of the parameters' priors:

    - rate: Student-t with 3 degrees of freedom around zero. Its scale is one over the span of the
      measured times. Where the form is constant or saturating it is multiplied by the typical size
      of the state; for a product it is divided by that of the other state. So over the measured
      rows the state gains about as much as it contains, or much less or more. A threshold acts
      above the level only, and has four times that scale;
    - exponent: uniform from 1/4 to 3; half: log-uniform from a tenth to ten times the typical size;
      level: uniform from zero to twice that;
    - period: log-uniform between the shortest that the rows resolve and twice the span;
    - sine, cosine: Student-t with 3 degrees of freedom around zero, whose scale makes the state
      swing by half its typical size at the median period.

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
    about = "state"

    state: str
    form: str = "constant"
    prefix: str | None = None
    priors: Mapping[str, Prior] | None = None
    center: float | None = None
    size: float | None = None
    other: str | None = None

    @property
    def variant(self) -> str:
        """The form of the term, and the other state of a product."""
        return f"{self.form} with {self.other}" if self.other else self.form

    @property
    def name(self) -> str:
        """The kind, the state, and the form of the term."""
        return f"{self.kind}({self.state}, {self.variant})"

    @property
    def modification(self) -> MissingTerm:
        """The change of the right-hand side."""
        return MissingTerm(
            self.state, self.form, self.prefix, self.center or 0.0, self.size or 1.0, self.other
        )

    def prepare(self, context: Context) -> Cause:
        """Fill in the priors from the measured times and the size of the state."""
        size = self.size_of(context, self.state)
        size = size if self.size is None else self.size
        axis = context.axis(context.inputs[0])
        period = (self.priors or {}).get("period", axis.period_prior)
        swing = np.pi * size / float(period.median())
        rate = 1 / axis.span * (size if self.form in ("constant", "saturating") else 1.0)
        if self.form == "threshold":
            rate *= _THRESHOLD_FACTOR
        if self.other is not None:
            rate /= self.size_of(context, self.other)
        defaults = {
            "rate": frozen(stats.t, 3, scale=rate),
            "sine": frozen(stats.t, 3, scale=swing),
            "cosine": frozen(stats.t, 3, scale=swing),
            "period": period,
            "exponent": frozen(stats.uniform, loc=0.25, scale=2.75),
            "half": frozen(stats.loguniform, 0.1 * size, 10 * size),
            "level": frozen(stats.uniform, scale=2 * size),
        }
        center = axis.center if self.form == "seasonal" else 0.0
        center = center if self.center is None else self.center
        return self.completed(context, defaults, center=center, size=size)

    def grid(self) -> dict[str, FloatArray]:
        """Return periods evenly spaced in frequency; else quantiles of the further number."""
        if self.form != "seasonal":
            return super().grid()
        return {"period": period_nodes(self.parameters["period"])}

    def shown(self) -> Code:
        """Return the term, as it is where the state is positive."""
        code = self.code()
        expression = _SHOWN.get(self.form, code.expression)
        return replace(code, expression=expression, numbers={**code.numbers, "amplitude": "1"})

    def code(self) -> Code:
        """Return the cause as Python."""
        change = self.modification
        term, units = _CODE[self.form]
        states = {"state": self.state} if "{state}" in term else {}
        if self.other is not None:
            states["other"] = self.other
        constants = {"size": change.size} if self.form == "power" else {}
        angle = {"angle": "2 * np.pi * ({t} - {center}) / {period}"}
        seasonal = self.form == "seasonal"
        return Code(
            term,
            units,
            constants={"center": change.center} if seasonal else constants,
            steps=angle if seasonal else {},
            does="adds to slope",
            of=self.state,
            states=states,
        )


def _of_pairs(context: Context) -> Iterator[Cause]:
    return (
        DynamicTerm(state, "product", other=other)
        for state in context.states
        for other in context.states
        if other != state
    )


def _of_states(form: str) -> Callable[[Context], Iterator[Cause]]:
    return lambda context: (DynamicTerm(state, form) for state in context.states)


register(
    Form(
        "missing-term",
        DynamicTerm,
        _of_states("constant"),
        meaning="{target} gains or loses something that its equation leaves out",
        lacking=needs(
            lambda context: context.states,
            "inside the dynamics: needs an OdeSimulator and surrogate=ExactSurrogate()",
        ),
        headline="The equation of {target} misses a constant {rate:gain|loss} of {rate:size}",
    ),
    Form(
        "missing-term: proportional",
        DynamicTerm,
        _of_states("proportional"),
        headline=(
            "The equation of {target} misses a {rate:gain|loss} in proportion to it, {rate:size}"
        ),
    ),
    Form(
        "missing-term: seasonal",
        DynamicTerm,
        _of_states("seasonal"),
        meaning="something drives {target} up and down regularly, and its equation leaves that out",
        headline="The equation of {target} misses a drive with a period of {period}",
    ),
    Form(
        "missing-term: power",
        DynamicTerm,
        _of_states("power"),
        meaning=(
            "{target} gains or loses something that grows with a power of it, as by crowding, "
            "and its equation leaves that out"
        ),
        headline="The equation of {target} misses a {rate:gain|loss} by a power of it",
    ),
    Form(
        "missing-term: saturating",
        DynamicTerm,
        _of_states("saturating"),
        meaning=(
            "{target} gains or loses something in proportion to it as long as it is small, and "
            "a constant where it is large, and its equation leaves that out"
        ),
        headline="The equation of {target} misses a {rate:gain|loss} that saturates",
    ),
    Form(
        "missing-term: threshold",
        DynamicTerm,
        _of_states("threshold"),
        meaning=(
            "{target} gains or loses something where it is above a level, as by an overflow, "
            "and its equation leaves that out"
        ),
        headline="The equation of {target} misses a {rate:gain|loss} above a level of {level}",
    ),
    Form(
        "missing-term: product",
        DynamicTerm,
        _of_pairs,
        meaning=(
            "{target} gains or loses something where it meets another state, and its equation "
            "leaves that out"
        ),
        headline="The equation of {target} misses a {rate:gain|loss} where two states meet",
    ),
)


@dataclass(eq=False, repr=False)
class TermByExperiment(OverExperiments, Dynamic):
    """A term missing from an `OdeSimulator` with another rate in each experiment.

    As `DynamicTerm` of the form ``"proportional"``, ``rate x`` in the slope of the state x. Where
    the known rate constants of two assays differ, that of what is missing may differ as well. An
    experiment that was not measured has a rate of zero.

    Parameters
    ----------
    state : str
    column : str
        The measured column with the experiment of each row.
    prefix : str or None, default=None
        As in `DynamicDrift`.
    prior : frozen scipy.stats distribution or None, default=None
        Of each rate. None: as in `DynamicTerm`.
    levels : tuple of float, default=()
        Values of the column. Empty: those of the measured rows, or 0, 1, ... of labels.
    labels : tuple of str or None, default=None
        What to call them. None: as they are.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> loss = hs.TermByExperiment("b", "assay", prefix="loss", levels=(0.0, 1.0))
    >>> theta = {"rate, assay = 0": np.full(3, -0.2), "rate, assay = 1": np.full(3, -0.1)}
    >>> _, omega = loss.inputs({"assay": np.array([0.0, 1.0, 7.0])}, {}, theta)
    >>> omega["loss_rate"].tolist()
    [-0.2, -0.1, 0.0]
    """

    kind = "missing-term"
    about = "state"
    meaning = (
        "{target} gains or loses something in proportion to it, at another rate in each "
        "experiment, and its equation leaves that out"
    )

    state: str
    column: str
    prefix: str | None = None
    prior: Prior = None
    levels: tuple[float, ...] = ()
    labels: tuple[str, ...] | None = None

    @property
    def variant(self) -> str:
        """The form of the term, and what it differs by."""
        return f"proportional by {self.column}"

    @property
    def name(self) -> str:
        """The kind, the state, and the form of the term."""
        return f"{self.kind}({self.state}, {self.variant})"

    @property
    def modification(self) -> MissingTerm:
        """The change of the right-hand side, of one experiment."""
        return MissingTerm(self.state, "proportional", self.prefix)

    def prepare(self, context: Context) -> Cause:
        """Fill in the experiments and the prior of their rates."""
        term = DynamicTerm(self.state, "proportional", self.prefix).prepare(context)
        prior = self.prior or term.parameters["rate"]
        prefix = self.free_prefix(context)
        return self.filled(prefix=prefix, prior=prior, levels=self.levels_in(context))

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the priors of the rates."""
        return dict.fromkeys(self.names_of_levels, self.prior)

    @property
    def priors_of_change(self) -> Mapping[str, Prior]:
        """The prior of the rate of one experiment."""
        return {"rate": self.prior}

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Run the simulation with the rate of each row's experiment in its right-hand side."""
        rates = [theta[name] for name in self.names_of_levels]
        own = self.each_row(X, [*rates, np.zeros(len(X[self.column]))])
        return X, {**omega, self.modification.full("rate"): own}

    @property
    def names_of_levels(self) -> list[str]:
        """Names of the rates."""
        return [f"rate, {name}" for name in super().names_of_levels]

    def start(self) -> dict[str, float]:
        """Return rates of zero."""
        return dict.fromkeys(self.names_of_levels, 0.0)

    def code(self) -> Code:
        """Return the cause as Python."""
        levels = tuple(zip(self.levels, self.names_of_levels, strict=True))
        return Code(
            "{rate} * {state}",
            columns={"x": self.column},
            does="adds to slope",
            of=self.state,
            states={"state": self.state},
            table=LevelTable(self.column, levels, "1 / {t}"),
            by_row={"rate": "by_level({x}, {table})"},
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        rates = ", ".join(f"{values[name]:+.4g} ({name[6:]})" for name in self.names_of_levels)
        return f"simulation with a rate per experiment times {self.state} in its slope: {rates}"


def _of_states_by_experiment(context: Context) -> Iterator[Cause]:
    column = context.experiment
    # where no rate is known to differ, one that all experiments share comes first
    if column is None or not set(context.by_experiment) & set(context.rates):
        return
    # with more experiments a rate that they share predicts nearly as well
    if len(np.unique(context.X[column])) > MAX_LEVELS:
        return
    for state in context.states:
        yield TermByExperiment(state, column, labels=context.names.get(column))


register(
    Form(
        "missing-term: proportional by",
        TermByExperiment,
        _of_states_by_experiment,
        headline=(
            "The equation of {target} misses a term in proportion to it that "
            "differs between experiments"
        ),
    )
)
