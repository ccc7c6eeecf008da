"""Batches of measurements that differ in a parameter of the simulation."""

import numpy as np
import pandas as pd
from scipy import stats

import hybridsurrogate as hs

RATE, LEVEL = 0.5, 3.0


def decay(x, rate, level):
    return level * np.exp(-rate * x)


DECAY = hs.Simulator(
    decay,
    inputs={"x": (0, 4)},
    parameters={"rate": stats.lognorm(0.5, scale=0.5), "level": stats.norm(3, 1)},
)


def batches(seed, spread=0.15, n=10, rows=12, noise=0.05):
    """Return rows of named batches, their outputs, and the rate of each batch."""
    rng = np.random.default_rng(seed)
    rates = np.maximum(RATE + spread * rng.standard_normal(n), 0.01)
    x = rng.uniform(0, 4, (n, rows))
    y = decay(x, rates[:, None], LEVEL) + noise * rng.standard_normal((n, rows))
    names = np.repeat([f"b{k}" for k in range(n)], rows)
    return pd.DataFrame({"x": x.ravel(), "batch": names}), y.ravel(), rates
