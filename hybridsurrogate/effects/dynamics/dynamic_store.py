"""The cause that an unseen store exchanges with a state of an ODE."""

from __future__ import annotations

from collections.abc import Mapping

from scipy import stats

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.dynamics.dynamic import Dynamic
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.ode.store import CoupledStore
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# of the log-normal ratio: 95 % of the stores are between a twentieth and twenty times the state's
_LOG_RATIO = 1.5
# of the steps of "rk4", at least 400 in the range of time, an exchange takes half of one or more
_MOST_RATES = 800


class DynamicStore(Dynamic):
    """A state that the equations lack, which exchanges with one of theirs.

    ``dx/dt = ... - k (x - z)`` and ``dz/dt = k / ratio (x - z)``, z being the unseen state: the
    wall of a heated box, the tissue of pharmacokinetics (Gibaldi and Perrier 1982,
    Pharmacokinetics, chapter 2). The ratio is the store's size in shares of the state's. Alone the
    two come together as ``exp(-t / scale)``, so that ``k = ratio / (scale (1 + ratio))``. At the
    start z is x plus a gap. It needs an `OdeSimulator`; for other simulations `SecondStore` and
    `Decay` are the second exponential of a store that empties.

    Parameters
    ----------
    state : str
    prefix : str or None, default=None
        As in `DynamicDrift`.
    priors : dict of name to prior, optional
        Of the numbers below, where the defaults do not fit.

    Notes
    -----
    Priors of the numbers by default:

    - ratio: log-normal, 95 % of it between a twentieth and twenty: a much smaller store does
      nothing, a much larger one is a constant, which `DynamicTerm` has;
    - scale: log-uniform, from a quarter of the distance of neighbouring rows, or 1/800 of their
      span, to that span: what a driven state does at once is seen of a faster exchange, and of
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
    >>> from hybridsurrogate.ode.store import CoupledStore
    >>> t = np.linspace(0.5, 10, 20)
    >>> y = drug.modified([CoupledStore("blood")])(t, np.tile([0.5, 1.5, 1.0, -8.0], (20, 1)))
    >>> tissue = hs.DynamicStore("blood", priors={"gap": norm(-8, 0.1)})
    >>> model = hs.PowerScaledSurrogate(
    ...     drug, surrogate=hs.ExactSurrogate(), effects=[tissue], n_draws=200, random_state=0)
    >>> model = model.fit(t[:, None], y + 0.01 * np.cos(40 * t))
    >>> float(model.posterior_.estimates(0)["ratio"].mean().round(1))
    1.5
    """

    kind = "second-store"
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
    def modification(self) -> CoupledStore:
        """The change of the right-hand side."""
        return CoupledStore(self.state, self.prefix)

    def prepare(self, context: Context) -> Cause:
        """Fill in the priors from the measured times and the size of the state."""
        size, axis = self.size_of(context, self.state), context.axis(context.inputs[0])
        shortest = max(axis.spacing / 4, axis.span / _MOST_RATES)
        defaults = {
            "ratio": frozen(stats.lognorm, _LOG_RATIO),
            "scale": frozen(stats.loguniform, shortest, axis.span),
            "gap": frozen(stats.t, 3, scale=size),
        }
        return self.filled(
            prefix=self.prefix or self.free_prefix(context, self.modification),
            priors=self.all_priors(defaults),
        )

    def start(self) -> dict[str, float]:
        """Return a store that is at rest; at a ratio of zero the prior ends: it is enumerated."""
        return {"gap": 0.0}

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
        )


register(
    Form(
        "second-store: inside",
        DynamicStore,
        lambda context: map(DynamicStore, context.states),
        meaning="{target} exchanges with a store that its equation leaves out, as a room does with "
        "its walls or blood with tissue",
        headline="{target} exchanges with a store that its equation leaves out, {ratio:size} "
        "times its size, over {scale}",
        call="`DynamicStore(state)`, inside an ODE",
        formula="slope of the state - k (state - z), slope of z = k (state - z) / ratio; "
        "k = ratio / (scale (1 + ratio)), z = state + gap at the start",
        priors="ratio: log-normal, sd of the logarithm 1.5; scale: log-uniform, a quarter spacing "
        "to the span; gap: Student-t, typical state",
        estimates="ratio, scale, gap",
        left_out="fewer than 8 times; no `OdeSimulator` with `ExactSurrogate`",
    )
)
