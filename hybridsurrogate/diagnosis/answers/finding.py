"""The causes that a diagnosis detected or compared, in numbers, formulas and curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from hybridsurrogate.catalogue import Skipped
from hybridsurrogate.diagnosis.answers.extension import failures
from hybridsurrogate.diagnosis.search.candidate import total_evidence
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.parameters.parameter_process import ParameterProcess
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.notebook import table
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


NOT_COMPARED = "not compared: "
_COLUMNS = [
    "kind",
    "target",
    "form",
    "probability",
    "log_evidence",
    "smooth_curve",
    "correlated",
    "note",
]
ESTIMATED = "far behind in a sample of the rows, from which its evidence is estimated"


def form_of(cause: Cause) -> str:
    """Return the kind and, where it has several forms, which: "trend: quadratic"."""
    return f"{cause.kind}: {cause.variant}" if cause.variant else cause.kind


def cause_table(result: Search, skipped: list[Skipped]) -> pd.DataFrame:
    """Return one row a cause, most probable first, those not compared last with the reason."""
    evidence = total_evidence(result.candidates)
    found = zip(
        result.candidates,
        failures(result),
        result.probability,
        evidence - evidence[0],
        result.remainder,
        result.correlated,
        strict=True,
    )
    rows = [
        (
            w.kind,
            w.cause.target if w.cause else None,
            form_of(w.cause) if w.cause else "none",
            *numbers,
            note or (ESTIMATED if w.is_estimate else ""),
        )
        for w, note, *numbers in found
    ]
    unknown = (0.0, np.nan, np.nan, np.nan)
    rows += [
        (one.kind, one.target, one.kind, *unknown, f"{NOT_COMPARED}{one.reason}") for one in skipped
    ]
    return pd.DataFrame(rows, columns=_COLUMNS).sort_values(
        "probability", ascending=False, kind="stable", ignore_index=True
    )


def not_reached(result: Search, causes: Sequence[Cause]) -> list[Skipped]:
    """Return the causes that an interrupted search left out."""
    reached = [w.cause for w in result.candidates]
    return [
        Skipped(cause.kind, cause.target, "the search was interrupted")
        for cause in causes
        if all(cause is not other for other in reached)
    ]


def is_compared(table: pd.DataFrame) -> pd.Series:
    """Return which rows of the table of causes were compared, not left out."""
    return ~table["note"].str.startswith(NOT_COMPARED)


def parameter_course(before: Any, extended: Any, n: int = 101) -> pd.DataFrame:
    """Return each parameter that wanders over its input, a row a place.

    Parameters
    ----------
    before, extended : PowerScaledSurrogate
        Fitted, without and with the causes.
    n : int, default=101
        Places over the measured range.

    Returns
    -------
    pandas.DataFrame
        As `DiscrepancyDiagnosis.parameter_course`; without rows where none wanders.
    """
    posterior = extended.posterior_
    named, constant = posterior.named(), before.posterior_.named()
    tables = []
    for k, cause in enumerate(posterior.model.effects):
        if not isinstance(cause, ParameterProcess):
            continue
        assert cause.ends is not None  # it is prepared
        x, name = np.linspace(*cause.ends, n), cause.parameter
        drawn = cause.course(x, named[name], posterior.draws_of(k)[0])
        lower, upper = np.quantile(drawn, (0.05, 0.95), axis=0)
        course = {"mean": drawn.mean(axis=0), "lower": lower, "upper": upper}
        own = {"parameter": name, "over": cause.over, "x": x, **course}
        tables.append(pd.DataFrame(own).assign(constant=float(np.mean(constant[name]))))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()
