"""Draws by name with their priors, and the estimates of a fitted estimator as a table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import norm

from hybridsurrogate.effects.parameters.parameter_by_experiment import ParameterByExperiment
from hybridsurrogate.model.posterior import Diagnostics, Posterior
from hybridsurrogate.types import FloatArray, Prior

# values of other variables by name
Values = Mapping[str, FloatArray]


@dataclass(frozen=True)
class Variable:
    """Draws of one unknown.

    Attributes
    ----------
    name : str
    values : ndarray of shape (S, ...)
    log_prior : ndarray of the shape of values, or None
        Log prior density of each draw, given the variables before; None where the draws are of
        step 1 alone, in which this is no prior of the measured rows.
    prior_of : callable or None
        Takes uniform numbers (N, ...) and prior draws of the variables before, returns prior draws.
    column : str or None
        The measured column of experiments.
    labels : tuple of str
        What the values along the last axis belong to; empty for a single value.
    """

    name: str
    values: FloatArray
    log_prior: FloatArray | None = None
    prior_of: Callable[[FloatArray, Values], FloatArray] | None = None
    column: str | None = None
    labels: tuple[str, ...] = ()


def variables_of(posterior: Posterior, noise_prior: Prior) -> list[Variable]:
    """Return all unknowns that the measured rows inform.

    A parameter with a value for each experiment has these values and no other; one that is spread
    has its mean and the standard deviation between experiments before them, as ``p_mean`` and
    ``p_spread``. Unknowns that are drawn from their priors alone are left out.

    Parameters
    ----------
    posterior : Posterior
    noise_prior : prior of sigma
    """
    model = posterior.model
    named = posterior.named()
    names, draws = list(named), posterior.values.T
    differing = {
        effect.parameter: k
        for k, effect in enumerate(model.effects)
        if isinstance(effect, ParameterByExperiment)
    }
    out: list[Variable] = []
    # numbers of causes come between the parameters and what the surrogate has
    owners = dict(enumerate((owner for owner, _ in model.theta_names), start=model.n_parameters))
    for k, (values, prior) in enumerate(zip(draws, model.all_priors, strict=True)):
        owner = owners.get(k)
        if k < model.n_parameters and names[k] in differing:
            out += _by_experiment(posterior, differing[names[k]], values)
        elif owner is None or (owner not in differing.values() and model.effects[owner].is_learned):
            out.append(_single(names[k], values, prior))
    rest = {name: values for name, values in named.items() if name not in names[: len(draws)]}
    for name, values in rest.items():
        if name.endswith("effect_coefficients"):
            learned = [model.effects[owner].is_learned for owner, _ in model.column_names]
            sd = model.column_sd[learned]
            if len(sd):
                out.append(_columns(name, values[:, learned], sd))
        elif values.ndim == 1:
            out.append(_single(name, values, noise_prior))
        else:
            out.append(Variable(name, values))
    return out


def prior_draws(
    variables: list[Variable], n: int, random_state: np.random.RandomState
) -> dict[str, FloatArray]:
    """Return n draws from the priors of all variables that have one, by name.

    Parameters
    ----------
    variables : list of Variable
    n : int
    random_state : RandomState
    """
    drawn: dict[str, FloatArray] = {}
    for one in variables:
        if one.prior_of is not None:
            u = random_state.uniform(size=(n, *one.values.shape[1:]))
            drawn[one.name] = one.prior_of(u, drawn)
    return drawn


def _single(name: str, values: FloatArray, prior: Prior) -> Variable:
    with np.errstate(divide="ignore"):
        log_prior = np.asarray(prior.logpdf(values))
    return Variable(name, values, log_prior, lambda u, _: np.asarray(prior.ppf(u)))


def _columns(name: str, values: FloatArray, sd: FloatArray) -> Variable:
    return Variable(name, values, norm.logpdf(values, 0, sd), lambda u, _: norm.ppf(u, 0, sd))


def _by_experiment(posterior: Posterior, k: int, mean: FloatArray) -> list[Variable]:
    """Return the values of a parameter in each experiment, after their mean and spread."""
    model = posterior.model
    effect = model.effects[k]
    assert isinstance(effect, ParameterByExperiment)
    assert effect.prior is not None
    name, prior, column = effect.parameter, effect.prior, effect.column
    estimates = posterior.estimates(k)
    each = np.column_stack([estimates[own] for own in estimates if own != "spread"])
    labels = tuple(own.removeprefix(f"{column} = ") for own in estimates if own != "spread")
    if effect.how == "own":
        log_prior = np.asarray(prior.logpdf(each))
        return [
            Variable(name, each, log_prior, lambda u, _: np.asarray(prior.ppf(u)), column, labels)
        ]
    spread: FloatArray = estimates["spread"]
    low, high = prior.support()
    out = [_single(f"{name}_mean", mean, prior)]
    if "spread" in effect.parameters:
        out.append(_single(f"{name}_spread", spread, effect.parameters["spread"]))
    with np.errstate(divide="ignore", invalid="ignore"):
        log_prior = norm.logpdf(each, 0, spread[:, None])

    def of_prior(u: FloatArray, before: Values) -> FloatArray:
        sd = before.get(f"{name}_spread", np.full(len(u), spread[0]))
        values = before[f"{name}_mean"][:, None] + sd[:, None] * norm.ppf(u)
        return np.clip(values, low, high)

    values = np.clip(mean[:, None] + each, low, high)
    return [*out, Variable(name, values, log_prior, of_prior, column, labels)]


class MixturePart(NamedTuple):
    """One of the posteriors that are mixed, its weight, and how its draws were made."""

    weight: float
    posterior: Posterior
    diagnostics: Diagnostics
    noise_prior: Prior


_COLUMNS = ("name", "experiment", "cause", "mean", "sd", "q5", "q95", "ess", "khat", "source")


def summary_of(parts: Sequence[MixturePart]) -> pd.DataFrame:
    """Return estimates by name: see ``summary`` of the estimators.

    Parameters
    ----------
    parts : sequence of MixturePart
    """
    tables = []
    for k, part in enumerate(parts):
        # a count that is fitted without a simulation has no unknown with a name
        table = pd.DataFrame(_rows(part), columns=_COLUMNS)
        if len(parts) > 1:
            table = table.assign(model=k, weight=part.weight)
        tables.append(table)
    return pd.concat(tables, ignore_index=True).set_index("name")


def _rows(part: MixturePart) -> list[dict[str, object]]:
    posterior = part.posterior
    model, rows = posterior.model, []
    # causes report their own numbers, in the user's units
    own = {*posterior.named()} - {*model.parameters, "sigma", "noise_sigma"}
    for one in variables_of(posterior, part.noise_prior):
        if one.labels:
            for k, label in enumerate(one.labels):
                name = f"{one.name}[{label}]"
                rows.append(_row(name, one.values[:, k], part, experiment=label))
        elif one.name not in own and one.values.ndim == 1:
            rows.append(_row(one.name, one.values, part))
    if model.errors is not None and model.errors.kind == "scaled":
        rows.append(_row("error_factor", posterior.sigma / model.errors.unit, part))
    for k, effect in enumerate(model.effects):
        if not isinstance(effect, ParameterByExperiment):
            for name, values in posterior.estimates(k).items():
                source = "data" if effect.is_learned else "prior"
                rows.append(_row(name, values, part, cause=effect.name, source=source))
    return rows


def _row(
    name: str,
    values: FloatArray,
    part: MixturePart,
    *,
    experiment: str = "",
    cause: str = "",
    source: str = "data",
) -> dict[str, object]:
    found, learned = part.diagnostics, source == "data"
    khat = np.array([found.khat, found.second_khat])
    khat = khat[~np.isnan(khat)]
    effective = min(found.effective_draws, float(len(values)))
    return {
        "name": name,
        "experiment": experiment,
        "cause": cause,
        "mean": float(np.mean(values)),
        "sd": float(np.std(values, ddof=1)),
        "q5": float(np.quantile(values, 0.05)),
        "q95": float(np.quantile(values, 0.95)),
        "ess": effective if learned else np.nan,
        "khat": float(khat.max()) if learned and len(khat) else np.nan,
        "source": source,
    }
