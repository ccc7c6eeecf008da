"""Measurements with a hidden effect, and what it is: a blind test bed for any diagnosis.

The curves here are written apart from those that any diagnosis fits. The size of an effect is the
root mean square, over the measured rows, of what is left of it after the simulation's parameters
have been fitted to the noise-free truth, in noise standard deviations. A natural magnitude of the
effect is drawn and the noise follows from the size, so one seed gives the same effect at each size
(unless the noise would be too small or too large for it).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import uniform

from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.simulation import Assumed, Simulator

from .by_hand import KINDS as EFFECT_KINDS
from .by_hand import fit_kind

Array = NDArray[np.float64]

KINDS = ("none", *EFFECT_KINDS)

# noise in shares of the range of the simulation's output
_NOISE_SHARES = (0.003, 0.3)
# parameters that absorb more of the effect than this leave nothing to find
_LEAST_LEFT = 0.1
_N_OUT = 100
_MOST_REDRAWS = 100


class InfeasibleError(Exception):
    """No case of this kind and size came out of many draws."""


@dataclass(frozen=True)
class Case:
    """One data set; the last column of X is recorded, but the simulation does not know it."""

    simulator: Simulator
    X: Array
    y: Array
    X_out: Array
    mu_out: Array
    truth: dict[str, Any]


# ---------------------------------------------------------------------------- the simulations


def slow_growth(t: Array, rate: Array, slope: Array) -> Array:
    return 5 + rate * np.log(t) + slope * t


def cooling(minutes: Array, rate: Array, start: Array) -> Array:
    return 20 + (start - 20) * np.exp(-rate * minutes)


def colony(day: Array, growth: Array, middle: Array, floor: Array) -> Array:
    return floor + (100 - floor) / (1 + np.exp(-growth * (day - middle)))


def pendulum(t: Array, amplitude: Array, frequency: Array, damping: Array) -> Array:
    return amplitude * np.exp(-damping * t) * np.cos(2 * np.pi * frequency * t)


def uptake(substrate: Array, half: Array, inhibition: Array) -> Array:
    return 10 * substrate / (half + substrate + substrate**2 / inhibition)


def heat_transfer(
    reynolds: Array, prandtl: Array, factor: Array, exponent: Array, prandtl_exponent: Array
) -> Array:
    return 2 + factor * reynolds**exponent * prandtl**prandtl_exponent


def epidemic(day: Array, contact: Array, seeded: Array, recovery: Array) -> Array:
    # Kermack and McKendrick's closed form for small epidemics, per thousand
    speed = contact - recovery
    peak = 500 * (speed / contact) ** 2
    peak_day = 2 / speed * np.arccosh(np.sqrt(peak / seeded))
    return peak / np.cosh(speed * (day - peak_day) / 2) ** 2


def conversion(hours: Array, temperature: Array, rate: Array, q10: Array, lag: Array) -> Array:
    speed = rate * q10 ** ((temperature - 20) / 10)
    return 100 * (1 - np.exp(-speed * np.maximum(hours - lag, 0)))


_SIMULATIONS: dict[str, tuple[Callable[..., Array], dict[str, Any], dict[str, Any], Any]] = {
    "slow_growth": (
        slow_growth,
        {"t": (1, 100)},
        {"rate": truncated_normal(1.0, 0.3, 0.2, 2.0)},
        {"slope": Assumed(0.01, uniform(0, 0.03))},
    ),
    "cooling": (
        cooling,
        {"minutes": (0, 60)},
        {"rate": truncated_normal(0.05, 0.015, 0.01, 0.1)},
        {"start": Assumed(90.0, uniform(75, 30))},
    ),
    "colony": (
        colony,
        {"day": (0, 30)},
        {
            "growth": truncated_normal(0.4, 0.1, 0.15, 0.8),
            "middle": truncated_normal(11, 2, 6, 16),
        },
        {"floor": Assumed(10.0, uniform(2, 16))},
    ),
    "pendulum": (
        pendulum,
        {"t": (0, 20)},
        {
            "amplitude": truncated_normal(5, 1, 2, 8),
            "frequency": truncated_normal(0.25, 0.02, 0.19, 0.31),
        },
        {"damping": Assumed(0.08, uniform(0.03, 0.1))},
    ),
    "uptake": (
        uptake,
        {"substrate": (0.1, 30)},
        {"half": truncated_normal(3, 1, 0.5, 6)},
        {"inhibition": Assumed(40.0, uniform(20, 50))},
    ),
    "heat_transfer": (
        heat_transfer,
        {"reynolds": (10, 1000), "prandtl": (0.7, 7)},
        {
            "factor": truncated_normal(0.6, 0.15, 0.2, 1.0),
            "exponent": truncated_normal(0.5, 0.04, 0.38, 0.62),
        },
        {"prandtl_exponent": Assumed(0.33, uniform(0.23, 0.2))},
    ),
    "epidemic": (
        epidemic,
        {"day": (0, 60)},
        {
            "contact": truncated_normal(0.47, 0.04, 0.38, 0.6),
            "seeded": truncated_normal(1.0, 0.3, 0.3, 2.0),
        },
        {"recovery": Assumed(0.25, uniform(0.18, 0.12))},
    ),
    "conversion": (
        conversion,
        {"hours": (1, 20), "temperature": (15, 35)},
        {
            "rate": truncated_normal(0.08, 0.02, 0.03, 0.15),
            "q10": truncated_normal(2.0, 0.3, 1.3, 3.0),
        },
        {"lag": Assumed(0.6, uniform(0, 1))},
    ),
}

SIMULATIONS = {name: Simulator(*parts) for name, parts in _SIMULATIONS.items()}


# ------------------------------------------------------------------------------- the effects


@dataclass(frozen=True)
class _Setting:
    """What is true apart from the effect, and where the measurements lie."""

    simulator: Simulator
    omega: Array  # (n_parameters + n_assumed,), constants as the modeller assumed them
    X: Array
    X_out: Array
    low: Array  # of the measured range, for each input
    span: Array
    output_range: float


Effect = tuple[Callable[[Array], Array], dict[str, Any]]


def _run(setting: _Setting, X: Array, omega: Array | None = None) -> Array:
    omega = np.tile(setting.omega, (len(X), 1)) if omega is None else omega
    return setting.simulator(X[:, : len(setting.low)], omega)


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw from a log-uniform distribution."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _added(
    kind: str, setting: _Setting, rng: np.random.Generator
) -> tuple[Callable[[Array], Array], dict[str, Any]]:
    """Draw a curve that is added to the simulation."""
    j = int(rng.integers(len(setting.low)))
    low, span = setting.low[j], setting.span[j]
    height = _sign(rng) * _between(rng, 0.03, 0.4) * setting.output_range
    truth: dict[str, Any] = {"target": setting.simulator.input_names[j]}
    if kind == "offset":
        return lambda X: np.full(len(X), height), {"target": "", "value": height}
    if kind == "missing-input":
        return lambda X: height * X[:, -1], {"target": "extra", "slope": height}
    if kind == "trend":
        # the simulation is right somewhere in the measured range: where it was tuned
        origin, slope = low + span * rng.uniform(), height / span
        truth |= {"slope": slope, "location": origin}
        return lambda X: slope * (X[:, j] - origin), truth
    if kind == "periodic":
        period, phase = span * _between(rng, 0.15, 1.0), rng.uniform(0, 2 * np.pi)
        truth |= {"period": period, "phase": phase, "amplitude": abs(height)}
        return lambda X: abs(height) * np.sin(2 * np.pi * (X[:, j] - low) / period + phase), truth
    if kind == "step":
        location = low + span * rng.uniform(0.15, 0.85)
        truth |= {"location": location, "value": height}
        return lambda X: height * (X[:, j] > location), truth
    if kind == "bump":
        location, width = low + span * rng.uniform(0.1, 0.9), span * _between(rng, 0.04, 0.15)
        truth |= {"location": location, "width": width, "amplitude": height}
        return lambda X: height * np.exp(-0.5 * ((X[:, j] - location) / width) ** 2), truth
    raise ValueError(f"Unknown kind {kind!r}.")


def _draw_effect(kind: str, setting: _Setting, rng: np.random.Generator) -> Effect | None:
    """Draw the noise-free truth as a function of X, and its numbers; None if out of bounds."""
    simulator, n_parameters = setting.simulator, len(setting.simulator.parameter_names)
    if kind == "none":
        return lambda X: _run(setting, X), {"target": ""}
    if kind == "gain":
        gain = 1 + _sign(rng) * _between(rng, 0.03, 0.4)
        return lambda X: gain * _run(setting, X), {"target": "", "gain": gain}
    if kind == "wrong-constant":
        k = int(rng.integers(len(simulator.assumed_names)))
        name = simulator.assumed_names[k]
        changed = setting.omega.copy()
        changed[n_parameters + k] = simulator.assumed[name].prior.ppf(rng.uniform(0.03, 0.97))
        truth = {"target": name, "value": changed[n_parameters + k]}
        return lambda X: _run(setting, X, np.tile(changed, (len(X), 1))), truth
    if kind == "parameter-drift":
        return _draw_drift(setting, rng)
    curve, truth = _added(kind, setting, rng)
    return lambda X: _run(setting, X) + curve(X), truth


def _draw_drift(setting: _Setting, rng: np.random.Generator) -> Effect | None:
    simulator = setting.simulator
    k, j = int(rng.integers(len(simulator.parameter_names))), int(rng.integers(len(setting.low)))
    name = simulator.parameter_names[k]
    low, high = simulator.parameter_ranges[name]
    middle = setting.low[j] + setting.span[j] / 2
    slope = _sign(rng) * rng.uniform(0.1, 0.6) * (high - low) / setting.span[j]

    def values(x: Array) -> Array:
        return setting.omega[k] + slope * (x - middle)

    # it goes on drifting beyond the measurements, and must mean something there too
    ends = values(np.array(simulator.input_ranges[simulator.input_names[j]]))
    if ends.min() < low or ends.max() > high:
        return None

    def truth(X: Array) -> Array:
        omega = np.tile(setting.omega, (len(X), 1))
        omega[:, k] = values(X[:, j])
        return _run(setting, X, omega)

    numbers = {
        "target": name,
        "along": simulator.input_names[j],
        "slope": slope,
        "location": middle,
    }
    return truth, numbers


# ---------------------------------------------------------------------------------- the cases


def _even(rng: np.random.Generator, n: int, low: float, high: float) -> Array:
    """Draw n values, one in each of n equal parts of the range, in order."""
    return low + (high - low) * (np.arange(n) + rng.uniform(size=n)) / n


def _draw_setting(simulator: Simulator, n_rows: int, rng: np.random.Generator) -> _Setting:
    """Draw true parameters and measured inputs.

    The first input is measured over the first 60 to 70 % of its range, the others over all of it:
    out of range means beyond the measured part of the first.
    """
    ranges = np.array(list(simulator.input_ranges.values()), dtype=float)
    measured = ranges.copy()
    measured[0, 1] = ranges[0, 0] + rng.uniform(0.6, 0.7) * np.ptp(ranges[0])
    outside = ranges.copy()
    outside[0, 0] = measured[0, 1]

    def rows(box: Array, n: int) -> Array:
        columns = [_even(rng, n, *box[0])]
        columns += [rng.permutation(_even(rng, n, *limits)) for limits in box[1:]]
        return np.column_stack([*columns, rng.normal(size=n)])

    X, X_out = rows(measured, n_rows), rows(outside, _N_OUT)
    # in deviations from its usual value, so its effect has no constant part to argue about
    X[:, -1] -= X[:, -1].mean()
    parameters = [prior.ppf(rng.uniform(0.1, 0.9)) for prior in simulator.parameters.values()]
    constants = [constant.value for constant in simulator.assumed.values()]
    omega = np.array([*parameters, *constants], dtype=float)
    output = simulator(X[:, :-1], np.tile(omega, (n_rows, 1)))
    low, span = measured[:, 0], np.ptp(measured, axis=1)
    return _Setting(simulator, omega, X, X_out, low, span, float(np.ptp(output)))


def left_over(simulator: Simulator, X: Array, mu: Array) -> Array:
    """Return what the simulation cannot follow of a noise-free curve, its parameters fitted."""
    plain = fit_kind(simulator, X, mu, "none", np.random.default_rng(0))[0]
    omega = np.tile(plain.numbers, (len(X), 1))
    return mu - simulator(X[:, : len(simulator.input_names)], omega)


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def make_case(
    kind: str, size: float, seed: int, n_rows: int = 40, simulation: str | None = None
) -> Case:
    """Make one data set with one hidden effect.

    Cases in which the parameters absorb nearly everything (less than a tenth of the effect's root
    mean square is left), or for which the noise would fall below 0.3 % or rise above 30 % of the
    simulation's output range, are drawn again, with another simulation. So a kind that some
    simulation cannot show, such as a gain where a parameter is a factor, never comes with it.

    Parameters
    ----------
    kind : str
        One of ``KINDS``.
    size : float
        Of the effect after what the parameters absorb, in noise standard deviations; without
        meaning for "none", whose noise is 1 to 10 % of the output range.
    seed : int
        The same seed gives the same case.
    n_rows : int
        Number of measurements.
    simulation : str, optional
        One of ``SIMULATIONS``, or else one is drawn.

    Returns
    -------
    Case
        ``truth`` holds kind, target, the effect's numbers in the units of the data, noise_sd,
        parameters (the true ones), mu (noise-free, measured rows) and left (what is left of the
        effect, measured rows).

    Raises
    ------
    InfeasibleError
        If no draw is admissible.
    """
    rng = np.random.default_rng([KINDS.index(kind), seed])
    for _ in range(_MOST_REDRAWS):
        name = str(rng.choice(list(SIMULATIONS)))
        setting = _draw_setting(SIMULATIONS[simulation or name], n_rows, rng)
        effect = _draw_effect(kind, setting, rng)
        if effect is None:
            continue
        truth_at, numbers = effect
        mu, base = truth_at(setting.X), _run(setting, setting.X)
        if kind == "none":
            left, noise_sd = np.zeros(n_rows), _between(rng, 0.01, 0.1) * setting.output_range
        else:
            left = left_over(setting.simulator, setting.X, mu)
            noise_sd = rms(left) / size
            share = noise_sd / setting.output_range
            if not _NOISE_SHARES[0] <= share <= _NOISE_SHARES[1]:
                continue
            if rms(left) < _LEAST_LEFT * rms(mu - base):
                continue
        parameter_names = setting.simulator.parameter_names
        truth = {
            "kind": kind,
            **numbers,
            "noise_sd": noise_sd,
            "parameters": dict(zip(parameter_names, setting.omega, strict=False)),
            "mu": mu,
            "left": left,
        }
        y = mu + noise_sd * rng.normal(size=n_rows)
        return Case(setting.simulator, setting.X, y, setting.X_out, truth_at(setting.X_out), truth)
    raise InfeasibleError(f"{kind!r} at size {size} with {simulation or 'any simulation'}")


# -------------------------------------------------------------------------- what counts as same

# The second is the first with a number more, so it follows it always: to name it is a mistake
# all the same, one of saying too much.
_CONTAINED = {("offset", "trend")}
_SAME_CURVE = 0.05


def same_curve(case: Case, kind_a: str, kind_b: str) -> bool:
    """Tell whether kind b draws the same curve as the truth of this case, which is kind a.

    It does if, fitted to the noise-free truth together with the parameters, it leaves less than
    5 % (root mean square) of what the parameters alone leave: no measurement at these inputs, with
    noise of that order, tells them apart. It is decided case by case, from the curves: a constant
    that multiplies x and a trend are one curve only where the parameters make up for the trend's
    value at 0.
    """
    if kind_a != case.truth["kind"]:
        raise ValueError(f"This case holds {case.truth['kind']!r}, not {kind_a!r}.")
    if kind_a == kind_b:
        return True
    if "none" in (kind_a, kind_b) or (kind_a, kind_b) in _CONTAINED:
        return False
    rng = np.random.default_rng(0)
    fits = fit_kind(case.simulator, case.X, case.truth["mu"], kind_b, rng)
    if not fits:  # "unexplained" and the like name no curve
        return False
    best = fits[0]
    return bool(np.sqrt(best.rss / len(case.X)) < _SAME_CURVE * rms(case.truth["left"]))
