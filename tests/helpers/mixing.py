"""One fit of predictive weighting, looked at from other weights."""

import copy


def at_weight(mixture, beta):
    """Return a fitted mixture with the same two posteriors at another weight."""
    out = copy.copy(mixture)
    out.beta_ = beta
    return out
