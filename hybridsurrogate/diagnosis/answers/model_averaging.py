"""Predictions that do not bet on one name: averaged over what may be the cause."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import clone

from hybridsurrogate.diagnosis.search.evidence import Search
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.estimators.averaged import AveragedSurrogate
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate

# the fewest causes that together have so much of the probability
_MASS = 0.95


def averaged_over(
    result: Search,
    before: PowerScaledSurrogate,
    after: PowerScaledSurrogate,
    earlier: tuple[Cause, ...],
    X: ArrayLike,
    y: ArrayLike,
) -> AveragedSurrogate:
    """Return the average over the extensions by each probable cause, and by none, fitted.

    Parameters
    ----------
    result : Search
        Its causes were weighed beside ``earlier``.
    before, after : PowerScaledSurrogate
        Without effects, and the extension, whose remainder all extensions keep.
    earlier : tuple of Cause
        Accepted before, part of every extension.
    X, y
        Measured data as the user gave them.
    """
    order = np.argsort(-result.probability, kind="stable")
    n = int(np.searchsorted(np.cumsum(result.probability[order]), _MASS)) + 1
    models = []
    beyond = tuple(effect for effect in after.effects if not effect.is_learned)
    for candidate in (result.candidates[k] for k in order[:n]):
        effects = (*earlier, candidate.cause) if candidate.cause is not None else earlier
        models.append(clone(before).set_params(effects=(*effects, *beyond) if effects else ()))
    weights = result.probability[order[:n]]
    return AveragedSurrogate(models, weights.tolist(), before.random_state).fit(X, y)
