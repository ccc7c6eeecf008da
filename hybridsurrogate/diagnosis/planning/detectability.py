"""How often planned measurements would show what a simulation gets wrong, before any is made."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from itertools import pairwise
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import ndtri
from scipy.stats import qmc
from sklearn.base import clone
from sklearn.utils import check_random_state, check_scalar

from hybridsurrogate.catalogue import Skipped
from hybridsurrogate.diagnosis.answers.finding import form_of
from hybridsurrogate.diagnosis.checks.parameters import check_rows, checked_settings
from hybridsurrogate.diagnosis.planning.result import Detectability, detectability_of
from hybridsurrogate.diagnosis.search.context import SearchContext, on_working_rows
from hybridsurrogate.diagnosis.search.setup import Prepared, prepare, trained_emulator
from hybridsurrogate.diagnosis.search.simulated import (
    NOTHING,
    Outcomes,
    Place,
    hidden,
    outcomes,
    shapes_of,
)
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.estimators.emulation import as_given
from hybridsurrogate.estimators.power_scaled import FitTask, PowerScaledSurrogate, prepared
from hybridsurrogate.exceptions import HybridSurrogateWarning, did_you_mean
from hybridsurrogate.likelihoods import Likelihood, as_likelihood
from hybridsurrogate.model.posterior import FEW_DRAWS
from hybridsurrogate.model.statistics import emulator_posterior
from hybridsurrogate.numerics.linear_algebra import one_blas_thread
from hybridsurrogate.simulation.arrays import as_numbers, complete_table
from hybridsurrogate.types import FloatArray


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
    task = prepared(model, X, _any_output(model, len(X)))
    outputs = _outputs(task, as_likelihood(model.likelihood), n, random)
    made = [place_at(model, X, eta, noise, own, exclude, random) for eta in outputs]
    return [place for place, _ in made], made[-1][1]


def _any_output(model: PowerScaledSurrogate, n: int) -> FloatArray:
    """Return outputs that any likelihood accepts: the rows alone are used."""
    simulation: Any = model.simulation
    k = len(simulation.outputs)
    return np.ones((n, k) if k > 1 else n)


def place_at(
    model: PowerScaledSurrogate,
    X: Any,
    eta: FloatArray,
    noise: FloatArray,
    own: Sequence[Cause],
    exclude: Sequence[str],
    random: np.random.RandomState,
) -> tuple[Place, Prepared]:
    """Return the place of one data set in which nothing is wrong, and what is compared there.

    Parameters
    ----------
    model, X, noise, own, exclude, random
        As for `places`.
    eta : ndarray of shape (n_single_rows,)
        Rows without noise, on the scale of eta.
    """
    sigma = np.tile(noise, eta.size // len(noise))[None]
    y = as_likelihood(model.likelihood).sample(eta[None], sigma, random)[0]
    one = clone(model).set_params(n_draws=FEW_DRAWS, random_state=random.randint(2**31 - 1))
    with warnings.catch_warnings():
        # of data that are none, and of which nothing is reported
        warnings.simplefilter("ignore", HybridSurrogateWarning)
        y = y.reshape(_any_output(model, len(X)).shape)
        fitted = as_given(one.fit(X, y))
    ready = prepare(fitted, own, exclude)
    return _place(ready, fitted, noise), ready


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
    for _ in range(FEW_DRAWS):
        u = sequence.random(2 ** int(np.ceil(np.log2(n))))[:, :d]
        values = model.values(ndtri(np.clip(u, 1e-6, 1 - 1e-6)))
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            eta = model.simulated(X, values, c)[0]
        out += list(eta[np.isfinite(eta).all(axis=1)])
        if len(out) >= n:
            return out[:n]
    raise ValueError(
        "The simulation fails at the planned rows for nearly all parameters: check the rows, or "
        "the priors."
    )


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


# sets of parameters at which causes are linearised, and data sets without a cause in all
_N_PLACES, _N_NULL = 8, 400
# bytes for each planned row: 118 MB more for 960 rows more, all kinds of a simulation of one input
_BYTES_A_ROW = 125_000


def detectability(
    estimator: PowerScaledSurrogate,
    X: ArrayLike,
    *,
    causes: Sequence[str | Cause] | None = None,
    sizes: Sequence[float] = (0.5, 1.0, 2.0, 4.0, 8.0),
    noise: float | Sequence[float] | None = None,
    exclude: Sequence[str] = (),
    false_alarm_rate: float = 0.05,
    n_replicates: int = 100,
    random_state: int | np.random.RandomState | None = None,
) -> Detectability:
    """Return how often a diagnosis of planned measurements would detect and name each cause.

    Data sets with each cause are simulated at the planned rows, with parameters from their priors.
    What a diagnosis would conclude from each is computed from the closed-form evidence of all
    causes, linearised where nothing is wrong and, of large changes of inputs or parameters, at many
    sizes: seconds for hundreds of data sets, where a whole diagnosis of each would take hours.
    Rates are averages over the priors of each cause, of a wave over all periods that it may have.
    Other things than the causes compared are not predicted, outliers among them.

    Parameters
    ----------
    estimator : PowerScaledSurrogate
        The model, with its simulation; without effects.
    X : array-like of shape (n, n_columns)
        Planned rows, as for ``fit``: with columns that the simulation ignores, too.
    causes : sequence of str or Cause, or None
        What is simulated: kinds of the catalogue ("trend"), forms of a kind ("trend: quadratic"),
        causes with their target ("step(t)"), one cause alone ("step(t): plain"), or user-defined
        ones, which are also compared and replace the catalogue's of the same form. None: every
        kind.
    sizes : sequence of float, default=(0.5, 1, 2, 4, 8)
        Root mean square over the rows, in standard deviations of the noise, of what the
        simulation's parameters cannot follow of the cause. Of a cause in the noise: the largest
        standard deviation of a row over the smallest, less one; of autocorrelated noise the
        standard deviation of the correlated part in that of the rest.
    noise : float, sequence of float, or None
        Standard deviation of one measurement on the scale of eta, of several outputs of each; the
        second parameter of a likelihood that is not normal. None: the median of the model's
        ``noise_prior``.
    exclude : sequence of str, default=()
        Kinds that are not compared, as in the diagnosis.
    false_alarm_rate : float, default=0.05
    n_replicates : int, default=100
        Data sets of each cause and size: a rate of one half then has a standard error of 0.05.
    random_state : int, RandomState or None, default=None

    Returns
    -------
    Detectability

    Raises
    ------
    TypeError, ValueError
        For arguments that cannot work: unknown causes, sizes that are not positive, more rows than
        fit into memory, or no noise.

    Examples
    --------
    >>> import numpy as np
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> model = hs.PowerScaledSurrogate(case.simulator, surrogate=hs.ExactSurrogate())
    >>> planned = np.linspace(1, 10, 20)[:, None]
    >>> found = hs.detectability(
    ...     model, planned, causes=["step"], sizes=[0.5, 4], noise=0.1, random_state=0)
    >>> found.table["detected"].is_monotonic_increasing
    True
    """
    words = () if causes is None else _as_words(causes)
    own = [one for one in words if isinstance(one, Cause)]
    checked_settings(
        estimator=estimator,
        causes=own,
        exclude=exclude,
        false_alarm_rate=false_alarm_rate,
        n_replicates=_N_NULL,
    )
    check_scalar(n_replicates, "n_replicates", Integral, min_val=1)
    _check_memory(int(np.shape(X)[0]) if np.ndim(X) else 0)
    rows = complete_table(X, labels=estimator.experiment)
    levels, scale = _checked_sizes(sizes), _checked_noise(estimator, noise)
    random = check_random_state(random_state)
    with one_blas_thread():
        n_places = min(_N_PLACES, int(n_replicates))
        at, ready = places(estimator, rows, scale, own, exclude, n_places, random)
        labels = _labels(words, at[0].causes, ready.skipped)
        counts = np.diff(np.linspace(0, n_replicates, n_places + 1).astype(int))
        parts = [
            _simulated(place, labels, levels, int(m), random)
            for place, m in zip(at, counts, strict=True)
        ]
    return _result(parts, at[0], labels, levels, len(rows), float(false_alarm_rate))


class _Part(NamedTuple):
    """What comes of the data sets at one place: without a cause, and with each of some size."""

    null: Outcomes
    hidden: dict[tuple[str, float], tuple[Outcomes, FloatArray]]


def _simulated(
    place: Place,
    labels: Sequence[str],
    sizes: Sequence[float],
    m: int,
    random: np.random.RandomState,
) -> _Part:
    """Return the outcomes of m data sets of each cause and size, evaluated together."""
    n, n_null = len(place.noise), _N_NULL // _N_PLACES
    responses = [place.responses(np.zeros((n_null, n)), np.ones((n_null, n)), random)]
    drawn: list[tuple[str, float, FloatArray]] = []
    for label in labels:
        forms = [(c, shapes_of(place, c, random)) for c in place.causes if _is(c, label)]
        for size in sizes:
            made = hidden(place, forms, size, m, random)
            if made is not None:
                responses.append(made[0])
                drawn.append((label, size, made[1]))
    found = outcomes(place, np.concatenate(responses))
    ends = np.cumsum([0, *map(len, responses)]).tolist()
    null, *others = (found.between(*both) for both in pairwise(ends))
    with_cause = zip(drawn, others, strict=True)
    return _Part(null, {(label, size): (one, change) for (label, size, change), one in with_cause})


def _result(
    parts: Sequence[_Part],
    place: Place,
    labels: Sequence[str],
    sizes: Sequence[float],
    n_rows: int,
    rate: float,
) -> Detectability:
    """Return the rates over all places."""
    null = np.concatenate([part.null.statistic for part in parts])
    limit = float(np.quantile(null, 1 - rate, method="higher"))
    rows: list[tuple[str, float, Outcomes, FloatArray]]
    rows = [(NOTHING, 0.0, part.null, np.zeros(len(part.null.none))) for part in parts]
    rows += [(*key, *value) for part in parts for key, value in part.hidden.items()]
    conclusions = pd.concat(
        [
            pd.DataFrame({"share": one.share, "change": change}).assign(
                cause=label, size=size, found=np.where(one.detected(limit, rate), one.kind, NOTHING)
            )
            for label, size, one, change in rows
        ],
        ignore_index=True,
    )
    of_label = {label: [c for c in place.causes if _is(c, label)] for label in labels}
    kind_of = {label: causes[0].kind for label, causes in of_label.items()}
    in_noise = {
        label: not any(c.coefficients or c.touches_simulation for c in causes)
        for label, causes in of_label.items()
    }
    return detectability_of(conclusions, kind_of, in_noise, sizes, n_rows, rate)


def _is(cause: Cause, label: str) -> bool:
    return label in (cause.kind, form_of(cause), cause.name, _full(cause))


def _full(cause: Cause) -> str:
    """Return the words for one cause alone: its target and its form, "plain" where it has none."""
    return f"{cause.name}: {cause.variant or 'plain'}"


def _labels(
    words: Sequence[str | Cause], causes: Sequence[Cause], skipped: Sequence[Skipped]
) -> list[str]:
    """Return what is simulated, in words; raise ValueError for what is not compared."""
    if not words:
        return list(dict.fromkeys(one.kind for one in causes))
    labels = [_full(one) if isinstance(one, Cause) else one for one in words]
    for label in labels:
        if any(_is(one, label) for one in causes):
            continue
        known = [*dict.fromkeys([*(c.kind for c in causes), *map(form_of, causes)])]
        kind = label.partition(":")[0].partition("(")[0]
        reasons = [one.reason for one in skipped if one.kind == kind]
        why = f" ({reasons[0]})" if reasons else ""
        raise ValueError(
            f"No cause {label!r} is compared at the planned rows{why}; there are "
            f"{', '.join(known)}.{did_you_mean(label, known)}"
        )
    return list(dict.fromkeys(labels))


def _as_words(causes: Any) -> tuple[str | Cause, ...]:
    if isinstance(causes, str | Cause) or not isinstance(causes, Sequence) or not causes:
        raise TypeError(
            "causes must be a sequence of kinds such as ['step', 'trend'], or None, got "
            f"{causes!r}."
        )
    wrong = [one for one in causes if not isinstance(one, str | Cause)]
    if wrong:
        raise TypeError(f"causes are words or Cause objects, got {wrong[0]!r}.")
    return tuple(causes)


def _checked_sizes(sizes: Any) -> list[float]:
    values = np.unique(as_numbers(sizes, "sizes"))
    if values.ndim != 1 or not len(values) or not (values > 0).all():
        raise ValueError(
            "sizes must be positive, in standard deviations of the noise, such as [0.5, 1, 2], "
            f"got {sizes!r}."
        )
    return [float(one) for one in values]


def _checked_noise(estimator: PowerScaledSurrogate, noise: Any) -> FloatArray:
    """Return the noise of each output, or of all, (k,) or (1,)."""
    likelihood = as_likelihood(estimator.likelihood)
    if not likelihood.has_scale:
        if noise is not None:
            raise ValueError(f"The {likelihood.name} likelihood has no noise to be given.")
        return np.ones(1)
    if noise is None:
        if estimator.noise_prior is None:
            raise ValueError(
                "How far measurements scatter decides what is detected: give noise=..., the "
                "standard deviation of one measurement, or the model a noise_prior."
            )
        return np.array([float(estimator.noise_prior.median())])
    values = np.atleast_1d(as_numbers(noise, "noise"))
    simulation: Any = estimator.simulation
    k = len(simulation.outputs)
    if values.shape not in ((1,), (k,)) or not (values > 0).all():
        raise ValueError(
            f"noise must be one positive number{f', or {k}, one for each output' * (k > 1)}, got "
            f"{noise!r}."
        )
    return values


def _check_memory(n: int) -> None:
    """Raise ValueError for more rows than there is memory."""
    try:
        there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # not on Windows
        return
    if n * _BYTES_A_ROW > there:
        raise ValueError(
            f"{n:,} planned rows need about {n * _BYTES_A_ROW / 1e9:.3g} GB, and this machine has "
            f"{there / 1e9:.3g}. Plan with some of them: with k times as many rows a cause is "
            "detected at a size smaller by the square root of k."
        )
