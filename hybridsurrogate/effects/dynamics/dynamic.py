"""What causes inside the dynamics of an ODE have in common."""

from __future__ import annotations

from collections.abc import Mapping

from hybridsurrogate.effects.base import Context, Declared, Rows
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.simulation.modification import Modification
from hybridsurrogate.types import Prior

NEEDS_ODE = (
    "{}: causes inside the dynamics need simulation=OdeSimulator(...), or runs of one, and "
    "surrogate=ExactSurrogate(): an emulator has no right-hand side."
)


class Dynamic(Declared):
    """A cause that modifies the right-hand side, and sets the numbers of the modification."""

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

    def free_prefix(self, context: Context, change: Modification) -> str:
        """Return a prefix that no number has which is a parameter already."""
        prefix, k = change.label, 1
        while any(name.startswith(f"{prefix}_") for name in context.parameters):
            k += 1
            prefix = f"{change.label}_{k}"
        return prefix

    def all_priors(self, defaults: Mapping[str, Prior]) -> dict[str, Prior]:
        """Return the priors of all numbers: those given, and else the defaults."""
        change = self.modification
        given = self.priors or {}
        unknown = sorted(given.keys() - change.neutral.keys())
        if unknown:
            raise ValueError(
                f"{type(self).__name__} ({self.variant}) has no {unknown[0]!r}: "
                f"{list(change.neutral)}.{did_you_mean(unknown[0], change.neutral)}"
            )
        return {name: given.get(name, defaults[name]) for name in change.neutral}

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
