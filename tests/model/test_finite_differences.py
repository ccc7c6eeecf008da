"""Simulations whose output jumps where their parameters hardly change."""

import warnings

import numpy as np
import pytest
from few_kinds import all_but
from problems import make_problem
from scipy.integrate import solve_ivp
from scipy.stats import norm

import hybridsurrogate as hs
from hybridsurrogate.model.context import least_step

T = np.linspace(0.1, 10, 40)
NOISE = 0.7


def rise(t, rate, top):
    return top * (1 - np.exp(-rate * t))


def rounded(digits):
    return lambda t, rate, top: np.round(rise(t, rate, top), digits)


def with_its_own_random_numbers(t, rate, top):
    # as good as random, and the same for the same parameters
    wild = np.sin(1.3e6 * (t + 7 * rate + 3 * top)) * 4e4
    return rise(t, rate, top) + 0.25 * (2 * (wild - np.floor(wild)) - 1)


def looked_up(t, rate, top):
    return rise(t, np.round(20 * rate) / 20, top)


def fast_wave(t, rate, top):
    # hundreds of radians within a standard deviation of the rate
    return top * np.sin(300 * rate * t)


def place_of_a_jump(t, rate, top):
    return top * (t > 10 * rate)


def solved(tolerance):
    def output(t, rate, top):
        def slope(_, level):
            return rate * (top - level)

        return solve_ivp(slope, (0, t), [0.0], rtol=tolerance, atol=tolerance).y[0, -1]

    return output


def model_of(function, vectorized=True):
    simulator = hs.Simulator(
        function,
        {"t": (0, 10)},
        {"rate": hs.truncated_normal(0.4, 0.15, 0.05, 1.0), "top": norm(40, 8)},
        vectorized=vectorized,
    )
    return hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )


def measured(function, seed, hidden=0.0):
    random = np.random.default_rng(seed)
    return function(T, 0.33, 44.0) + hidden + NOISE * random.standard_normal(len(T))


def diagnosis_of(function, y, exclude=()):
    settings = {"exclude": exclude, "cv": None, "n_replicates": 99, "random_state": 0}
    diagnosis = hs.DiscrepancyDiagnosis(model_of(function), **settings)
    return diagnosis.fit(T[:, None], y)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("function", "vectorized", "is_rough"),
    [
        (rise, True, False),
        (fast_wave, True, False),
        (place_of_a_jump, True, False),
        (solved(1e-9), False, False),
        (rounded(1), True, True),
        (rounded(0), True, True),
        (with_its_own_random_numbers, True, True),
        (looked_up, True, True),
    ],
)
def test_slopes_are_taken_over_steps_that_jumps_do_not_rule(function, vectorized, is_rough):
    X, model = T[::4, None], model_of(function, vectorized)
    rows = model.checked_settings()
    problem = make_problem(model.simulation, *rows, None, (), ("t",), X, X[:, 0])
    step = least_step(problem.model, problem.X)
    assert step == problem.model.least_step
    # a hundredth or a tenth of a standard deviation: slopes decide which, and rounding with them
    assert step >= 1e-2 if is_rough else step == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "function", [rounded(0), rounded(1), looked_up, with_its_own_random_numbers]
)
def test_a_bump_on_a_rough_simulation_is_found_where_it_is(function):
    bump = 6 * NOISE * np.exp(-0.5 * ((T - 5.5) / 0.8) ** 2)
    right = []
    for seed in range(3):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
            found = diagnosis_of(function, measured(function, seed, bump)).best_cause_
        right.append(
            found is not None
            and found.kind == "bump"
            and abs(found.estimates["location"][0] - 5.5) < 0.5
        )
    # on the smooth one 10 of 10
    assert np.sum(right) >= 2


@pytest.mark.slow
def test_nothing_is_named_where_a_rough_simulation_is_right():
    function = rounded(0)
    verdicts = []
    for seed in range(6):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
            verdicts.append(diagnosis_of(function, measured(function, seed)).verdict_)
    # of 6 at a rate of 5 %, more than 1 come once in 30 times, more than 2 once in 450
    assert verdicts.count("adequate") >= 4


def test_jumps_as_large_as_the_noise_are_warned_of_with_their_size():
    # the error of rounding to whole numbers has a standard deviation of 1 / sqrt(12) = 0.29
    with pytest.warns(hs.DiagnosisWarning, match="The simulation is rough: .* about 0.[23]"):
        diagnosis_of(rounded(0), measured(rounded(0), 1), all_but("step", "trend"))


def test_jumps_far_below_the_noise_are_not_warned_of():
    diagnosis_of(rounded(1), measured(rounded(1), 1), all_but("step", "trend"))
