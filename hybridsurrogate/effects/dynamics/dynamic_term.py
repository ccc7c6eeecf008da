"""The cause that a term is missing from the dynamics of an ODE."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.dynamics.dynamic import Dynamic
from hybridsurrogate.effects.notation import SIMULATION, number, signed, word
from hybridsurrogate.effects.over_column import period_nodes, period_prior, span_and_spacing
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.ode.dynamics import MissingTerm
from hybridsurrogate.priors import Prior, frozen


class DynamicTerm(Dynamic):
    """A term missing from the slope of a state of an `OdeSimulator`.

    Parameters
    ----------
    state : str
    form : {"constant", "proportional", "seasonal"}
        The term is ``rate``, ``rate`` times the state, or a forcing from outside:
        ``sine sin(a) + cosine cos(a)`` with ``a = 2 pi (t - center) / period``.
    prefix : str or None, default=None
        As in `DynamicDrift`.
    priors : dict of name to prior, optional
        Of the numbers below, where the defaults do not fit.
    center : float or None, default=None
        Time at which the seasonal forcing has phase zero. None: the middle of the measured rows.

    Notes
    -----
    Priors of the numbers by default, where the typical size of a state is its root mean square at
    the medians of the parameters' priors:

    - rate: Student-t with 3 degrees of freedom around zero, whose scale is one over the span of the
      measured times, times the typical size of the state where the form is constant: over the
      measured rows the state gains about as much as it holds, or much less or more;
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

    def __init__(
        self,
        state: str,
        form: str = "constant",
        prefix: str | None = None,
        priors: Mapping[str, Prior] | None = None,
        center: float | None = None,
    ):
        self.state = state
        self.form = form
        self.prefix = prefix
        self.priors = priors
        self.center = center

    @property
    def target(self) -> str:  # type: ignore[override]
        """The state concerned."""
        return self.state

    @property
    def variant(self) -> str:
        """Whether the term is constant, proportional to the state, or seasonal."""
        return self.form

    @property
    def name(self) -> str:
        """The kind, the state, and the form of the term."""
        return f"{self.kind}({self.state}, {self.form})"

    @property
    def modification(self) -> MissingTerm:
        """The change of the right-hand side."""
        return MissingTerm(self.state, self.form, self.prefix, self.center or 0.0)

    def prepare(self, context: Context) -> Cause:
        """Fill in the priors from the measured times and the size of the state."""
        change = self.modification
        size = self.size_of(context, self.state)
        times = context.column(context.inputs[0])
        span, _ = span_and_spacing(times)
        period = (self.priors or {}).get("period", period_prior(times))
        swing = np.pi * size / float(period.median())
        rate = 1 / span * (1.0 if self.form == "proportional" else size)
        defaults = {
            "rate": frozen(stats.t, 3, scale=rate),
            "sine": frozen(stats.t, 3, scale=swing),
            "cosine": frozen(stats.t, 3, scale=swing),
            "period": period,
        }
        center = float(times.min() + times.max()) / 2 if change.form == "seasonal" else 0.0
        return self.filled(
            prefix=self.prefix or self.free_prefix(context, change),
            priors=self.all_priors(defaults),
            center=center if self.center is None else self.center,
        )

    def grid(self) -> dict[str, FloatArray]:
        """Return periods evenly spaced in frequency."""
        periods = {k: prior for k, prior in self.parameters.items() if k == "period"}
        return {name: period_nodes(prior) for name, prior in periods.items()}

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the rate, or period and amplitude."""
        if self.form != "seasonal":
            return dict(theta)
        amplitude = np.hypot(theta["sine"], theta["cosine"])
        return {"period": np.asarray(theta["period"]), "amplitude": amplitude}

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        if self.form == "seasonal":
            return (
                f"simulation with a forcing of {values['amplitude']:.4g} and period "
                f"{values['period']:.4g} in the slope of {self.state}"
            )
        term = f"{values['rate']:+.4g}" + ("" if self.form == "constant" else f" {self.state}")
        return f"simulation with {term} in the slope of {self.state}"

    def latex(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in LaTeX."""
        state = word(self.state)
        slope = rf"\frac{{d}}{{dt}} {state}"
        if self.form == "seasonal":
            angle = rf"\frac{{2 \pi \, t}}{{{number(values['period'])}}}"
            term = rf"+ {number(values['amplitude'])} \sin\left({angle} + \varphi\right)"
        else:
            term = signed(values["rate"]) + ("" if self.form == "constant" else rf" \, {state}")
        return rf"{SIMULATION}, \quad {slope} \to {slope} {term}"


def _of_states(form: str) -> Callable[[Context], Iterator[Cause]]:
    return lambda context: (DynamicTerm(state, form) for state in context.states)


def _lacking(context: Context) -> list[tuple[None, str]]:
    reason = "inside the dynamics: needs an OdeSimulator and surrogate=ExactSurrogate()"
    return [] if context.states else [(None, reason)]


register(
    Form(
        "missing-term",
        DynamicTerm,
        _of_states("constant"),
        meaning="{target} gains or loses something that its equation leaves out",
        lacking=_lacking,
        like=("parameter-drift",),
        call="`DynamicTerm(state)`",
        formula="slope of the state + rate",
        priors="rate: Student-t, typical state over the span",
        estimates="rate",
        left_out="fewer than 8 times; no `OdeSimulator` with `ExactSurrogate`",
    )
)
register(
    Form(
        "missing-term: proportional",
        DynamicTerm,
        _of_states("proportional"),
        call='`..., form="proportional"`',
        formula="slope of the state + rate state",
        priors="rate: Student-t, one over the span",
        estimates="rate",
        left_out="the same",
    )
)
register(
    Form(
        "missing-term: seasonal",
        DynamicTerm,
        _of_states("seasonal"),
        meaning="something drives {target} up and down regularly, and its equation leaves that out",
        call='`..., form="seasonal"`',
        formula="slope of the state + amplitude sin(2π (t - center) / period + phase)",
        priors="sine, cosine: Student-t, half the typical state at the median period; period: log-"
        "uniform, 2 spacings to 2 spans",
        estimates="period, amplitude",
        left_out="the same",
    )
)
