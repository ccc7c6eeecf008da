"""Noise that is not what was assumed, in noise standard deviations; the simulation is right.

What a size s means: noise that grows with the output has 1 + s times the standard deviation at the
largest output (without its sign) as at the smallest, a straight line between. Outliers, one row in
ten but at least three, have 1 + 2 s times that of the other rows. Of autocorrelated noise the
correlated part has s times the standard deviation of the independent part; it is an AR(1) process
along the first input, over two to five spacings of the rows. The first and the last have root mean
square one, the others' noise is as large as it would be without outliers.

An input, or a parameter, that is another one in every row makes noise where the simulation is
steep: so much that at the steepest row the standard deviation is, to first order, 1 + s times that
of the noise without it. The simulation itself is run there, not its slope.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .curves import OF_SLOPE, Setting, run
from .simulations import Array

# kinds that are in the noise alone
KINDS = ("noise", *OF_SLOPE)
# of the steepest row, as shares of its slope: an even slope makes noise like any other
_LEAST_SPREAD = 0.2
_STEP = 1e-4

Draw = tuple[Array, dict[str, Any]]


def growing_with_output(size: float, x: Array, mu: Array, rng: np.random.Generator) -> Draw:
    height = np.abs(mu)
    shape = 1 + size * (height - height.min()) / np.ptp(height)
    shape /= np.sqrt(np.mean(shape**2))
    return shape * rng.normal(size=len(mu)), {"ratio": 1 + size}


def outliers(size: float, x: Array, mu: Array, rng: np.random.Generator) -> Draw:
    n = len(mu)
    far = rng.permutation(n)[: max(3, round(n / 10))]
    noise = rng.normal(size=n)
    noise[far] *= 1 + 2 * size
    return noise, {"share": len(far) / n, "factor": 1 + 2 * size, "rows": far}


def autocorrelated(size: float, x: Array, mu: Array, rng: np.random.Generator) -> Draw:
    order = np.argsort(x)
    length = np.ptp(x) / (len(x) - 1) * np.exp(rng.uniform(np.log(2), np.log(5)))
    memory = np.exp(-np.diff(x[order]) / length)
    fresh = rng.normal(size=len(x))
    path = fresh.copy()
    for k, kept in enumerate(memory, start=1):
        path[k] = kept * path[k - 1] + np.sqrt(1 - kept**2) * fresh[k]
    noise = rng.normal(size=len(x))
    noise[order] += size * path
    return noise / np.sqrt(1 + size**2), {"length": length, "share": size**2 / (1 + size**2)}


FORMS: dict[str, Callable[[float, Array, Array, np.random.Generator], Draw]] = {
    "noise: mean": growing_with_output,
    "noise: tails": outliers,
    "noise: autocorrelation": autocorrelated,
}


def of_slope(
    kind: str, size: float, setting: Setting, noise_sd: float, rng: np.random.Generator
) -> Draw | None:
    """Draw which input or parameter is off, and noise; None where it is as steep everywhere."""
    names = setting.simulator.input_names
    if kind == "random-parameter":
        names = setting.simulator.parameter_names
    k = int(rng.integers(len(names)))
    low, high = (setting.simulator.input_ranges | setting.simulator.parameter_ranges)[names[k]]

    def moved(by: Array | float) -> Array:
        X, omega = setting.X.copy(), np.tile(setting.omega, (len(setting.X), 1))
        (omega if kind == "random-parameter" else X)[:, k] += by
        with np.errstate(invalid="ignore", divide="ignore"):
            return run(setting, X, omega)

    step = _STEP * (high - low)
    slope = np.abs(moved(step) - moved(-step)) / (2 * step)
    if not np.isfinite(slope).all() or np.ptp(slope) < _LEAST_SPREAD * slope.max():
        return None
    row_sd = np.sqrt(1 + ((1 + size) ** 2 - 1) * (slope / slope.max()) ** 2)
    usual = np.sqrt(np.mean(row_sd**2))
    spread = noise_sd / usual * np.sqrt((1 + size) ** 2 - 1) / slope.max()
    off = (moved(spread * rng.normal(size=len(slope))) - moved(0.0)) / noise_sd
    if not np.isfinite(off).all():
        return None
    told = {"target": names[k], "spread": spread, "row_sd": row_sd / usual}
    return off + rng.normal(size=len(slope)) / usual, told
