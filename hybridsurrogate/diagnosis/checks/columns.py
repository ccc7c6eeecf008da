"""Measured columns that are not what they should be: copies of the output, units, exchanged ones.

Columns that make a diagnosis impossible are refused before anything is fitted. What is only
doubtful becomes a `Caution`.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats

from hybridsurrogate.diagnosis.checks.caution import SETTINGS, Caution
from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.effects.context import MIN_ROWS_EACH
from hybridsurrogate.exceptions import DiagnosisWarning
from hybridsurrogate.model.posterior import FEW_DRAWS
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.rows.columns import column_names, experiments_of, matched_columns
from hybridsurrogate.model.statistics import emulator_posterior
from hybridsurrogate.numerics.digits import number
from hybridsurrogate.priors import frozen
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.types import FloatArray

Ranges = Mapping[str, tuple[float, float]]

# how many of the small unit make one of the large
_UNITS = {
    60.0: "seconds and minutes, or minutes and hours",
    3600.0: "seconds and hours",
    86400.0: "seconds and days",
    24.0: "hours and days",
    1440.0: "minutes and days",
    7.0: "days and weeks",
    12.0: "months and years",
    365.25: "days and years",
    10.0: "mm and cm",
    100.0: "percent and shares, or cm and m",
    1e3: "milli and one, or one and kilo",
    1e6: "micro and one, or one and mega",
    180 / np.pi: "degrees and radians",
}
# between these shares a prior lies, whatever its tails
_TAIL_SHARE = 0.001
# difference of minus twice the log density at which two units fit alike: 60 and 180 / pi are 5 %
# apart
_SAME_DEVIANCE = 2.0
# y = offset + factor x
_SHIFTED = {
    (273.15, 1.0): "kelvins, and the simulation degrees Celsius",
    (-273.15, 1.0): "degrees Celsius, and the simulation kelvins",
    (32.0, 1.8): "degrees Fahrenheit, and the simulation degrees Celsius",
    (-32 / 1.8, 1 / 1.8): "degrees Celsius, and the simulation degrees Fahrenheit",
}


def check_usable_columns(
    X: Any,
    y: ArrayLike | None,
    simulation: SimulationData | Simulator | None,
    experiment: str | None,
) -> None:
    """Raise ValueError for columns that make a diagnosis impossible, before anything is fitted.

    A `DiagnosisWarning` names columns of text with too many names.

    Parameters
    ----------
    X : table of shape (n, n_columns)
        As given; the estimator refuses what it does not accept.
    y : array-like of shape (n,) or (n, n_outputs), or None
    simulation : SimulationData, Simulator or None
    experiment : str or None
        The column of the experiments.

    Raises
    ------
    ValueError
        Where a column that the simulation ignores is the output or a linear function of it; where
        all rows have the same inputs and nothing else varies; where most rows lie outside the
        simulated ranges.
    """
    if simulation is None:
        return
    for name in experiments_of([X], experiment, None, simulation).left_out:
        warnings.warn(
            f"The column {name!r} is left out: its names, such as {X[name].iloc[0]!r}, stand in "
            f"fewer than {MIN_ROWS_EACH} rows each. If these are numbers, "
            "pandas.to_numeric(X[name]).",
            DiagnosisWarning,
            stacklevel=3,
        )
    columns = _numbers(X, simulation)
    if not columns or y is None:
        return
    ranges = simulation.input_ranges
    outputs = np.asarray(y, dtype=object).reshape(len(next(iter(columns.values()))), -1)
    for name, values in columns.items():
        if name not in ranges and any(_copies(values, y) for y in outputs.T):
            raise ValueError(
                f"The column {name!r} is the output itself, or a linear function of it: drop it. "
                "Whatever the simulation misses, such a column explains it."
            )
    if not any(np.ptp(values) > 0 for values in columns.values()):
        place = ", ".join(f"{x} = {number(columns[x][0])}" for x in ranges if x in columns)
        raise ValueError(
            f"All {len(outputs)} measured rows have the same inputs, {place}. A diagnosis compares "
            "the simulation with measurements along its inputs and needs a spread in one of them "
            "at least: give the inputs at which each row was measured."
        )
    _check_ranges(columns, ranges)


def _numbers(X: Any, simulation: SimulationData | Simulator) -> dict[str, FloatArray]:
    """Return the numeric columns, by name; none of what is no table of rows."""
    if np.ndim(X) != 2 or not len(X):
        return {}
    names, order = matched_columns(column_names(X), np.shape(X)[1], simulation)
    table = X.iloc[:, order] if isinstance(X, pd.DataFrame) else np.asarray(X)[:, order]
    out = {}
    for name, (_, values) in zip(names, pd.DataFrame(table).items(), strict=True):
        numbers = pd.to_numeric(values, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
        if np.isfinite(numbers).all():
            out[name] = numbers
    return out


def _copies(values: FloatArray, y: Any) -> bool:
    """Return whether values are a linear function of what was measured of an output."""
    numbers = np.asarray(pd.to_numeric(pd.Series(y), errors="coerce"), dtype=float)
    there = np.isfinite(numbers)
    return there.sum() > 2 and 1 - _likeness(values[there], numbers[there]) < SETTINGS.copy_rounding


def _likeness(a: FloatArray, b: FloatArray) -> float:
    """Return the size of a correlation, zero where one has no spread."""
    if min(np.ptp(a), np.ptp(b)) <= 0:
        return 0.0
    a, b = a - a.mean(), b - b.mean()
    return float(abs(a @ b) / (np.linalg.norm(a) * np.linalg.norm(b)))


def _check_ranges(columns: Mapping[str, FloatArray], ranges: Ranges) -> None:
    """Raise ValueError where at least half of the rows lie outside a simulated range."""
    for name, (low, high) in ranges.items():
        if name not in columns:
            continue
        values = columns[name]
        outside = 1 - _share_within(values, low, high)
        if outside < SETTINGS.majority:
            continue
        hint = _exchange(columns, ranges, name) or _unit(name, values, low, high)
        raise ValueError(
            f"{outside:.0%} of the measured rows have {name!r} outside the simulated range, "
            f"{low:g} to {high:g}: they go from {values.min():g} to {values.max():g}. {hint}"
        )


def _share_within(values: FloatArray, low: float, high: float) -> float:
    slack = 1e-9 * (high - low)
    return float(np.mean((values >= low - slack) & (values <= high + slack)))


def _unit(name: str, values: FloatArray, low: float, high: float) -> str:
    """Return what may be wrong with the unit of values, and what to do."""
    ways = [(f"multiplied by {f:.6g}", f * values, words) for f, words in _UNITS.items()]
    ways += [(f"divided by {f:.6g}", values / f, words) for f, words in _UNITS.items()]
    ways += [
        (f"as {a:.6g} + {b:.6g} of them", a + b * values, words)
        for (a, b), words in _SHIFTED.items()
    ]
    fitting = [way for way in ways if _share_within(way[1], low, high) >= SETTINGS.nearly_all]
    if not fitting:
        return "Check its unit, or simulate the range that was measured."
    # of several units the commonest that fills about as much of what was simulated as any
    most = max(np.ptp(way[1]) for way in fitting)
    how, _, words = next(way for way in fitting if np.ptp(way[1]) >= SETTINGS.nearly_all * most)
    return (
        f"Is it in another unit, as {words}? Its values {how} lie within. Check the unit, or "
        "simulate the range that was measured."
    )


def _exchange(columns: Mapping[str, FloatArray], ranges: Ranges, name: str) -> str:
    """Return which input may be exchanged with one that lies outside its range."""
    there = [other for other in ranges if other in columns]
    before = {one: _share_within(columns[one], *ranges[one]) for one in there}
    for other in (one for one in there if one != name):
        after = [_share_within(columns[a], *ranges[b]) for a, b in ((other, name), (name, other))]
        gain = sum(after) - before[name] - before[other]
        if min(after) >= SETTINGS.nearly_all and gain >= SETTINGS.majority:
            return (
                f"With the columns {name!r} and {other!r} exchanged, {min(after):.0%} lie within: "
                "were they swapped?"
            )
    return ""


def doubtful_columns(problem: Problem, ranges: Ranges) -> list[Caution]:
    """Return what looks wrong with single columns before a search.

    Parameters
    ----------
    problem : Problem
        Without effects.
    ranges : mapping of input to (low, high)
        Those simulated.
    """
    if problem.stacking is not None:
        return []
    model = problem.model
    columns = dict(zip(model.columns, problem.X.T, strict=False))
    sentences = []
    for name in list(columns)[model.n_inputs :]:
        likeness = _likeness(columns[name], problem.observed)
        if likeness > SETTINGS.copy_correlation:
            sentences.append(
                f"The column {name!r} follows the output almost exactly (correlation "
                f"{likeness:.5f}). Is it the output once more, rounded or computed from it? Then "
                "drop it."
            )
    for name in ranges:
        outside = 1 - _share_within(columns[name], *ranges[name])
        hint = _exchange(columns, ranges, name) if outside > 0 else ""
        if hint and not any(repr(name) in sentence for sentence in sentences):
            sentences.append(f"{outside:.0%} of the rows have {name!r} outside its range. {hint}")
    return [Caution("columns", sentence) for sentence in (*sentences, *_unit_of_output(problem))]


def _unit_of_output(problem: Problem) -> list[str]:
    """Say whether measured outputs look like the simulated ones in another unit."""
    simulated, y = _simulated(problem), problem.observed
    scaled, shifted = _alike(simulated, y), _alike(simulated, y, centred=True)
    gains = scaled @ y / np.sum(scaled**2, axis=1)
    # a unit is wrong where no parameters that draw the same shape reach the size
    far = np.all(gains > SETTINGS.unit_factor) or np.all(gains * SETTINGS.unit_factor < 1)
    shift = _named_shift(shifted, y) if len(shifted) else None
    if len(gains) and far:
        gain = float(np.median(gains))
        found = f"about {number(gain, 2)} times what is simulated{_named_factor(gain)}"
    elif shift is not None:
        found = f"in other degrees than the simulated one: it looks like {shift}"
    else:
        return []
    return [
        f"The measured output is {found}. Check that both have the same unit before believing a "
        "cause."
    ]


def _simulated(problem: Problem) -> FloatArray:
    """Return simulated outputs (J, n) at draws of the priors, and at the best fit that is known."""
    model = problem.model
    z = np.random.RandomState(0).standard_normal((FEW_DRAWS, model.n_unknowns))
    z[0] = 0.0
    z = np.vstack([z, problem.good]) if len(problem.good) else z
    coefficients = emulator_posterior(model.basis, problem.simulation).mean
    with np.errstate(over="ignore", invalid="ignore"):
        eta = model.simulated(problem.X, model.values(z), coefficients)[0]
        simulated = problem.likelihood.inverse(eta)
    return np.asarray(simulated[np.isfinite(simulated).all(axis=1)])


def _alike(simulated: FloatArray, y: FloatArray, centred: bool = False) -> FloatArray:
    """Return those of simulated outputs (J, n) that have the shape of y, up to a factor.

    The shape selects the parameters, as the size is in doubt. Centred: up to a constant as well.
    """
    a, b = simulated, y
    if centred:
        a, b = a - a.mean(axis=1, keepdims=True), b - b.mean()
    sizes = np.linalg.norm(a, axis=1) * np.linalg.norm(b)
    return simulated[a @ b > SETTINGS.nearly_all * np.maximum(sizes, np.finfo(float).tiny)]


def _named_factor(gain: float) -> str:
    for factor, words in _UNITS.items():
        for value in (factor, 1 / factor):
            if abs(np.log(gain / value)) < SETTINGS.unit_tolerance:
                return f" (as {words})"
    return ""


def _named_shift(simulated: FloatArray, y: FloatArray) -> str | None:
    """Return the shift between two units of temperature, where it is one."""
    spread = float(np.std(y))
    if not np.all(np.abs(np.mean(y - simulated, axis=1)) > SETTINGS.chance_sd * spread):
        return None
    for (offset, factor), words in _SHIFTED.items():
        left = np.mean(y - offset - factor * simulated, axis=1)
        if np.min(np.abs(left)) < spread:
            return words
    return None


def better_columns(result: Search, ranges: Ranges, chosen: Candidate) -> list[Caution]:
    """Return with which inputs exchanged, or in another unit, the simulation fits much better.

    Parameters whose priors are in another unit included. After a search that detected something
    wrong: each way takes one fit of the simulation alone.

    Parameters
    ----------
    result : Search
    ranges : mapping of input to (low, high)
        Those simulated.
    chosen : Candidate
        The best cause: other columns must do about as well, unless it is a curve of any shape.
    """
    problem, null = result.problem, result.candidates[0].fit
    least = SETTINGS.majority * null.sigma
    if chosen.cause is not None and not chosen.cause.is_process:
        least = min(least, chosen.fit.sigma / SETTINGS.majority)
    if problem.working_point is not None:
        return []
    found: list[tuple[float, float, str]] = []
    others = [(words, replace(problem, X=X)) for words, X in _other_columns(problem, ranges)]
    misses_most = null.sigma * problem.unit_noise > SETTINGS.majority * np.std(problem.y)
    is_known = chosen.cause is not None and chosen.cause.concerns == "prior"
    if misses_most and problem.model.basis.is_simulation and not is_known:
        others += _other_priors(problem)
    for words, other in others:
        try:
            fit = result.context.at(other).best_null()
        except ValueError:  # a simulation that fails there
            continue
        if np.isfinite(fit.mode.objective) and fit.sigma < least:
            found.append((result.context.deviance(fit.mode, fit.sigma), fit.sigma, words))
    if not found:
        return []
    # the commonest of those units of which the value is about as near to the middle of the prior
    most = min(found)[0] + _SAME_DEVIANCE
    best, words = next((sigma, words) for deviance, sigma, words in found if deviance < most)
    unit = problem.unit_noise
    return [
        Caution(
            "columns",
            f"With {words}, the simulation alone misses the output by {number(unit * best, 2)} "
            f"instead of {number(unit * null.sigma, 2)}. Check units of columns and priors.",
        )
    ]


def _other_columns(problem: Problem, ranges: Ranges) -> Iterator[tuple[str, FloatArray]]:
    """Yield what may be wrong with the inputs, and rows in which it is not."""
    names = problem.model.columns[: problem.model.n_inputs]
    # that which output a row is of is a column, too
    own = [k for k, name in enumerate(names) if name != OUTPUT]
    for i, j in combinations(own, 2):
        X = problem.X.copy()
        X[:, [i, j]] = X[:, [j, i]]
        yield f"the columns {names[i]!r} and {names[j]!r} exchanged", X
    for k, name in enumerate(names):
        if name not in ranges:
            continue
        values, (low, high) = problem.X[:, k], ranges[name]
        for factor, units in _UNITS.items():
            X = problem.X.copy()
            X[:, k] = factor * values
            filled = np.ptp(X[:, k]) > SETTINGS.majority * (high - low)
            if filled and _share_within(X[:, k], low, high) >= SETTINGS.nearly_all:
                yield f"{name!r} multiplied by {factor:.6g} (as {units})", X


def _other_priors(problem: Problem) -> Iterator[tuple[str, Problem]]:
    """Yield in which unit the prior of a parameter may be, and the problem with it in the other."""
    model = problem.model
    for name, prior in model.parameters.items():
        low, high = prior.ppf([_TAIL_SHARE, 1 - _TAIL_SHARE])
        if not low > 0:
            continue
        for factor, units in _UNITS.items():
            for by, words in ((factor, f"{factor:.6g}"), (1 / factor, f"1/{factor:.6g}")):
                other = frozen(stats.loguniform, by * low, by * high)
                parameters = model.parameters | {name: other}
                said = f"the prior of {name!r} multiplied by {words} (as {units})"
                yield said, replace(problem, model=replace(model, parameters=parameters))
