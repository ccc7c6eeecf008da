"""Noise that is not what was assumed, in noise standard deviations; the simulation is right.

What a size s means: noise that grows with the output has 1 + s times the standard deviation at the
largest output (without its sign) as at the smallest, a straight line between. Outliers, one row in
ten but at least three, have 1 + 2 s times that of the other rows. Of autocorrelated noise the
correlated part has s times the standard deviation of the independent part; it is an AR(1) process
along the first input, over two to five spacings of the rows. The first and the last have root mean
square one, the others' noise is as large as it would be without outliers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .simulations import Array

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
