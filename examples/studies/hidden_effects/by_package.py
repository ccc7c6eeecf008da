"""What the package says of a blind case, in the form of `by_hand`."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import hybridsurrogate as hs

from .cases import Case


def diagnose(
    case: Case, seed: int, exclude: Sequence[str] = (), n_replicates: int = 200
) -> dict[str, Any]:
    """Diagnose one case by the package; the truth in it is not looked at."""
    model = hs.PowerScaledSurrogate(
        case.simulator, surrogate=hs.ExactSurrogate(), random_state=seed
    )
    diagnosis = hs.DiscrepancyDiagnosis(
        model, exclude=exclude, n_replicates=n_replicates, cv=None, random_state=seed
    )
    with warnings.catch_warnings():
        # doubtful draws of a wrong cause are its own affair; what counts here are the names
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        diagnosis.fit(case.X, case.y)
    return {
        "kind": diagnosis.best_cause_.kind,
        "set": diagnosis.indistinguishable_,
        "effect": next(iter(diagnosis.extended_estimator_.effects), None),
        "verdict": diagnosis.verdict_,
        "p_value": diagnosis.p_value_,
        "predict": diagnosis.extended_estimator_.predict,
        "predict_none": diagnosis.estimator_.predict,
    }
