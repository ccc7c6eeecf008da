"""The simulation as its own surrogate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hybridsurrogate.simulation.modification import Modification
from hybridsurrogate.surrogates.base import Surrogate, register
from hybridsurrogate.surrogates.basis import Basis
from hybridsurrogate.surrogates.domain import Domain
from hybridsurrogate.surrogates.families.polynomial_chaos import PolynomialChaos
from hybridsurrogate.types import FloatArray


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

    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return no features."""
        return np.empty((len(X), 0))


register("exact", ExactSurrogate())
