"""Step 2 where each coefficient draw has a narrow posterior at a place of its own."""

import numpy as np
import pytest
from problems import make_problem
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.inference.conditional.grid import log_density_of_pairs
from hybridsurrogate.inference.conditional.pairwise_squares import MeasuredGiven
from hybridsurrogate.inference.conditional.sampler import second_step
from hybridsurrogate.inference.posterior_sampler import first_step
from hybridsurrogate.inference.procedure import make_target

PRIORS = {
    "start": hs.truncated_normal(60, 10, 40, 80),
    "rate": hs.truncated_normal(0.15, 0.05, 0.05, 0.3),
    "ambient": hs.truncated_normal(20, 4, 10, 30),
}


def temperature(t, start, rate, ambient=20.0):
    return ambient + start * np.exp(-rate * t)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n_parameters", "effects"),
    [(2, ()), (3, ()), (2, (hs.Gain(),)), (2, (hs.Trend("t"),))],
    ids=["two", "three", "a cause of sizes", "a cause with columns"],
)
def test_step_two_leaves_a_posterior_of_measured_rows_alone_as_it_is(n_parameters, effects):
    """Without weight on the runs both steps condition on the same rows, in two ways."""
    names = list(PRIORS)[:n_parameters]
    simulator = hs.Simulator(temperature, {"t": (0, 20)}, {name: PRIORS[name] for name in names})
    t = np.linspace(0, 20, 30)
    y = temperature(t, 63, 0.15) + 0.4 * np.random.default_rng(0).standard_normal(30)
    problem = make_problem(
        simulator.run(128, random_state=0),
        hs.PolynomialChaos(),
        hs.Normal(),
        None,
        effects,
        ("t",),
        t[:, None],
        y,
    )
    random_state = np.random.RandomState(0)
    drawn = first_step(make_target(problem, 0.0, 1.0), "auto", 1000, random_state)
    given = MeasuredGiven(
        problem.model, problem.X, y, problem.weights, drawn.c, problem.noise_prior, problem.scale
    )
    again = second_step(given, drawn.u, random_state)
    assert again.khat < 0.7
    u = np.column_stack([again.z, np.log(again.sigma)])
    densities = [log_density_of_pairs(given, points, np.arange(1000)) for points in (drawn.u, u)]
    change = densities[1] - densities[0]
    assert abs(change.mean()) < 4 * change.std() / np.sqrt(1000)
    # draws of step 1 come by importance weights, some of them more than once
    effective = drawn.diagnostics.effective_draws
    for k in range(u.shape[1]):
        both = np.concatenate([drawn.u[:, k], u[:, k]])
        assert abs(drawn.u[:, k].mean() - u[:, k].mean()) < 4 * both.std() / np.sqrt(effective / 2)


@pytest.mark.parametrize(
    "effects",
    [(), (hs.Gain(),), (hs.ParameterDrift("rate", "t"), hs.Trend("t")), (hs.NoiseOfMean(),)],
    ids=["none", "gain", "moved", "noise of the mean"],
)
@pytest.mark.parametrize(
    "surrogate", [hs.PolynomialChaos(), hs.Kriging(), hs.GaussianProcess()], ids=repr
)
def test_outputs_of_each_draw_are_its_features_times_its_coefficients(surrogate, effects):
    priors = {name: PRIORS[name] for name in ("start", "rate")}
    runs = hs.Simulator(temperature, {"t": (0, 20)}, priors).run(60, random_state=0)
    t = np.linspace(0, 20, 7)
    problem = make_problem(
        runs, surrogate, hs.Normal(), None, effects, ("t",), t[:, None], temperature(t, 63, 0.15)
    )
    rng = np.random.default_rng(0)
    model = problem.model
    values = model.values(rng.normal(size=(5, len(model.all_priors))))
    c = rng.normal(size=(5, len(model.basis.coefficient_mean)))
    known, features, noise = model.simulated(problem.X, values)
    output, same_noise = model.outputs(problem.X, values, c)
    expected = known + np.einsum("jnp,jp->jn", features, c)
    np.testing.assert_allclose(output, expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(same_noise, noise)


def test_the_noise_stays_within_a_bounded_prior():
    runs = hs.Simulator(temperature, {"t": (0, 20)}, PRIORS).run(60, random_state=0)
    t = np.linspace(0, 20, 30)
    y = temperature(t, 63, 0.15) + 0.4 * np.random.default_rng(0).standard_normal(30)
    one = hs.SimulationData(
        runs.X,
        runs.omega[:, :1],
        runs.y,
        inputs={"t": (0, 20)},
        parameters={"start": PRIORS["start"]},
    )
    model = hs.PowerScaledSurrogate(
        one, hs.PolynomialChaos(2), noise_prior=stats.uniform(0.5, 2), random_state=0
    ).fit(t[:, None], y)
    assert model.posterior_.sigma.min() >= 0.5
    assert model.posterior_.sigma.max() <= 2.5
