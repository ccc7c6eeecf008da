"""
A Gaussian process as surrogate, against Kennedy and O'Hagan
============================================================

Case study 1 with a Gaussian process in place of the polynomials, and beside the weights the
calibration of Kennedy and O'Hagan: the simulation plus a process for what it misses. ``--fast``
takes fewer draws.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from reproduction.cases import Rows
from reproduction.comparison import best_of, compare, joined, over_beta, paths
from scipy.stats import halfnorm

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin
from hybridsurrogate.plotting import Scene, plot_predictive_bands, plot_scores_over_beta
from hybridsurrogate.scoring import rmse

FAST = "--fast" in sys.argv
BETAS = np.linspace(0, 1, 3 if FAST else 11)

# %%
# Priors as in the paper's appendix: inverse gamma (5, 5) for length scales, half-normal for the
# amplitude.

case = make_log_sin(random_state=0)
settings = {
    "surrogate": hs.GaussianProcess(amplitude_prior=halfnorm(scale=1)),
    "noise_prior": halfnorm(scale=0.5),
    "n_draws": 100 if FAST else 1000,
    "random_state": 0,
}
fitted = paths(case.simulation, case.X, case.y, BETAS, **settings)
theirs = hs.KennedyOHaganSurrogate(case.simulation, amplitude_prior=halfnorm(scale=1), **settings)
theirs.fit(case.X, case.y)

# %%
# On rows in and out of range, one to one, their ELPD is above that of every weight, while power
# scaling has the smaller error of the mean.

both = joined(Rows(case.X_in, case.y_in, case.mu_in), Rows(case.X_out, case.y_out, case.mu_out))
level = {
    "model": "Kennedy-O'Hagan",
    "test": "1/1",
    "elpd": theirs.score(both.X, both.y),
    "rmse": rmse(theirs.sample_predictive_mean(both.X), both.truth),
}
fig, axes = plt.subplots(2, 1, figsize=(5, 5.6), layout="constrained", sharex=True)
table = over_beta(fitted, {"1/1": both})
plot_scores_over_beta(table, axes=axes, references=pd.DataFrame([level]))

# %%
# What the diagnosis says
# -----------------------
# The process of Kennedy and O'Hagan can follow the oscillation but not say what it is, so beyond
# the data it returns to nothing. A named cause goes on.

model = hs.PowerScaledSurrogate(case.simulator, **{**settings, "surrogate": hs.ExactSurrogate()})
diagnosis = hs.DiscrepancyDiagnosis(
    model, cv=None, n_replicates=49 if FAST else 200, random_state=0
).fit(case.X, case.y)
print(diagnosis.verdict_, diagnosis.best_cause_.formula)
models = best_of(fitted, both)
models |= {"Kennedy-O'Hagan": theirs, "extended": diagnosis.extended_estimator_}
print(compare(models, both).to_string())

x = np.linspace(1, 200, 100)
truth = 0.01 * x + 1 + np.log(x) + np.sin(0.05 * x)
scene = Scene(measured=(case.X[:, 0], case.y), truth=(x, truth), train=(1, 100), xlabel="x")
fig, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained", sharey=True)
for ax, (name, shown) in zip(axes, list(models.items())[-2:], strict=True):
    plot_predictive_bands(x, shown.sample_posterior_predictive(x[:, None]), ax=ax, scene=scene)
    ax.set_title(name)
plt.show()
