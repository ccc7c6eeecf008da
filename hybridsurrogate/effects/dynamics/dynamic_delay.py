"""The cause that a delay is missing from the dynamics of an ODE."""

from __future__ import annotations

from collections.abc import Mapping

from scipy import stats

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.dynamics.dynamic import Dynamic
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.ode.dynamics import DelayedState
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


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

    def __init__(
        self,
        state: str,
        prefix: str | None = None,
        priors: Mapping[str, Prior] | None = None,
    ):
        self.state = state
        self.prefix = prefix
        self.priors = priors

    @property
    def variant(self) -> str:
        """That it is inside the dynamics."""
        return "inside the dynamics"

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
        return self.filled(
            prefix=self.prefix or self.free_prefix(context, self.modification),
            priors=self.all_priors({"lag": frozen(stats.halfcauchy, scale=span / 10)}),
        )

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
        call="`DynamicDelay(state)`, inside an ODE",
        formula="slopes follow the state as it was a lag ago",
        priors="lag: half-Cauchy, scale a tenth of the span",
        estimates="lag",
        left_out='fewer than 3 times; no `OdeSimulator` with `method="rk4"` and `ExactSurrogate`',
    )
)
