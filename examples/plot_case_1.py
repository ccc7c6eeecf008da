"""
Case study 1: a logarithm that lacks an oscillation
===================================================

The simulation is ``0.01 x + 1 + omega log(x)``; the process that is measured has omega = 1 and also
oscillates: ``sin(0.05 x)``. 30 measurements reach over half of the simulated range. How much weight
beta does the simulation deserve, and what does it miss? After arXiv:2412.11875, case study 1.
``--fast`` takes fewer draws.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
from reproduction.cases import Rows
from reproduction.comparison import best_of, compare, joined, over_beta, paths
from scipy.stats import halfnorm, norm

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin
from hybridsurrogate.plotting import (
    Scene,
    plot_bands_over_beta,
    plot_mean_draws_over_beta,
    plot_scores_over_beta,
    plot_setup,
)

FAST = "--fast" in sys.argv
BETAS = np.linspace(0, 1, 5 if FAST else 21)
SHOWN = (0, 2, 4) if FAST else (0, 2, 8, 15, 20)

# %%
# Runs and measurements
# ---------------------
# 100 runs without noise; their colour is omega. The measured range is shaded.

case = make_log_sin(random_state=0)
x = np.linspace(1, 200, 100)
truth = 0.01 * x + 1 + np.log(x) + np.sin(0.05 * x)
scene = Scene(measured=(case.X[:, 0], case.y), truth=(x, truth), train=(1, 100), xlabel="x")
fig, ax = plt.subplots()
runs = case.simulation
plot_setup(scene, runs.X[:, 0], runs.y, runs.omega[:, 0], ax=ax)

# %%
# Both schemes over beta
# ----------------------
# Power scaling trains one surrogate on both sources; predictive weighting trains two and mixes
# what they predict. At beta = 0 the simulation has no say, at beta = 1 it alone has.

settings = {
    "surrogate": hs.PolynomialChaos(degree=5, coefficient_prior=norm(0, 5)),
    "noise_prior": halfnorm(scale=0.5),
    "n_draws": 200 if FAST else 1000,
    "random_state": 0,
}
fitted = paths(case.simulation, case.X, case.y, BETAS, **settings)
tests = {
    "in range": Rows(case.X_in, case.y_in, case.mu_in),
    "out of range": Rows(case.X_out, case.y_out, case.mu_out),
}
tests["1/1"] = joined(*tests.values())

# %%
# Draws of the mean, in the colour of omega; the surrogate of the measured rows alone has none.

draws, omega = {}, {}
for scheme, path in fitted.items():
    chosen = [path.estimators[k] for k in SHOWN]
    draws[scheme] = [model.sample_predictive_mean(x[:, None]) for model in chosen]
    if scheme == "power scaling":
        omega[scheme] = [model.posterior_.values[:, 0] for model in chosen]
    else:
        omega[scheme] = [np.full(len(curves), np.nan) for curves in draws[scheme]]
betas = BETAS[list(SHOWN)]
fig, axes = plt.subplots(2, len(betas), figsize=(11, 5), layout="constrained", sharex=True)
plot_mean_draws_over_beta(x, draws, omega, betas, axes=axes, scene=scene)

# %%
# Where new measurements are expected: 50, 90 and 99 % bands.

bands = {
    scheme: [path.estimators[k].sample_posterior_predictive(x[:, None]) for k in SHOWN]
    for scheme, path in fitted.items()
}
fig, axes = plt.subplots(2, len(betas), figsize=(11, 5), layout="constrained", sharex=True)
plot_bands_over_beta(x, bands, betas, axes=axes, scene=scene)

# %%
# Scores
# ------
# In range the measurements alone are best, out of range the simulation alone: there a polynomial
# that has seen no data may be anything. On rows of both kinds a weight in between is best.

table = over_beta(fitted, tests)
fig, axes = plt.subplots(2, 3, figsize=(10, 5.6), layout="constrained", sharex=True)
plot_scores_over_beta(table, axes=axes)

# %%
# What the diagnosis says
# -----------------------
# A weight spreads the fault over everything. The diagnosis names it, from the same 30 rows.

model = hs.PowerScaledSurrogate(case.simulator, **{**settings, "surrogate": hs.ExactSurrogate()})
diagnosis = hs.DiscrepancyDiagnosis(
    model, cv=None, n_replicates=49 if FAST else 200, random_state=0
).fit(case.X, case.y)
print(diagnosis.verdict_, diagnosis.best_cause_.formula)
print("not distinguished:", ", ".join(diagnosis.indistinguishable_))

# %%
# The extended model against the best beta of each scheme and Kennedy and O'Hagan's calibration, on
# the 1/1 rows:

theirs = hs.KennedyOHaganSurrogate(case.simulation, amplitude_prior=halfnorm(scale=1), **settings)
theirs.fit(case.X, case.y)
models = best_of(fitted, tests["1/1"])
models |= {"Kennedy-O'Hagan": theirs, "extended": diagnosis.extended_estimator_}
print(compare(models, tests["1/1"]).to_string())
plt.show()
