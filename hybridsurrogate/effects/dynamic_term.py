"""The cause that a term is missing from the dynamics of an ODE."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.dynamics import MissingTerm
from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.effects.dynamic import NEEDS_ODE, Dynamic
from hybridsurrogate.effects.notation import SIMULATION, signed, word
from hybridsurrogate.priors import Prior


class DynamicTerm(Dynamic):
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
            raise ValueError(NEEDS_ODE.format(f"DynamicTerm({self.state!r})"))
        if self.state not in context.states:
            raise ValueError(
                f"There is no state {self.state!r}; the states are {list(context.states)}."
            )
        scale = 1 / (float(np.ptp(context.column(context.inputs[0]))) or 1.0)
        if self.form == "constant":
            scale *= context.states[self.state]
        return self.filled(
            prefix=self.prefix or self.free_prefix(context, change),
            priors=self.priors or {"rate": stats.t(3, scale=scale)},
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
