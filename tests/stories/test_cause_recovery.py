"""A cause of every kind is recovered from data, and the extended simulator has it."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from tide import CASES, FRAME, NOISE, SIMULATOR, problem_of

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.answers.extension import extend_simulator
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.inference.evidence.marginal_likelihood import LocalMode


@pytest.fixture(scope="module")
def fits():
    """Return a function that fits the estimator of a case, once."""
    made = {}

    def fit(name):
        if name not in made:
            cause, truth, _ = CASES[name]
            rng = np.random.default_rng(list(CASES).index(name))
            scatter = NOISE * rng.standard_normal(len(FRAME))
            if name == "noise":
                scatter *= np.exp(0.2 * (FRAME.t.to_numpy() - 6))
            y = np.asarray(truth(FRAME)) + scatter
            columns = ["t", "dose", *(c for c in cause.reads if c in ("wind", "batch"))]
            # between rows the density over two ends of an episode is flat, and falls at them
            sampler = hs.EnsembleSampler(max_steps=600) if name == "episode, factor" else "auto"
            model = hs.PowerScaledSurrogate(
                SIMULATOR,
                surrogate=hs.ExactSurrogate(),
                effects=(cause,),
                sampler=sampler,
                n_draws=400,
                random_state=0,
            )
            made[name] = model.fit(FRAME[columns], y), FRAME[columns], y
        return made[name]

    return fit


@pytest.mark.parametrize("name", CASES)
@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.SamplingWarning")
def test_the_truth_is_recovered(fits, name):
    model, _, _ = fits(name)
    estimates = model.posterior_.estimates(0)
    for quantity, truth in CASES[name][2].items():
        low, high = np.quantile(estimates[quantity], [0.005, 0.995])
        assert low < truth < high, (quantity, low, truth, high)
        assert high - low < 2 * abs(truth) + 0.5
    means = {key: float(np.mean(draws)) for key, draws in estimates.items()}
    words = model.posterior_.model.effects[0].formula(means)
    assert words.startswith(("simulation", "1.", "0.9", "min(simulation, ", "max(simulation, "))
    assert "{" not in words


@pytest.mark.parametrize("name", CASES)
@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.SamplingWarning")
def test_the_extended_simulator_is_simulator_and_effect(fits, name):
    model, frame, y = fits(name)
    posterior = model.posterior_
    cause = posterior.model.effects[0]
    problem = problem_of(frame, y)
    if name == "noise":
        with pytest.raises(ValueError, match="leaves the simulation as it is"):
            extend_simulator(SIMULATOR, cause, problem)
        return
    extended = extend_simulator(SIMULATOR, cause, problem)
    X = frame.to_numpy(dtype=float)
    eta, _ = posterior.eta(X)
    assert set(extended.input_names) == set(frame.columns)
    for draw in (0, 9):
        omega = np.concatenate([posterior.values[draw], posterior.effect_coefficients[draw]])
        run = extended(X, np.tile(omega, (len(X), 1)))
        np.testing.assert_allclose(run, eta[draw], rtol=1e-10)
    # and the fitted one follows the noise-free truth
    assert np.sqrt(np.mean((model.predict(frame) - np.asarray(CASES[name][1](FRAME))) ** 2)) < 0.06


def test_of_two_peaks_the_better_with_noise_of_its_own_is_taken():
    n, sigma = 40, 3.9
    rng = np.random.default_rng(0)
    fits = [(0.4 * rng.standard_normal(n), 1.6), (0.5 * rng.standard_normal(n), 0.1)]
    problem = SimpleNamespace(y=np.zeros(n), scale=1.0, noise_is_known=False)
    context = SearchContext(problem, None, None)
    found, expected, at_sigma = [], [], []
    for residual, away in fits:
        squares = residual @ residual
        mode = LocalMode(np.array([away]), squares, squares / sigma**2 + away**2, 0)
        found.append(context.deviance(mode, sigma))
        at_sigma.append(mode.objective)
        own = np.sqrt(squares / n)
        density = stats.norm.logpdf(residual, 0, own).sum() + stats.norm.logpdf(away)
        expected.append(-2 * density)
    assert found[0] - found[1] == pytest.approx(expected[0] - expected[1])
    assert found[0] < found[1]
    assert at_sigma[0] > at_sigma[1]  # at the noise of a fit without the cause
    nowhere = LocalMode(np.zeros(1), np.inf, np.inf, 0)
    assert context.deviance(nowhere, sigma) == np.inf
