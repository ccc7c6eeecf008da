"""Parameters that the data push against the end of their prior."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.types import FloatArray, Prior

# the outermost share of a prior that holds so much of a posterior
_OUTERMOST, _HELD = 0.02, 0.9
# mean distance from the end over standard deviation: 1 of a density that falls off exponentially
# from there, 1.32 of half a normal one, 1.73 of a uniform one
_PILED_UP = 1.5


class AtPriorEnd(NamedTuple):
    """A parameter at the end of its prior.

    Attributes
    ----------
    name : str
    side : {"low", "high"}
    mean : float
        Of the posterior.
    end : float
        The value beyond which the prior has 2 % of its mass.
    """

    name: str
    side: str
    mean: float
    end: float


def at_prior_ends(posterior: Posterior) -> list[AtPriorEnd]:
    """Return the parameters whose prior keeps the posterior from going further.

    The posterior is piled up at an end of the prior's support or, of a prior without ends, 90 % of
    it lie in the outermost 2 % of the prior.

    Parameters
    ----------
    posterior : Posterior
    """
    model = posterior.model
    return _at_ends(zip(model.parameters.items(), posterior.values.T, strict=False))


def effects_at_prior_ends(posterior: Posterior, n: int) -> list[AtPriorEnd]:
    """Return what of the first n effects the data push against an end of its prior.

    Parameters
    ----------
    posterior : Posterior
    n : int
    """
    model, found = posterior.model, []
    for position, (owner, name) in enumerate(model.theta_names, start=model.n_parameters):
        if owner < n:
            word = f"{name} of {model.effects[owner].name}"
            found.append(((word, model.priors[position]), posterior.values[:, position]))
    return _at_ends(found)


def _at_ends(found: Iterable[tuple[tuple[str, Prior], FloatArray]]) -> list[AtPriorEnd]:
    out = []
    for (name, prior), draws in found:
        for side in ("low", "high"):
            if _pushed(prior, draws, side):
                end = float(prior.ppf(_OUTERMOST if side == "low" else 1 - _OUTERMOST))
                out.append(AtPriorEnd(name, side, float(np.mean(draws)), end))
                break
    return out


def _pushed(prior: Prior, draws: FloatArray, side: str) -> bool:
    below = prior.cdf(draws)
    share = below if side == "low" else 1 - below
    if np.mean(share < _OUTERMOST) > _HELD:
        return True
    end = prior.support()[side == "high"]
    sd = float(np.std(draws))
    usual = float(np.diff(prior.ppf([0.16, 0.84]))[0]) / 2
    return bool(abs(float(np.mean(draws)) - end) < _PILED_UP * sd < _PILED_UP * usual / 2)
