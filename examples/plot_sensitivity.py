"""
What the posteriors of omega and sigma say about beta
=====================================================

How the unknown parameter and the noise of case studies 1 and 2.1 change with the weight of the
simulation. ``--fast`` takes fewer draws.
"""

import sys

import matplotlib.pyplot as plt
from reproduction.cases import CASES
from reproduction.comparison import paths

import hybridsurrogate as hs
from hybridsurrogate.plotting import plot_densities_over_beta

FAST = "--fast" in sys.argv
BETAS = (0.0, 0.1, 0.4, 0.5, 0.75, 1.0)
N_DRAWS = 200 if FAST else 2000


def draw(name):
    """Posterior densities of parameter and noise of a case study, with prior and truth."""
    case = CASES[name](0)
    settings = {**case.settings, "n_draws": N_DRAWS, "random_state": 0}
    power = paths(case.simulation, case.X, case.y, BETAS, **settings)["power scaling"]
    posteriors = [model.posterior_ for model in power.estimators]
    ((parameter, truth),) = case.truth.items()
    values = [posterior.values[:, 0] for posterior in posteriors]
    sigma = [posterior.sigma for posterior in posteriors]
    _, axes = plt.subplots(1, 2, figsize=(9, 4.5), layout="constrained")
    prior = case.simulation.parameters[parameter]
    plot_densities_over_beta(BETAS, values, axes[0], prior, truth, label=parameter)
    plot_densities_over_beta(BETAS, sigma, axes[1], case.settings["noise_prior"], label="sigma")
    for beta, omega, noise in zip(BETAS, values, sigma, strict=True):
        said = f"{parameter} {omega.mean():.3f} (sd {omega.std():.3f}), sigma {noise.mean():.3f}"
        print(f"case study {name}, beta = {beta}: {said}")
    return case


# %%
# Case study 1
# ------------
# At beta = 0 the surrogate follows the measurements for any omega, so omega stays at its prior. It
# is narrowest near beta = 0.5. The noise grows with beta: it has to explain the oscillation.

case = draw("1")

# %%
# Case study 2.1
# --------------
# The contact rate settles below its true 1.6: it makes up for the recovery rate, which is wrong.

draw("2.1")

# %%
# What the diagnosis says
# -----------------------
# A noise that grows with beta, and an omega far from what is known of it, say that something is
# wrong. The diagnosis says what, and once it is part of the model both return to their true values:
# omega = 1, sigma = 0.2.

settings = {**case.settings, "surrogate": hs.ExactSurrogate(), "n_draws": N_DRAWS}
model = hs.PowerScaledSurrogate(case.simulator, random_state=0, **settings)
diagnosis = hs.DiscrepancyDiagnosis(
    model, cv=None, n_replicates=49 if FAST else 200, random_state=0
).fit(case.X, case.y)
after = diagnosis.extended_estimator_.posterior_
print(diagnosis.verdict_, diagnosis.best_cause_.formula)
print(f"omega {after.values[:, 0].mean():.3f}, sigma {after.sigma.mean():.3f}")
plt.show()
