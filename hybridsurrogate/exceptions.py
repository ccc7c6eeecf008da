"""Warnings about doubtful results and inputs, and suggestions for misspelt names."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class HybridSurrogateWarning(UserWarning):
    """Base class of every warning of this package."""


class FailedRunsWarning(HybridSurrogateWarning):
    """Some simulation runs failed and were dropped."""


class MissingMeasurementWarning(HybridSurrogateWarning):
    """Rows without a measurement of the output were left out."""


class RowByRowWarning(HybridSurrogateWarning):
    """A simulation that was to take arrays takes numbers only, and is called row by row."""


class EmulationWarning(HybridSurrogateWarning):
    """A simulation is slow to run: a fit made runs of it, and uses an emulator of them."""


class ExtrapolationWarning(HybridSurrogateWarning):
    """Measured or predicted inputs, or all measured outputs, lie outside what was simulated."""


class SamplingWarning(HybridSurrogateWarning):
    """The draws from a posterior are unreliable."""


class SolverWarning(HybridSurrogateWarning):
    """The solutions of an ODE depend on the step of the solver."""


class PriorWarning(HybridSurrogateWarning):
    """A prior and the simulated range hardly overlap."""


class DiagnosisWarning(HybridSurrogateWarning):
    """A diagnosis is based on too little, or something was left out of it."""


class ConfoundingWarning(DiagnosisWarning):
    """The data cannot distinguish a cause from a parameter of the simulation."""


def did_you_mean(name: object, known: Iterable[object]) -> str:
    """Return a question, with a space before it, that gives the known name most like another one.

    Nothing where none is alike. Errors about names end with it.

    Parameters
    ----------
    name : object
        The name that is not known; of several, in a list, each has its question.
    known : iterable of object

    Examples
    --------
    >>> did_you_mean("delya", ["delay", "drift"])
    " Did you mean 'delay'?"
    >>> did_you_mean("moon", ["co2", "nile"])
    ''
    """
    by_fold = {str(one).casefold(): str(one) for one in known}
    names = name if isinstance(name, list | tuple | set) else [name]
    text = ""
    for one in map(str, names):
        for near in get_close_matches(one.casefold(), by_fold, n=1):
            instead = f" instead of {one!r}" if len(names) > 1 else ""
            text += f" Did you mean {by_fold[near]!r}{instead}?"
    return text
