"""Planned rows as places at which data are simulated: parameters from their priors."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc
from sklearn.base import clone

from hybridsurrogate.diagnosis.checks.parameters import check_rows
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.setup import Prepared, prepare, trained_emulator
from hybridsurrogate.diagnosis.search.working_rows import on_working_rows
from hybridsurrogate.diagnosis.simulated.place import Place
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.estimators.emulation import as_given
from hybridsurrogate.estimators.power_scaled import FitTask, PowerScaledSurrogate, prepared
from hybridsurrogate.exceptions import HybridSurrogateWarning
from hybridsurrogate.likelihoods import Likelihood, as_likelihood
from hybridsurrogate.model.statistics import emulator_posterior
from hybridsurrogate.types import FloatArray

# draws of a fit that only has to start a search near the parameters
_DRAWS = 100
# draws from the priors for one at which the simulation runs
_MOST_TRIED = 50


def places(
    model: PowerScaledSurrogate,
    X: Any,
    noise: FloatArray,
    own: Sequence[Cause],
    exclude: Sequence[str],
    n: int,
    random: np.random.RandomState,
) -> tuple[list[Place], Prepared]:
    """Return places at planned rows, each at parameters drawn from their priors.

    At each the model is fitted to one data set in which nothing is wrong, as for a diagnosis. And
    what is compared at the last, which also says what is not.

    Parameters
    ----------
    model : PowerScaledSurrogate
        Not fitted, without effects.
    X : array-like of shape (n_rows, n_columns)
    noise : ndarray of shape (1,) or (n_outputs,)
        The likelihood's second parameter, of each output.
    own : sequence of Cause
        User-defined causes.
    exclude : sequence of str
    n : int
        Places.
    random : RandomState

    Raises
    ------
    ValueError
        Where the simulation fails at parameters all over their priors.
    """
    simulation: Any = model.simulation
    k = len(simulation.outputs)
    likelihood = as_likelihood(model.likelihood)
    # outputs that any likelihood accepts; the rows alone are used
    ones = np.ones((len(X), k) if k > 1 else len(X))
    task = prepared(model, X, ones)
    outputs = _outputs(task, likelihood, n, random)
    found = []
    for eta in outputs:
        sigma = np.tile(noise, eta.size // len(noise))[None]
        y = likelihood.sample(eta[None], sigma, random)[0]
        one = clone(model).set_params(n_draws=_DRAWS, random_state=random.randint(2**31 - 1))
        with warnings.catch_warnings():
            # of data that are none, and of which nothing is reported
            warnings.simplefilter("ignore", HybridSurrogateWarning)
            fitted = as_given(one.fit(X, y.reshape(ones.shape)))
        ready = prepare(fitted, own, exclude)
        found.append(_place(ready, fitted, noise))
    return found, ready


def _outputs(
    task: FitTask, likelihood: Likelihood, n: int, random: np.random.RandomState
) -> list[FloatArray]:
    """Return outputs (n_single_rows,) on the scale of eta at n draws of the parameters."""
    problem, X = task.plain.problem, task.data.single.X
    hyper = np.array([[float(p.median()) for p in problem.model.basis.hyperpriors.values()]])
    problem = problem.given(hyper[0])
    model = problem.model
    check_rows(len(X), model.columns, [*model.parameters, *model.constants])
    d = model.n_unknowns
    c = emulator_posterior(model.basis, problem.simulation).mean
    sequence = qmc.Sobol(max(d, 1), rng=np.random.default_rng(random.randint(2**31 - 1)))
    out: list[FloatArray] = []
    for _ in range(_MOST_TRIED):
        u = sequence.random(2 ** int(np.ceil(np.log2(n))))[:, :d]
        values = model.values(_standard_normal(u))
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            eta = model.simulated(X, values, c)[0]
        out += list(eta[np.isfinite(eta).all(axis=1)])
        if len(out) >= n:
            return out[:n]
    raise ValueError(
        "The simulation fails at the planned rows for nearly all parameters: check the rows, or "
        "the priors."
    )


def _standard_normal(u: FloatArray) -> FloatArray:
    return np.asarray(ndtri(np.clip(u, 1e-6, 1 - 1e-6)))


def _place(ready: Prepared, fitted: PowerScaledSurrogate, noise: FloatArray) -> Place:
    """Return the place of one data set in which nothing is wrong."""
    problem, emulator = trained_emulator(ready.problem, fitted)
    context = SearchContext.of(on_working_rows(problem, fitted.posterior_), emulator)
    rows = context.problem
    of_rows: FloatArray | None = None
    if rows.stacking is not None and rows.working_point is None:
        which = rows.X[:, rows.stacking.at].astype(np.intp)
        of_rows = (noise / rows.stacking.scale)[which]
    elif rows.working_point is None:
        of_rows = np.broadcast_to(noise, len(rows.y))
    return Place.of(context, context.best_null(), ready.causes, of_rows)
