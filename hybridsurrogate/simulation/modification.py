"""A change of an ODE's right-hand side, which causes inside the dynamics make."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from hybridsurrogate.types import FloatArray

Numbers = Mapping[str, FloatArray]  # a modification's own numbers, (m,) each


@dataclass(frozen=True)
class Modification(ABC):
    """A change of the right-hand side with further parameters, and no effect at neutral ones.

    Subclasses define these parameters and what they change. They override `factors`, `drives`,
    `terms` or `lags`; or `couples_to`, `begins` and `exchange`.
    """

    # whether earlier states of solutions are needed: only "rk4" has them
    looks_back: ClassVar[bool] = False

    @property
    @abstractmethod
    def label(self) -> str:
        """What the full names of the numbers begin with."""

    @property
    @abstractmethod
    def neutral(self) -> dict[str, float]:
        """Own names of the numbers, at values that change nothing."""

    @property
    @abstractmethod
    def sizes(self) -> tuple[str, ...]:
        """Own names of those numbers which, all at neutral, change nothing."""

    @property
    def is_in_time(self) -> bool:
        """Whether its numbers place it in time, as a period or a location does."""
        return False

    @property
    def couples_to(self) -> str | None:
        """The state with which a further, unseen one exchanges; None: there is none."""
        return None

    @property
    def takes_over(self) -> tuple[str, float] | None:
        """The parameter whose term acts on the unseen state, and its value without that term."""
        return None

    @abstractmethod
    def check(self, rates: Sequence[str], states: Sequence[str]) -> None:
        """Raise ValueError where an ODE with these rates and states has nothing to change."""

    @property
    def constants(self) -> dict[str, float]:
        """Full names of the numbers, at values that change nothing."""
        return {self.full(name): value for name, value in self.neutral.items()}

    def full(self, name: str) -> str:
        """Return the full name of a number."""
        return f"{self.label}_{name}"

    def factors(self, t: FloatArray, numbers: Numbers, step: float) -> dict[str, FloatArray]:
        """Return factors (k, m) on parameters at times t (k, 1), m numbers each."""
        return {}

    def terms(self, state: Mapping[str, FloatArray], numbers: Numbers) -> dict[str, FloatArray]:
        """Return what is added to the slopes of states, (m,) each."""
        return {}

    def drives(self, t: FloatArray, numbers: Numbers, step: float) -> dict[str, FloatArray]:
        """Return what is added to the slopes of states (k, m) at times t (k, 1), whatever these."""
        return {}

    def lags(self, numbers: Numbers) -> dict[str, FloatArray]:
        """Return how long ago, (m,), the right-hand side sees a state, for those it sees late."""
        return {}

    def begins(self, state: FloatArray, numbers: Numbers) -> FloatArray:
        """Return the unseen state at the start, (m,), where there is one; state is at the start."""
        raise NotImplementedError(f"{type(self).__name__} has no unseen state.")

    def exchange(
        self, state: FloatArray, unseen: FloatArray, numbers: Numbers, term: FloatArray | float
    ) -> tuple[FloatArray, FloatArray]:
        """Return what is added to the slope of the state, and the slope of the unseen one, (m,).

        ``term`` is what acts on the unseen one, in amounts of the state.
        """
        raise NotImplementedError(f"{type(self).__name__} has no unseen state.")


Active = list[tuple[Modification, dict[str, FloatArray]]]  # changes, and their numbers (m,)


class Drive(NamedTuple):
    """What drives a right-hand side, by time (k, m) or at one time (m,)."""

    factors: dict[str, FloatArray]  # on parameters
    added: dict[str, FloatArray]  # to slopes of states

    def at(self, k: int) -> Drive:
        """Return what drives it at one of the times."""
        return Drive(
            {name: values[k] for name, values in self.factors.items()},
            {name: values[k] for name, values in self.added.items()},
        )


def drive_of(active: Active, t: FloatArray, step: float) -> Drive:
    """Return what changes drive a right-hand side with at times t (k,)."""
    factors: dict[str, FloatArray] = {}
    added: dict[str, FloatArray] = {}
    for change, numbers in active:
        for name, factor in change.factors(t[:, None], numbers, step).items():
            factors[name] = factors[name] * factor if name in factors else factor
        _add(added, change.drives(t[:, None], numbers, step))
    return Drive(factors, added)


def lags(active: Active) -> dict[str, FloatArray]:
    """Return how long ago a right-hand side sees a state, (m,), for those it sees late."""
    total: dict[str, FloatArray] = {}
    for change, numbers in active:
        _add(total, change.lags(numbers))
    return total


def _add(total: dict[str, FloatArray], more: Mapping[str, FloatArray]) -> None:
    for name, values in more.items():
        total[name] = total[name] + values if name in total else values
