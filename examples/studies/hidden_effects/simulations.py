"""Eight simulations of textbook kind, in which effects are hidden."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import uniform

from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.simulation.simulator import Assumed, Simulator

Array = NDArray[np.float64]


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
