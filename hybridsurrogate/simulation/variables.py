"""Inputs, parameters and assumed constants: named, each with a range or a prior."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats

from hybridsurrogate.arguments import as_names, as_real, check_mapping, described
from hybridsurrogate.exceptions import PriorWarning, did_you_mean
from hybridsurrogate.priors import check_prior, check_priors, prior_range
from hybridsurrogate.simulation.arrays import as_numbers, as_table, check_spread, is_numeric
from hybridsurrogate.types import FloatArray, Prior

# a column with more values, or of more names, is no column of levels
MAX_LEVELS = 6
# shares of a prior's mass in the simulated range: an error below the first, else a warning below
# the second
_MIN_SUPPORT, _FULL_SUPPORT = 0.01, 0.9


def varied_ranges(X: FloatArray, omega: FloatArray, fields: dict[str, Any]) -> dict[str, Range]:
    """Return the range of every input and column of omega; ValueError if one was never varied."""
    # what each name is, and the argument that it came by
    kinds = dict.fromkeys(fields["input_names"], ("input", "inputs"))
    kinds |= dict.fromkeys(fields["parameter_names"], ("parameter", "parameters"))
    kinds |= dict.fromkeys(fields["assumed_names"], ("assumed constant", "assumed"))
    ranges = {}
    for (name, (kind, argument)), column in zip(kinds.items(), (*X.T, *omega.T), strict=True):
        low, high = float(column.min()), float(column.max())
        if not low < high:
            raise ValueError(
                f"The {kind} {name!r} was never varied in the runs: "
                f"vary it or leave it out of {argument}."
            )
        ranges[name] = (low, high)
    return ranges


def ranges_of_inputs(
    inputs: Mapping[str, Range] | Sequence[str], varied: dict[str, Range]
) -> dict[str, Range]:
    """Return the ranges given, which must hold those varied, or the latter for names alone."""
    if not isinstance(inputs, Mapping):
        return {name: varied[name] for name in inputs}
    ranges = check_ranges(inputs)
    for name, given in ranges.items():
        if not _within(varied[name], given):
            raise ValueError(
                f"Runs go from {varied[name][0]:g} to {varied[name][1]:g} in the input {name!r}, "
                f"beyond its range, {given[0]:g} to {given[1]:g}: widen the range."
            )
    return ranges


def parameter_range(prior: Prior, varied: Range) -> Range:
    """Return the support of a prior if it has two ends and holds all runs, else their range."""
    low, high = (float(end) for end in prior.support())
    bounded = np.isfinite([low, high]).all()
    return (low, high) if bounded and _within(varied, (low, high)) else varied


def check_value(name: str, value: float, varied: Range, n_runs: int) -> None:
    """Raise ValueError where an assumed value lies beyond the runs."""
    low, high = varied
    margin = _margin(varied, n_runs)
    if not low - margin <= value <= high + margin:
        raise ValueError(
            f"The assumed value {value!r} of {name!r} lies outside its simulated range, {low:g} to "
            f"{high:g}: simulate around it."
        )


def check_support(name: str, prior: Prior, varied: Range, n_runs: int) -> None:
    """Warn the caller of a constructor, or raise, if runs hold little of a prior's mass."""
    margin = _margin(varied, n_runs)
    share = float(prior.cdf(varied[1] + margin) - prior.cdf(varied[0] - margin))
    text = (
        f"{share:.1%} of the prior of {name!r} lies in its simulated range, "
        f"{varied[0]:g} to {varied[1]:g}"
    )
    if not share >= _MIN_SUPPORT:
        raise ValueError(f"Only {text}: move the prior, or simulate where it has support.")
    if share < _FULL_SUPPORT:
        warnings.warn(f"Only {text}.", PriorWarning, stacklevel=3)


def _margin(varied: Range, n_runs: int) -> float:
    # a sample stops short of the ends of the range that it was drawn from, by about one spacing
    return 2 * (varied[1] - varied[0]) / (n_runs - 1)


def _within(inner: Range, outer: Range) -> bool:
    # files hold rounded numbers
    slack = 1e-9 * (outer[1] - outer[0])
    return inner[0] >= outer[0] - slack and inner[1] <= outer[1] + slack


Range = tuple[float, float]


@dataclass(frozen=True)
class Assumed:
    """A constant that the modeller fixed, perhaps wrongly.

    Parameters
    ----------
    value : float
        The value it was fixed at.
    prior : scipy.stats frozen distribution
        What it could be if that value is wrong.

    Raises
    ------
    ValueError
        If the prior as good as rules out the value: it lies outside the support or, where that
        has no end, beyond the outermost 0.1 %.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from scipy.stats import uniform
    >>> hs.Assumed(0.55, uniform(0.3, 0.6)).value
    0.55
    """

    value: float
    prior: Prior

    def __post_init__(self) -> None:
        check_prior(self.prior, "an assumed constant")
        as_real(self.value, "The value of an assumed constant")
        low, high = prior_range(self.prior)
        if not low <= self.value <= high:
            raise ValueError(
                f"The assumed value {self.value!r} lies outside the range of its prior, "
                f"{low:g} to {high:g}: widen the prior."
            )


def named_fields(
    input_names: tuple[str, ...],
    parameters: Mapping[str, Prior] | None,
    assumed: Mapping[str, Assumed] | None,
) -> dict[str, Any]:
    """Check the names and priors, and return the attributes of a simulation that follow."""
    priors, constants = check_priors(parameters), check_assumed(assumed)
    fields: dict[str, Any] = {
        "parameters": priors,
        "assumed": constants,
        "input_names": input_names,
        "parameter_names": tuple(priors),
        "assumed_names": tuple(constants),
    }
    names = [*input_names, *fields["parameters"], *fields["assumed"]]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(
            f"{', '.join(twice)} named more than once: inputs, parameters and assumed constants "
            f"need different names."
        )
    if not input_names:
        raise ValueError("A simulation needs at least one input.")
    return fields


def prior_names(parameters: Mapping[str, Prior | None] | Sequence[str] | None) -> dict[str, Any]:
    """Return the prior of each parameter, None where only its name is given.

    Examples
    --------
    >>> prior_names(["rate", "loss"])
    {'rate': None, 'loss': None}
    """
    if isinstance(parameters, Mapping):
        return check_mapping(
            parameters, "parameters", "prior", '{"rate": scipy.stats.norm(1, 0.2)}'
        )
    names = [parameters] if isinstance(parameters, str) else parameters
    known = isinstance(names, list | tuple) and all(isinstance(name, str) for name in names)
    if not (names is None or known):
        raise TypeError(
            f"parameters must be a dict of name to prior, or a list of names, got {parameters!r}."
        )
    return dict.fromkeys(names or ())


def with_uniform_priors(
    parameters: Mapping[str, Prior | None], omega: FloatArray
) -> dict[str, Any]:
    """Return priors, where there is none a uniform one over the runs, omega (n, at least so many).

    Raises
    ------
    ValueError
        For a parameter that has one value in all runs.

    Warns
    -----
    PriorWarning
        Says for which it was so.
    """
    priors, ends = dict(parameters), {}
    for (name, prior), column in zip(parameters.items(), omega.T, strict=False):
        if prior is not None:
            continue
        values = column[np.isfinite(column)]
        low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
        if not low < high:
            raise ValueError(
                f"The parameter {name!r} was never varied in the runs: vary it or leave it out of "
                "parameters."
            )
        priors[name] = stats.uniform(low, high - low)
        ends[name] = f"{low:.6g} to {high:.6g}"
    if ends:
        one = len(ends) == 1
        over = ", ".join(text if one else f"{name} from {text}" for name, text in ends.items())
        names = ", ".join(map(repr, ends))
        taken = f"{names}: {'it is' if one else 'they are'} taken as uniform over the runs, {over}"
        warnings.warn(
            f"No prior was given for {taken}. Give one: parameters={{name: "
            "scipy.stats.norm(mean, sd)}, on the command line --prior NAME=MEAN,SD.",
            PriorWarning,
            stacklevel=3,
        )
    return priors


def priors_of(parameters: dict[str, Prior], assumed: dict[str, Assumed]) -> dict[str, Prior]:
    """Return the priors of the columns of omega, in their order."""
    return parameters | {name: constant.prior for name, constant in assumed.items()}


def check_assumed(assumed: Mapping[str, Assumed] | None) -> dict[str, Assumed]:
    """Return the assumed constants by name; TypeError for anything else."""
    example = '{"recovery": Assumed(0.2, scipy.stats.norm(0.2, 0.05))}'
    constants = check_mapping(assumed, "assumed", "Assumed", example)
    for name, constant in constants.items():
        if not isinstance(constant, Assumed):
            raise TypeError(
                f"The assumed constant {name!r} must be Assumed(value, prior), got "
                f"{described(constant)}."
            )
    return constants


def check_inputs(inputs: Mapping[str, Range] | Sequence[str]) -> dict[str, Range] | tuple[str, ...]:
    """Return the inputs as a dict of finite ranges or a tuple of names; raise for anything else."""
    if isinstance(inputs, Mapping):
        return check_ranges(inputs)
    return as_names(inputs, "inputs", '["t"], or a dict of ranges, {"t": (0, 10)}')


def check_ranges(ranges: Mapping[str, Range]) -> dict[str, Range]:
    """Return finite ranges by name, as floats; raise for anything else."""
    checked = {}
    given = check_mapping(ranges, "inputs", "range", '{"t": (0, 10)}', optional=False)
    for name, ends in given.items():
        try:
            pair = as_numbers(ends, "")
        except (TypeError, ValueError):
            pair = np.empty(0)
        if pair.shape != (2,):
            raise TypeError(
                f"The range of {name!r} must be a pair of numbers (low, high), such as (0, 10), "
                f"got {described(ends)}."
            )
        low, high = pair
        if not (low < high and np.isfinite([low, high]).all()):
            raise ValueError(
                f"The range of {name!r} must be finite, from low to high, got ({low:g}, {high:g})."
            )
        check_spread(np.array([low, high], dtype=float), f"The range of {name!r}")
        checked[name] = (float(low), float(high))
    return checked


def describe(
    source: str,
    input_names: Sequence[str],
    parameter_names: Sequence[str],
    assumed_names: Sequence[str],
    output: str,
) -> str:
    """Say on one line what depends on what."""
    text = f"{source}: {', '.join(input_names)} -> {output}"
    if parameter_names:
        text += f", parameters: {', '.join(parameter_names)}"
    if assumed_names:
        text += f", assumed: {', '.join(assumed_names)}"
    return text


def select_columns(frame: pd.DataFrame, names: Sequence[str], title: str) -> pd.DataFrame:
    """Return the named columns, all of them numbers."""
    missing = [name for name in names if name not in frame.columns]
    if missing:
        raise ValueError(
            f"{title} have no column {', '.join(missing)}; "
            f"there are {', '.join(map(str, frame.columns))}."
            f"{did_you_mean(missing, frame.columns)}"
        )
    for name in names:
        if not is_numeric(frame[name]):
            raise ValueError(
                f"The column {name!r} must hold numbers, but some are text or dates. Count dates "
                "from one day in runs and measurements, (dates - pandas.Timestamp('2020-01-01')) / "
                "pandas.Timedelta('1D')."
            )
    return frame[list(names)]


def as_matrix(values: ArrayLike, word: str, names: Sequence[str]) -> FloatArray:
    """Return a float copy with one column a name; those of a frame go by name."""
    table = as_table(values, word)
    if isinstance(table, pd.DataFrame) and any(isinstance(c, str) for c in table.columns):
        table = select_columns(table, names, word)
    # an array was read as numbers already, and one on disk is not to be copied
    matrix = table if isinstance(table, np.ndarray) else as_numbers(table, word)
    if matrix.ndim == 1 and len(names) == 1:
        matrix = matrix[:, None]
    if matrix.ndim != 2 or matrix.shape[1] != len(names):
        raise ValueError(
            f"{word} must have shape (n, {len(names)}), columns {', '.join(names) or 'none'}, "
            f"got {matrix.shape}."
        )
    return matrix


def check_finite(values: FloatArray, word: str, names: Sequence[str]) -> None:
    """Raise ValueError that says where a matrix (n, len(names)) holds NaN or infinity."""
    wrong = ~np.isfinite(values)
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        raise ValueError(
            f"{word} holds NaN or infinity in {wrong.any(axis=1).sum()} of {len(values)} rows, the "
            f"first in the column {names[column]!r} of row {row + 1}: {values[row, column]}. "
            "Correct these rows, or leave them out."
        )


def check_lengths(arrays: dict[str, FloatArray]) -> None:
    """Check that arrays, given by what to call them, have the same number of rows."""
    if len({len(array) for array in arrays.values()}) > 1:
        counts = ", ".join(f"{word} {len(array)}" for word, array in arrays.items())
        raise ValueError(f"The numbers of rows differ: {counts}.")
