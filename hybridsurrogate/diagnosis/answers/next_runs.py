"""Where further runs of the simulation would reduce the uncertainty of its emulator most."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.types import FloatArray

# draws of each posterior, places of them that count, probability below which alternatives do not
_DRAWS, _PLACES, _UNLIKELY = 60, 500, 0.02


def next_runs(
    result: Search, posteriors: Sequence[Posterior], n: int, names: Sequence[str]
) -> pd.DataFrame:
    """Return the n runs that reduce uncertainty most where the models ask for the simulation.

    Each in turn reduces the remaining variance most, on average over draws of the posteriors and
    the best fits of the alternatives (Cohn 1996, Neural Networks 9:1071; as
    active learning of a Gaussian process: Gramacy 2020, Surrogates, section 6.2).

    Parameters
    ----------
    result : Search
    posteriors : sequence of Posterior
        Of the models before and after.
    n : int
    names : sequence of str
        Inputs, parameters and assumed constants.

    Returns
    -------
    DataFrame of n rows
        Where runs are curves without the input along which they are.

    Raises
    ------
    ValueError
        Where the simulation is run itself, or its surrogate has no uncertainty.
    """
    basis, X = result.problem.model.basis, result.problem.X
    if not basis.leaves_open:
        raise ValueError(
            "The simulation is run itself, or its emulator has no uncertainty: no further run "
            "would add information."
        )
    asked = [
        model.places(X[:, : len(model.columns)], values)
        for model, values in _models(result, posteriors)
    ]
    inputs, omega = (np.concatenate(parts) for parts in zip(*asked, strict=True))
    kept = basis.of_runs(np.arange(float(inputs.shape[1]))[None])[0].astype(int).tolist()
    runs = np.unique(np.hstack([inputs[:, kept], omega]), axis=0)
    if len(runs) > _PLACES:
        runs = runs[np.random.default_rng(0).choice(len(runs), _PLACES, replace=False)]
    chosen = _settling(basis.open_at(runs[:, : len(kept)], runs[:, len(kept) :]), n)
    columns = [names[k] for k in kept] + list(names[inputs.shape[1] :])
    return pd.DataFrame(runs[chosen], columns=columns)


def _models(
    result: Search, posteriors: Sequence[Posterior]
) -> list[tuple[MeasuredModel, FloatArray]]:
    """Return models and draws of their values: of posteriors, and best fits of alternatives."""
    out: list[tuple[MeasuredModel, FloatArray]] = []
    for posterior in posteriors:
        rows = np.unique(np.linspace(0, posterior.n_draws - 1, _DRAWS).astype(int))
        out.append((posterior.model, posterior.values[rows]))
    for w, probability in zip(result.candidates, result.probability, strict=True):
        if probability > _UNLIKELY:
            out.append((w.fit.model, w.fit.values))
    return out


def _settling(covariance: FloatArray, n: int) -> NDArray[np.intp]:
    """Return n of the rows of a covariance, the one that takes most from all variances first."""
    left = covariance.copy()
    chosen: list[int] = []
    least = 1e-9 * float(np.max(np.diagonal(covariance), initial=0.0))
    for _ in range(min(n, len(left))):
        variance = np.diagonal(left)
        gain = np.sum(left**2, axis=0) / np.maximum(variance, least)
        gain[chosen] = -np.inf
        k = int(np.argmax(gain))
        chosen.append(k)
        left = left - np.outer(left[:, k], left[k]) / max(float(variance[k]), least)
    return np.array(chosen, dtype=np.intp)
