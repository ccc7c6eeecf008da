"""Scores side by side, for the examples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

import hybridsurrogate as hs
from hybridsurrogate.scoring import paired_difference, rmse

from .cases import Rows
from .scores import MIXED, POWER


def paths(simulation: Any, X: Any, y: Any, betas: Sequence[float], **settings: Any) -> dict:
    """Return both schemes fitted at every beta, by name."""
    schemes = {POWER: hs.PowerScaledSurrogate, MIXED: hs.PredictiveWeightedSurrogate}
    return {
        name: hs.beta_path(scheme(simulation, **settings), X, y, betas)
        for name, scheme in schemes.items()
    }


def over_beta(fitted: Mapping[str, hs.BetaPath], tests: Mapping[str, Rows]) -> pd.DataFrame:
    """Return ELPD and RMSE of each scheme at each beta on each test set."""
    rows = [
        (
            scheme,
            test,
            float(beta),
            model.score(held.X, held.y),
            rmse(model.sample_predictive_mean(held.X), held.truth),
        )
        for scheme, path in fitted.items()
        for beta, model in zip(path.betas, path.estimators, strict=True)
        for test, held in tests.items()
    ]
    return pd.DataFrame(rows, columns=["scheme", "test", "beta", "elpd", "rmse"])


def best_of(fitted: Mapping[str, hs.BetaPath], held: Rows) -> dict[str, Any]:
    """Return each scheme at the beta whose ELPD is best on these rows, beta in the name."""
    found = {}
    for scheme, path in fitted.items():
        k = int(np.argmax(path.score(held.X, held.y)))
        found[f"{scheme}, beta = {path.betas[k]:g}"] = path.estimators[k]
    return found


def compare(models: Mapping[str, Any], held: Rows) -> pd.DataFrame:
    """Return ELPD and RMSE, and by how much the last model is better, with standard errors.

    Errors are those of the mean over test rows, paired by row.
    """
    density = {name: m.log_predictive_density(held.X, held.y) for name, m in models.items()}
    error = {
        name: np.sqrt(np.mean((m.sample_predictive_mean(held.X) - held.truth) ** 2, axis=0))
        for name, m in models.items()
    }
    last = list(models)[-1]
    rows = {}
    for name in models:
        gain = paired_difference(density[last], density[name])
        saved = paired_difference(error[name], error[last])
        rows[name] = {
            "ELPD": density[name].mean(),
            "last is better by": gain.difference,
            "error": gain.standard_error,
            "RMSE": error[name].mean(),
            "last is lower by": saved.difference,
            "its error": saved.standard_error,
        }
    return pd.DataFrame(rows).T.round(3)


def joined(*tests: Rows) -> Rows:
    """Return several test sets as one."""
    names = ("X", "y", "truth")
    return Rows(*(np.concatenate([getattr(rows, name) for rows in tests]) for name in names))
