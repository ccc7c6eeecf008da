"""Case study 1 with a Gaussian-process surrogate: every beta against Kennedy and O'Hagan.

`python -m tests.case1_gaussian_process` prints scores on the test set with one row in range for
each row out of range, for each seed and on average.
"""

from __future__ import annotations

import argparse
import warnings

import numpy as np
from scipy.stats import halfnorm

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin
from hybridsurrogate.scoring import rmse

BETAS = np.linspace(0, 1, 21)


def scores(model, case):
    """ELPD and RMSE on rows in and out of range, one to one."""
    X = np.concatenate([case.X_in, case.X_out])
    y, mu = np.concatenate([case.y_in, case.y_out]), np.concatenate([case.mu_in, case.mu_out])
    return model.score(X, y), rmse(model.sample_predictive_mean(X), mu)


def main() -> None:
    """Print one line a seed, then how often the paper's findings hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    given = parser.parse_args()
    found = []
    for seed in range(given.seeds):
        case = make_log_sin(random_state=seed)
        settings = {
            "surrogate": hs.GaussianProcess(amplitude_prior=halfnorm(scale=1)),
            "noise_prior": halfnorm(scale=0.5),
            "random_state": seed,
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hs.SamplingWarning)
            theirs = hs.KennedyOHaganSurrogate(case.simulation, **settings).fit(case.X, case.y)
            rows = {"kennedy-ohagan": np.array([scores(theirs, case)])}
            for estimator in (hs.PowerScaledSurrogate, hs.PredictiveWeightedSurrogate):
                path = hs.beta_path(estimator(case.simulation, **settings), case.X, case.y, BETAS)
                rows[estimator.__name__] = np.array([scores(m, case) for m in path.estimators])
        found.append(rows)
        ko, ps, pw = (rows[name] for name in rows)
        middle = (BETAS >= 0.2) & (BETAS <= 0.5)
        print(
            f"seed {seed}: ELPD KOH {ko[0, 0]:.2f}, best PS {ps[:, 0].max():.2f}, best PW "
            f"{pw[:, 0].max():.2f}; RMSE KOH {ko[0, 1]:.2f}, best PS for beta in [0.2, 0.5] "
            f"{ps[middle, 1].min():.2f}",
            flush=True,
        )
    mean = {name: np.mean([rows[name] for rows in found], axis=0) for name in found[0]}
    for name, table in mean.items():
        best = table[:, 0].argmax()
        print(f"mean {name}: ELPD {table[best, 0]:.2f}, RMSE {table[:, 1].min():.2f}")
    ko = np.array([rows["kennedy-ohagan"][0] for rows in found])
    ps = np.array([rows["PowerScaledSurrogate"] for rows in found])
    pw = np.array([rows["PredictiveWeightedSurrogate"] for rows in found])
    best = np.maximum(ps[:, :, 0].max(axis=1), pw[:, :, 0].max(axis=1))
    below = ps[:, (BETAS >= 0.2) & (BETAS <= 0.5), 1].min(axis=1) < ko[:, 1]
    print(f"best ELPD of all beta below Kennedy and O'Hagan's: {np.sum(best < ko[:, 0])} seeds")
    print(f"RMSE below theirs for some beta in [0.2, 0.5]: {below.sum()} seeds of {len(ko)}")


if __name__ == "__main__":
    main()
