"""Right-hand sides that follow a state as it was some time ago."""

from __future__ import annotations

import math

import numpy as np
import pytest
from agreement import assert_same_numbers
from decay import make_decay
from scipy import special

import hybridsurrogate as hs
from hybridsurrogate.ode.dynamics import DelayedState


@pytest.mark.parametrize("lag", [0.003, 0.4037, 1.0, 7.0])
def test_delayed_state_follows_the_closed_form(lag):
    # dn/dt = -rate n(t - lag) from n = 2 by the method of steps: sums of powers
    late = make_decay(max_step=0.01).modified([DelayedState("n")])
    t, rate = np.linspace(1, 5, 41), 0.7
    since, expected = t - 1, np.full(len(t), 2.0)
    for k in range(1, 1 + int(np.ceil(4 / lag)) if lag > 0.1 else 1):
        part = np.maximum(since - (k - 1) * lag, 0) ** k
        expected += 2 * (-rate) ** k * part / math.factorial(k)
    if lag < 0.1:
        # nearly a decay at the rate r with r = rate exp(r lag)
        r = -special.lambertw(-rate * lag).real / lag
        expected = 2 * np.exp(-r * since)
    values = late(t, np.tile([rate, lag], (41, 1)))
    np.testing.assert_allclose(values, expected, atol=1e-5)
    # solutions with other lags beside it change nothing
    other = late(np.repeat(t, 2), np.column_stack([np.full(82, rate), np.tile([lag, 0.0], 41)]))
    np.testing.assert_allclose(other[::2], values, rtol=1e-12)
    np.testing.assert_allclose(other[1::2], 2 * np.exp(-rate * since), rtol=1e-6)


@pytest.mark.parametrize("lag", [1e-3, 5e-3, 0.0125])
def test_fast_rates_with_short_lags_are_stable(lag):
    # dx/dt = -rate (x(t - lag) - 1) rests at 1 where rate * lag < pi / 2
    late = hs.OdeSimulator(
        lambda t, state, rate: -rate * (state - 1),
        initial_state=[0.0],
        observe=lambda state: state[0],
        inputs={"t": (0, 10)},
        parameters={"rate": hs.truncated_normal(20, 5, 1, 100)},
        states="x",
    ).modified([DelayedState("x")])
    # 80 is 2 a step of the solver
    for rate in (20.0, 80.0):
        np.testing.assert_allclose(late(np.linspace(3, 10, 9), [[rate, lag]] * 9), 1, atol=1e-9)


def test_lags_of_other_solutions_change_nothing():
    late = make_decay().modified([DelayedState("n")])
    t, omega = np.linspace(1, 5, 12), np.tile([0.7, 0.0], (12, 1))
    alone = late(t, omega)
    lags = np.repeat([0.0, 0.3, np.nan, -1.0], 12)
    mixed = late.evaluate(np.tile(t, 4), np.column_stack([np.full(48, 0.7), lags])).reshape(4, 12)
    assert_same_numbers(mixed[0], alone)
    assert np.isfinite(mixed[1]).all()
    # what is still to come cannot be seen: impossible, but where the solution starts
    assert np.isnan(mixed[2:, 1:]).all()


def test_a_delayed_state_needs_rk4():
    with pytest.raises(ValueError, match=r'DelayedState needs method="rk4"'):
        make_decay(method="LSODA").modified([DelayedState("n")])
