"""Causes inside the right-hand side of an ODE: what they share, a delay, an unseen store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Rows, of_wave
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.ode.dynamics import CoupledStore, DelayedState
from hybridsurrogate.priors import frozen
from hybridsurrogate.simulation.modification import Modification
from hybridsurrogate.types import Prior

NEEDS_ODE = (
    "{}: causes inside the dynamics need simulation=OdeSimulator(...), or runs of one, and "
    "surrogate=ExactSurrogate(): an emulator has no right-hand side."
)


class Dynamic(Declared):
    """A cause that modifies the right-hand side, and sets the numbers of the modification."""

    prefix: str | None = None
    priors: Mapping[str, Prior] | None = None

    @property
    def modification(self) -> Modification:
        """The change of the right-hand side."""
        raise NotImplementedError(f"{type(self).__name__} lacks the property modification.")

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the priors of the modification's numbers."""
        return self.priors or {}

    @property
    def priors_of_change(self) -> Mapping[str, Prior]:
        """The priors of the modification's numbers, by name, without a prefix."""
        return self.parameters

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Run the simulation with other numbers in its right-hand side."""
        change = self.modification
        return X, {**omega, **{change.full(name): theta[name] for name in change.neutral}}

    def start(self) -> dict[str, float]:
        """Return sizes of zero."""
        return dict.fromkeys(self.modification.sizes, 0.0)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the numbers, of a wave its period and amplitude."""
        return of_wave(theta)

    def free_prefix(self, context: Context) -> str:
        """Return the prefix that was given, or one that no number has which is a parameter."""
        label, k = self.modification.label, 1
        prefix = self.prefix or label
        while self.prefix is None and any(p.startswith(f"{prefix}_") for p in context.parameters):
            k += 1
            prefix = f"{label}_{k}"
        return prefix

    def completed(self, context: Context, defaults: Mapping[str, Prior], **further: Any) -> Self:
        """Return the cause with a prefix, and the priors of all numbers: given, or the defaults."""
        change = self.modification
        given = self.priors or {}
        unknown = sorted(given.keys() - change.neutral.keys())
        if unknown:
            raise ValueError(
                f"{type(self).__name__} ({self.variant}) has no {unknown[0]!r}: "
                f"{list(change.neutral)}.{did_you_mean(unknown[0], change.neutral)}"
            )
        priors = {name: given.get(name, defaults[name]) for name in change.neutral}
        return self.filled(prefix=self.free_prefix(context), priors=priors, **further)

    def size_of(self, context: Context, state: str) -> float:
        """Return the typical size of a state, or raise ValueError where there is none.

        That of the simulation, in so far as measured outputs are as large as simulated ones: what
        grows without the crowding that it lacks is simulated many times too large.
        """
        if not context.states:
            raise ValueError(NEEDS_ODE.format(f"{type(self).__name__}({state!r})"))
        if state not in context.states:
            raise ValueError(
                f"There is no state {state!r}; the states are {list(context.states)}."
                f"{did_you_mean(state, context.states)}"
            )
        return context.states[state] * context.ratio


@dataclass(eq=False, repr=False)
class DynamicDelay(Dynamic):
    """A right-hand side that follows a state as it was a lag ago: a delay differential equation.

    Where `Delay` shifts the output as a whole, here a rate answers late, so that growth overshoots
    and a regulation oscillates. Before the start the state is what it is there. It needs an
    `OdeSimulator` with ``method="rk4"``.

    Parameters
    ----------
    state : str
    prefix : str or None, default=None
        As in `DynamicDrift`.
    priors : dict of name to prior, optional
        Of the lag. By default half-Cauchy, its scale a tenth of the span of the measured times:
        most lags are short, none is ruled out.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> growth = hs.OdeSimulator(
    ...     lambda t, state, rate: rate * state * (1 - state), initial_state=[0.1],
    ...     observe=lambda state: state[0], inputs={"t": (0, 20)}, states="n",
    ...     parameters={"rate": hs.truncated_normal(0.6, 0.2, 0, 2)})
    >>> from hybridsurrogate.ode.dynamics import DelayedState
    >>> t = np.linspace(0.5, 20, 40)
    >>> y = growth.modified([DelayedState("n")])(t, np.tile([0.7, 2.0], (40, 1)))
    >>> model = hs.PowerScaledSurrogate(
    ...     growth, surrogate=hs.ExactSurrogate(), effects=[hs.DynamicDelay("n")],
    ...     n_draws=200, random_state=0).fit(t[:, None], y + 0.01 * np.cos(40 * t))
    >>> float(model.posterior_.estimates(0)["lag"].mean().round(1))
    2.0
    """

    kind = "delay"
    about = "state"
    variant = "inside the dynamics"

    state: str
    prefix: str | None = None
    priors: Mapping[str, Prior] | None = None

    @property
    def name(self) -> str:
        """The kind, and the state in the dynamics."""
        return f"{self.kind}({self.state} in the dynamics)"

    @property
    def modification(self) -> DelayedState:
        """The change of the right-hand side."""
        return DelayedState(self.state, self.prefix)

    def prepare(self, context: Context) -> Cause:
        """Fill in the prior of the lag from the measured times."""
        self.size_of(context, self.state)
        span = context.axis(context.inputs[0]).span
        return self.completed(context, {"lag": frozen(stats.halfcauchy, scale=span / 10)})

    def start(self) -> dict[str, float]:
        """Return nothing: at a lag of zero the prior ends, so lags are enumerated."""
        return {}

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code("{lag}", {"lag": "{t}"}, does="delays", of=self.state)

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return f"simulation whose slopes follow {self.state} as it was {values['lag']:.4g} earlier"


register(
    Form(
        "delay: inside",
        DynamicDelay,
        lambda context: map(DynamicDelay, context.states),
        meaning="the effects of {target} come later than in the equations",
        headline="What {target} does comes {lag} later than the equations have it",
    )
)


@dataclass(eq=False, repr=False)
class DynamicStore(Dynamic):
    """A state that the equations lack, which exchanges with one of theirs.

    ``dx/dt = ... - k (x - z)`` and ``dz/dt = k / ratio (x - z)``, z being the unseen state: the
    wall of a heated box, the tissue of pharmacokinetics (Gibaldi and Perrier 1982,
    Pharmacokinetics, chapter 2). The ratio is the store's size in shares of the state's. Alone the
    two come together as ``exp(-t / scale)``, so that ``k = ratio / (scale (1 + ratio))``. At the
    start z is x plus a gap. It needs an `OdeSimulator`; for other simulations `SecondStore` and
    `Decay` are the second exponential of a store that empties.

    With ``through`` the store is in series: a term g of the slope acts on the store instead of the
    state, ``dx/dt = ... - g(x) - k (x - z)`` and ``dz/dt = (k (x - z) + g(z)) / ratio``. A box
    loses its heat through the wall (Bacher and Madsen 2011, Energy and Buildings 43, 1511 to 1522,
    the models with an envelope), a drug is broken down in the tissue.

    Parameters
    ----------
    state : str
    prefix : str or None, default=None
        As in `DynamicDrift`.
    priors : dict of name to prior, optional
        Of the numbers below, where the defaults do not fit.
    through : str or None, default=None
        The parameter, or assumed constant, that multiplies or divides the term: one of several in
        the slope, which falls as the state grows. None: no term is moved.
    divides : bool or None, default=None
        Whether that parameter divides the term; None: `prepare` finds out.

    Raises
    ------
    ValueError
        By `prepare`, where there is no such state or term.

    Notes
    -----
    Priors of the numbers by default:

    - ratio: log-normal, 95 % of it between a twentieth and twenty: a much smaller store does
      nothing, a much larger one is a constant, which `DynamicTerm` has;
    - scale: log-uniform, from a quarter of the distance of neighbouring rows, or half a step of
      "rk4", to their span: what a driven state does at once is seen of a faster exchange, and of
      a slower one no more than a constant;
    - gap: Student-t with 3 degrees of freedom around zero, its scale the typical size of the state,
      so that a store at rest and an empty one are both ordinary.

    Where nothing drives the state it follows two exponentials, from which rate, ratio, scale and
    gap cannot all be inferred: give the prior of what is known, as below of an empty store.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from scipy.stats import norm
    >>> drug = hs.OdeSimulator(
    ...     lambda t, state, rate: -rate * state, initial_state=[8.0],
    ...     observe=lambda state: state[0], inputs={"t": (0, 10)}, states="blood",
    ...     parameters={"rate": hs.truncated_normal(0.5, 0.1, 0, 1)})
    >>> from hybridsurrogate.ode.dynamics import CoupledStore
    >>> t = np.linspace(0.5, 10, 20)
    >>> y = drug.modified([CoupledStore("blood")])(t, np.tile([0.5, 1.5, 1.0, -8.0], (20, 1)))
    >>> tissue = hs.DynamicStore("blood", priors={"gap": norm(-8, 0.1)})
    >>> model = hs.PowerScaledSurrogate(
    ...     drug, surrogate=hs.ExactSurrogate(), effects=[tissue], n_draws=200, random_state=0)
    >>> model = model.fit(t[:, None], y + 0.01 * np.cos(40 * t))
    >>> float(model.posterior_.estimates(0)["ratio"].mean().round(1))
    1.5

    A box that is heated, and loses heat through its wall:

    >>> box = hs.OdeSimulator(
    ...     lambda t, state, loss: np.sin(t) ** 2 - loss * state, initial_state=[8.0],
    ...     observe=lambda state: state[0], inputs={"t": (0, 10)}, states="air",
    ...     parameters={"loss": hs.truncated_normal(0.5, 0.1, 0, 1)})
    >>> box.terms
    {'air': {'loss': False}}
    >>> hs.DynamicStore("air", through="loss").name
    'second-store(air, in series with loss)'
    """

    kind = "second-store"
    about = "state"

    state: str
    prefix: str | None = None
    priors: Mapping[str, Prior] | None = None
    through: str | None = None
    divides: bool | None = None

    @property
    def variant(self) -> str:
        """Whether a term acts on the store, and which."""
        return f"in series with {self.through}" if self.through else "inside the dynamics"

    @property
    def name(self) -> str:
        """The kind and the state, and what acts on the store."""
        return f"{self.kind}({self.state}{f', {self.variant}' if self.through else ''})"

    @property
    def modification(self) -> CoupledStore:
        """The change of the right-hand side."""
        return CoupledStore(self.state, self.prefix, self.through, bool(self.divides))

    def prepare(self, context: Context) -> Cause:
        """Fill in the priors from the measured times and the size of the state."""
        size, axis = self.size_of(context, self.state), context.axis(context.inputs[0])
        terms, divides = context.terms.get(self.state, {}), self.divides
        if self.through is not None and divides is None:
            if self.through not in terms:
                cure = f"give one of {list(terms)}" if terms else "leave through out"
                raise ValueError(
                    f"{self.through!r} multiplies or divides no single term of the slope of "
                    f"{self.state!r} that falls as it grows: {cure}, or write the unseen state "
                    f"into the equations.{did_you_mean(self.through, terms)}"
                )
            divides = terms[self.through]
        # rows may lie within few steps of the solver
        shortest = max(axis.spacing / 4, min(context.resolved, axis.span / 4))
        defaults = {
            # 95 % of the stores are between a twentieth and twenty times the state's
            "ratio": frozen(stats.lognorm, 1.5),
            "scale": frozen(stats.loguniform, shortest, axis.span),
            "gap": frozen(stats.t, 3, scale=size),
        }
        return self.completed(context, defaults, divides=divides)

    def start(self) -> dict[str, float]:
        """Return a store that is at rest; at a ratio of zero the prior ends: it is enumerated."""
        return {"gap": 0.0}

    def shown(self) -> Code:
        """Return both equations, with the term where it acts."""
        code = self.code()
        if self.through is None:
            return code
        term = f"term of {self.through}"
        return replace(
            code,
            expression=f"{code.expression} - {{term}}",
            unseen="({rate} * ({state} - {store}) + {moved}) / {ratio}",
            states={**code.states, "term": term, "moved": f"{term} at the store"},
        )

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{rate} * ({store} - {state})",
            {"ratio": "1", "scale": "{t}", "gap": "{state}"},
            steps={"rate": "{ratio} / {scale} / (1 + {ratio})"},
            does="adds to slope",
            of=self.state,
            states={"state": self.state, "store": f"store of {self.state}"},
            unseen="{rate} / {ratio} * ({state} - {store})",
            through=self.modification.takes_over,
        )


register(
    Form(
        "second-store: inside",
        DynamicStore,
        lambda context: map(DynamicStore, context.states),
        meaning=(
            "{target} exchanges with a store that its equation leaves out, as a room does with "
            "its walls or blood with tissue"
        ),
        headline=(
            "{target} exchanges with a store that its equation leaves out, {ratio:size} "
            "times its size, over {scale}"
        ),
    ),
    Form(
        "second-store: in series",
        DynamicStore,
        lambda context: (
            DynamicStore(state, through=name)
            for state in context.states
            for name in context.terms.get(state, ())
        ),
        meaning=(
            "{target} exchanges with a store that its equation leaves out, and one of its terms "
            "acts on that store, as a room loses its heat through the walls or a drug is broken "
            "down in tissue"
        ),
        headline=(
            "The term of {through} acts on a store that exchanges with {target} over {scale}, "
            "{ratio:size} times its size, and not on {target} itself"
        ),
    ),
)
