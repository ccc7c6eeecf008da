"""How well each model foresees measurements beyond the range that it has seen."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pandas as pd
from hidden_effects import noises
from hidden_effects.cases import Case

import hybridsurrogate as hs

LEVEL = 0.9
MODELS = ("plain", "named", "averaged")
# score and coverage, in the words of the columns of results
WORDS = {model: (f"elpd_{model}", f"inside_{model}") for model in MODELS}


def foreseen(case: Case, diagnosis: hs.DiscrepancyDiagnosis, seed: int) -> dict[str, float]:
    """Return log density a row and coverage of the plain, the named and the averaged model.

    The measurements out of range are made here: the truth and noise of the case's size. None where
    the hidden effect is in the noise or there is none.
    """
    if case.truth["kind"] in ("none", *noises.KINDS):
        return {}
    noise = np.random.default_rng(seed).standard_normal(len(case.mu_out))
    y = case.mu_out + case.truth["noise_sd"] * noise
    out = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        warnings.simplefilter("ignore", RuntimeWarning)
        after = diagnosis.extended_estimator_
        models: dict[str, Any] = {
            "plain": diagnosis.estimator_,
            "named": getattr(after, "estimators_", [after])[0],
            "averaged": after,
        }
        for name, model in models.items():
            score, inside = WORDS[name]
            out[score] = model.score(case.X_out, y)
            out[inside] = float(np.mean(model.interval_holds(case.X_out, y, (LEVEL,))[0]))
    return out


def beyond(found: pd.DataFrame) -> pd.DataFrame:
    """Return mean scores and coverage out of range, by size and whether the name was right."""
    words = [word for pair in zip(*WORDS.values(), strict=True) for word in pair]
    needed = [*WORDS["plain"], *WORDS["named"]]
    scored = found[found["rows"].isin(found["rows"].mode()[:1])].dropna(subset=needed)
    if scored.empty:
        return scored
    right = scored["exact"].map({True: "right", False: "wrong"})
    rows = []
    for size, part in scored.groupby("size"):
        for name, mine in [*part.groupby(right), ("all", part)]:
            gain = mine["elpd_averaged"] - mine["elpd_named"]
            error = gain.std() / np.sqrt(len(mine))
            rows.append((name, size, len(mine), *mine[words].mean(), gain.mean(), error))
    columns = ["name", "size", "cases", *words, "averaging gains", "its error"]
    table = pd.DataFrame(rows, columns=columns).set_index(["name", "size"]).sort_index()
    return table.dropna(axis=1, how="all")
