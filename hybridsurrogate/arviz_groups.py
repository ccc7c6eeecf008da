"""Draws and measured rows for ArviZ of either generation: the only file that imports it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.prediction.variables import Variable, prior_draws, variables_of
from hybridsurrogate.types import FloatArray, Prior


def arviz_of(
    posteriors: Sequence[Posterior],
    noise_priors: Sequence[Prior],
    followed: Sequence[NDArray[np.bool_]] | None,
    X: FloatArray,
    y: FloatArray,
    random: np.random.RandomState,
) -> Any:
    """Return an ArviZ object of the draws of all posteriors and of measured rows.

    It has what the posteriors have in common: posterior, prior, log likelihood, log prior,
    posterior predictive and observed data. ``followed`` says which posterior a draw follows at each
    row, (S, n); what it draws once is that of the posterior which it follows most. None: draws come
    one after the other.
    """

    def joined(parts: Sequence[FloatArray], chosen: NDArray[np.intp] | None) -> FloatArray:
        if chosen is None:
            return np.concatenate(parts)
        each = np.stack(parts)
        index = chosen.reshape(1, *chosen.shape, *[1] * (each.ndim - 1 - chosen.ndim))
        return np.take_along_axis(each, index, axis=0)[0]

    at_rows = None if followed is None else np.argmax(followed, axis=0)
    once = None if followed is None else np.argmax(np.sum(followed, axis=2), axis=0)
    density: list[FloatArray] = []
    drawn: list[FloatArray] = []
    for p in posteriors:
        eta, sigma = p.eta(X)
        density.append(p.likelihood.log_density(y, eta, sigma))
        drawn.append(p.likelihood.sample(eta, sigma, random))
    pairs = zip(posteriors, noise_priors, strict=True)
    first, *others = ({v.name: v for v in variables_of(p, prior)} for p, prior in pairs)
    shared = {
        name: [first[name], *(other[name] for other in others)]
        for name in first
        if all(_alike(first[name], other.get(name)) for other in others)
    }
    # ArviZ would drop what is called like its dimensions
    own = ("chain", "draw")
    names = {name: f"parameter_{name}" if name in own else name for name in shared}
    of_prior = prior_draws(list(first.values()), posteriors[0].n_draws, random)
    columns = {v.column: v.labels for v in first.values() if v.column is not None}
    taken = {*own, *names.values()}
    dimension = {column: f"{column}_label" if column in taken else column for column in columns}
    return arviz_groups(
        {
            "posterior": {
                names[k]: joined([v.values for v in each], once) for k, each in shared.items()
            },
            "prior": {names[k]: of_prior[k] for k in shared if k in of_prior},
            "log_likelihood": {"y": joined(density, at_rows)},
            "log_prior": {
                names[k]: joined([v.log_prior for v in each if v.log_prior is not None], once)
                for k, each in shared.items()
                if all(v.log_prior is not None for v in each)
            },
            "posterior_predictive": {"y": joined(drawn, at_rows)},
            "observed_data": {"y": y},
        },
        {names[k]: dimension[each[0].column] for k, each in shared.items() if each[0].column},
        {dimension[column]: labels for column, labels in columns.items()},
    )


def _alike(one: Variable, other: Variable | None) -> bool:
    if other is None:
        return False
    return one.values.shape[1:] == other.values.shape[1:] and one.labels == other.labels


def arviz_groups(
    groups: dict[str, dict[str, FloatArray]],
    dims: dict[str, str] | None = None,
    labels: dict[str, tuple[str, ...]] | None = None,
) -> Any:
    """Return an ArviZ object with the given groups; draws come first in every array.

    ArviZ before 1.0 takes groups as keywords and returns InferenceData, later versions take one
    nested dict and return a DataTree. ``dims`` names the last dimension of variables, ``labels``
    the places along it.
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
        if variables
    }
    named = {
        "dims": {name: [dimension] for name, dimension in (dims or {}).items()},
        "coords": {name: list(places) for name, places in (labels or {}).items()},
    }
    # by number: 1.x warns when it is asked for the names of 0.x
    if not arviz.__version__.startswith("0."):
        return arviz.from_dict(shaped, **named)
    # 0.x converts no such group by itself
    log_prior = shaped.pop("log_prior", None)
    data = arviz.from_dict(**shaped, **named)
    if log_prior is not None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            data.add_groups({"log_prior": log_prior}, **named)
    return data
