"""What an estimator needs of a surrogate: to turn the domain of a simulation into a basis."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from sklearn.base import BaseEstimator

from hybridsurrogate.arguments.functions import state_to_pickle
from hybridsurrogate.registration import add
from hybridsurrogate.surrogates.basis import Basis
from hybridsurrogate.surrogates.domain import Domain


class Surrogate(BaseEstimator, ABC):
    """Base of the surrogates: constructor parameters only, no state.

    A user-defined surrogate implements ``build`` and returns a `Basis`.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.surrogates import Basis, Surrogate
    >>> class LineBasis(Basis):
    ...     def known(self, X, omega, hyper=None):
    ...         return np.zeros(len(X))
    ...     def features(self, X, omega):
    ...         return np.column_stack([np.ones(len(X)), X, omega])
    >>> class Line(Surrogate):
    ...     def build(self, domain):
    ...         p = 1 + len(domain.input_ranges) + len(domain.parameter_ranges)
    ...         return LineBasis(np.zeros(p), np.full(p, 10 * domain.scale))
    """

    def __getstate__(self) -> dict[str, Any]:
        state: dict[str, Any] = super().__getstate__()
        return state_to_pickle(state, type(self).__name__)

    @abstractmethod
    def build(self, domain: Domain) -> Basis:
        """Return the basis on a domain."""

    def of_measured_data(self) -> Surrogate:
        """Return the surrogate of measured data alone with which predictive weighting mixes it.

        It is built where omega has no columns: a surrogate that needs parameters returns another.
        """
        return self


# an instance by name; property tests run over it
SURROGATES: dict[str, Surrogate] = {}


def register(name: str, surrogate: Surrogate) -> None:
    """Give a surrogate a name and make its class public; its file calls it at the end.

    Parameters
    ----------
    name : str
    surrogate : Surrogate
        One that can be built on any domain, for the tests of what all surrogates must hold.

    Examples
    --------
    >>> register("line", dict())
    Traceback (most recent call last):
        ...
    TypeError: register('line', ...) needs a Surrogate object, got {}.
    """
    if not isinstance(surrogate, Surrogate):
        raise TypeError(f"register({name!r}, ...) needs a Surrogate object, got {surrogate!r}.")
    add(SURROGATES, name, surrogate)
