"""An unseen state that exchanges with a state of an ODE, as a second compartment does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hybridsurrogate.ode.dynamics import check_state
from hybridsurrogate.simulation.modification import Modification, Numbers
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class CoupledStore(Modification):
    """A state z that the equations lack and that exchanges with one of their states, x.

    ``dx/dt = ... - k (x - z)`` and ``dz/dt = k / ratio (x - z)``: the wall of a heated box, the
    tissue of pharmacokinetics (Gibaldi and Perrier 1982, Pharmacokinetics, chapter 2). Alone the
    two come together as ``exp(-t / scale)``, so that ``k = ratio / (scale (1 + ratio))``. At the
    start z is x plus a gap. A store of ratio zero takes nothing.

    Parameters
    ----------
    state : str
    prefix : str or None, default=None
        What the full names of the numbers begin with; None: the state and "store".

    Examples
    --------
    >>> from hybridsurrogate.ode.store import CoupledStore
    >>> CoupledStore("air").constants
    {'air_store_ratio': 0.0, 'air_store_scale': 1.0, 'air_store_gap': 0.0}
    """

    state: str
    prefix: str | None = None

    @property
    def label(self) -> str:
        """The prefix, or the state and "store"."""
        return self.prefix or f"{self.state}_store"

    @property
    def neutral(self) -> dict[str, float]:
        """A ratio of zero; scale and gap."""
        return {"ratio": 0.0, "scale": 1.0, "gap": 0.0}

    @property
    def sizes(self) -> tuple[str, ...]:
        """The ratio."""
        return ("ratio",)

    @property
    def is_in_time(self) -> bool:
        """Its scale is a time."""
        return True

    @property
    def couples_to(self) -> str:
        """The state with which it exchanges."""
        return self.state

    def check(self, rates: Sequence[str], states: Sequence[str]) -> None:
        """Raise ValueError where there is no such state."""
        check_state(self.state, states)

    def begins(self, state: FloatArray, numbers: Numbers) -> FloatArray:
        """Return the unseen state at the start, (m,)."""
        return state + numbers["gap"]

    def exchange(
        self, state: FloatArray, unseen: FloatArray, numbers: Numbers
    ) -> tuple[FloatArray, FloatArray]:
        """Return what is added to the slope of the state, and the slope of the unseen one, (m,)."""
        flow = (state - unseen) / (numbers["scale"] * (1 + numbers["ratio"]))
        return -numbers["ratio"] * flow, flow
