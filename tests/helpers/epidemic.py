"""An epidemic with two states, and one whose contact rate falls."""

from __future__ import annotations

import numpy as np

import hybridsurrogate as hs
from hybridsurrogate.ode.dynamics import TimeVaryingParameter

CONTACT, RECOVERY = 0.45, 0.12


def sir(t, state, contact_rate, recovery_rate):
    new = contact_rate * state[0] * state[1]
    return np.stack([-new, new - recovery_rate * state[1]])


def second(state):
    return state[1]


def make_epidemic(method="rk4", max_step=None):
    return hs.OdeSimulator(
        sir,
        {"s": 0.999, "i": 0.001},
        second,
        inputs={"t": (0, 60)},
        parameters={"contact_rate": hs.truncated_normal(0.4, 0.15, 0.05, 1.5)},
        assumed={"recovery_rate": hs.Assumed(RECOVERY, hs.truncated_normal(0.12, 0.04, 0.02, 0.4))},
        states=("s", "i"),
        output="infected",
        method=method,
        max_step=max_step,
    )


def hidden_fall(seed=0, n=40):
    """Forty days of an epidemic whose contact rate falls by 65 % around day 22."""
    t = np.linspace(1.5, 60, n)[:, None]
    truth = make_epidemic().modified([TimeVaryingParameter("contact_rate", "logistic")])
    omega = np.tile([CONTACT, RECOVERY, -0.65, 22.0, 3.0], (n, 1))
    noise = np.random.default_rng(seed).standard_normal(n)
    return t, truth(t, omega) * np.exp(0.05 * noise)
