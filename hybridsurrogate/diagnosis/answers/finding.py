"""The causes that a diagnosis detected, in numbers and formulas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hybridsurrogate.diagnosis.search.forward_selection import SearchStep
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.notebook.tables import table
from hybridsurrogate.numerics import digits


@dataclass(frozen=True)
class CauseFinding:
    """A cause that a diagnosis detected.

    Attributes
    ----------
    kind : str
    target : str or None
        The input, parameter, constant or column concerned.
    formula : str
        The extended simulation in words, with numbers.
    probability : float
        Posterior probability of the kind, all its forms and targets together, given all other
        detected causes.
    estimates : dict of str to (mean, low, high)
        With 90 % intervals, in the user's units.
    latex : str
        The formula in LaTeX.
    same_curve : tuple of str
        Other kinds that draw the same curve through the measured rows; the probability is that of
        all together.

    Examples
    --------
    As in ``diagnosis.best_cause_``:

    >>> estimates = {"offset": (2.0, 1.5, 2.5)}
    >>> found = CauseFinding("offset", None, "simulation + 2", 0.9, estimates)
    >>> mean, low, high = found.estimates["offset"]
    >>> f"{found.kind}: {found.formula}, offset from {low} to {high}"
    'offset: simulation + 2, offset from 1.5 to 2.5'
    """

    kind: str
    target: str | None
    formula: str
    probability: float
    estimates: dict[str, tuple[float, float, float]]
    latex: str = r"\text{simulation}"
    same_curve: tuple[str, ...] = ()

    def _repr_html_(self) -> str:
        concerns = [] if self.target is None else [("target", self.target)]
        same = [("same curve", digits.listing(list(self.same_curve)))] if self.same_curve else []
        words = [
            ("kind", self.kind),
            *concerns,
            ("probability", digits.probability(self.probability)),
            ("formula", self.formula),
            *same,
        ]
        numbers = [
            (name, digits.number(mean), f"{digits.number(low)} to {digits.number(high)}")
            for name, (mean, low, high) in self.estimates.items()
        ]
        header = ("estimate", "mean", "90 % interval")
        return table(words) + (table(numbers, header) if numbers else "")


def finding_of(
    step: SearchStep, position: int, posterior: Posterior, same_curve: tuple[str, ...] = ()
) -> CauseFinding:
    """Return what one search chose, its numbers from the draws of the extended model.

    Parameters
    ----------
    step : SearchStep
    position : int
        Of the cause among the effects of the extended model.
    posterior : Posterior
    same_curve : tuple of str
        Kinds that draw the same curve.
    """
    chosen, found = step.chosen, step.conditional
    kinds = chosen.kind, *same_curve
    alike = [w.kind in kinds for w in found.candidates]
    probability = min(float(found.probability[alike].sum()), 1.0)
    cause = chosen.cause
    if cause is None:
        return CauseFinding("none", None, "the simulation as it is", probability, {})
    estimates = {
        name: (float(v.mean()), float(np.quantile(v, 0.05)), float(np.quantile(v, 0.95)))
        for name, v in posterior.estimates(position).items()
    }
    means = {name: value[0] for name, value in estimates.items()}
    formula, latex = cause.formula(means), cause.latex(means)
    return CauseFinding(
        cause.kind, cause.target, formula, probability, estimates, latex, same_curve
    )
