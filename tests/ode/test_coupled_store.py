"""An unseen state that exchanges with one of the equation, against other ways of solving it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from agreement import assert_same_numbers
from decay import make_decay
from few_kinds import all_but
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from tide import context_of

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


def test_exchanges_are_no_faster_than_the_solver_resolves():
    """Of rows in a part of the range of time: steps are a share of the whole range."""
    cooling = make_decay(
        rhs=lambda t, state, rate: rate * (22 - state),
        initial_state=[95.0],
        inputs={"t": (0, 221)},
        parameters={"rate": hs.truncated_normal(0.03, 0.02, 0, 0.2)},
    )
    t = np.arange(101.0)
    store = hs.DynamicStore("n").prepare(context_of(pd.DataFrame({"t": t}), cooling))
    shortest = store.parameters["scale"].ppf(0.0)
    rows = np.tile([0.03, 0.1, shortest, -5.0], (len(t), 1))
    out = cooling.modified([CoupledStore("n")])(t, rows)
    assert np.all((out > 22) & (out < 96))


def test_a_state_that_is_not_there_is_told():
    with pytest.raises(ValueError, match="There is no state 'm'"):
        make_decay().modified([CoupledStore("m")])


def make_room(**settings):
    """Return a heated room in weather whose temperature a second state follows."""
    given = {
        "rhs": room,
        "initial_state": [20.0, 18.0],
        "observe": lambda state: state[0],
        "inputs": {"t": (0, 24)},
        "parameters": {
            "resistance": hs.truncated_normal(3, 1, 1, 9),
            "heat": hs.truncated_normal(4, 1, 0, 9),
            "uptake": hs.truncated_normal(0.3, 0.1, 0, 1),
        },
        "states": ("air", "paper"),
    }
    return hs.OdeSimulator(**(given | settings))


def outside(t):
    return 10 + 5 * np.sin(t / 4)


def room(t, state, resistance, heat, uptake):
    air, paper = state
    taken = uptake * (air - paper)
    loss = (air - outside(t)) / resistance
    return np.stack([heat * np.maximum(np.sin(t), 0) - loss - 0.2 * taken, taken])


def with_a_wall(t, state, moved):
    """Return slopes of air, paper and wall, with one term of the air at the wall."""
    air, paper, wall = state
    at = dict.fromkeys(("resistance", "uptake"), air) | {moved: wall}
    loss, taken = (at["resistance"] - outside(t)) / 3, 0.3 * (at["uptake"] - paper)
    term = {"resistance": -loss, "uptake": -0.2 * taken}
    flow = (air - wall) / (SCALE * (1 + RATIO))
    rest = sum(value for name, value in term.items() if name != moved)
    air_slope = 4 * np.maximum(np.sin(t), 0) + rest - RATIO * flow
    return [air_slope, taken, flow + term[moved] / RATIO]


def solved_with_a_wall(t, moved):
    start, given = [20.0, 18.0, 20.0 + GAP], {"rtol": 1e-9, "atol": 1e-9, "max_step": 0.1}
    return solve_ivp(lambda *at: with_a_wall(*at, moved), (0, 24), start, t_eval=t, **given).y


@pytest.mark.parametrize("method", ["rk4", "rosenbrock", "LSODA"])
@pytest.mark.parametrize(("moved", "divides"), [("resistance", True), ("uptake", False)])
def test_a_term_acts_on_the_store_instead(method, moved, divides):
    change = CoupledStore("air", through=moved, divides=divides)
    walled = make_room(method=method).modified([change])
    t = np.linspace(0, 24, 25)
    rows = np.tile([3.0, 4.0, 0.3, RATIO, SCALE, GAP], (25, 1))
    true = solved_with_a_wall(t, moved)
    np.testing.assert_allclose(walled.solution(t, rows), true[:2], atol=2e-3)
    # without a size the room is as it was
    rows[:, 3] = 0.0
    np.testing.assert_allclose(walled(t, rows), make_room(method=method)(t, rows[:, :3]), atol=1e-3)


def test_what_acts_on_the_wall_is_named_and_predicted():
    t = np.linspace(0, 24, 49)
    true = solved_with_a_wall(t, "resistance")[0]
    y = true + 0.1 * np.random.default_rng(0).standard_normal(len(t))
    model = hs.PowerScaledSurrogate(
        make_room(), surrogate=hs.ExactSurrogate(), n_draws=200, random_state=0
    )
    early = t < 16
    diagnosis = hs.DiscrepancyDiagnosis(
        model,
        exclude=all_but("second-store"),
        cv=None,
        n_replicates=50,
        random_state=0,
    ).fit(t[early, None], y[early])
    assert diagnosis.causes_["form"].iloc[0] == "second-store: in series with resistance"
    before, after = (
        np.sqrt(np.mean((one.predict(t[~early, None]) - true[~early]) ** 2))
        for one in (diagnosis.estimator_, diagnosis.extended_estimator_)
    )
    assert after < before / 3


def test_a_term_that_no_store_can_take_over_is_told():
    model = hs.PowerScaledSurrogate(
        make_room(),
        surrogate=hs.ExactSurrogate(),
        effects=[hs.DynamicStore("air", through="heat")],
    )
    with pytest.raises(ValueError, match=r"'heat' multiplies or divides no .*'uptake'"):
        model.fit(TIMES[:, None], TIMES)
    with pytest.raises(ValueError, match="rhs has no parameter 'warmth'"):
        make_room().modified([CoupledStore("air", through="warmth")])


def test_terms_that_a_store_can_take_over():
    # the heat does not fall as the air gets warmer
    assert make_room().terms == {"air": {"resistance": True, "uptake": False}, "paper": {}}
    # the whole slope is no term of it, nor is what a number bends
    assert make_decay().terms == {"n": {}}
    bent = make_decay(rhs=lambda t, state, rate: 1 - state**rate)
    assert bent.terms == {"n": {}}
