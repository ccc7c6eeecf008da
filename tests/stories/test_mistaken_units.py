"""Measurements in other units than the simulation: far off, where noise would explain all."""

import re

import numpy as np
import pytest

import hybridsurrogate as hs
from hybridsurrogate.effects.base import Context

X = np.linspace(0, 10, 40)[:, None]


def temperature(x, phase):
    """Return degrees Celsius."""
    return 15 + 8 * np.sin(2 * np.pi * x / 10 - phase)


def pressure(x, amplitude):
    """Return kPa."""
    return 101 + amplitude * np.sin(x) - 0.1 * x


def simulator(function):
    name = function.__code__.co_varnames[1]
    return hs.Simulator(function, {"x": (0, 10)}, {name: hs.truncated_normal(1, 0.3, 0, 2)})


def diagnose(function, change, seed, runs=False, cv=None):
    y = change(function(X[:, 0], 1.1))
    y = y + 0.1 * np.std(y) * np.random.default_rng(seed).standard_normal(40)
    simulation = simulator(function)
    surrogate = hs.ExactSurrogate()
    if runs:
        simulation, surrogate = simulation.run(100, random_state=0), hs.Kriging()
    model = hs.PowerScaledSurrogate(simulation, surrogate=surrogate, n_draws=200, random_state=0)
    return hs.DiscrepancyDiagnosis(model, cv=cv, random_state=0).fit(X, y)


# it was named outliers, or noise that grows with the mean, with a probability of one
@pytest.mark.slow
@pytest.mark.parametrize("amount", [273.15, 1000, 1e5])
@pytest.mark.parametrize("function", [temperature, pressure])
def test_an_offset_far_beyond_the_spread_is_named(function, amount):
    found = [diagnose(function, lambda y: y + amount, seed) for seed in range(2)]
    for d in found:
        assert (d.verdict_, d.best_cause_.kind) == ("named", "offset")
        _, low, high = d.best_cause_.estimates["amplitude"]
        assert high - low < 2
        assert low - 0.5 < amount < high + 0.5


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1e-3, 1e-2, 60, 1000])
@pytest.mark.parametrize("function", [temperature, pressure])
def test_a_factor_of_another_order_is_named(function, factor):
    found = [diagnose(function, lambda y: factor * y, seed) for seed in range(2)]
    for d in found:
        assert (d.verdict_, d.best_cause_.kind) == ("named", "gain")
        _, low, high = d.best_cause_.estimates["gain"]
        assert high < 1.1 * low
        assert 0.99 * low < factor < 1.01 * high


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The measured outputs:hybridsurrogate.ExtrapolationWarning")
@pytest.mark.parametrize(
    ("change", "kind"), [(lambda y: y + 273.15, "offset"), (lambda y: 1000 * y, "gain")]
)
def test_mistaken_units_are_named_from_runs_alone(change, kind):
    d = diagnose(temperature, change, 0, runs=True)
    assert (d.verdict_, d.best_cause_.kind) == ("named", kind)


@pytest.mark.slow
def test_the_extended_simulation_is_proved_in_the_folds():
    d = diagnose(temperature, lambda y: 1000 * y, 0, cv=5)
    assert set(d.gain_.kinds) == {"gain"}
    assert d.gain_.rmse_after < 0.05 * d.gain_.rmse_before
    assert re.search(r"\b(99\d|100\d)(\.\d+)? \* simulation", str(d.report(full=True)))


def test_outputs_that_are_not_far_keep_the_usual_priors():
    near = Context({"t": X[:, 0]}, 1, {}, {}, 1.0, location=8.0, distance=8.0, ratio=7.0)
    assert hs.Offset().prepare(near).coefficient_sd is None
    assert hs.Gain().prepare(near).scale is None
    assert near.reach == 3.0
    far = Context({"t": X[:, 0]}, 1, {}, {}, 1.0, location=90.0, distance=90.0, ratio=20.0)
    assert hs.Offset().prepare(far).coefficient_sd == 30.0
    assert hs.Gain().prepare(far).scale == pytest.approx(np.log(20) / 3)
    assert hs.Gain().prepare(far).parameters["gain"].cdf(np.exp(1.0)) == pytest.approx(
        1 - 0.5 * np.exp(-3 / np.log(20))
    )
    assert far.reach > 90.0


def test_a_size_that_is_given_is_kept():
    far = Context({"t": X[:, 0]}, 1, {}, {}, 1.0, location=90.0, distance=90.0, ratio=20.0)
    assert hs.Offset(sd=2.0).prepare(far).coefficient_sd == 2.0
    assert hs.Gain(scale=0.1).prepare(far).scale == 0.1


@pytest.mark.parametrize("sampler", ["auto", "importance"])
def test_outputs_too_far_for_doubles_are_told(sampler):
    """It ended in "max() arg is an empty sequence"."""
    model = hs.PowerScaledSurrogate(
        simulator(pressure), surrogate=hs.ExactSurrogate(), sampler=sampler, random_state=0
    )
    y = pressure(X[:, 0], 1.0) + 1e13
    with pytest.raises(ValueError, match="further from the simulation than any noise"):
        model.fit(X, y + np.random.default_rng(0).standard_normal(40))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The measured outputs:hybridsurrogate.ExtrapolationWarning")
@pytest.mark.parametrize("runs", [False, True])
def test_another_sign_is_told(runs):
    with pytest.warns(hs.DiagnosisWarning, match="Check the sign conventions"):
        d = diagnose(temperature, lambda y: -y, 0, runs=runs)
    assert d.verdict_ == "unexplained"
    # below zero for another reason
    assert diagnose(temperature, lambda y: y - 273.15, 0, runs=runs).best_cause_.kind == "offset"
