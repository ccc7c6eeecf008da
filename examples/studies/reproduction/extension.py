"""What the diagnosis says in each case study, and the scores of the model it extends."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import hybridsurrogate as hs

from .cases import CASES, CaseStudy
from .scores import of_rows, pointwise, table

EXTENDED, AVERAGED = "extended", "averaged"


class Hidden(NamedTuple):
    """What was hidden in a case study: its cause, and an estimate with its true value if known."""

    cause: hs.Cause
    estimate: str = ""
    value: float = np.nan


HIDDEN = {
    "1": Hidden(hs.Periodic("x"), "period", 2 * np.pi / 0.05),
    "1.2": Hidden(hs.Periodic("x"), "period", 2 * np.pi / 0.05),
    "2.1": Hidden(hs.WrongConstant("recovery_rate"), "value", 0.7),
    "2.1 whole": Hidden(hs.WrongConstant("recovery_rate"), "value", 0.7),
    # nobody knows the truth; contacts fell with the lockdown of 9 March, day 15
    "2.2": Hidden(hs.ParameterDrift("contact_rate", "t")),
}


def asking(case: CaseStudy, seed: int, n_draws: int, **more: Any) -> Any:
    """Return an estimator that asks the simulation itself instead of an emulator."""
    asked = {**case.settings, "surrogate": hs.ExactSurrogate(), "n_draws": n_draws, **more}
    return hs.PowerScaledSurrogate(case.simulator, random_state=seed, **asked)


def extend(name: str, seed: int, n_draws: int = 1000, **settings: Any) -> pd.DataFrame:
    """Return scores of what the diagnosis extends, and whether it found what was hidden.

    Of the model extended by the cause that it names, and of the average over all causes by their
    probabilities.
    """
    case, hidden = CASES[name](seed), HIDDEN[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        diagnosis = hs.DiscrepancyDiagnosis(
            asking(case, seed, n_draws), cv=None, random_state=seed, **settings
        ).fit(case.X, case.y)
        after = diagnosis.extended_estimator_
        named = getattr(after, "estimators_", [after])[0]
        rows = list(of_rows(case, pointwise(named, case)))
        rows += list(of_diagnosis(diagnosis, hidden.cause))
        mixed = list(of_rows(case, pointwise(after, case)))
        if hidden.estimate:
            given = asking(case, seed, n_draws, effects=(hidden.cause,)).fit(case.X, case.y)
            draws = given.posterior_.estimates(0)[hidden.estimate]
            low, high = np.quantile(draws, [0.05, 0.95])
            rows.append(("given", "estimate", float(draws.mean())))
            rows.append(("given", "covered", float(low <= hidden.value <= high)))
    scores = [(EXTENDED, np.nan, row) for row in rows]
    return table(name, seed, [*scores, *((AVERAGED, np.nan, row) for row in mixed)])


def of_diagnosis(diagnosis: Any, cause: hs.Cause) -> Iterable[tuple[str, str, float]]:
    """Yield whether a cause came first, and whether it is among those not distinguished."""
    first = diagnosis.best_cause_
    yield "diagnosis", "found", float((first.kind, first.target) == (cause.kind, cause.target))
    yield "diagnosis", "rival", float(cause.kind in diagnosis.indistinguishable_)
    yield "diagnosis", "p-value", float(diagnosis.p_value_)
