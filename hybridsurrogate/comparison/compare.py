"""Several simulations compared on the same measurements: evidence, held-out scores, agreement."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from itertools import combinations
from numbers import Integral
from typing import Any

import numpy as np
import pandas as pd
from joblib import delayed
from numpy.typing import ArrayLike
from scipy import special
from sklearn.base import clone
from sklearn.utils import check_consistent_length, check_random_state, check_scalar

from hybridsurrogate.arguments import check_flag, check_n_jobs
from hybridsurrogate.comparison.result import SimulationComparison
from hybridsurrogate.diagnosis.checks.parameters import check_diagnosable
from hybridsurrogate.diagnosis.diagnosis import DiscrepancyDiagnosis
from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.context import SearchContext, on_working_rows
from hybridsurrogate.diagnosis.search.exact_scores import scored
from hybridsurrogate.diagnosis.search.processes import at_best_noise
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.diagnosis.search.setup import prepare, trained_emulator
from hybridsurrogate.diagnosis.validation.cross_validation import in_parallel, random_folds
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.exceptions import HybridSurrogateWarning
from hybridsurrogate.inference.loo import stacking_weights
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.model.rows.measured_data import (
    GivenRows,
    check_outcomes,
    taken_out,
    without_gaps,
)
from hybridsurrogate.numerics.linear_algebra import one_blas_thread
from hybridsurrogate.scoring.scores import paired_difference
from hybridsurrogate.simulation.arrays import complete_table
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
    alone = Search(context, [Candidate(None, null, context.evidence(null, sizes))], sizes)
    return scored(at_best_noise(alone, False)).candidates[0].log_evidence


def held_out_densities(
    estimators: Sequence[PowerScaledSurrogate],
    rows: GivenRows,
    cv: int,
    random_state: np.random.RandomState,
    n_jobs: int | None = None,
) -> FloatArray:
    """Return the log density of each measurement under each model fitted without its fold, (m, k).

    Parameters
    ----------
    estimators : sequence of k PowerScaledSurrogate
        Not fitted.
    rows : GivenRows
        Measured.
    cv : int
        Folds, the same for all.
    random_state : RandomState
    n_jobs : int or None

    Returns
    -------
    ndarray of shape (m, k)
        Of all that was measured, row by row: m is n where there is one output without gaps.
    """
    y, folds = rows.y, random_folds(len(rows.y), cv, random_state)
    tasks = [
        delayed(_densities)(one, rows.take(train), rows.take(test))
        for train, test in folds
        for one in estimators
    ]
    found = iter(in_parallel(tasks, n_jobs))
    out = np.full((*y.shape, len(estimators)), np.nan)
    for _, test in folds:
        for k in range(len(estimators)):
            out[test, ..., k] = next(found)
    return out[np.isfinite(y)]


def _densities(estimator: PowerScaledSurrogate, train: GivenRows, test: GivenRows) -> FloatArray:
    with warnings.catch_warnings():
        # the fit to all rows has warned of the data, and held-out rows are beyond these
        warnings.simplefilter("ignore", HybridSurrogateWarning)
        fitted: Any = clone(estimator).fit(*train)
        return np.asarray(fitted.log_predictive_density(test.X, test.y, test.y_err))


def agreement(
    before: Mapping[str, Any], after: Mapping[str, Any] | None, X: ArrayLike
) -> pd.DataFrame:
    """Return how far each pair of simulations differs at measured rows.

    Parameters
    ----------
    before, after : dict of name to fitted estimator
        As they are, and extended; None: not diagnosed.
    X : array-like of shape (n, n_columns)

    Returns
    -------
    DataFrame
        One row a pair: "first", "second", and "before" and "after": the root mean square over the
        rows of the difference of their noise-free predictions, each in units of its posterior
        standard deviation. At most one where they agree to within their uncertainty.
    """
    columns = {"before": before} if after is None else {"before": before, "after": after}
    moments = {
        word: {name: _moments(one, X) for name, one in models.items()}
        for word, models in columns.items()
    }

    def apart(one: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]) -> float:
        gap, variance = one[0] - other[0], one[1] + other[1]
        squares = np.divide(gap**2, variance, out=np.zeros_like(gap), where=variance > 0)
        return float(np.sqrt(np.mean(squares)))

    rows = [
        {
            "first": one,
            "second": other,
            **{word: apart(known[one], known[other]) for word, known in moments.items()},
        }
        for one, other in combinations(before, 2)
    ]
    return pd.DataFrame(rows)


def _moments(estimator: Any, X: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of the noise-free predictions."""
    draws = estimator.sample_predictive_mean(X)
    return np.mean(draws, axis=0), np.var(draws, axis=0)


def compare_simulations(
    estimators: Sequence[PowerScaledSurrogate] | Mapping[str, PowerScaledSurrogate],
    X: ArrayLike,
    y: ArrayLike,
    *,
    y_err: Any = None,
    diagnose: bool = True,
    cv: int = 5,
    max_causes: int | None = None,
    n_jobs: int | None = None,
    random_state: int | np.random.RandomState | None = None,
) -> SimulationComparison:
    """Compare several simulations of the same measurements, and what each of them lacks.

    Parameters
    ----------
    estimators : sequence or dict of name to PowerScaledSurrogate
        One for each simulation, at least two. The simulations may have other parameters, and read
        other columns of X; outputs and likelihood are the same. Without names they have those of
        their simulators. Effects (``effects=``) are part of the model: in evidence and diagnoses
        they are at their best place, with their sizes integrated out.
    X : array-like of shape (n, n_columns)
        Measured rows. A DataFrame where the simulations have other inputs.
    y : array-like of shape (n,), or (n, n_outputs) of several outputs
    y_err : float, str, array-like of the shape of y, or None, default=None
        Known standard deviations of the measurements, as in the estimators' ``fit``.
    diagnose : bool, default=True
        Also diagnose each: what it lacks, and whether they agree once extended. Without, a
        comparison takes seconds.
    cv : int, default=5
        Folds of the held-out densities, the same for all.
    max_causes : int or None, default=None
        Of each diagnosis.
    n_jobs : int or None, default=None
        Processes that share the folds.
    random_state : int, RandomState or None, default=None

    Returns
    -------
    SimulationComparison

    Raises
    ------
    TypeError, ValueError
        For fewer than two estimators, other outputs or likelihoods, columns that cannot be the same
        for all, and whatever a fit refuses.

    Notes
    -----
    The evidence supposes that one of the simulations is right: a probability near one is no sign
    that the favoured one is. That is what the diagnoses are for.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.stats import norm
    >>> import hybridsurrogate as hs
    >>> def line(t, rate):
    ...     return rate * t
    >>> def root(t, rate):
    ...     return rate * np.sqrt(t)
    >>> models = [
    ...     hs.PowerScaledSurrogate(
    ...         hs.Simulator(f, inputs={"t": (0, 9)}, parameters={"rate": norm(1, 1)}),
    ...         surrogate=hs.ExactSurrogate(), random_state=0)
    ...     for f in (line, root)]
    >>> t = np.linspace(0, 9, 30)
    >>> y = 2 * np.sqrt(t) + 0.2 * np.random.default_rng(0).standard_normal(30)
    >>> hs.compare_simulations(models, t[:, None], y, diagnose=False, random_state=0).chosen
    'root'
    """
    models = _named(estimators)
    _check_alike(models, X)
    check_flag(diagnose, "diagnose")
    check_n_jobs(n_jobs)
    check_scalar(cv, "cv", Integral, min_val=2)
    random = check_random_state(random_state)
    first = next(iter(models.values()))
    check_outcomes(y, as_likelihood(first.likelihood))
    X, y_err = taken_out(X, y_err)
    check_consistent_length(X, y)
    X, y, _, y_err = without_gaps(X, y, None, y_err)
    X = complete_table(X, labels=first.experiment)
    fitted = {name: clone(one).fit(X, y, y_err=y_err) for name, one in models.items()}
    one = next(iter(fitted.values()))
    rows = GivenRows(X, one.measured_outputs(y), y_err=one.data_.y_err)
    unfitted = [clone(one) for one in models.values()]
    with one_blas_thread():
        evidence = np.array([log_evidence(one) for one in fitted.values()])
        density = held_out_densities(unfitted, rows, int(cv), random, n_jobs)
    diagnoses: dict[str, Any] = {}
    if diagnose:
        seed = random.randint(2**31 - 1)
        diagnoses = {
            name: DiscrepancyDiagnosis(
                clone(one), cv=None, max_causes=max_causes, n_jobs=n_jobs, random_state=seed
            ).fit(X, y, y_err=rows.y_err)
            for name, one in models.items()
        }
    table = _table(list(models), evidence, density, diagnoses)
    extended = {name: one.extended_estimator_ for name, one in diagnoses.items()}
    return SimulationComparison(
        table,
        agreement(fitted, extended or None, X),
        pd.DataFrame(density, columns=list(models)),
        fitted,
        diagnoses,
    )


def _table(
    names: Sequence[str], evidence: FloatArray, density: FloatArray, diagnoses: Mapping[str, Any]
) -> pd.DataFrame:
    """Return the scores of each simulation, most probable first."""
    elpd = np.mean(density, axis=0)
    best = int(np.argmax(elpd))
    apart = [paired_difference(density[:, k], density[:, best]) for k in range(len(names))]
    table = pd.DataFrame(
        {
            "log_evidence": evidence,
            "probability": special.softmax(evidence),  # equally probable before
            "elpd": elpd,
            "difference": [one.difference for one in apart],
            "difference_error": [one.standard_error for one in apart],
            "weight": stacking_weights(density),
        },
        index=list(names),
    )
    if diagnoses:
        found = [diagnoses[name] for name in names]
        table = table.assign(
            verdict=[one.verdict_ for one in found],
            cause=[" + ".join(_word(cause) for cause in one.found_causes_) for one in found],
            p_value=[one.p_value_ for one in found],
        )
    return table.sort_values("log_evidence", ascending=False, kind="stable")


def _word(cause: Any) -> str:
    return f"{cause.kind}({cause.target})" if cause.target else str(cause.kind)


def _named(estimators: Any) -> dict[str, PowerScaledSurrogate]:
    """Return the estimators by name; raise for fewer than two, and for what is none."""
    if isinstance(estimators, Mapping):
        models = {str(name): one for name, one in estimators.items()}
    elif isinstance(estimators, Sequence) and not isinstance(estimators, str):
        simulators = [
            getattr(getattr(one, "simulation", None), "simulator", None) for one in estimators
        ]
        words = [str(getattr(one, "name", "") or "simulation") for one in simulators]
        models = {
            word if words.count(word) == 1 else f"{word} {k + 1}": one
            for k, (word, one) in enumerate(zip(words, estimators, strict=True))
        }
    else:
        raise TypeError(
            "estimators must be a list of PowerScaledSurrogate objects, or a dict of them by name, "
            f"got {estimators!r}."
        )
    for one in models.values():
        check_diagnosable(one)
    if len(models) < 2:
        raise ValueError(f"There are at least two simulations to compare, got {len(models)}.")
    return models


def _check_alike(models: Mapping[str, PowerScaledSurrogate], X: Any) -> None:
    """Raise ValueError for simulations of other outputs, or scored otherwise."""
    names, every = list(models), list(models.values())
    first: Any = every[0].simulation
    for name, one in zip(names[1:], every[1:], strict=True):
        simulation: Any = one.simulation
        if simulation.outputs != first.outputs:
            raise ValueError(
                f"{name!r} simulates {', '.join(simulation.outputs)}, and {names[0]!r} "
                f"{', '.join(first.outputs)}: simulations of other outputs have no measurements in "
                "common. Where it is the same quantity, give it the same name (output=...)."
            )
        if as_likelihood(one.likelihood) != as_likelihood(every[0].likelihood):
            raise ValueError(
                f"{name!r} has another likelihood than {names[0]!r}: give all the same, so that "
                "the simulations alone differ."
            )
        if one.experiment != every[0].experiment:
            raise ValueError("All estimators must have the same experiment=... column.")
        if not hasattr(X, "columns") and simulation.input_names != first.input_names:
            raise ValueError(
                f"{name!r} has the inputs {', '.join(simulation.input_names)}, and {names[0]!r} "
                f"{', '.join(first.input_names)}: give X as a DataFrame, so that each finds its "
                "columns by name."
            )
