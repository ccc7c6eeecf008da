"""The explanations that an engineer would try, as curves that can be fitted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hybridsurrogate.simulation.simulator import Simulator

from .simulations import Array

KINDS = (
    "offset",
    "trend",
    "periodic",
    "step",
    "bump",
    "gain",
    "wrong-constant",
    "parameter-drift",
    "missing-input",
)

# what is searched, in shares of the measured span: a little more than a test case can hold
_PERIODS = (0.12, 1.25)
_WIDTHS = (0.03, 0.2)


@dataclass(frozen=True)
class Form:
    """One explanation with its target, as curves that can be fitted.

    ``columns(X, shape)`` gives (S, n, q) curves with free coefficients for S sets of shape numbers,
    ``rewrite(X, omega, shape)`` changes parameters and constants, (S, n, k), row by row.
    """

    kind: str
    target: str
    n_numbers: int
    bounds: Array  # (m, 2), of the shape numbers, which do not enter linearly
    starts: Array  # (s, m)
    columns: Callable[[Array, Array], Array] | None = None
    rewrite: Callable[[Array, Array, Array], Array] | None = None
    shape_is_free: bool = True  # False: only the values in `starts` are tried, a step's locations


def plain_form() -> Form:
    return Form("none", "", 0, np.empty((0, 2)), np.empty((1, 0)))


def forms(simulator: Simulator, X: Array) -> list[Form]:
    """List every explanation for these measurements, once for each possible target."""
    n_inputs = len(simulator.input_names)
    found = [_linear("offset", "", 1, lambda X: np.ones((len(X), 1)))]
    for j, name in enumerate(simulator.input_names):
        found += _forms_along(j, name, X[:, j])
    # the simulation's own curve is the column, so `_columns` supplies it
    found.append(Form("gain", "", 1, np.empty((0, 2)), np.empty((1, 0))))
    ranges = list(simulator.parameter_ranges.values())
    for k, name in enumerate(simulator.parameter_names):
        found += [
            _drift(k, name, ranges[k], j, X[:, j]) for j, _ in enumerate(simulator.input_names)
        ]
    for k, name in enumerate(simulator.assumed_names, start=len(simulator.parameter_names)):
        found.append(_wrong_constant(k, name, ranges[k]))
    for j in range(n_inputs, X.shape[1]):
        found.append(_missing(j, X[:, j].mean()))
    return found


def _linear(kind: str, target: str, n_numbers: int, curves: Callable[[Array], Array]) -> Form:
    def columns(X: Array, shape: Array) -> Array:
        return np.broadcast_to(curves(X), (len(shape), *curves(X).shape))

    return Form(kind, target, n_numbers, np.empty((0, 2)), np.empty((1, 0)), columns)


def _missing(j: int, mean: float) -> Form:
    return _linear("missing-input", "extra", 1, lambda X: X[:, [j]] - mean)


def _forms_along(j: int, name: str, x: Array) -> list[Form]:
    low, span = x.min(), np.ptp(x)

    def line(X: Array) -> Array:
        # where the simulation was right is not known, so a line needs two numbers
        return np.column_stack([np.ones(len(X)), (X[:, j] - low) / span])

    def waves(X: Array, shape: Array) -> Array:
        angle = 2 * np.pi * (X[:, j] - low) * shape  # by frequency: the grid is even in it
        return np.stack([np.sin(angle), np.cos(angle)], axis=-1)

    def steps(X: Array, shape: Array) -> Array:
        return (X[:, j] > shape)[..., None].astype(float)

    def bumps(X: Array, shape: Array) -> Array:
        location, width = shape[:, :1], np.exp(shape[:, 1:])
        return np.exp(-0.5 * ((X[:, j] - location) / width) ** 2)[..., None]

    frequency = (1 / (_PERIODS[1] * span), 1 / (_PERIODS[0] * span))
    values = np.unique(x)
    # two points on either side, or it is an outlier rather than a step
    between = (values[1:-2] + values[2:-1]) / 2
    log_width = np.log(np.multiply(_WIDTHS, span))
    bump_starts = [
        (location, width)
        for location in np.linspace(low, low + span, 25)
        for width in np.linspace(*log_width, 5)
    ]
    return [
        _linear("trend", name, 2, line),
        Form(
            "periodic",
            name,
            3,
            np.array([frequency]),
            np.linspace(*frequency, 40)[:, None],
            waves,
        ),
        Form(
            "step",
            name,
            2,
            np.array([[low, low + span]]),
            between[:, None],
            steps,
            shape_is_free=False,
        ),
        Form(
            "bump",
            name,
            3,
            np.array([[low, low + span], log_width]),
            np.array(bump_starts),
            bumps,
        ),
    ]


def _drift(k: int, name: str, limits: tuple[float, float], j: int, x: Array) -> Form:
    middle, half = (x.min() + x.max()) / 2, np.ptp(x) / 2
    reach = (limits[1] - limits[0]) / 2

    def rewrite(X: Array, omega: Array, shape: Array) -> Array:
        drifted = omega.copy()
        drifted[..., k] += shape * (X[:, j] - middle) / half
        drifted[..., k] = np.clip(drifted[..., k], *limits)
        return drifted

    starts = reach * np.linspace(-0.8, 0.8, 9)[:, None]
    return Form("parameter-drift", name, 1, np.array([[-reach, reach]]), starts, rewrite=rewrite)


def _wrong_constant(k: int, name: str, limits: tuple[float, float]) -> Form:
    def rewrite(X: Array, omega: Array, shape: Array) -> Array:
        changed = omega.copy()
        changed[..., k] = shape
        return changed

    starts = np.linspace(*limits, 11)[1:-1, None]
    return Form("wrong-constant", name, 1, np.array([limits]), starts, rewrite=rewrite)
