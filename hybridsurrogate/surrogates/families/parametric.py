"""A function as its own surrogate: the simulation itself, or one with unknown constants."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import stats

from hybridsurrogate.priors import check_priors
from hybridsurrogate.simulation.modification import Modification
from hybridsurrogate.surrogates.basis import Basis, Domain, Surrogate, register
from hybridsurrogate.surrogates.families.polynomial_chaos import PolynomialChaos
from hybridsurrogate.types import FloatArray, Prior


class ExactSurrogate(Surrogate):
    """A cheap, callable simulation as it is: no emulator, no coefficients.

    Needs a `Simulator`, or the runs of one; runs made elsewhere cannot be evaluated anew.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from scipy.stats import norm
    >>> fall = hs.Simulator(lambda t, g: 100 - g * t**2 / 2, inputs={"t": (0, 4)},
    ...                     parameters={"g": norm(9.8, 0.2)})
    >>> model = hs.PowerScaledSurrogate(fall, surrogate=hs.ExactSurrogate(), random_state=0)
    >>> t = np.linspace(0, 4, 12)
    >>> model = model.fit(t[:, None], 100 - 9.6 * t**2 / 2 + 0.1 * np.cos(50 * t))
    >>> round(model.predict([[2.0]]).item(), 1)
    80.8
    """

    def build(self, domain: Domain) -> Basis:
        """Return the basis; raise ValueError when the simulation is not callable."""
        if domain.simulate is None:
            raise ValueError(
                "ExactSurrogate evaluates the simulation itself, but there is no callable one: "
                "pass a Simulator (or runs made by Simulator.run) as simulation, or choose an "
                "emulator such as PolynomialChaos."
            )
        return ExactBasis(np.empty(0), np.empty(0), domain.simulate)

    def of_measured_data(self) -> Surrogate:
        """Return a polynomial: measured data have no simulation to evaluate."""
        return PolynomialChaos()


@dataclass(frozen=True)
class ExactBasis(Basis):
    """The simulation as known part, and no features."""

    simulate: Any

    is_simulation = True

    @property
    def is_quick(self) -> bool:
        """Whether many runs of the simulation take hardly longer than one."""
        return self.simulate.simulator.is_quick

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        """Return the simulation."""
        return self.simulate(X, omega)

    def modified(self, modifications: Sequence[Modification]) -> Basis:
        """Return the basis of a simulation with changed dynamics."""
        return replace(self, simulate=self.simulate.modified(modifications))


register("exact", ExactSurrogate())


CurveFunction = Callable[[FloatArray, FloatArray, dict[str, FloatArray]], Any]


class ParametricSurrogate(Surrogate):
    """A user-defined surrogate: any function of inputs, parameters and unknown constants.

    Parameters
    ----------
    function : callable
        ``function(X, omega, constants) -> (n,)`` on the scale of eta: X of shape (n, n_inputs),
        omega (n, n_parameters), constants a dict of name to (n,), all in the user's units. All
        rows of all draws come in one call, so it must be vectorised.
    prior : dict of name to frozen scipy.stats distribution
        Priors of the constants.

    Notes
    -----
    The constants are sampled together with the simulation's parameters: up to about twenty.
    A surrogate that is linear in its unknowns is faster as a subclass of `Surrogate`. A function
    that uses omega has no surrogate of measured data alone: for predictive weighting override
    ``of_measured_data`` in a subclass.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from scipy.stats import norm
    >>> def growth(X, omega, c):
    ...     return c["height"] * omega[:, 0] / (1 + np.exp(-c["rate"] * X[:, 0]))
    >>> surrogate = hs.ParametricSurrogate(growth, {"height": norm(1, 1), "rate": norm(1, 1)})
    >>> sorted(surrogate.prior)
    ['height', 'rate']
    """

    def __init__(
        self, function: CurveFunction | None = None, prior: Mapping[str, Prior] | None = None
    ):
        self.function = function
        self.prior = prior

    def build(self, domain: Domain) -> Basis:
        """Return the basis on a domain; raise ValueError when the function does not fit it."""
        if not callable(self.function):
            raise TypeError(
                f"ParametricSurrogate needs a function(X, omega, constants), got {self.function!r}."
            )
        priors = check_priors(self.prior, "prior")
        if not priors:
            raise ValueError("ParametricSurrogate needs a prior for at least one constant.")
        basis = _ParametricBasis(np.empty(0), np.empty(0), self.function, priors)
        medians = np.array([float(prior.ppf(0.5)) for prior in priors.values()])
        values = basis.known(domain.X, domain.omega, np.tile(medians, (len(domain.X), 1)))
        if not np.isfinite(values).any():
            raise ValueError(
                f"{_name(self.function)} is NaN or infinite at every training row, with its "
                "constants at the medians of their priors. Check units and priors."
            )
        return basis


def _name(function: CurveFunction) -> str:
    return f"The surrogate function {getattr(function, '__name__', function)!r}"


@dataclass(frozen=True)
class _ParametricBasis(Basis):
    function: CurveFunction
    priors: dict[str, Prior]

    known_depends_on_hyper = True

    @property
    def hyperpriors(self) -> dict[str, Prior]:
        return self.priors

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        assert hyper is not None
        constants = dict(zip(self.priors, hyper.T, strict=True))
        with np.errstate(all="ignore"):  # constants far in their tails are impossible, no error
            values = np.asarray(self.function(X, omega, constants), dtype=float)
        if values.shape != (len(X),):
            raise ValueError(
                f"{_name(self.function)} must return shape ({len(X)},) for {len(X)} rows, got "
                f"{values.shape}. It gets all rows of all draws at once: use numpy functions."
            )
        return values


def _straight(X: FloatArray, omega: FloatArray, constants: dict[str, FloatArray]) -> FloatArray:
    return constants["slope"] * X[:, 0]


register("parametric", ParametricSurrogate(_straight, {"slope": stats.norm(0, 10)}))
