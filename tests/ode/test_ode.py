"""Simulations that are ODEs, changes of their dynamics, and causes inside them."""

from __future__ import annotations

import pickle

import numpy as np
import pandas as pd
import pytest
from agreement import assert_same_numbers
from decay import make_decay
from epidemic import CONTACT, RECOVERY, hidden_fall, make_epidemic, sir
from scipy import stats
from scipy.integrate import solve_ivp
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.exceptions import FailedRunsWarning
from hybridsurrogate.ode.dynamics import DelayedState, MissingTerm, TimeVaryingParameter

# of a fixed step, where a right-hand side is compared with its exact solution
STEP = 60 / 400


def reference(rhs, start, times, **settings):
    span = (0.0, float(np.max(times)))
    exact = {"rtol": 1e-11, "atol": 1e-14, "method": "RK45"} | settings
    return solve_ivp(rhs, span, start, dense_output=True, **exact).sol(times)


# ------------------------------------------------------------------------------------ solutions


def test_exponential_decay():
    t, rate = np.linspace(1, 5, 23), np.linspace(0.2, 3, 23)
    exact = make_decay(max_step=0.01)
    np.testing.assert_allclose(exact(t, rate), 2 * np.exp(-rate * (t - 1)), rtol=1e-6)


def test_logistic_growth_from_an_unknown_start():
    simulator = hs.OdeSimulator(
        lambda t, state, rate, **_: rate * state * (1 - state),
        lambda start, **_: [start],
        lambda state, rate, start: state[0],
        inputs={"t": (0, 10)},
        parameters={"rate": stats.uniform(0.5, 1), "start": stats.uniform(0.01, 0.1)},
        states=("n",),
    )
    t, rate, start = np.linspace(0, 10, 30), np.linspace(0.5, 1.5, 30), np.linspace(0.01, 0.1, 30)
    exact = 1 / (1 + (1 / start - 1) * np.exp(-rate * t))
    np.testing.assert_allclose(simulator(t, np.column_stack([rate, start])), exact, rtol=1e-6)


@pytest.mark.parametrize("method", ["rk4", "DOP853"])
def test_harmonic_oscillator_with_a_second_input(method):
    simulator = hs.OdeSimulator(
        lambda t, state, stiffness, mass: np.stack([state[1], -stiffness / mass * state[0]]),
        [1.0, 0.0],
        lambda state: state[0],
        inputs={"t": (0, 10), "mass": (1, 4)},
        parameters={"stiffness": stats.uniform(0.5, 1)},
        states=("x", "v"),
        method=method,
        max_step=10 / 400 if method == "rk4" else None,
    )
    X = np.column_stack([np.linspace(0, 10, 20), np.repeat([1.0, 4.0], 10)])
    exact = np.cos(np.sqrt(1.2 / X[:, 1]) * X[:, 0])
    np.testing.assert_allclose(simulator(X, np.full((20, 1), 1.2)), exact, atol=1e-6)


def test_runge_kutta_agrees_with_scipy():
    t = np.linspace(0, 60, 25)
    for rate in (0.2, 0.45, 0.9):
        expected = reference(
            lambda s, state, rate=rate: sir(s, state, rate, RECOVERY), [0.999, 0.001], t
        )[1]
        # the interpolation of DOP853 is coarser than its steps
        for method, error in {"rk4": 1e-5, "LSODA": 1e-6, "Radau": 1e-6, "DOP853": 1e-4}.items():
            step = STEP if method == "rk4" else None
            values = make_epidemic(method, max_step=step)(t, np.full(25, rate))
            np.testing.assert_allclose(values, expected, rtol=error, err_msg=method)


def test_values_do_not_depend_on_the_other_rows():
    simulator, random = make_epidemic(), np.random.default_rng(0)
    t, rate = np.tile(np.linspace(0, 60, 20), 30), np.repeat(random.uniform(0.1, 1, 30), 20)
    values, order = simulator(t, rate), random.permutation(600)
    np.testing.assert_allclose(simulator(t[order], rate[order]), values[order], rtol=1e-12)
    np.testing.assert_allclose(simulator(t[:5], rate[:5]), values[:5], rtol=1e-12)


def test_is_a_simulator():
    simulator = make_epidemic()
    assert isinstance(simulator, hs.Simulator)
    assert clone(simulator) is simulator
    assert simulator.rates == ("contact_rate", "recovery_rate")
    assert repr(simulator).startswith("OdeSimulator(sir: t -> infected")
    runs = simulator.run(16, random_state=0)
    np.testing.assert_allclose(runs.y, simulator(runs.X, runs.omega))
    again = pickle.loads(pickle.dumps(simulator))
    np.testing.assert_array_equal(again(runs.X, runs.omega), runs.y)
    np.testing.assert_allclose(simulator.solution(runs.X, runs.omega)[1], runs.y)
    assert len(simulator(np.empty((0, 1)), np.empty((0, 1)))) == 0


# -------------------------------------------------------------------------------- modifications

CHANGES = [
    TimeVaryingParameter("contact_rate", "step"),
    TimeVaryingParameter("contact_rate", "ramp"),
    TimeVaryingParameter("recovery_rate", "logistic"),
    TimeVaryingParameter("contact_rate", "periodic", center=30.0),
    MissingTerm("i", "constant"),
    MissingTerm("s", "proportional"),
    MissingTerm("i", "seasonal", center=30.0),
    MissingTerm("i", "power", size=0.1),
    MissingTerm("i", "saturating"),
    MissingTerm("i", "product", other="s"),
    DelayedState("i"),
]


def test_modifications_at_neutral_change_nothing():
    simulator = make_epidemic()
    changed = simulator.modified(CHANGES)
    t, rate = np.linspace(0, 60, 12), np.full((12, 1), CONTACT)
    expected = simulator(t, rate)
    assert_same_numbers(changed(t, rate), expected)
    constants = np.tile([RECOVERY, *changed.modifiers.values()], (12, 1))
    assert_same_numbers(changed(t, np.hstack([rate, constants])), expected)
    frame = pd.DataFrame({"contact_rate": rate[:, 0], "recovery_rate": RECOVERY})
    frame = frame.assign(**changed.modifiers)
    assert_same_numbers(changed(t, frame), expected)


def _course(shape, t):
    if shape == "step":
        # as wide as the solver's own step
        return -0.6 * 0.5 * (1 + np.tanh((t - 25) / 0.15))
    if shape == "logistic":
        return -0.6 / (1 + np.exp(-(t - 25) / 4))
    if shape == "ramp":
        return -0.6 * np.clip((t - 25) / 8, 0, 1)
    return 0.3 * np.sin(2 * np.pi * t / 14) - 0.2 * np.cos(2 * np.pi * t / 14)


@pytest.mark.parametrize(
    ("shape", "numbers"),
    [
        ("step", [-0.6, 25.0]),
        ("logistic", [-0.6, 25.0, 4.0]),
        ("ramp", [-0.6, 25.0, 8.0]),
        ("periodic", [0.3, -0.2, 14.0]),
    ],
)
def test_changing_parameter_agrees_with_scipy(shape, numbers):
    t = np.linspace(0, 60, 30)
    changed = make_epidemic(max_step=STEP).modified([TimeVaryingParameter("contact_rate", shape)])
    values = changed(t, np.tile([CONTACT, RECOVERY, *numbers], (30, 1)))
    expected = reference(
        lambda s, state: sir(s, state, CONTACT * (1 + _course(shape, s)), RECOVERY),
        [0.999, 0.001],
        t,
        max_step=0.1,
    )[1]
    np.testing.assert_allclose(values, expected, rtol=1e-4)


@pytest.mark.parametrize(
    ("term", "numbers", "own"),
    [
        (MissingTerm("i", "constant"), [1e-3], lambda s, i: 1e-3),
        (MissingTerm("i", "proportional"), [1e-3], lambda s, i: 1e-3 * i),
        (
            MissingTerm("i", "power", size=0.1),
            [-0.1, 1.7],
            lambda s, i: -0.1 * 0.1 * (i / 0.1) ** 1.7,
        ),
        (MissingTerm("i", "saturating"), [-0.02, 0.15], lambda s, i: -0.02 * i / (0.15 + i)),
        (MissingTerm("i", "product", other="s"), [-0.1], lambda s, i: -0.1 * i * s),
    ],
    ids=lambda value: value.form if isinstance(value, MissingTerm) else "",
)
def test_missing_term_agrees_with_scipy(term, numbers, own):
    t = np.linspace(0, 60, 30)
    changed = make_epidemic(max_step=STEP).modified([term])
    values = changed(t, np.tile([CONTACT, RECOVERY, *numbers], (30, 1)))

    def slope(s, state):
        return sir(s, state, CONTACT, RECOVERY) + np.array([0, own(*state)])

    np.testing.assert_allclose(values, reference(slope, [0.999, 0.001], t)[1], rtol=1e-5)


def test_seasonal_forcing_agrees_with_scipy():
    t = np.linspace(0, 60, 30)
    changed = make_epidemic(max_step=STEP).modified([MissingTerm("i", "seasonal", center=5.0)])
    values = changed(t, np.tile([CONTACT, RECOVERY, 2e-4, -1e-4, 14.0], (30, 1)))

    def slope(s, state):
        angle = 2 * np.pi * (s - 5) / 14
        own = 2e-4 * np.sin(angle) - 1e-4 * np.cos(angle)
        return sir(s, state, CONTACT, RECOVERY) + np.array([0, own])

    np.testing.assert_allclose(values, reference(slope, [0.999, 0.001], t)[1], rtol=1e-5)


def test_rows_in_any_order_share_their_solutions():
    steps = []

    def counted(t, state, rate):
        steps.append(state.shape[1])
        return -rate * state

    simulator = make_decay(rhs=counted)
    t, rate = np.tile(np.linspace(1, 5, 20), 30), np.repeat(np.linspace(0.2, 1.5, 30), 20)
    order = np.random.default_rng(0).permutation(600)
    steps.clear()
    values = simulator(t[order], rate[order])
    assert set(steps) == {30}
    np.testing.assert_allclose(values, 2 * np.exp(-rate[order] * (t[order] - 1)), rtol=1e-6)


@pytest.mark.parametrize("method", ["rk4", "DOP853"])
def test_rows_in_any_order_are_observed_with_their_own_numbers(method):
    """What only ``observe`` takes: an input such as the gain of a sensor, and a parameter."""
    simulator = hs.OdeSimulator(
        lambda t, state, rate: -rate * state,
        [1.0],
        lambda state, sensor, scale: sensor * scale * state[0],
        inputs={"t": (0, 4), "sensor": (1, 100)},
        parameters={"rate": stats.uniform(0.5, 1), "scale": stats.uniform(1, 9)},
        states=("n",),
        method=method,
    )
    X = np.array([[1.0, 1.0], [1.0, 100.0], [2.0, 1.0], [2.0, 100.0]])
    omega = np.array([[1.0, 2.0], [1.0, 3.0], [1.0, 2.0], [1.0, 3.0]])
    exact = X[:, 1] * omega[:, 1] * np.exp(-X[:, 0])
    np.testing.assert_allclose(simulator(X, omega), exact, rtol=1e-4)


# --------------------------------------------------------------------------------------- errors


@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.PriorWarning")
@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.SolverWarning")
@pytest.mark.parametrize("method", ["rk4", "RK45"])
def test_solutions_that_fail_are_nan(method):
    def explosive(t, state, rate):
        if np.any(rate > 2.5):
            raise OverflowError("too fast")
        return rate * state**2

    simulator = make_decay(rhs=explosive, method=method)
    y = simulator(np.full(4, 1.3), np.array([0.1, 2.9, 0.2, 0.3]))
    np.testing.assert_allclose(y[[0, 2, 3]], 1 / (0.5 - 0.3 * np.array([0.1, 0.2, 0.3])), rtol=1e-5)
    assert np.isnan(y[1])
    assert np.isnan(simulator([4.0], [2.0])).all()  # infinite at t = 1.25
    with pytest.warns(FailedRunsWarning, match="too fast"):
        simulator.run(32, random_state=0)


def test_times_before_the_start():
    with pytest.raises(ValueError, match=r"'t' before the start of the simulation at 1 .* 0\.5"):
        make_decay()([0.5], [1.0])


def test_a_delay_meets_the_initial_state_before_the_start():
    t = np.linspace(1, 5, 30)
    y = make_decay()(np.maximum(t - 0.6, 1), np.full(30, 1.1))
    y = y + 0.01 * np.random.default_rng(0).standard_normal(30)
    model = hs.PowerScaledSurrogate(
        make_decay(),
        surrogate=hs.ExactSurrogate(),
        effects=(hs.Delay("t"),),
        n_draws=200,
        random_state=0,
    ).fit(t[:, None], y)
    assert model.posterior_.estimates(0)["lag"].mean() == pytest.approx(0.6, abs=0.05)
    np.testing.assert_allclose(model.predict([[1.2]]), 2.0, atol=0.02)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rhs": lambda t, state, rate: -rate}, r"rhs must return .* \(1, 2\)"),
        ({"rhs": lambda t, state, rate: [state[0], [1, 2, 3]]}, "rhs must return"),
        ({"initial_state": [1.0, 2.0]}, r"initial_state must return .* \(1, 2\)"),
        ({"initial_state": {"m": 1.0}}, r"initial_state has \['m'\]"),
        ({"observe": lambda state: state}, r"observe must return .* \(2,\)"),
        ({"method": "euler"}, "method must be one of"),
        ({"states": ()}, "states must be"),
        ({"max_step": 0.0}, "max_step must be positive"),
    ],
)
def test_wrong_definitions(settings, message):
    with pytest.raises(ValueError, match=message):
        make_decay(**settings)


def test_wrong_names():
    with pytest.raises(TypeError, match="rhs needs speed"):
        make_decay(rhs=lambda t, state, speed: -speed * state)
    with pytest.raises(TypeError, match="rate: neither rhs nor"):
        make_decay(rhs=lambda t, state: -state)
    with pytest.raises(ValueError, match="rhs has no parameter 'x'"):
        make_decay().modified([TimeVaryingParameter("x", "step")])
    with pytest.raises(ValueError, match="There is no state 'x'"):
        make_decay().modified([MissingTerm("x", "constant")])
    with pytest.raises(ValueError, match="give one of them another prefix"):
        make_decay().modified([MissingTerm("n", "constant")] * 2)
    plain = hs.Simulator(lambda t: t, inputs={"t": (0, 1)})
    with pytest.raises(ValueError, match="no right-hand side"):
        plain.modified([MissingTerm("n", "constant")])
    with pytest.raises(ValueError, match="shape must be one of"):
        TimeVaryingParameter("rate", "jump")
    with pytest.raises(ValueError, match="form must be"):
        MissingTerm("n", "square")
    with pytest.raises(ValueError, match="product needs the name of the other state"):
        MissingTerm("n", "product")
    with pytest.raises(ValueError, match="There is no state 'm'"):
        make_decay().modified([MissingTerm("n", "product", other="m")])


def test_causes_inside_the_dynamics_need_an_exact_ode():
    t, y = hidden_fall()
    simulator = make_epidemic(max_step=1.0)
    effects = (hs.DynamicDrift("contact_rate"),)
    plain = hs.Simulator(
        lambda t, contact_rate: contact_rate * t + 1,
        inputs={"t": (0, 60)},
        parameters={"contact_rate": stats.norm()},
    )
    for model in (
        hs.PowerScaledSurrogate(plain, surrogate=hs.ExactSurrogate(), effects=effects),
        hs.PowerScaledSurrogate(simulator.run(32, random_state=0), effects=effects),
        hs.PowerScaledSurrogate(plain.run(32, random_state=0), effects=(hs.DynamicTerm("i"),)),
    ):
        with pytest.raises(ValueError, match=r"need simulation=OdeSimulator.*ExactSurrogate"):
            model.fit(t, y)
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate())
    for cause, message in (
        (hs.DynamicDrift("x"), "'x' is no parameter or assumed constant"),
        (hs.DynamicDrift("contact_rate", column="u"), "time of the simulation is 't'"),
        (hs.DynamicDrift("contact_rate", priors={"period": stats.norm()}), "has no 'period'"),
        (hs.DynamicTerm("x"), "no state 'x'"),
    ):
        with pytest.raises(ValueError, match=message):
            model.set_params(effects=(cause,)).fit(t, y)


@pytest.mark.parametrize(("method", "again"), [("rk4", True), ("LSODA", False)])
def test_solutions_that_are_dear_one_by_one_are_cached(method, again):
    calls = []

    def decay(t, state, rate):
        calls.append(t)
        return -rate * state

    simulator = make_decay(rhs=decay, method=method)
    t, rate = np.array([[1.0], [2.0]]), np.full((2, 1), 0.5)
    first = simulator.cached(t, rate)
    calls.clear()
    np.testing.assert_array_equal(simulator.cached(t, rate), first)
    assert bool(calls) is again
