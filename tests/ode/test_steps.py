"""Steps of the solver: what it leaves out must not be found in the data."""

import warnings

import numpy as np
import pytest
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.effects.registry import kinds
from hybridsurrogate.ode.dynamics import TimeVaryingParameter


def ode(rhs, start, end, parameters, states="x", **settings):
    return hs.OdeSimulator(
        rhs,
        initial_state=start,
        observe=lambda state: state[0],
        inputs={"t": (0, end)},
        parameters=parameters,
        states=states,
        **settings,
    )


def swinging(t, state, rate):
    return np.stack([state[1], -(rate**2) * state[0]])


def decaying(t, state, rate):
    return -rate * state


def oscillator(periods, **settings):
    rate = 2 * np.pi * periods / 100
    priors = {"rate": hs.truncated_normal(rate, 0.01 * rate, 0.5 * rate, 2 * rate)}
    return ode(swinging, [1.0, 0.0], 100, priors, ("x", "v"), **settings), rate


@pytest.mark.parametrize("periods", [1, 10, 40, 60])
def test_solutions_are_as_exact_as_measurements_ask_for(periods):
    simulator, rate = oscillator(periods)
    t = np.linspace(0, 100, 301)
    found = simulator(t[:, None], np.full((301, 1), rate))
    np.testing.assert_allclose(found, np.cos(rate * t), atol=3e-4)


@pytest.mark.slow
def test_what_the_solver_leaves_out_is_not_named():
    """With 10 steps a period 8 % of the size are lost: a gain was named, p = 0.005."""
    simulator, rate = oscillator(40)
    random = np.random.default_rng(0)
    t = np.sort(random.uniform(0, 100, 60))
    y = np.cos(rate * t) + 0.05 * random.standard_normal(60)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    )
    others = tuple(kind for kind in kinds() if kind not in ("gain", "trend"))
    found = hs.DiscrepancyDiagnosis(model, exclude=others, cv=None, random_state=0)
    assert found.fit(t[:, None], y).verdict_ == "adequate"


def test_smooth_solutions_take_long_steps():
    simulator = ode(decaying, [1.0], 20, {"rate": stats.uniform(0.1, 0.4)})
    assert simulator.function.step >= 0.2
    t = np.linspace(0, 20, 101)
    np.testing.assert_allclose(
        simulator(t[:, None], np.full((101, 1), 0.5)), np.exp(-0.5 * t), atol=1e-4
    )


@pytest.mark.parametrize("location", [5.0, 5.07, 11.9])
def test_long_steps_follow_a_rate_that_jumps_anywhere(location):
    """The state has a bend there: what is off is less than noise of one percent."""
    plain = ode(decaying, [1.0], 20, {"rate": stats.uniform(0.1, 0.4)})
    change = TimeVaryingParameter("rate", "step")
    simulator = plain.modified([change])
    t = np.linspace(0, 20, 401)
    numbers = {"rate": 0.3, "rate_step_amount": 0.5, "rate_step_location": location}
    found = simulator(t[:, None], np.tile(list(numbers.values()), (401, 1)))
    exact = np.exp(-0.3 * t - 0.15 * np.maximum(t - location, 0))
    np.testing.assert_allclose(found, exact, atol=3e-3)


def test_a_right_hand_side_that_jumps_is_not_followed_without_end():
    def fed(t, state, rate):
        return (np.floor(t) % 2 == 0) - rate * state

    simulator = ode(fed, [0.0], 20, {"rate": hs.truncated_normal(0.5, 0.05, 0.2, 1)})
    assert simulator.function.step > 20 / 6400
    # fed during the first second and the third: between them it decays
    t = np.array([1.0, 2.0, 3.0])
    one = (1 - np.exp(-0.5)) / 0.5
    exact = [one, one * np.exp(-0.5), one * np.exp(-1.0) + one]
    np.testing.assert_allclose(simulator(t[:, None], np.full((3, 1), 0.5)), exact, rtol=5e-3)


def test_stiff_solutions_that_short_steps_can_follow():
    """At 1/400 of the range, the step that was once taken for any equation, there were none."""
    rate = hs.truncated_normal(2000, 100, 1000, 3000)
    simulator = ode(lambda t, state, rate: -rate * (state - np.cos(t)), [0.0], 3, {"rate": rate})
    t = np.linspace(0.1, 3, 20)
    found = simulator(t[:, None], np.full((20, 1), 2000.0))
    # the slow solution, to second order in 1 / rate
    exact = np.cos(t) + np.sin(t) / 2000 - np.cos(t) / 2000**2
    np.testing.assert_allclose(found, exact, atol=1e-5)


def test_steps_that_are_too_long_are_told():
    with pytest.warns(hs.SolverWarning, match="max_step, 0.5, is too long .* more than its size"):
        oscillator(100, max_step=0.5)
    priors = {"rate": hs.truncated_normal(20000, 200, 10000, 30000)}
    with pytest.warns(hs.SolverWarning, match='not finite, even with .* method="rosenbrock"'):
        ode(lambda t, state, rate: -rate * (state - np.cos(t)), [0.0], 3, priors, method="rk4")

    def lorenz(t, state, r):
        x, y, z = state
        return np.stack([10 * (y - x), x * (r - z) - y, x * y - 8 / 3 * z])

    priors = {"r": hs.truncated_normal(28, 1, 20, 35)}
    with pytest.warns(hs.SolverWarning, match="shortest step that is tried, 0.0078"):
        ode(lorenz, [1.0, 1.0, 1.0], 50, priors, ("x", "y", "z"))


def test_nothing_is_told_of_what_only_rounding_moves():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        two = ode(
            lambda t, state, rate: np.stack([0 * state[0], -rate * state[1]]),
            [0.0, 1.0],
            20,
            {"rate": stats.uniform(0.1, 0.4)},
            ("x", "y"),
        )
        oscillator(4, max_step=0.5)
    assert two.function.step >= 0.05


def test_a_changed_simulator_keeps_the_step():
    simulator, _ = oscillator(20)
    changed = simulator.modified([TimeVaryingParameter("rate", "ramp")])
    assert changed.function.step == simulator.function.step < 0.25
