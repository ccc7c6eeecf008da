"""Predictions averaged over what may be the cause."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np

from hybridsurrogate.diagnosis.answers.unknown_beyond import with_remainder
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.estimators.averaged import AveragedSurrogate
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.exceptions import DiagnosisWarning, HybridSurrogateWarning

# what is less probable is not averaged over: on cases outside the catalogue that costs 0.01 nats a
# row beyond the data (standard error 0.01), and takes less than half of the fits
_LEAST = 0.05

Causes = tuple[Cause, ...]


def averaged_over(
    steps: Sequence[SearchStep],
    before: PowerScaledSurrogate,
    fitted: Callable[[Causes], PowerScaledSurrogate],
) -> AveragedSurrogate:
    """Return the average over possible causes, by probability, the accepted ones first.

    Each extension keeps a remainder beyond the measured range, as large as what it changes. A
    `DiagnosisWarning` lists what cannot be fitted together with the first.

    Parameters
    ----------
    steps : sequence of SearchStep
        Accepted.
    before : PowerScaledSurrogate
        Fitted without effects.
    fitted : callable
        Returns the estimator fitted with causes as effects.
    """
    sets, shares = explanations(steps)

    def reaching(causes: Causes) -> PowerScaledSurrogate:
        model = fitted(causes)
        # excluded rows carry no information on the simulation elsewhere
        in_data = all(cause.concerns == "data" for cause in causes)
        return model if in_data else with_remainder(before, model)

    models, weights = [reaching(sets[0])], shares[:1]
    for causes, share in zip(sets[1:], shares[1:], strict=True):
        try:
            with warnings.catch_warnings():
                # of the rows the first fit has warned; doubtful draws are in the report
                warnings.simplefilter("ignore", HybridSurrogateWarning)
                model = reaching(causes) if causes else before
        except ValueError as error:
            warnings.warn(
                f"{' and '.join(cause.name for cause in causes)}, with {100 * share:.0f} % of the "
                f"probability, could not be fitted and is not averaged over: {error}",
                DiagnosisWarning,
                stacklevel=6,
            )
            continue
        models.append(model)
        weights.append(share)
    return AveragedSurrogate.of_fitted(models, weights, before.random_state)


def explanations(steps: Sequence[SearchStep]) -> tuple[list[Causes], list[float]]:
    """Return the sets of causes that have at least 5 % of the probability, and their shares of it.

    The accepted ones come first; in each further one another cause, or none, stands
    in place of one of them. The probability of the others is conditional on those that stay, which
    gives their ratio to that of the accepted causes. Correlated noise stays with the causes
    that were compared given it and need it.

    Parameters
    ----------
    steps : sequence of SearchStep
        Accepted.
    """
    found = tuple(step.chosen.cause for step in steps if step.chosen.cause is not None)
    sets, ratios = [found], [1.0]
    for k, step in enumerate(steps):
        search = step.conditional
        held = [id(effect) for effect in search.problem.model.effects]
        free = [c for c in found if id(c) not in held and c is not found[k]]
        if not all(cause.is_correlated_noise for cause in free):
            continue
        others = _without(found, free)
        at = next(i for i, w in enumerate(search.candidates) if w.cause is found[k])
        for i, candidate in enumerate(search.candidates):
            if i == at:
                continue
            own = () if candidate.cause is None else (candidate.cause,)
            causes = tuple(c for old in others for c in (own if old is found[k] else (old,)))
            noise = _correlated_noise(search) if search.correlated[i] > 0.5 else ()
            sets.append((*causes, *noise))
            ratios.append(float(search.probability[i] / search.probability[at]))
    shares = np.array(ratios) / np.sum(ratios)
    # the accepted ones come first, even where a cause was chosen for what it explains with a second
    order = [0, *(1 + np.argsort(-shares[1:], kind="stable"))]
    kept = [i for i in order if i == 0 or shares[i] >= _LEAST]
    return [sets[i] for i in kept], [float(shares[i]) for i in kept]


def _correlated_noise(search: Search) -> Causes:
    """Return the noise given which the causes of a search were compared."""
    paths = [
        (w.log_evidence, w.cause)
        for w in search.candidates
        if w.cause is not None and w.cause.is_correlated_noise
    ]
    return (max(paths, key=lambda path: path[0])[1],)


def _without(causes: Causes, left_out: Sequence[Cause]) -> Causes:
    return tuple(c for c in causes if all(c is not other for other in left_out))
