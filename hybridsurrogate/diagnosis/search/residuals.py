"""Whether what a model leaves of the measured rows looks like noise.

Replicates of noise are fitted by the linearised model as the measured rows were, so that the
freedom of the fit is in what they leave, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.search import (
    Search,
    local_posterior,
    measured_and_other,
    size_of,
)
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.types import FloatArray

# of causes that are right so many are called the nearest one
RESIDUAL_LEVEL = 0.05
# sets of noise that residuals are compared with
_REPLICATES = 999
# slow waves over a column, from a half to two over its range
_N_WAVES = 4


@dataclass(frozen=True)
class ResidualCheck:
    """Residuals of a model compared with replicated noise.

    Attributes
    ----------
    p_value : float
        The chance that noise alone has one statistic as extreme as the most extreme one here.
    statistics : dict of str to float
        The chance of each: "neighbours over t" (correlation of neighbouring rows), "curve over t"
        (power of slow waves), "spread over t" (change of the spread), "tails" (kurtosis).
    """

    p_value: float
    statistics: dict[str, float]

    @property
    def worst(self) -> str:
        """The statistic with the least chance."""
        return min(self.statistics, key=lambda name: self.statistics[name])


def check_residuals(result: Search, w: Candidate) -> ResidualCheck | None:
    """Return how probable it is that noise leaves residuals as strange as those of a cause.

    None where the noise is not normal: with outliers, and under other likelihoods.

    Parameters
    ----------
    result : Search
    w : Candidate
        Of its candidates.
    """
    if result.problem.working_point is not None or (w.cause and "outliers" in w.cause.acts_on):
        return None
    left = _left(result, w)
    X, columns = result.problem.X, result.problem.model.columns
    found: dict[str, FloatArray] = {}
    for k, name in enumerate(columns):
        if name == OUTPUT or len(np.unique(X[:, k])) < 2 * _N_WAVES:
            continue
        # of several outputs one after the other
        outputs = X[:, columns.index(OUTPUT)] if OUTPUT in columns else np.zeros(len(X))
        for word, statistic in _along(left[:, np.lexsort((X[:, k], outputs))]).items():
            found[f"{word} over {name}"] = statistic
    found["tails"] = np.mean(left**4, axis=1)
    values = np.array(list(found.values()))
    # the share of all that are as extreme: of the measured rows, and of each replicate
    ranks = np.argsort(np.argsort(-values, axis=1), axis=1) + 1
    shares = ranks / values.shape[1]
    least = shares.min(axis=0)
    p_value = float(np.mean(least <= least[0]))
    return ResidualCheck(p_value, dict(zip(found, shares[:, 0].tolist(), strict=True)))


def has_residual_structure(result: Search, w: Candidate, check: ResidualCheck | None) -> bool:
    """Return whether residual structure remains: in the residuals, or given a smooth curve.

    Parameters
    ----------
    result : Search
    w : Candidate
        Of its candidates, or one that came later.
    check : ResidualCheck or None
        Of it.
    """
    place = [other is w for other in result.candidates]
    remainder = float(result.remainder[place.index(True)]) if any(place) else 0.0
    return remainder > 0.5 or (check is not None and check.p_value <= RESIDUAL_LEVEL)


def _left(result: Search, w: Candidate) -> FloatArray:
    """Return what the model leaves of the measured rows, then of noise, (1 + R, n), scaled."""
    rows, _ = measured_and_other(result, w, result.problem.X[:0])
    is_path = w.cause is not None and w.cause.is_correlated_noise
    # a curve that is drawn towards zero would leave a share of itself
    size = size_of(result, w) if is_path else float(result.sizes[-1])
    design = rows.design / rows.noise[:, None]
    target = (result.problem.y - rows.offset) / rows.noise
    local = local_posterior(result, w, rows, size)
    for _ in range(SETTINGS.optimiser_steps if is_path else 0):
        # expectation and maximisation: the remaining noise given a path of this size. Without, the
        # p-values of two measured sets (casualties, beaver) are 0.09 and 0.03, not 0.55 and 0.09
        squares = (target - design @ local.mean) ** 2
        squares = squares + np.sum(design @ local.covariance * design, axis=1)
        w = w._replace(fit=w.fit._replace(sigma=float(np.sqrt(np.mean(squares)))))
        local = local_posterior(result, w, rows, size)
    measured = target - design @ local.mean
    # a fixed stream: a verdict is reproducible
    random = np.random.RandomState(0)
    noise = random.standard_normal((_REPLICATES, len(measured)))
    if is_path:
        # a path leaves a share of itself, in the replicates as in the measured rows
        path = design[:, rows.first :]
        path = path * size / w.fit.sigma / np.sqrt(np.mean(np.sum(path**2, axis=1)))
        noise += random.standard_normal((_REPLICATES, path.shape[1])) @ path.T
    fitted = noise @ design @ local.covariance @ design.T / w.fit.sigma**2
    left = np.vstack([measured, noise - fitted])
    scale = np.sqrt(np.mean(left**2, axis=1, keepdims=True))
    return np.asarray(left / np.maximum(scale, np.finfo(float).tiny))


def _along(left: FloatArray) -> dict[str, FloatArray]:
    """Return statistics of residuals (R, n) along a column, each (R,)."""
    waves = fft.dct(left, axis=1, norm="ortho")[:, 1 : 1 + _N_WAVES]
    return {
        "neighbours": np.mean(left[:, 1:] * left[:, :-1], axis=1),
        "curve": np.sum(waves**2, axis=1),
        "spread": np.abs(np.abs(left) @ np.linspace(-1, 1, left.shape[1])),
    }
