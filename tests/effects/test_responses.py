"""What is made of the simulated output: through runs, in one of several outputs, of counts."""

import numpy as np
import pytest
from few_kinds import all_but
from scipy.stats import norm
from tide import context_of

import hybridsurrogate as hs
from hybridsurrogate.catalogue import catalogue
from hybridsurrogate.effects.context import OutputScale
from hybridsurrogate.inference.procedure import make_target

LIMIT = 12.0


def speed(t, a):
    return a * t + 0.02 * t**2


SMALL = hs.Simulator(speed, {"t": (0, 10)}, {"a": hs.truncated_normal(2, 0.3, 1, 3)}, output="v")
T = np.linspace(0.1, 9.9, 50)
NOISE = 0.3 * np.random.default_rng(5).normal(size=50)
FEW = all_but("limit", "gain", "offset", "step", "bump", "periodic", "response")


def test_a_response_of_ones_own_is_its_function_and_slope():
    """The posterior with a gain written as a response is that with the gain itself."""

    class Factor(hs.Cause):
        kind = "factor"
        parameters = {"gain": norm(1, 0.3)}

        def response(self, simulated, X, theta):
            return theta["gain"] * simulated, np.broadcast_to(theta["gain"], simulated.shape)

    class Same(Factor):
        response = hs.Cause.response

        def gain(self, X, theta):
            return theta["gain"]

    runs = SMALL.run(60, random_state=0)
    emulators = [(runs, hs.Kriging()), (runs, hs.PolynomialChaos(degree=3))]
    for simulation, surrogate in ((SMALL, hs.ExactSurrogate()), *emulators):
        first, second = (
            hs.PowerScaledSurrogate(
                simulation, surrogate=surrogate, effects=(cause,), n_draws=100, random_state=0
            ).fit(T[:, None], 1.1 * speed(T, 2.0) + NOISE)
            for cause in (Factor(), Same())
        )
        places = first.inference_.unknowns
        densities = [
            make_target(one.inference_.problem, 1.0, 1.0).search_density(places)
            for one in (first, second)
        ]
        # both are differences of finite steps
        np.testing.assert_allclose(*densities, rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("surrogate", [hs.Kriging(), hs.PolynomialChaos(degree=3)])
def test_a_limit_is_found_through_runs_alone(surrogate):
    # a rough emulator: what the runs leave open is no less than the noise
    runs = SMALL.run(12, random_state=0)
    model = hs.PowerScaledSurrogate(
        runs, surrogate=surrogate, effects=(hs.Limit(),), n_draws=300, random_state=0
    )
    away = []
    for random in map(np.random.default_rng, range(4)):
        y = np.minimum(speed(T, 2.0), LIMIT) + np.std(NOISE) * random.standard_normal(len(T))
        posterior, X = model.fit(T[:, None], y).posterior_, T[:, None]
        limits = posterior.estimates(0)["limit"]
        away.append((limits.mean() - LIMIT) / limits.std())
    # together as far away as 99 % of such sets are: the tail of one is a single draw
    assert abs(np.mean(away)) * np.sqrt(len(away)) < 2.58
    # no draw passes its own limit, wherever its emulator is
    assert np.all(posterior.eta(X)[0] <= limits[:, None] + 1e-9)
    # what the emulator leaves open is not seen beyond the limit, and all of it elsewhere
    factor, draw = np.eye(posterior.coefficients.shape[1]), posterior.values[:1]
    limited = posterior.model.emulator_error(X, draw, factor)
    everywhere = posterior.model.with_effects(()).emulator_error(X, draw[:, :1], factor)
    beyond, within = speed(T, 2.0) > LIMIT + 1, speed(T, 2.0) < LIMIT - 1
    assert np.abs(everywhere[beyond]).max() > 0
    np.testing.assert_array_equal(limited[beyond], 0.0)
    np.testing.assert_allclose(limited[within], everywhere[within], rtol=1e-9)


def test_a_limit_of_one_output_is_in_its_units_and_in_the_extended_simulation():
    random = np.random.default_rng(3)
    simulator = hs.Simulator(
        lambda t, a: (a * np.sin(t), 100 * a * np.cos(t)),
        {"t": (0, 10)},
        {"a": hs.truncated_normal(2, 0.3, 1, 3)},
        output=("u", "v"),
    )
    t = np.sort(random.uniform(0, 10, 60))
    Y = np.column_stack([2 * np.sin(t), np.minimum(200 * np.cos(t), 90)])
    Y += random.normal(size=Y.shape) * [0.1, 8.0]
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    settings = {"exclude": FEW, "cv": None, "n_replicates": 39}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings, random_state=0)
    best = diagnosis.fit(t[:, None], Y).best_cause_
    assert (best.kind, best.target) == ("limit", "v")
    mean = best.estimates["limit"][0]
    posterior = diagnosis.extended_estimator_.posterior_
    low, high = np.quantile(posterior.estimates(0)["limit"], [0.005, 0.995])
    assert low < 90 < high
    # its own parameter is in the units in which the cause is weighed
    extended, rows = diagnosis.extended_simulator_, np.array([[0.0], [np.pi]])
    assert list(extended.parameters) == ["a", "limit"]
    scale = posterior.model.effects[0].scale
    u, v = extended(rows, np.array([[2.0, mean / scale]] * 2)).T
    np.testing.assert_allclose(v, [mean, -200.0], rtol=1e-9)
    np.testing.assert_allclose(u, [0.0, 0.0], atol=1e-9)


def test_counts_that_are_cut_off():
    """A detector that counts no more than so much, under a likelihood of counts."""
    random = np.random.default_rng(8)
    simulator = hs.Simulator(
        lambda t, rate: 200 * np.exp(-rate * t) + 5,
        {"t": (0, 10)},
        {"rate": hs.truncated_normal(0.4, 0.1, 0.1, 0.9)},
    )
    t = np.sort(random.uniform(0, 10, 50))
    y = random.poisson(np.minimum(200 * np.exp(-0.4 * t) + 5, 90)).astype(float)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), likelihood="poisson", random_state=0
    )
    settings = {"exclude": FEW, "cv": None, "n_replicates": 39}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings, random_state=0).fit(t[:, None], y)
    assert diagnosis.best_cause_.kind == "limit"
    draws = diagnosis.extended_estimator_.posterior_.estimates(0)["limit"]
    low, high = np.quantile(draws, [0.005, 0.995])
    assert low < 90 < high


def test_numbers_of_a_bent_sensor_are_those_of_its_parabola():
    """Of a second output in other units: its response at any output, by hand."""
    bent = hs.SensorResponse(OutputScale(spread=2.0, simulated=3.0, unit=50.0))
    theta = {"level": np.array([0.3]), "gain": np.array([0.8]), "curvature": np.array([-0.05])}
    told = {name: values[0] for name, values in bent.estimates(theta, {}).items()}
    for eta in (-1.0, 0.0, 2.5, 7.0):
        measured = 50 * bent.response(np.array([eta]), {}, theta)[0][0]
        y = 50 * eta
        by_numbers = told["level"] + told["gain"] * y + told["curvature"] * y**2
        assert by_numbers == pytest.approx(measured)


@pytest.mark.parametrize("cause", [hs.Limit(), hs.Limit(below=True), hs.SensorResponse()])
def test_slopes_are_those_of_the_response(cause):
    simulated = np.linspace(-2.95, 2.95, 60)
    theta = {"limit": 0.7, "level": 0.3, "gain": 0.8, "curvature": -0.2}
    ready = cause.prepare(context_of())
    _, slope = ready.response(simulated, {}, theta)
    ahead, behind = (ready.response(simulated + h, {}, theta)[0] for h in (1e-6, -1e-6))
    np.testing.assert_allclose((ahead - behind) / 2e-6, slope, atol=1e-6)


def test_a_build_up_of_ones_own_says_itself_where_it_begins():
    class WarmUp(hs.Cause):
        kind = "build-up"
        target = "t"
        parameters = {"scale": norm(3, 0.1)}

        def gain(self, X, theta):
            return 1 - np.exp(-X["t"] / theta["scale"])

    assert any(isinstance(cause, WarmUp) for cause in catalogue(context_of(), [WarmUp()])[0])


def test_a_build_up_of_a_logarithmic_output_is_the_same_factor():
    """The logarithm of the share is added, as with a gain, so that units do not matter."""
    taken_up = hs.BuildUp("t", log_scale=True).prepare(context_of())
    rows, theta = {"t": np.array([0.5, 2.0, 8.0])}, {"scale": np.full(3, 1.5)}
    simulated = np.array([3.0, 20.0, 7.0])
    values, slopes = taken_up.response(np.log(simulated), rows, theta)
    np.testing.assert_allclose(np.exp(values), simulated * (1 - np.exp(-rows["t"] / 1.5)))
    np.testing.assert_array_equal(slopes, 1.0)


def test_a_second_store_is_added_to_the_output_itself():
    tissue = hs.SecondStore("t").prepare(context_of(likelihood="lognormal"))
    rows = {"t": tissue.pivot + np.array([0.0, 2.0, 8.0])}
    theta = {"size": np.full(3, 0.5), "scale": np.full(3, 4.0)}
    simulated = np.array([3.0, 1.0, 0.1])
    total = simulated + 0.5 * np.exp(-np.array([0.0, 2.0, 8.0]) / 4)
    values, slopes = tissue.response(np.log(simulated), rows, theta)
    np.testing.assert_allclose(np.exp(values), total)
    np.testing.assert_allclose(slopes, simulated / total)


def test_a_second_store_of_an_output_itself_is_a_decay():
    with pytest.raises(ValueError, match=r"use Decay\('t'\), which is the same"):
        hs.SecondStore("t").prepare(context_of())


def test_a_second_store_is_found_in_a_decay():
    """Blind: 3 exp(-1.2 t) is simulated, a tenth of it comes back with a time of 6."""
    rng = np.random.default_rng(3)
    t = np.sort(rng.uniform(0, 6, 40))
    clean = 3 * np.exp(-1.2 * t) + 0.3 * np.exp(-t / 6)
    simulator = hs.Simulator(
        lambda t, size, rate: size * np.exp(-rate * t),
        inputs={"t": (0, 8)},
        parameters={
            "size": hs.truncated_normal(2.5, 1, 0.2, 6),
            "rate": hs.truncated_normal(0.8, 0.3, 0.1, 2),
        },
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), likelihood="lognormal", random_state=0
    )
    few = all_but(
        "second-store", "trend", "ramp", "saturation", "parameter-drift", "wrong-constant"
    )
    settings = {"exclude": few, "cv": None, "n_replicates": 39}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings, random_state=0)
    diagnosis.fit(t[:, None], clean * np.exp(0.1 * rng.standard_normal(40)))
    best = diagnosis.best_cause_
    assert (best.kind, best.target) == ("second-store", "t")
    draws = diagnosis.extended_estimator_.estimators_[0].posterior_.estimates(0)
    for name, truth in (("size", 0.3 * np.exp(-t[0] / 6)), ("scale", 6.0)):
        low, high = np.quantile(draws[name], [0.005, 0.995])
        assert low < truth < high
