"""Parameters that the data push against the end of their prior."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hybridsurrogate.posterior import Posterior

# the outermost share of a prior that holds so much of a posterior
_OUTERMOST, _HELD = 0.02, 0.9


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
    """Return the parameters of which 90 % of the posterior lies in the outermost 2 % of the prior.

    Parameters
    ----------
    posterior : Posterior
    """
    out = []
    pairs = zip(posterior.model.parameters.items(), posterior.values.T, strict=False)
    for (name, prior), draws in pairs:
        share = prior.cdf(draws)
        mean = float(np.mean(draws))
        if np.mean(share < _OUTERMOST) > _HELD:
            out.append(AtPriorEnd(name, "low", mean, float(prior.ppf(_OUTERMOST))))
        elif np.mean(share > 1 - _OUTERMOST) > _HELD:
            out.append(AtPriorEnd(name, "high", mean, float(prior.ppf(1 - _OUTERMOST))))
    return out
