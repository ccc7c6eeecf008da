"""Draws and measured rows for ArviZ of either generation: the only file that imports it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.posterior import Posterior
from hybridsurrogate.priors import FloatArray


def arviz_of(
    posteriors: Sequence[Posterior],
    followed: Sequence[NDArray[np.bool_]] | None,
    X: FloatArray,
    y: FloatArray,
    random: np.random.RandomState,
) -> Any:
    """Return an ArviZ object of the draws of all posteriors and of measured rows.

    It has what the posteriors have in common: posterior, log likelihood, posterior predictive and
    observed data. ``followed`` says which posterior a draw follows at each row, (S, n); what it
    draws once is that of the posterior which it follows most. None: draws come one after the other.
    """

    def joined(parts: Sequence[FloatArray], chosen: NDArray[np.intp] | None) -> FloatArray:
        if chosen is None:
            return np.concatenate(parts)
        each = np.stack(parts)
        index = chosen.reshape(1, *chosen.shape, *[1] * (each.ndim - 1 - chosen.ndim))
        return np.take_along_axis(each, index, axis=0)[0]

    at_rows = None if followed is None else np.argmax(followed, axis=0)
    once = None if followed is None else np.argmax(np.sum(followed, axis=2), axis=0)
    told: list[FloatArray] = []
    drawn: list[FloatArray] = []
    for p in posteriors:
        eta, sigma = p.eta(X)
        told.append(p.likelihood.log_density(y, eta, sigma))
        drawn.append(p.likelihood.sample(eta, sigma, random))
    named = [p.named() for p in posteriors]
    shared = [k for k in named[0] if all(k in other for other in named)]
    # ArviZ calls its dimensions so and would drop what has their names
    posterior = {
        f"parameter_{k}" if k in ("chain", "draw") else k: joined(
            [other[k] for other in named], once
        )
        for k in shared
        if len({other[k].shape[1:] for other in named}) == 1
    }
    return arviz_groups(
        {
            "posterior": posterior,
            "log_likelihood": {"y": joined(told, at_rows)},
            "posterior_predictive": {"y": joined(drawn, at_rows)},
            "observed_data": {"y": y},
        }
    )


def arviz_groups(groups: dict[str, dict[str, FloatArray]]) -> Any:
    """Return an ArviZ object with the given groups; draws come first in every array.

    ArviZ before 1.0 takes groups as keywords and returns InferenceData, later versions take one
    nested dict and return a DataTree.
    """
    with warnings.catch_warnings():
        # ArviZ 0.x announces its own successor at import
        warnings.simplefilter("ignore", FutureWarning)
        import arviz

    shaped = {
        group: {
            name: (value if group == "observed_data" else value[None])
            for name, value in variables.items()
        }
        for group, variables in groups.items()
    }
    # by number: 1.x warns when it is asked for the names of 0.x
    if arviz.__version__.startswith("0."):
        return arviz.from_dict(**shaped)
    return arviz.from_dict(shaped)
