"""
How many runs to how many measurements
======================================

Case study 1 with 30, 50 and 100 runs of the simulation and 30 measurements: does the best weight
move with the numbers? ``--fast`` takes fewer draws.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from reproduction.cases import Rows
from reproduction.comparison import best_of, compare, joined, over_beta, paths
from scipy.stats import halfnorm, norm

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin
from hybridsurrogate.plotting import plot_scores_over_beta

FAST = "--fast" in sys.argv
BETAS = np.linspace(0, 1, 5 if FAST else 21)
settings = {
    "surrogate": hs.PolynomialChaos(degree=5, coefficient_prior=norm(0, 5)),
    "noise_prior": halfnorm(scale=0.5),
    "n_draws": 200 if FAST else 1000,
    "random_state": 0,
}

# %%
# The same measurements each time, one row in range for each row out of range to be predicted.

tables, fitted = [], {}
for n_runs in (30, 50, 100):
    case = make_log_sin(n_runs=n_runs, random_state=0)
    both = joined(Rows(case.X_in, case.y_in, case.mu_in), Rows(case.X_out, case.y_out, case.mu_out))
    fitted[n_runs] = paths(case.simulation, case.X, case.y, BETAS, **settings)
    tables.append(over_beta(fitted[n_runs], {f"{n_runs} runs, 30 rows": both}))
table = pd.concat(tables)
fig, axes = plt.subplots(2, 3, figsize=(10, 5.6), layout="constrained", sharex=True)
plot_scores_over_beta(table, axes=axes)

# %%
# The best beta of each:

power = table[table["scheme"] == "power scaling"].reset_index()
best = power.loc[power.groupby("test", sort=False)["rmse"].idxmin(), ["test", "beta", "rmse"]]
print(best.to_string(index=False))

# %%
# What the diagnosis says
# -----------------------
# It asks the simulation itself, so the number of runs made before does not matter to it.

model = hs.PowerScaledSurrogate(case.simulator, **{**settings, "surrogate": hs.ExactSurrogate()})
diagnosis = hs.DiscrepancyDiagnosis(
    model, cv=None, n_replicates=49 if FAST else 200, random_state=0
).fit(case.X, case.y)
print(diagnosis.verdict_, diagnosis.best_cause_.formula)
theirs = hs.KennedyOHaganSurrogate(case.simulation, amplitude_prior=halfnorm(scale=1), **settings)
theirs.fit(case.X, case.y)
models = best_of(fitted[100], both)
models |= {"Kennedy-O'Hagan": theirs, "extended": diagnosis.extended_estimator_}
print(compare(models, both).to_string())
plt.show()
