"""The ensemble backend: when it stops, what it says, how it goes on."""

import numpy as np
import pytest

import hybridsurrogate as hs
from hybridsurrogate.inference import ensemble
from hybridsurrogate.inference.modes import Gaussian


def narrow(x):
    return -0.5 * np.sum((x / [1.0, 3.0, 0.2]) ** 2, axis=1)


MODES = [Gaussian(np.zeros(3), np.diag([1.0, 3.0, 0.2]))]


def run(sampler, log_density=narrow, seed=0):
    return sampler.run(log_density, MODES, 1000, np.random.RandomState(seed))


def test_stops_by_autocorrelation_time():
    short, long = run(hs.EnsembleSampler(tol=30)), run(hs.EnsembleSampler(tol=200))
    for drawn, tol in ((short, 30), (long, 200)):
        assert drawn.converged
        assert drawn.n_steps > tol * drawn.autocorrelation_time
        np.testing.assert_allclose(drawn.draws.std(axis=0), [1, 3, 0.2], rtol=0.15)
    assert long.n_steps > short.n_steps


def test_unconverged_run_warns(simulation, measured):
    model = hs.PowerScaledSurrogate(
        simulation,
        surrogate=hs.PolynomialChaos(2),
        sampler=hs.EnsembleSampler(max_steps=60),
        n_draws=200,
        random_state=0,
    )
    with pytest.warns(hs.SamplingWarning, match="stopped after 60 steps, too few"):
        model.fit(*measured)
    assert not model.diagnostics_.converged
    assert model.diagnostics_.sampler == "emcee"


def test_stopped_run_goes_on_with_the_same_result(tmp_path):
    pytest.importorskip("h5py")
    unbroken = run(hs.EnsembleSampler(tol=100))
    calls = 0

    def breaks(x):
        nonlocal calls
        calls += 1
        if calls == 431:  # in the middle of a block of steps
            raise KeyboardInterrupt
        return narrow(x)

    sampler = hs.EnsembleSampler(tol=100, file=str(tmp_path / "chain.h5"))
    with pytest.raises(KeyboardInterrupt):
        run(sampler, breaks)
    resumed = run(sampler)
    np.testing.assert_array_equal(resumed.draws, unbroken.draws)
    assert resumed.n_steps == unbroken.n_steps
    assert resumed.autocorrelation_time == unbroken.autocorrelation_time
    # a finished run costs nothing but the check of its start
    calls = -1000
    again = run(sampler, breaks)
    np.testing.assert_array_equal(again.draws, unbroken.draws)
    assert calls < -990


def test_resuming_needs_a_seed_and_h5py(tmp_path, simulation, measured, monkeypatch):
    sampler = hs.EnsembleSampler(file=str(tmp_path / "chain.h5"))
    model = hs.PowerScaledSurrogate(simulation, sampler=sampler)
    with pytest.raises(ValueError, match="random_state is an int"):
        model.fit(*measured)
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    with pytest.raises(ImportError, match="pip install h5py"):
        run(sampler)


@pytest.mark.parametrize(
    ("parameters", "match"),
    [
        ({"n_walkers": 5}, "even and at least twice the 3 dimensions"),
        ({"n_walkers": 4}, "even and at least twice the 3 dimensions"),
        ({"max_steps": 0}, "max_steps"),
        ({"tol": 0.0}, "tol"),
    ],
)
def test_bad_settings(parameters, match):
    with pytest.raises(ValueError, match=match):
        run(hs.EnsembleSampler(**parameters))


def test_own_moves_and_walkers_are_used(monkeypatch):
    import emcee

    seen = {}
    original = emcee.EnsembleSampler.__init__

    def spy(self, nwalkers, *args, **kwargs):
        seen.update(nwalkers=nwalkers, moves=kwargs["moves"])
        original(self, nwalkers, *args, **kwargs)

    monkeypatch.setattr(ensemble.emcee.EnsembleSampler, "__init__", spy)
    moves = [(emcee.moves.StretchMove(), 1.0)]
    run(hs.EnsembleSampler(n_walkers=24, moves=moves, max_steps=50))
    assert seen == {"nwalkers": 24, "moves": moves}
