"""From a fitted estimator to what a search needs: the problem, the causes, the emulator."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from sklearn.base import clone

from hybridsurrogate.catalogue import Skipped, catalogue
from hybridsurrogate.diagnosis.search.processes import at_noise_of
from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.effects.context import position_among
from hybridsurrogate.effects.noise.known_errors import Jitter, SharedErrors
from hybridsurrogate.effects.parameters.parameter_by_experiment import ParameterByExperiment
from hybridsurrogate.effects.wrapped import prepared_for
from hybridsurrogate.emulators.conditioned import krige
from hybridsurrogate.estimators.power_scaled import FitTask, PowerScaledSurrogate, as_causes
from hybridsurrogate.exceptions import DiagnosisWarning
from hybridsurrogate.inference.procedure import at_prior_ends
from hybridsurrogate.model.context import check_effects
from hybridsurrogate.model.posterior import FEW_DRAWS, Posterior
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.statistics import EmulatorPosterior, emulator_posterior
from hybridsurrogate.priors import to_normal
from hybridsurrogate.simulation.arrays import is_whole
from hybridsurrogate.simulation.simulator import SimulationData
from hybridsurrogate.types import FloatArray


class Prepared(NamedTuple):
    """The measured rows as a problem without effects, and the causes to compare on it.

    Attributes
    ----------
    problem : Problem
    causes : list of Cause
        Prepared.
    skipped : list of Skipped
        What cannot be compared, with reasons.
    unusable : list of Skipped
        Those of the user.
    """

    problem: Problem
    causes: list[Cause]
    skipped: list[Skipped]
    unusable: list[Skipped]

    def warn(self) -> None:
        """Warn of user-defined causes that cannot be compared."""
        for left in self.unusable:
            name = f"{left.kind}({left.target})" if left.target else left.kind
            warnings.warn(
                f"Your cause {name!r} was not compared: {left.reason}.",
                DiagnosisWarning,
                stacklevel=4,
            )


def prepare(
    fitted: PowerScaledSurrogate,
    own: Sequence[Cause],
    excluded: Collection[str] = (),
    max_causes: int | None = None,
) -> Prepared:
    """Return what a search over the catalogue and user-defined causes needs.

    Parameters
    ----------
    fitted : PowerScaledSurrogate
        With known effects or none.
    own : sequence of Cause
        The user's.
    excluded : collection of str
        Kinds of the catalogue that are excluded.
    max_causes : int or None, default=None
        How many may be accepted together; None: as many as the data ask for.

    Raises
    ------
    ValueError
        By name, for a cause of the user's that returns a wrong shape or NaN.
    """
    data, plain = fitted.data_, fitted.plain_
    if plain.run_weights is not None:
        # whatever beta a search has the runs in full
        plain = FitTask.of(clone(fitted).set_params(beta=1.0), data).plain
    known = as_causes(fitted.effects)
    problem = plain.on_rows(*data.single).with_effects((*known, *data.experiments.effects()))
    # as many measurements as there are rows, whatever the unit of their weights
    problem = replace(problem, weights=problem.weights / problem.weights.mean())
    problem = _at_jitter_of(at_noise_of(problem, fitted.posterior_), fitted)
    problem = _at_correlation_of(_at_spread_of(problem, fitted.posterior_), fitted.posterior_)
    # a search over causes has no time to infer a surrogate's hyperparameters each time
    hyper = fitted.posterior_.values[:, fitted.posterior_.model.n_unknowns :]
    problem = problem.given(np.median(hyper, axis=0))
    problem = replace(problem, good=_best_draw(fitted, problem))
    coefficients = emulator_posterior(problem.model.basis, problem.simulation).mean
    at = problem.model.values(problem.good)
    context = plain.context_of(problem, coefficients, at)
    if problem.stacking is None:
        with np.errstate(over="ignore", invalid="ignore"):
            output, _, noise = problem.model.simulated(problem.X, at, coefficients)
            missed = np.nan_to_num((problem.y - output[0]) / noise[0])
        context = replace(context, missed=missed)
    if problem.model.basis.is_simulation:
        ends = {one.name: one.mean for one in at_prior_ends(fitted.posterior_)}
        context = replace(context, at_prior_end=ends)
    problem = replace(problem, reach=context.reach)
    usable, unusable = [], []
    for cause in own:
        reason = _lacks(cause, context, problem)
        if reason is None:
            usable.append(cause)
        else:
            unusable.append(Skipped(cause.kind, cause.target, reason))
    causes, skipped = catalogue(context, usable, excluded, alone=max_causes in (None, 1))
    return Prepared(problem, causes, [*unusable, *skipped], unusable)


def _best_draw(fitted: PowerScaledSurrogate, problem: Problem) -> FloatArray:
    """Return the parameters of that draw of the posterior that fits best, as z (1, n)."""
    posterior = fitted.posterior_
    some = posterior.thinned(FEW_DRAWS)
    # a draw for which the simulation fails is far off
    with np.errstate(over="ignore", invalid="ignore"):
        precision = problem.weights / problem.model.known_noise(problem.X) ** 2
        squares = (problem.y - some.eta(problem.X)[0]) ** 2 @ precision
    best = int(np.argmin(np.where(np.isfinite(squares), squares, np.inf)))
    # what the problem fixes at a known value is an unknown of the posterior
    of_posterior = [*posterior.model.parameters, *posterior.model.theta_names]
    unknowns = [*problem.model.parameters, *problem.model.theta_names]
    there = [of_posterior.index(name) for name in unknowns]
    return to_normal(problem.model.priors, some.values[best : best + 1, there])


def _at_spread_of(problem: Problem, posterior: Posterior) -> Problem:
    """Return the problem with what differs by experiment at its median spread.

    What a recorded column of the experiments explains, such as a temperature, must not count as
    spread: the column would be compared with a spread that holds it already. So it is the smallest
    of the medians with no such column and with one, by least squares in each draw.
    """
    effects = list(problem.model.effects)
    for k, effect in enumerate(effects):
        if isinstance(effect, SharedErrors):
            draws = posterior.estimates(k)
            median = {name: float(np.median(draws[name])) for name in effect.parameters}
            effects[k] = effect.at_estimate(median)
        elif isinstance(effect, ParameterByExperiment) and "spread" in effect.parameters:
            draws = posterior.estimates(k)
            spreads = [draws.pop("spread")]
            deviations = np.stack(list(draws.values()), axis=1)
            there, columns = _of_experiments(problem, effect)
            spreads += [_residual_sd(deviations[:, there], column) for column in columns]
            spread = min(float(np.median(each)) for each in spreads)
            effects[k] = effect.filled(spread=spread)
    return replace(problem, model=problem.model.with_effects(effects))


def _of_experiments(
    problem: Problem, effect: ParameterByExperiment
) -> tuple[NDArray[np.intp], FloatArray]:
    """Return which experiments were measured, and what differs between them only.

    Their positions (k,), and the columns that are constant within each experiment (n_columns, k).
    """
    X = problem.X[:, : len(problem.model.columns)]
    label = list(problem.model.columns).index(effect.column)
    levels, first, which = np.unique(X[:, label], return_index=True, return_inverse=True)
    there = np.all(X[first][which] == X, axis=0) & np.any(X[0] != X, axis=0)
    there[label] = False
    return position_among(effect.levels, levels), X[first][:, there].T


def _residual_sd(deviations: FloatArray, column: FloatArray) -> FloatArray:
    """Return the standard deviation about a straight line over a column, of each draw.

    ``deviations`` has shape (n_draws, n_experiments), ``column`` (n_experiments,).
    """
    n = len(column)
    if n < 4:  # a line explains what any three do
        return np.full(len(deviations), np.inf)
    centred = column - column.mean()
    deviations = deviations - deviations.mean(axis=1, keepdims=True)
    explained = (deviations @ centred) ** 2 / (centred @ centred)
    left = np.maximum(np.sum(deviations**2, axis=1) - explained, 0.0)
    return np.sqrt(left / (n - 2))


def _at_jitter_of(problem: Problem, fitted: PowerScaledSurrogate) -> Problem:
    """Return the problem with a fixed jitter in the shares of the rows in the noise.

    A search has no time to infer it anew for every cause: sigma alone is unknown, the noise of a
    typical row, at least its error. What is wrong with the simulation must not count as jitter, or
    precise rows lose their weight before the causes are compared.
    """
    posterior, errors = fitted.posterior_, problem.model.errors
    there = [k for k, e in enumerate(posterior.model.effects) if isinstance(e, Jitter)]
    if errors is None or not there:
        return problem
    most = [float(np.median(draws)) for draws in posterior.estimates(there[0]).values()]
    columns = problem.X[:, : len(problem.model.columns)]
    residual = problem.y - np.nanmean(posterior.eta(columns)[0], axis=0)
    which: FloatArray = np.zeros(len(residual))
    if problem.stacking is not None:
        which = columns[:, problem.stacking.at]
    jitter = []
    for k, largest in enumerate(most):
        here = which == k
        known = problem.X[here, columns.shape[1]]
        found = _jitter_of_neighbours(columns[here], residual[here], known)
        jitter.append(min(found, largest))
    kept = [effect for effect in problem.model.effects if not isinstance(effect, Jitter)]
    model = replace(problem.model.with_effects(kept), errors=errors.with_jitter(tuple(jitter)))
    return replace(problem, model=model, noise_prior=fitted.plain_.jitter_prior)


def _at_correlation_of(problem: Problem, posterior: Posterior) -> Problem:
    """Return the problem with correlations between outputs at their medians.

    Of thirty rows those of neighbours' differences, which a smooth fault leaves as they are, are so
    uncertain that 7 of 60 sets with nothing wrong had p <= 0.05.
    """
    model, fitted = problem.model, posterior.model
    known, found = model.output_correlation, fitted.output_correlation
    if known is None or found is None or problem.stacking is None:
        return problem
    draws = found.matrices(posterior.draws_of(fitted.effects.index(found))[0], posterior.n_draws)
    names = problem.stacking.names
    noise = [float(np.median(posterior.noise_of(name, k))) for k, name in enumerate(names)]
    # the errors of rows are their scales where they are known
    ratios = None if model.errors else tuple(sd / noise[0] for sd in noise)
    fixed = known.at_estimate(np.median(draws, axis=0), ratios)
    effects = [fixed if effect is known else effect for effect in model.effects]
    return replace(problem, model=model.with_effects(effects))


def _jitter_of_neighbours(X: FloatArray, residual: FloatArray, errors: FloatArray) -> float:
    """Return the likeliest jitter for the differences of residuals from those of nearest rows.

    Differences of neighbours estimate noise whatever smooth curve is in the residuals (Gasser,
    Sroka and Jennen-Steinmetz 1986, Biometrika 73:625).
    """
    spread = np.std(X, axis=0)
    places = X[:, spread > 0] / spread[spread > 0]
    if len(residual) < 2 or not places.shape[1]:
        return np.inf
    _, near = cKDTree(places).query(places, k=2)
    # of equal rows the first may be another one
    other = np.where(near[:, 0] == np.arange(len(near)), near[:, 1], near[:, 0])
    squares = (residual - residual[other]) ** 2
    # from a thirtieth of the known errors to thirty times them
    jitter = np.append(0.0, np.geomspace(0.03, 30.0, 60) * np.median(errors))
    variance = errors**2 + errors[other] ** 2 + 2 * jitter[:, None] ** 2
    return float(jitter[np.argmin(np.sum(np.log(variance) + squares / variance, axis=1))])


def _lacks(cause: Cause, context: Context, problem: Problem) -> str | None:
    """Return what a cause of the user's needs and does not find, None where it has everything."""
    try:
        prepared = prepared_for(cause, context)
    except ValueError as error:
        return str(error)
    if not prepared.acts_on and not prepared.coefficients:
        return "it changes no prediction: give it to the estimator, as one of its effects"
    try:
        effects = (*problem.model.effects, prepared)
        check_effects(problem.model.with_effects(effects), problem.X)
    except KeyError as error:
        there = [*context.X, *context.parameters, *context.assumed]
        return f"it asks for {error}; there are {there}"
    return None


def trained_emulator(
    problem: Problem, fitted: PowerScaledSurrogate
) -> tuple[Problem, EmulatorPosterior]:
    """Return the problem with the simulation conditioned on the runs alone."""
    basis = problem.model.basis
    emulator = emulator_posterior(basis, problem.simulation)
    runs = fitted.data_.simulation
    trained = problem.simulation is not None or basis.holds_runs
    if not trained or not isinstance(runs, SimulationData):
        return problem, emulator
    run_eta = problem.likelihood.working_runs(runs.y)
    # whole numbers may be rounded means: uniform errors, through which an emulator has to see
    errors = problem.likelihood.rounding(run_eta) if is_whole(runs.y) else np.zeros(1)
    noise = float(np.sqrt(np.mean(errors**2)))
    kriged, emulator = krige(basis, emulator, runs, run_eta, noise)
    return replace(problem, model=replace(problem.model, basis=kriged)), emulator
