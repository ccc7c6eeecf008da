"""Measurements with a hidden effect, and what it is: a blind test bed for any diagnosis.

The curves here are written apart from those that any diagnosis fits. The size of an effect is the
root mean square, over the measured rows, of what is left of it after the simulation's parameters
have been fitted to the noise-free truth, in noise standard deviations. A natural magnitude of the
effect is drawn and the noise follows from the size, so one seed gives the same effect at each size
(unless the noise would be too small or too large for it).

Noise that changes along an input leaves no curve: there a size of s means that its standard
deviation at one end of the measured rows is 1 + s times that at the other, log-linear between. See
`noises` for the other forms of noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hybridsurrogate.simulation.simulator import Simulator

from . import mechanisms, noises
from .curves import OF_SLOPE, Setting, between, draw_effect, run
from .fits import fit_kind
from .forms import KINDS as EFFECT_KINDS
from .simulations import SIMULATIONS, Array

KINDS = ("none", *EFFECT_KINDS)
# what the catalogue knows beside the nine kinds that are also fitted by hand
LATER_FORMS = (
    "trend: quadratic",
    "ramp",
    "decay",
    "saturation",
    "delay",
    "interaction",
    "noise",
    "parameter-drift: step",
    "parameter-drift: logistic",
    "parameter-drift: periodic",
    "noise: mean",
    "noise: tails",
    "noise: autocorrelation",
    "trend: since the start",
    "episode",
    "episode: factor",
    "build-up",
    "limit",
    "response",
)
LATEST_FORMS = (
    *OF_SLOPE,
    "ramp: loss",
    "missing-input: friction",
    "parameter-drift: exponential",
)
FORMS = (*KINDS, *LATER_FORMS, *LATEST_FORMS)
# the place of a form is part of the seed of its cases: what is new comes last
_SEEDED = (*KINDS, *LATER_FORMS, *mechanisms.FORMS, *LATEST_FORMS)

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


# ---------------------------------------------------------------------------------- the cases


def _even(rng: np.random.Generator, n: int, low: float, high: float) -> Array:
    """Draw n values, one in each of n equal parts of the range, in order."""
    return low + (high - low) * (np.arange(n) + rng.uniform(size=n)) / n


def draw_setting(simulator: Simulator, n_rows: int, rng: np.random.Generator) -> Setting:
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
    return Setting(simulator, omega, X, X_out, low, span, float(np.ptp(output)))


def along(x: Array, ratio: float) -> Array:
    """Return a factor on the noise, ``ratio`` from end to end and one in root mean square."""
    shape = ratio ** ((x - x.min()) / np.ptp(x))
    return shape / rms(shape)


def left_over(simulator: Simulator, X: Array, mu: Array) -> Array:
    """Return what the simulation cannot follow of a noise-free curve, its parameters fitted."""
    plain = fit_kind(simulator, X, mu, "none", np.random.default_rng(0))[0]
    omega = np.tile(plain.numbers, (len(X), 1))
    return mu - simulator(X[:, : len(simulator.input_names)], omega)


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def feasible(noise_sd: float, left: Array, effect: Array, setting: Setting) -> bool:
    """Tell whether the noise is of a natural size, and the parameters do not absorb the effect."""
    low, high = _NOISE_SHARES
    natural = low <= noise_sd / setting.output_range <= high
    return natural and rms(left) >= _LEAST_LEFT * rms(effect)


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
        One of ``FORMS`` or of ``mechanisms.FORMS``: the word before a colon is the kind.
    size : float
        Of the effect after what the parameters absorb, in noise standard deviations; without
        meaning for "none", whose noise is 1 to 10 % of the output range. For "noise" the factor
        by which its standard deviation changes is 1 + size; see `noises` for its other forms.
    seed : int
        The same seed gives the same case.
    n_rows : int
        Number of measurements.
    simulation : str, optional
        One of ``SIMULATIONS``, or else one is drawn.

    Returns
    -------
    Case
        ``truth`` holds kind, form, target, the effect's numbers in the units of the data, noise_sd,
        parameters (the true ones), mu (noise-free, measured rows) and left (what is left of the
        effect, measured rows).

    Raises
    ------
    InfeasibleError
        If no draw is admissible.
    """
    rng = np.random.default_rng([_SEEDED.index(kind), seed])
    for _ in range(_MOST_REDRAWS):
        name = str(rng.choice(list(SIMULATIONS)))
        setting = draw_setting(SIMULATIONS[simulation or name], n_rows, rng)
        effect = draw_effect(kind, setting, rng)
        if effect is None:
            continue
        truth_at, numbers = effect
        mu, base = truth_at(setting.X), run(setting, setting.X)
        noise_shape = np.ones(n_rows)
        if kind.partition(":")[0] in ("none", *noises.KINDS):
            left, noise_sd = np.zeros(n_rows), between(rng, 0.01, 0.1) * setting.output_range
            if kind == "noise":
                numbers["ratio"] = (1 + size) ** numbers.pop("sign")
                noise_shape = along(setting.X[:, numbers.pop("column")], numbers["ratio"])
        else:
            left = left_over(setting.simulator, setting.X, mu)
            noise_sd = rms(left) / size
            if not feasible(noise_sd, left, mu - base, setting):
                continue
        parameter_names = setting.simulator.parameter_names
        truth = {
            "kind": kind.partition(":")[0],
            "form": kind,
            **numbers,
            "noise_sd": noise_sd,
            "parameters": dict(zip(parameter_names, setting.omega, strict=False)),
            "mu": mu,
            "left": left,
        }
        noise = noise_shape * rng.normal(size=n_rows)
        if kind in noises.FORMS:
            noise, told = noises.FORMS[kind](size, setting.X[:, 0], mu, rng)
            truth |= told
        elif kind in OF_SLOPE:
            drawn = noises.of_slope(kind, size, setting, noise_sd, rng)
            if drawn is None:
                continue
            noise, told = drawn
            truth |= told
        y = mu + noise_sd * noise
        return Case(setting.simulator, setting.X, y, setting.X_out, truth_at(setting.X_out), truth)
    raise InfeasibleError(f"{kind!r} at size {size} with {simulation or 'any simulation'}")


# -------------------------------------------------------------------------- what counts as same

# The second is the first with a number more, so it follows it always: to name it is a mistake
# all the same, one of saying too much.
_CONTAINED = {("offset", "trend")}
SAME_CURVE = 0.05


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
    return bool(np.sqrt(best.rss / len(case.X)) < SAME_CURVE * rms(case.truth["left"]))
