"""The ensemble backend: when it stops, what it says, how it goes on."""

import subprocess
import sys
import warnings

import numpy as np
import pytest
from moments import assert_gaussian
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.inference.sampling.modes import Gaussian, find_modes


def narrow(x):
    return -0.5 * np.sum((x / [1.0, 3.0, 0.2]) ** 2, axis=1)


MODES = [Gaussian(np.zeros(3), np.diag([1.0, 3.0, 0.2]), 0.0)]


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


@pytest.mark.slow
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


def test_one_move_is_enough():
    import emcee

    move = emcee.moves.StretchMove()
    assert run(hs.EnsembleSampler(moves=move, max_steps=100)).n_steps == 100


def test_a_file_has_one_writer(tmp_path):
    pytest.importorskip("h5py")
    path = str(tmp_path / "chain.h5")
    hold = "import h5py, sys; f = h5py.File(sys.argv[1], 'w'); print(1, flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", hold, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout.readline()
        with pytest.raises(OSError, match="n_jobs, cannot share"):
            run(hs.EnsembleSampler(file=path))
        other.communicate(b"\n")


def test_own_moves_and_walkers_are_used(monkeypatch):
    import emcee

    seen = {}
    original = emcee.EnsembleSampler.__init__

    def spy(self, nwalkers, *args, **kwargs):
        seen.update(nwalkers=nwalkers, moves=kwargs["moves"])
        original(self, nwalkers, *args, **kwargs)

    monkeypatch.setattr(emcee.EnsembleSampler, "__init__", spy)
    moves = [(emcee.moves.StretchMove(), 1.0)]
    run(hs.EnsembleSampler(n_walkers=24, moves=moves, max_steps=50))
    assert seen == {"nwalkers": 24, "moves": moves}


def test_ensemble_draws_of_a_gaussian_in_four_dimensions():
    rng = np.random.default_rng(0)
    root = np.tril(rng.normal(size=(4, 4))) + 2 * np.eye(4)
    mean, covariance = np.array([5.0, 0.0, -1.0, 2.0]), root @ root.T
    target = stats.multivariate_normal(mean, covariance)

    def log_density(x):
        return np.atleast_1d(target.logpdf(x))

    modes = find_modes(log_density, np.zeros((1, 4)))
    found = hs.EnsembleSampler().run(log_density, modes, 4000, np.random.RandomState(0))
    assert found.converged
    assert found.autocorrelation_time > 1
    assert found.effective_draws > 1000
    assert_gaussian(found.draws, mean, covariance, error=5 * np.sqrt(4000 / found.effective_draws))


def test_a_ridge_of_any_narrowness():
    """As measurements without noise leave one: emcee alone refuses to start there."""
    sds = np.array([1.0, 1e-9])
    turned = np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2)
    ridge = Gaussian(np.zeros(2), turned.T * sds, 0.0)

    def log_density(x):
        return -0.5 * np.sum((x @ turned.T / sds) ** 2, axis=1)

    random = np.random.RandomState(0)
    drawn = hs.EnsembleSampler().run(log_density, [ridge], 1000, random).draws @ turned.T
    np.testing.assert_allclose(drawn.std(axis=0), sds, rtol=0.15)


def bimodal(x):
    """Two Gaussians ten apart, the narrower one with three quarters of the mass."""
    first = np.log(0.75) + stats.multivariate_normal([0.0, 0.0], 0.25).logpdf(x)
    second = np.log(0.25) + stats.multivariate_normal([10.0, 0.0], 1.0).logpdf(x)
    return np.logaddexp(first, second)


def test_ensemble_draws_weigh_two_modes():
    modes = find_modes(bimodal, np.array([[0.5, 0.5], [9.0, 0.0]]))
    assert len(modes) == 2
    found = hs.EnsembleSampler(tol=20).run(bimodal, modes, 2000, np.random.RandomState(0))
    right = found.draws[:, 0] > 5
    assert right.mean() == pytest.approx(0.25, abs=0.06)
    assert found.draws[right].mean(axis=0) == pytest.approx([10.0, 0.0], abs=0.2)
    assert found.draws[~right].std(axis=0) == pytest.approx([0.5, 0.5], rel=0.1)


def test_ensemble_that_cannot_start_says_so():
    with pytest.raises(ValueError, match="minus infinity at every walker"):
        run(hs.EnsembleSampler(), lambda x: np.full(len(x), -np.inf))


def squared(x, omega):
    return omega**2 * x


def test_draws_weigh_two_modes_of_a_square():
    simulator = hs.Simulator(
        squared, inputs={"x": (0, 1)}, parameters={"omega": stats.uniform(-2, 4)}
    )
    X = np.linspace(0, 1, 15)[:, None]
    y = X[:, 0] + 0.1 * np.cos(40 * X[:, 0])
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=2000, random_state=0
    ).fit(X, y)
    assert model.diagnostics_.sampler == "importance"
    assert model.diagnostics_.n_modes == 2
    omega = model.posterior_.values[:, 0]
    # shares of far modes are those of importance weights: an ensemble hardly crosses between them
    assert np.mean(omega > 0) == pytest.approx(0.5, abs=0.05)
    assert np.abs(omega).mean() == pytest.approx(1.0, abs=0.05)


def kept_in(path, simulator):
    """Return a model whose chain is kept in a file."""
    return hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        sampler=hs.EnsembleSampler(max_steps=200, file=str(path)),
        n_draws=20,
        random_state=0,
    )


@pytest.fixture(scope="module")
def chain(tmp_path_factory, simulator, measured):
    """A file with a chain."""
    pytest.importorskip("h5py")
    path = tmp_path_factory.mktemp("chain") / "chain.h5"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.exceptions.SamplingWarning)
        kept_in(path, simulator).fit(*measured)
    return path


@pytest.mark.parametrize("damage", ["truncated", "no HDF5", "a missing array", "no folder"])
def test_a_damaged_file_is_told_with_its_path(damage, tmp_path, simulator, measured, chain):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / ("missing/chain.h5" if damage == "no folder" else "chain.h5")
    model = kept_in(path, simulator)
    if damage != "no folder":
        path.write_bytes(chain.read_bytes())
    if damage == "truncated":
        path.write_bytes(path.read_bytes()[:2000])
    if damage == "no HDF5":
        path.write_text("t,height\n1,2\n")
    if damage == "a missing array":
        with h5py.File(path, "a") as file:
            (run,) = file.values()
            del run["chain"]
    with pytest.raises(OSError, match=r"chain.h5'\) cannot be read or written .* damaged"):
        model.fit(*measured)
