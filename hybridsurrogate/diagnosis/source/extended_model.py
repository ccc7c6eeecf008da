"""What a module is written of: an extended model without its diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hybridsurrogate.effects.base import Cause, Rows
from hybridsurrogate.likelihoods import Binomial, Likelihood
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray

# where a logarithm differs from the identity
_TRIED = np.array([0.3, 2.0])


@dataclass(frozen=True)
class FittedCause:
    """A prepared cause, and draws of its parameters and coefficients, (n_draws,) each."""

    cause: Cause
    theta: Rows
    coefficients: Rows


@dataclass(frozen=True)
class ExtendedModel:
    """What a module is written of.

    Attributes
    ----------
    name : str
        Of the simulation.
    functions : tuple of (str, str)
        Names and modules of the functions that are passed, where they can be imported: the
        simulation, or ``rhs``, ``initial_state`` where it is a function, and ``observe``.
    inputs, outputs : tuple of str
    parameters : dict of name to ndarray of shape (n_draws,)
    assumed : dict of name to float
    causes : sequence of FittedCause
    likelihood : Likelihood
    sigma : dict of output to ndarray of shape (n_draws,)
        Standard deviation of the noise, empty where there is none.
    simulator : Simulator or None
    sizes : tuple of float
        Typical sizes of the states of an `OdeSimulator`.
    labels : dict of column to tuple of str
        Names of experiments that a column numbers.
    units : dict of name to str
    about : sequence of str
        Paragraphs of the docstring.
    written_by : str
        Its last one: where the numbers come from.
    returns_dict : bool
        Whether a function of one output returns it in a dict.
    """

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: Mapping[str, FloatArray]
    assumed: Mapping[str, float]
    causes: Sequence[FittedCause]
    likelihood: Likelihood
    sigma: Mapping[str, FloatArray] = field(default_factory=dict)
    simulator: Simulator | None = None
    sizes: tuple[float, ...] = ()
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    about: Sequence[str] = ()
    written_by: str = ""
    functions: tuple[tuple[str, str], ...] = ()
    returns_dict: bool = False


def link_of(likelihood: Likelihood) -> tuple[str, str]:
    """Return the scale on which causes act, and a word for it."""
    plain = likelihood
    while hasattr(plain, "plain"):
        plain = plain.plain
    if isinstance(plain, Binomial):
        return f"logit {plain.trials}", "log odds of "
    eta = np.asarray(plain.link(_TRIED))
    if np.allclose(eta, np.log(_TRIED)):
        return "log", "log "
    if np.allclose(eta, _TRIED):
        return "", ""
    raise ValueError(
        f"The likelihood {plain.name!r} has a link that is not written as Python: it "
        "is neither the output nor its logarithm."
    )
