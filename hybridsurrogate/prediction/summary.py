"""The estimates of a fitted estimator as a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from hybridsurrogate.effects.parameters.parameter_by_experiment import ParameterByExperiment
from hybridsurrogate.model.posterior import Diagnostics, Posterior
from hybridsurrogate.prediction.variables import variables_of
from hybridsurrogate.types import FloatArray, Prior


class MixturePart(NamedTuple):
    """One of the posteriors that are mixed, its weight, and how its draws were made."""

    weight: float
    posterior: Posterior
    diagnostics: Diagnostics
    noise_prior: Prior


def summary_of(parts: Sequence[MixturePart]) -> pd.DataFrame:
    """Return estimates by name: see ``summary`` of the estimators.

    Parameters
    ----------
    parts : sequence of MixturePart
    """
    tables = []
    for k, part in enumerate(parts):
        table = pd.DataFrame(_rows(part))
        if len(parts) > 1:
            table = table.assign(model=k, weight=part.weight)
        tables.append(table)
    return pd.concat(tables, ignore_index=True).set_index("name")


def _rows(part: MixturePart) -> list[dict[str, object]]:
    posterior = part.posterior
    model, rows = posterior.model, []
    # causes report their own numbers, in the user's units
    own = {*posterior.named()} - {*model.parameters, "sigma", "noise_sigma"}
    for one in variables_of(posterior, part.noise_prior):
        if one.labels:
            for k, label in enumerate(one.labels):
                name = f"{one.name}[{label}]"
                rows.append(_row(name, one.values[:, k], part, experiment=label))
        elif one.name not in own and one.values.ndim == 1:
            rows.append(_row(one.name, one.values, part))
    if model.errors is not None and model.errors.kind == "scaled":
        rows.append(_row("error_factor", posterior.sigma / model.errors.unit, part))
    for k, effect in enumerate(model.effects):
        if not isinstance(effect, ParameterByExperiment):
            for name, values in posterior.estimates(k).items():
                source = "data" if effect.is_learned else "prior"
                rows.append(_row(name, values, part, cause=effect.name, source=source))
    return rows


def _row(
    name: str,
    values: FloatArray,
    part: MixturePart,
    *,
    experiment: str = "",
    cause: str = "",
    source: str = "data",
) -> dict[str, object]:
    found, learned = part.diagnostics, source == "data"
    khat = np.array([found.khat, found.second_khat])
    khat = khat[~np.isnan(khat)]
    effective = min(found.effective_draws, float(len(values)))
    return {
        "name": name,
        "experiment": experiment,
        "cause": cause,
        "mean": float(np.mean(values)),
        "sd": float(np.std(values, ddof=1)),
        "q5": float(np.quantile(values, 0.05)),
        "q95": float(np.quantile(values, 0.95)),
        "ess": effective if learned else np.nan,
        "khat": float(khat.max()) if learned and len(khat) else np.nan,
        "source": source,
    }
