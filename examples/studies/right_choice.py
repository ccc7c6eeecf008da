"""Three data sets for which a choice of surrogate or likelihood decides.

python examples/studies/right_choice.py
"""

import sys

import numpy as np
from scipy.stats import uniform

import hybridsurrogate as hs

fast = "--fast" in sys.argv
n_draws = 300 if fast else 1000


def compare(title, choices, X, y, X_test, y_test):
    """Fit every choice, print its score on held-out rows, return the scores."""
    print(title)
    scores = {}
    for name, model in choices.items():
        model.set_params(n_draws=n_draws, random_state=0).fit(X, y)
        scores[name] = model.score(X_test, y_test)
        print(f"  {name:40s} ELPD {scores[name]:7.2f}  ({model.diagnostics_.sampler})")
    return scores


# A valve that opens at a threshold: polynomials ring, a network bends where it should.


def flow(pressure, threshold):
    return 3 * np.tanh(8 * (pressure - threshold)) + 0.5 * pressure


valve = hs.Simulator(flow, inputs={"pressure": (0, 4)}, parameters={"threshold": uniform(1.0, 2.0)})
random = np.random.default_rng(0)
x, x_test = random.uniform(0, 4, (2, 60))
measured, held_out = (flow(x, 1.7) + 0.05 * random.standard_normal(60) for x in (x, x_test))
runs = valve.run(400, random_state=0)
compare(
    "Valve",
    {
        "network": hs.PowerScaledSurrogate(runs, hs.NetworkSurrogate(), beta=0.9),
        "polynomial chaos, degree 7": hs.PowerScaledSurrogate(
            runs, hs.PolynomialChaos(7), beta=0.9
        ),
    },
    x[:, None],
    measured,
    x_test[:, None],
    held_out,
)


# A loose contact: every tenth measurement is far off.


def fall(t, gravity):
    return 100 - gravity / 2 * t**2


body = hs.Simulator(fall, inputs={"t": (0, 4)}, parameters={"gravity": uniform(8, 4)})


def drop(n):
    t = random.uniform(0, 4, n)
    noise = 0.3 * random.standard_normal(n)
    noise[random.uniform(size=n) < 0.1] *= 40
    return t[:, None], fall(t, 9.81) + noise


runs = body.run(64, random_state=0)
compare(
    "Falling body with outliers",
    {
        "Student-t": hs.PowerScaledSurrogate(
            runs, hs.PolynomialChaos(2), beta=0.9, likelihood=hs.StudentT(df=2)
        ),
        "normal": hs.PowerScaledSurrogate(runs, hs.PolynomialChaos(2), beta=0.9),
    },
    *drop(50),
    *drop(200),
)


# Rare events: small counts are neither normal nor log-normal.


def decays(hours, rate):
    return 12 * np.exp(-rate * hours)


counter = hs.Simulator(decays, inputs={"hours": (0, 10)}, parameters={"rate": uniform(0.1, 0.5)})


def count(n):
    hours = random.uniform(0, 10, n)
    return hours[:, None], random.poisson(decays(hours, 0.3)).astype(float)


design = counter.run(80, random_state=0)
counts = hs.SimulationData(
    design.X,
    design.omega,
    random.poisson(design.y).astype(float),
    inputs=design.input_ranges,
    parameters=design.parameters,
)
(X, y), (X_test, y_test) = count(40), count(200)
surrogate = hs.PolynomialChaos(2)
choices = {
    "Poisson": hs.PowerScaledSurrogate(counts, surrogate, likelihood="poisson"),
    "negative binomial": hs.PowerScaledSurrogate(counts, surrogate, likelihood="negative-binomial"),
    "normal": hs.PowerScaledSurrogate(counts, surrogate),
}
compare("Decays", choices, X, y, X_test, y_test)
