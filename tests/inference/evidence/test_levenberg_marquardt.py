"""Causes inside the dynamics are followed to their best fit from many starts."""

from __future__ import annotations

import numpy as np
import pytest
from problems import make_problem

import hybridsurrogate as hs
from hybridsurrogate.effects.dynamics.dynamic_drift import DynamicDrift
from hybridsurrogate.inference.evidence.grid import make_grid
from hybridsurrogate.inference.evidence.levenberg_marquardt import (
    best_of_global_starts,
    best_of_many,
)
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.model.context import make_context
from hybridsurrogate.model.statistics import emulator_posterior
from hybridsurrogate.ode.dynamics import TimeVaryingParameter

NOISE = 0.04


def sir(t, state, contact, recovery):
    new = contact * state[0] * state[1]
    return np.stack([-new, new - recovery * state[1]])


@pytest.fixture(scope="module")
def epidemic():
    """A first wave: few infected, and priors two or three deviations from the truth."""
    return hs.OdeSimulator(
        sir,
        {"susceptible": 1 - 4e-6, "infected": 4e-6},
        lambda state: state[1],
        inputs={"day": (1, 60)},
        parameters={
            "contact": hs.truncated_normal(0.3, 0.1, 0.1, 1.3),
            "recovery": hs.truncated_normal(0.2, 0.1, 0.1, 0.6),
        },
        states=("susceptible", "infected"),
        max_step=1.0,
    )


@pytest.mark.parametrize(
    ("shape", "numbers"),
    [("logistic", [-0.75, 12.0, 12.0]), ("logistic", [-0.6, 30.0, 2.0]), ("exponential", [-0.03])],
)
def test_best_fit_is_reached_from_a_simulation_far_from_the_data(epidemic, shape, numbers):
    day = np.arange(1.0, 61.0)[:, None]
    truth = epidemic.modified([TimeVaryingParameter("contact", shape, center=1.0)])
    noise = NOISE * np.random.default_rng(0).standard_normal(60)
    y = truth(day, np.tile([0.55, 0.15, *numbers], (60, 1))) * np.exp(noise)
    likelihood = as_likelihood("lognormal")
    names = epidemic.input_names
    problem = make_problem(epidemic, hs.ExactSurrogate(), likelihood, None, (), names, day, y)
    basis = problem.model.basis
    context = make_context(epidemic, names, 1, day, problem.scale, likelihood, basis, 0.0)
    model = problem.model.with_effects((DynamicDrift("contact", shape).prepare(context),))
    grid = make_grid(model)
    z, sigma = best_of_many(
        model, day, problem.y, emulator_posterior(basis, None), grid, np.zeros(2), 1e-3
    )
    assert sigma < 1.3 * NOISE
    if shape == "logistic":
        amount, location, _ = model.values(z[None])[0, 2:]
        assert location == pytest.approx(numbers[1], abs=4)
        assert amount == pytest.approx(numbers[0], abs=0.15)


def test_an_output_that_runs_to_zero_is_a_bad_fit_and_no_more():
    """Its logarithm is infinite, and columns of an earlier cause are fitted to it."""
    t = np.linspace(0, 40, 30)[:, None]
    simulator = hs.Simulator(
        lambda t, k: np.exp(-k * t), {"t": (0, 40)}, {"k": hs.truncated_normal(0.03, 0.02, 0, 0.1)}
    )
    y = np.exp(-0.03 * t[:, 0]) * np.where(t[:, 0] > 20, 0.6, 1)
    likelihood, names = as_likelihood("lognormal"), simulator.input_names
    problem = make_problem(simulator, hs.ExactSurrogate(), likelihood, None, (), names, t, y)
    basis = problem.model.basis
    context = make_context(simulator, names, 1, t, problem.scale, likelihood, basis, 0.0)
    causes = hs.Step("t"), hs.ParameterDrift("k", "t", shape="exponential")
    model = problem.model.with_effects([cause.prepare(context) for cause in causes])
    grid = make_grid(model)
    line = grid.neutral.copy()
    line[grid.sizes[0]] = 2.4
    with np.errstate(divide="ignore"):
        assert np.isinf(model.simulated(t, model.values(line[None]), np.empty(0))[0]).any()
    emulator = emulator_posterior(basis, None)
    known = grid.neutral
    best = best_of_global_starts(model, t, problem.y, emulator, grid, known[:2], known, 1e-6)
    assert best is None or np.isfinite(best).all()


def test_two_columns_that_are_one_curve_are_no_trouble():
    """Ridge regression tells them apart by no digit, and must not fail."""
    t = np.linspace(0, 40, 30)[:, None]
    simulator = hs.Simulator(
        lambda t, k: np.exp(-k * t), {"t": (0, 40)}, {"k": hs.truncated_normal(0.03, 0.02, 0, 0.1)}
    )
    y = np.exp(-0.03 * t[:, 0]) + 0.2
    likelihood, names = as_likelihood("normal"), simulator.input_names
    problem = make_problem(simulator, hs.ExactSurrogate(), likelihood, None, (), names, t, y)
    basis = problem.model.basis
    context = make_context(simulator, names, 1, t, problem.scale, likelihood, basis, 0.0)
    causes = hs.Offset(), hs.Offset(), hs.ParameterDrift("k", "t")
    model = problem.model.with_effects([cause.prepare(context) for cause in causes])
    grid, emulator = make_grid(model), emulator_posterior(basis, None)
    known = grid.neutral
    # a floor so low that it is lost to rounding beside the columns
    best = best_of_global_starts(model, t, problem.y, emulator, grid, known[:1], known, 1e-12)
    assert best is None or np.isfinite(best).all()


def test_what_is_known_well_is_not_expected_to_change_much():
    fall = hs.OdeSimulator(
        lambda t, state, gravity, drag: np.stack([state[1], -gravity - drag * state[1]]),
        [47.0, 0.0],
        lambda state: state[0],
        inputs={"t": (0, 3)},
        parameters={"drag": hs.truncated_normal(0.1, 0.1, 0, 1)},
        assumed={"gravity": hs.Assumed(9.81, hs.truncated_normal(9.81, 0.02, 9.7, 9.9))},
        states=("height", "velocity"),
    )
    t = np.linspace(0.1, 3, 30)[:, None]
    likelihood = as_likelihood("normal")
    y = 47 - 9.81 / 2 * t[:, 0] ** 2
    problem = make_problem(fall, hs.ExactSurrogate(), likelihood, None, (), ("t",), t, y)
    basis = problem.model.basis
    context = make_context(fall, ("t",), 1, t, problem.scale, likelihood, basis, 0.0)
    known = DynamicDrift("gravity").prepare(context).parameters["amount"]
    guessed = DynamicDrift("drag").prepare(context).parameters["amount"]
    # gravity is known to 0.2 %: it may change by half a per cent, and not by two
    assert known.cdf(-0.02) < 0.01 < known.cdf(-0.005)
    assert guessed.cdf(-0.5) > 0.1
    swing = DynamicDrift("gravity", "periodic").prepare(context).parameters["sine"]
    assert swing.support()[1] < 0.01


def test_exponential_change_has_a_closed_form():
    decay = hs.OdeSimulator(
        lambda t, state, rate: -rate * state,
        [2.0],
        lambda state: state[0],
        inputs={"t": (0, 5)},
        parameters={"rate": hs.truncated_normal(1, 0.5, 0, 3)},
        states="n",
    )
    slower = decay.modified([TimeVaryingParameter("rate", "exponential")])
    assert slower.modifiers == {"rate_exponential_rate": 0.0}
    t, rate, change = np.linspace(0, 5, 20), 0.8, -0.4
    values = slower(t, np.tile([rate, change], (20, 1)))
    exponent = rate * np.expm1(change * t) / change  # the integral of rate exp(change t)
    np.testing.assert_allclose(values, 2 * np.exp(-exponent), rtol=1e-6)
