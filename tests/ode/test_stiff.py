"""Stiff and unlucky equations: a method with steps of its own is chosen, and right."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import lognorm, uniform

import hybridsurrogate as hs
from hybridsurrogate.ode.dynamics import TimeVaryingParameter

RATES = {"k1": 5e4, "k2": 1e3, "k3": 1.2e4}
START = [0.008, 0.08, 0.0, 0.2, 0.0, 0.0]
TIMES = np.linspace(0.01, 0.1, 10)


def catalysis(t, state, k1, k2, k3):
    v1, v2, v3 = k1 * state[0] * state[1], k2 * state[2] * state[3], k3 * state[4]
    return np.stack([-v1 + v3, -v1, v1 - v2, -v2, v2 - v3, v3])


def product(state):
    return state[5]


def make_chain(**settings):
    return hs.OdeSimulator(
        catalysis,
        START,
        product,
        {"t": (0, 0.1)},
        {name: lognorm(1, scale=rate) for name, rate in RATES.items()},
        states=("s0", "s1", "s2", "s3", "s4", "s5"),
        **settings,
    )


def by_lsoda(rhs, start, times, *numbers):
    # next to Radau at 1e-9 the states differ by 7e-9 of their largest, in an eighth of its time
    found = solve_ivp(
        rhs,
        (0, times[-1]),
        start,
        method="LSODA",
        t_eval=times,
        args=numbers,
        rtol=1e-10,
        atol=1e-13,
    )
    return found.y


@pytest.fixture(scope="module")
def chain():
    return make_chain()


def test_a_method_for_stiff_equations_is_chosen(chain):
    """RK4 has steps of a 6,400th: at the upper ends of the priors solutions were not finite."""
    assert chain.method == "rosenbrock"
    priors = {"rate": hs.truncated_normal(1, 0.1, 0.5, 2)}
    decay = hs.OdeSimulator(
        lambda t, state, rate: -rate * state, [1.0], lambda state: state[0], {"t": (0, 4)}, priors,
        states="n",
    )  # fmt: skip
    assert decay.method == "rk4"


def test_solutions_are_those_of_an_implicit_method(chain):
    rates = np.array([*RATES.values()]) * np.exp(np.random.default_rng(0).normal(size=(8, 3)))
    found = chain(np.tile(TIMES, 8)[:, None], np.repeat(rates, 10, axis=0)).reshape(8, 10)
    for row, own in zip(found, rates, strict=True):
        np.testing.assert_allclose(row, by_lsoda(catalysis, START, TIMES, *own)[5], rtol=1e-5)


@pytest.mark.slow
def test_a_fit_of_stiff_rates_ends(chain):
    """Draws far out in the priors took the most steps that there may be: minutes, or no end."""
    rng = np.random.default_rng(0)
    y = chain(TIMES[:, None], np.tile([*RATES.values()], (10, 1))) * np.exp(
        0.2 * rng.standard_normal(10)
    )
    model = hs.PowerScaledSurrogate(
        chain, surrogate=hs.ExactSurrogate(), likelihood="lognormal", n_draws=300, random_state=0
    )
    draws = model.fit(TIMES[:, None], y).posterior_.named()
    for name, value in RATES.items():
        low, high = np.quantile(draws[name], [0.005, 0.995])
        assert low < value < high
    assert not model.diagnostics_.n_steps  # no ensemble was needed


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3])
def test_a_heavy_tail_of_stiff_rates_is_drawn_by_few_calls(chain, monkeypatch, seed):
    """A ridge was followed where there is none: 39 CPU s, and a tail of k2 a third too short."""
    rng = np.random.default_rng(0)
    y = chain(TIMES[:, None], np.tile([*RATES.values()], (10, 1))) * np.exp(
        0.2 * rng.standard_normal(10)
    )
    calls, evaluate = [], hs.OdeSimulator.evaluate

    def counted(simulator, X, omega):
        calls.append(len(X) // 10)
        return evaluate(simulator, X, omega)

    monkeypatch.setattr(hs.OdeSimulator, "evaluate", counted)
    model = hs.PowerScaledSurrogate(
        chain, surrogate=hs.ExactSurrogate(), likelihood="lognormal", n_draws=300, random_state=seed
    )
    draws = model.fit(TIMES[:, None], y).posterior_.named()
    assert model.diagnostics_.sampler == "importance"
    assert len(calls) < 100
    assert sum(calls) < 50_000
    # draws of the priors, weighted by the likelihood with sigma integrated out
    z = np.random.default_rng(5).standard_normal((12_000, 3))
    rates = np.array([*RATES.values()]) * np.exp(z)
    outputs = evaluate(chain, np.tile(TIMES, 12_000)[:, None], np.repeat(rates, 10, axis=0))
    squares = np.sum((np.log(y) - np.log(outputs.reshape(-1, 10))) ** 2, axis=1)
    sigma = np.geomspace(0.03, 3, 100)
    log_density = -0.5 * squares[:, None] / sigma**2 - 9 * np.log(sigma)
    log_density -= 0.5 * (sigma / np.std(np.log(y))) ** 2
    weight = np.exp(log_density - log_density.max()).sum(axis=1)
    weight /= weight.sum()
    few = np.sqrt(1 / 300 + np.sum(weight**2))
    for name, own in zip(RATES, z.T, strict=True):
        mean = weight @ own
        sd = np.sqrt(weight @ (own - mean) ** 2)
        found = np.log(draws[name] / RATES[name])
        assert found.mean() == pytest.approx(mean, abs=4 * few * sd)
        assert found.std() == pytest.approx(sd, rel=0.25)


def robertson(t, state, k1, k2, k3):
    slow, fast = k1 * state[0], k3 * state[1] * state[2]
    square = k2 * state[1] ** 2
    return np.stack([-slow + fast, slow - fast - square, square])


def van_der_pol(t, state, mu):
    return np.stack([state[1], mu * (1 - state[0] ** 2) * state[1] - state[0]])


def enzymes(t, state, on, off, turn, last):
    """Two enzymes in a row, each of which binds, lets go or turns over."""
    s, c1, m, c2 = state
    e1, e2 = 1e-3 - c1, 2e-3 - c2
    bind1, bind2 = on * e1 * s - off * c1, on * e2 * m - off * c2
    return np.stack([-bind1, bind1 - turn * c1, turn * c1 - bind2, bind2 - last * c2])


# right-hand side, start, times, medians of rates, their logarithmic spread
SYSTEMS = {
    "robertson": (
        robertson,
        [1.0, 0.0, 0.0],
        np.geomspace(0.01, 1e4, 25),
        {"k1": 0.04, "k2": 3e7, "k3": 1e4},
        0.5,
    ),
    "van der pol": (van_der_pol, [2.0, 0.0], np.linspace(1, 75, 30), {"mu": 100.0}, 0.02),
    "enzymes": (
        enzymes,
        [1.0, 0.0, 0.0, 0.0],
        np.linspace(0.5, 60, 30),
        {"on": 1e5, "off": 1e3, "turn": 40.0, "last": 15.0},
        0.5,
    ),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_fresh_stiff_systems_agree_with_an_implicit_method(name):
    rhs, start, times, rates, spread = SYSTEMS[name]
    names = [f"x{k}" for k in range(len(start))]
    simulator = hs.OdeSimulator(
        rhs,
        start,
        lambda state: tuple(state),
        {"t": (0, float(times[-1]))},
        {key: lognorm(spread, scale=value) for key, value in rates.items()},
        states=tuple(names),
        output=tuple(names),
    )
    assert simulator.method == "rosenbrock"
    scatter = np.random.default_rng(0).normal(size=(3, len(rates)))
    own = np.array([*rates.values()]) * np.exp(spread * scatter)
    found = simulator(np.tile(times, 3)[:, None], np.repeat(own, len(times), axis=0))
    for rows, each in zip(found.reshape(3, len(times), -1), own, strict=True):
        expected = by_lsoda(rhs, start, times, *each).T
        # errors of a step are 1e-4 of a state
        size = np.max(np.abs(expected), axis=0)
        np.testing.assert_allclose(rows / size, expected / size, atol=2e-4)


def test_a_solution_does_not_depend_on_those_that_run_with_it(chain):
    rates = np.array([*RATES.values()]) * np.exp(np.random.default_rng(1).normal(size=(5, 3)))
    together = chain(np.tile(TIMES, 5)[:, None], np.repeat(rates, 10, axis=0)).reshape(5, 10)
    alone = [chain(TIMES[:, None], np.tile(own, (10, 1))) for own in rates]
    np.testing.assert_allclose(together, alone, rtol=1e-11)


def test_stiff_rates_that_no_step_of_rk4_follows():
    priors = {"rate": hs.truncated_normal(20000, 200, 10000, 30000)}
    simulator = hs.OdeSimulator(
        lambda t, state, rate: -rate * (state - np.cos(t)),
        [0.0],
        lambda state: state[0],
        {"t": (0, 3)},
        priors,
        states="x",
    )
    t = np.linspace(0.1, 3, 20)
    # the slow solution, to second order in 1 / rate
    exact = np.cos(t) + np.sin(t) / 20000 - np.cos(t) / 20000**2
    found = simulator(t[:, None], np.full((20, 1), 20000.0))
    np.testing.assert_allclose(found, exact, atol=2e-5)


def test_a_start_that_is_unknown():
    """Nothing happens before the first case: a jump, elsewhere for each set of parameters."""

    def epidemic(t, state, r0, lead):
        s, e, i = state
        new = r0 * 1.4 * s * i / 1e6
        return np.stack([-new, new - 7 / 3 * e, 7 / 3 * e - 1.4 * i]) * (t >= -lead)

    simulator = hs.OdeSimulator(
        epidemic,
        [1e6 - 1, 0.0, 1.0],
        lambda state: 0.1 * 7 / 3 * state[1],
        {"t": (-8, 23)},
        {"r0": uniform(1, 4), "lead": uniform(0, 8)},
        states=("s", "e", "i"),
    )
    assert simulator.method == "rosenbrock"
    t = np.arange(1.0, 24)
    for r0, lead in [(2.2, 4.0), (3.5, 0.7)]:
        states = by_lsoda(epidemic, [1e6 - 1, 0, 1], np.append(0, t + lead), r0, 0.0)
        found = simulator(t[:, None], np.tile([r0, lead], (23, 1)))
        expected = 0.1 * 7 / 3 * states[1, 1:]
        np.testing.assert_allclose(found, expected, rtol=5e-4)


@pytest.mark.parametrize(("method", "max_steps"), [("rosenbrock", 200), ("LSODA", 5)])
def test_a_solution_that_takes_too_many_steps_failed(method, max_steps):
    simulator = hs.OdeSimulator(
        lambda t, state, rate: np.stack([rate * state[1], -rate * state[0]]),
        [1.0, 0.0],
        lambda state: state[0],
        {"t": (0, 10)},
        {"rate": uniform(0.1, 200)},
        states=("x", "v"),
        method=method,
        sizes=(1.0, 1.0),
        max_steps=max_steps,
    )
    found = simulator([[1.0], [1.0]], [[0.5], [200.0]])
    np.testing.assert_allclose(found[0], np.cos(0.5), rtol=1e-3)
    assert np.isnan(found[1])
    with pytest.warns(hs.FailedRunsWarning, match="took more than max_steps"):
        simulator.run(64, random_state=0)


def test_far_from_the_medians_solutions_take_hardly_more_steps(chain):
    """Sizes are those at the medians: a state a hundred times as large took thousands of steps."""
    factors = np.exp([[4, -4, -4], [-4, 4, 4], [4, 4, -4]])
    rates = np.array([*RATES.values()]) * factors
    few = make_chain(method="rosenbrock", sizes=chain.function.sizes, max_steps=400)
    found = few(np.tile(TIMES, 3)[:, None], np.repeat(rates, 10, axis=0)).reshape(3, 10)
    for row, own in zip(found, rates, strict=True):
        np.testing.assert_allclose(row, by_lsoda(catalysis, START, TIMES, *own)[5], rtol=1e-4)


def test_changed_dynamics_keep_the_method(chain):
    changed = chain.modified([TimeVaryingParameter("k2", "ramp")])
    assert changed.method == "rosenbrock"
    assert changed.function.sizes == chain.function.sizes
    omega = np.tile([*RATES.values(), 1.0, 0.0, 1e-9], (10, 1))
    doubled = np.tile([5e4, 2e3, 1.2e4], (10, 1))
    np.testing.assert_allclose(
        changed(TIMES[:, None], omega), chain(TIMES[:, None], doubled), rtol=1e-4
    )


def test_sizes_are_checked():
    with pytest.raises(ValueError, match="sizes must be a positive number for each state"):
        make_chain(method="rosenbrock", sizes=(1.0,))
