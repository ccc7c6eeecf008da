"""Every surrogate with every likelihood, on the published case study 1 and on counts.

`python examples/studies/combinations.py > docs/evidence/combinations.md` writes the page of the docs.
"""

import sys
import time
import warnings

import numpy as np
from scipy.stats import norm
from sklearn.preprocessing import SplineTransformer

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin, make_sir
from hybridsurrogate.scoring import rmse

fast = "--fast" in sys.argv
n_draws = 100 if fast else 1000


def growth(X, omega, constants):
    height, slope, shift = (constants[name] for name in ("height", "slope", "shift"))
    return height + slope * omega[:, 0] * np.log(np.maximum(X[:, 0], 1e-9)) + shift * omega[:, 0]


def epidemic(X, omega, constants):
    rise = constants["rise"] * (omega[:, 0] - omega[:, 1]) * X[:, 0]
    return constants["start"] + rise - np.logaddexp(0, rise - constants["peak"]) * 1.5


SURROGATES = {
    "PolynomialChaos": hs.PolynomialChaos(degree=4),
    "GaussianProcess": hs.GaussianProcess(degree=6),
    "FeatureSurrogate": hs.FeatureSurrogate(SplineTransformer(n_knots=5)),
    "NetworkSurrogate": hs.NetworkSurrogate(),
    "ParametricSurrogate": None,
    "ExactSurrogate": hs.ExactSurrogate(),
}
PARAMETRIC = {
    "case 1": hs.ParametricSurrogate(
        growth, {"height": norm(0, 5), "slope": norm(0, 2), "shift": norm(0, 3)}
    ),
    "counts": hs.ParametricSurrogate(
        epidemic, {"start": norm(0, 2), "rise": norm(1, 0.5), "peak": norm(5, 2)}
    ),
}
# noise like |error| / sigma: less convinced by outliers than a normal density
laplace = hs.CustomLikelihood(
    lambda y, eta, sigma: -np.abs(y - eta) / sigma - np.log(2 * sigma),
    lambda eta, sigma: eta,
    lambda eta, sigma, random_state: random_state.laplace(eta, sigma),
)
cases = {
    "case 1": (
        make_log_sin(random_state=0),
        make_log_sin(random_state=0).simulation,
        {"normal": "normal", "log-normal": "lognormal", "Student-t": "student-t", "own": laplace},
    ),
    "counts": (
        make_sir(add_one=False, random_state=0),
        make_sir(add_one=False, round_counts=True, random_state=0).simulation,
        {"negative binomial": "negative-binomial", "Poisson": "poisson"},
    ),
}
print(
    "# Every surrogate with every likelihood\n\n"
    "Printed by `python examples/studies/combinations.py`: power scaling at beta = 0.5, 1000 draws.\n"
    "Case 1 is the published case study; counts are an epidemic. ELPD is the mean over test rows,\n"
    "RMSE that of the noise-free mean; seconds are those of one core, and noisy.\n"
)
print(
    "| data | surrogate | likelihood | ELPD in range | out of range | RMSE in range | s | sampler |"
)
print("|---|---|---|---|---|---|---|---|")
if fast:
    SURROGATES = {name: SURROGATES[name] for name in ("PolynomialChaos", "ParametricSurrogate")}
for data, (case, runs, likelihoods) in cases.items():
    for name, surrogate in SURROGATES.items():
        for word, likelihood in likelihoods.items():
            if likelihood == "lognormal" and not (case.y > 0).all():
                continue
            model = hs.PowerScaledSurrogate(
                case.simulator if name == "ExactSurrogate" else runs,
                surrogate=surrogate or PARAMETRIC[data],
                likelihood=likelihood,
                beta=0.5,
                n_draws=n_draws,
                random_state=0,
            )
            start = time.perf_counter()
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", hs.HybridSurrogateWarning)
                model.fit(case.X, case.y)
            seconds = time.perf_counter() - start
            error = rmse(model.sample_predictive_mean(case.X_in), case.mu_in)
            sampler = model.diagnostics_.sampler + (" (doubtful)" if caught else "")
            print(
                f"| {data} | {name} | {word} | {model.score(case.X_in, case.y_in):.2f} "
                f"| {model.score(case.X_out, case.y_out):.2f} | {error:.2f} | {seconds:.1f} "
                f"| {sampler} |",
                flush=True,
            )
print(
    "\nWhere a Gaussian process meets a likelihood that forgives outliers, case 1 has two\n"
    "explanations: a right simulation with noise, or a wrong parameter with hardly any. Each has\n"
    "a Pareto k-hat of its own, so that their shares hold."
)
