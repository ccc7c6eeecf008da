"""Ranges over which a simulation was run, held against those given and against priors."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hybridsurrogate.exceptions import PriorWarning
from hybridsurrogate.simulation.variables import Range, check_ranges
from hybridsurrogate.types import FloatArray, Prior

# shares of a prior's mass in the simulated range: an error below the first, else a warning below
# the second
_NO_SUPPORT, _LITTLE_SUPPORT = 0.01, 0.9


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
    if not share >= _NO_SUPPORT:
        raise ValueError(f"Only {text}: move the prior, or simulate where it has support.")
    if share < _LITTLE_SUPPORT:
        warnings.warn(f"Only {text}.", PriorWarning, stacklevel=3)


def _margin(varied: Range, n_runs: int) -> float:
    # a sample stops short of the ends of the range that it was drawn from, by about one spacing
    return 2 * (varied[1] - varied[0]) / (n_runs - 1)


def _within(inner: Range, outer: Range) -> bool:
    # files hold rounded numbers
    slack = 1e-9 * (outer[1] - outer[0])
    return inner[0] >= outer[0] - slack and inner[1] <= outer[1] + slack
