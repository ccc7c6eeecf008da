"""An unseen state that exchanges with one of the equation, against other ways of solving it."""

from __future__ import annotations

import numpy as np
import pytest
from agreement import assert_same_numbers
from decay import make_decay
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import hybridsurrogate as hs
from hybridsurrogate.ode.dynamics import CoupledStore

TIMES = np.linspace(1, 5, 41)
RATE, RATIO, SCALE, GAP = 0.7, 1.5, 0.8, -2.0
ROWS = np.tile([RATE, RATIO, SCALE, GAP], (len(TIMES), 1))


@pytest.mark.parametrize("method", ["rk4", "rosenbrock", "LSODA"])
def test_the_solution_is_that_of_two_compartments(method):
    coupled = make_decay(method=method).modified([CoupledStore("n")])
    out = RATIO / (SCALE * (1 + RATIO))
    matrix = np.array([[-RATE - out, out], [out / RATIO, -out / RATIO]])
    true = [(expm(matrix * (t - 1)) @ [2.0, 2.0 + GAP])[0] for t in TIMES]
    np.testing.assert_allclose(coupled(TIMES, ROWS), true, atol=2e-4)
    # what observe and `solution` meet are the states of the equation alone
    assert coupled.solution(TIMES, ROWS).shape == (1, len(TIMES))


def test_a_store_without_size_takes_nothing_and_others_change_nothing():
    coupled = make_decay().modified([CoupledStore("n")])
    nothing = np.tile([RATE, 0.0, SCALE, GAP], (len(TIMES), 1))
    np.testing.assert_allclose(coupled(TIMES, nothing), 2 * np.exp(-RATE * (TIMES - 1)), rtol=1e-6)
    mixed = coupled(np.tile(TIMES, 2), np.vstack([nothing, ROWS]))
    assert_same_numbers(mixed[: len(TIMES)], coupled(TIMES, nothing))
    assert_same_numbers(mixed[len(TIMES) :], coupled(TIMES, ROWS))


def test_it_stands_with_other_changes_of_a_driven_equation():
    box = hs.OdeSimulator(
        lambda t, state, loss: loss * (10 * np.sin(t) - state) + np.array([[0.0], [1.0]]) * state,
        initial_state=[20.0, 1.0],
        observe=lambda state: state[0] + 0 * state[1],
        inputs={"t": (0, 6)},
        parameters={"loss": hs.truncated_normal(0.5, 0.1, 0, 1)},
        states=("air", "n"),
    ).modified([hs.DynamicTerm("air").modification, CoupledStore("air")])

    def slopes(t, state):
        air, other, wall = state
        flow = (air - wall) / (SCALE * (1 + RATIO))
        return [
            0.5 * (10 * np.sin(t) - air) + 3 - RATIO * flow,
            0.5 * (10 * np.sin(t) - other) + other,
            flow,
        ]

    t = np.linspace(0, 6, 13)
    true = solve_ivp(slopes, (0, 6), [20.0, 1.0, 15.0], t_eval=t, rtol=1e-9, atol=1e-9).y[0]
    rows = np.tile([0.5, 3.0, RATIO, SCALE, -5.0], (13, 1))
    np.testing.assert_allclose(box(t, rows), true, atol=1e-4)


def test_a_state_that_is_not_there_is_told():
    with pytest.raises(ValueError, match="There is no state 'm'"):
        make_decay().modified([CoupledStore("m")])
