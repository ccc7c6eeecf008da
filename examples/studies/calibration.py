"""Simulation-based calibration: are posteriors what they say they are?

Data sets are drawn from the prior; the rank of the truth among the draws of its posterior must then
be uniform (Talts, Betancourt, Simpson, Vehtari and Gelman 2018, arXiv 1804.06788).

`python -m examples.studies.calibration` runs 200 data sets of each model. Where a p-value is below the
limit, five times as many new data sets decide whether that was chance: the limit is shared between
both.
"""

from __future__ import annotations

import argparse
import warnings

import numpy as np
from scipy import stats
from scipy.stats import halfnorm, norm

import hybridsurrogate as hs
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.surrogates import Domain

N_RUNS, N_ROWS, N_RANKS, N_BINS = 15, 10, 99, 10
PRIOR = hs.truncated_normal(0.0, 0.5, -1.0, 1.0)
NOISE = halfnorm(scale=0.5)
RANGES = np.array([[-1.0, 1.0]])
MODELS = {
    "polynomial chaos, normal": (hs.PolynomialChaos(2, norm(0, 1)), "normal"),
    "gaussian process, normal": (
        hs.GaussianProcess(amplitude_prior=halfnorm(scale=1), mean=0.0, degree=8),
        "normal",
    ),
    "polynomial chaos, negative binomial": (
        hs.PolynomialChaos(1, norm(1, 1)),
        "negative-binomial",
    ),
}


def ranks_of(name: str, seed: int) -> dict[str, int]:
    """Draw a data set from the prior, fit it, and return the rank of each truth."""
    surrogate, word = MODELS[name]
    likelihood = as_likelihood(word)
    random = np.random.RandomState(seed)
    domain = Domain(RANGES, RANGES, 0.0, 1.0, input_names=("x",), parameter_names=("omega",))
    basis = surrogate.build(domain)
    p = len(basis.coefficient_mean)
    hyper = np.array([[prior.rvs(random_state=random) for prior in basis.hyperpriors.values()]])
    factor = basis.factor(hyper) if basis.hyperpriors else None
    root = np.diag(basis.coefficient_sd) if factor is None else factor[0]
    c = basis.coefficient_mean + root @ random.standard_normal(p)
    omega, sigma = PRIOR.rvs(random_state=random), NOISE.rvs(random_state=random)

    def draw(X: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        eta = basis.known(X, parameters) + basis.features(X, parameters) @ c
        return likelihood.sample(eta, np.full(len(eta), sigma), random)

    runs_X = random.uniform(-1, 1, (N_RUNS, 1))
    runs_omega = random.permutation(np.linspace(-1, 1, N_RUNS))[:, None]
    X = random.uniform(-1, 1, (N_ROWS, 1))
    simulation = hs.SimulationData(
        runs_X,
        runs_omega,
        draw(runs_X, runs_omega),
        inputs={"x": (-1, 1)},
        parameters={"omega": PRIOR},
    )
    model = hs.PowerScaledSurrogate(
        simulation,
        surrogate=surrogate,
        beta=0.5,  # both sources in full: an ordinary posterior, in step 1
        likelihood=word,
        noise_prior=NOISE,
        n_draws=N_RANKS,
        random_state=seed,
    )
    with warnings.catch_warnings():
        # fewer draws than a user would want, on purpose; an extreme prior may call for emcee
        warnings.simplefilter("ignore", hs.SamplingWarning)
        model.fit(X, draw(X, np.full((N_ROWS, 1), omega)))
    first = model.first_step_
    point = np.array([[0.3]]), np.array([[-0.4]])
    features = basis.features(*point)[0]
    truths = {
        "omega": (omega, first.values[:, 0]),
        "sigma": (sigma, first.sigma),
        "eta": (features @ c, first.coefficients @ features),
    }
    return {key: int(np.sum(draws < truth)) for key, (truth, draws) in truths.items()}


def p_values(name: str, n_sets: int, first_seed: int = 0) -> dict[str, float]:
    """Return the p-value of a chi-squared test of uniform ranks for each quantity."""
    ranks = [ranks_of(name, first_seed + seed) for seed in range(n_sets)]
    out = {}
    for key in ranks[0]:
        values = np.array([rank[key] for rank in ranks])
        counts = np.bincount(values * N_BINS // (N_RANKS + 1), minlength=N_BINS)
        out[key] = float(stats.chisquare(counts).pvalue)
        print(f"{name:38s} {key:6s} {counts} p = {out[key]:.3f}", flush=True)
    return out


def main() -> None:
    """Print ranks and p-values; fail where one is too small for the number of tests."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--models", nargs="*", default=list(MODELS))
    given = parser.parse_args()
    found = {name: p_values(name, given.sets) for name in given.models}
    limit = 0.05 / 2 / sum(len(values) for values in found.values())
    doubtful = [name for name, values in found.items() if min(values.values()) < limit]
    for name in doubtful:
        print(f"{name}: below {limit:.4f}, {5 * given.sets} new data sets decide")
        found[name] = p_values(name, 5 * given.sets, first_seed=given.sets)
    smallest = min(min(values.values()) for values in found.values())
    print(f"smallest p-value: {smallest:.4f} (limit {limit:.4f})")
    raise SystemExit(smallest < limit)


if __name__ == "__main__":
    main()
