"""
Case study 1.2: measured over more of the range
===============================================

Case study 1 with measurements over 70 % of the simulated range, and polynomials of degree six. The
oscillation is seen for longer, and power scaling can learn it without losing the simulation.
``--fast`` takes fewer draws.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
from reproduction.cases import FURTHER, Rows
from reproduction.comparison import best_of, compare, joined, over_beta, paths
from scipy.stats import halfnorm, norm

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin
from hybridsurrogate.plotting import Scene, plot_bands_over_beta, plot_scores_over_beta

FAST = "--fast" in sys.argv
BETAS = np.linspace(0, 1, 5 if FAST else 21)
SHOWN = (0, 2, 4) if FAST else (0, 2, 8, 15, 20)

# %%
# Test rows out of range begin where the measurements end.

case = make_log_sin(train_range=(1, FURTHER), random_state=0)
far = case.X_out[:, 0] > FURTHER
tests = {
    "in range": Rows(case.X_in, case.y_in, case.mu_in),
    "out of range": Rows(case.X_out[far], case.y_out[far], case.mu_out[far]),
}
settings = {
    "surrogate": hs.PolynomialChaos(degree=6, coefficient_prior=norm(0, 5)),
    "noise_prior": halfnorm(scale=0.5),
    "n_draws": 200 if FAST else 1000,
    "random_state": 0,
}
fitted = paths(case.simulation, case.X, case.y, BETAS, **settings)

# %%
# Posterior predictive bands of 50, 90 and 99 %.

x = np.linspace(1, 200, 100)
truth = 0.01 * x + 1 + np.log(x) + np.sin(0.05 * x)
scene = Scene(measured=(case.X[:, 0], case.y), truth=(x, truth), train=(1, FURTHER), xlabel="x")
bands = {
    scheme: [path.estimators[k].sample_posterior_predictive(x[:, None]) for k in SHOWN]
    for scheme, path in fitted.items()
}
fig, axes = plt.subplots(2, len(SHOWN), figsize=(11, 5), layout="constrained", sharex=True)
plot_bands_over_beta(x, bands, BETAS[list(SHOWN)], axes=axes, scene=scene)

# %%
# Out of range power scaling with a small weight is best by far: it extrapolates what it has learnt
# of the oscillation, and the simulation holds the rest.

fig, axes = plt.subplots(2, 2, figsize=(8, 5.6), layout="constrained", sharex=True)
plot_scores_over_beta(over_beta(fitted, tests), axes=axes)

# %%
# What the diagnosis says
# -----------------------

model = hs.PowerScaledSurrogate(case.simulator, **{**settings, "surrogate": hs.ExactSurrogate()})
diagnosis = hs.DiscrepancyDiagnosis(
    model, cv=None, n_replicates=49 if FAST else 200, random_state=0
).fit(case.X, case.y)
print(diagnosis.verdict_, diagnosis.best_cause_.formula)

# %%
# On rows of both kinds:

both = joined(*tests.values())
theirs = hs.KennedyOHaganSurrogate(case.simulation, amplitude_prior=halfnorm(scale=1), **settings)
theirs.fit(case.X, case.y)
models = best_of(fitted, both)
models |= {"Kennedy-O'Hagan": theirs, "extended": diagnosis.extended_estimator_}
print(compare(models, both).to_string())
plt.show()
