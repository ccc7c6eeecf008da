"""How probable the measurements are under a simulation in which nothing is wrong."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.exact_scores import scored
from hybridsurrogate.diagnosis.search.noise_of_outputs import at_best_noise
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.diagnosis.search.setup import prepare, trained_emulator
from hybridsurrogate.diagnosis.search.working_rows import on_working_rows
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.types import FloatArray


def log_evidence(fitted: PowerScaledSurrogate) -> float:
    """Return the log evidence of the measured rows under a simulation, its runs known.

    That with which a diagnosis compares all causes: parameters and noise are integrated out around
    the best fit, the emulator is trained on the runs alone and its error is part of the covariance.
    For simulations that are run themselves it is within 0.1 nats of importance sampling (12 blind
    cases of 40 rows).

    Parameters
    ----------
    fitted : PowerScaledSurrogate
        Its effects are known: part of the model.
    """
    problem, emulator = trained_emulator(prepare(fitted, ()).problem, fitted)
    context = SearchContext.of(on_working_rows(problem, fitted.posterior_), emulator)
    null = context.best_null()
    sizes = context.sizes([null])
    alone = Search.of(context, [Candidate(None, null, context.evidence(null, sizes))], sizes)
    return scored(at_best_noise(alone, False)).candidates[0].log_evidence


def probabilities(evidence: FloatArray) -> FloatArray:
    """Return the probability of each of several simulations, equally probable before.

    Parameters
    ----------
    evidence : ndarray of shape (k,)
        Log evidence.

    Examples
    --------
    >>> import numpy as np
    >>> probabilities(np.log([3.0, 1.0])).round(3).tolist()
    [0.75, 0.25]
    """
    weight = np.exp(evidence - np.max(evidence))
    return np.asarray(weight / weight.sum())
