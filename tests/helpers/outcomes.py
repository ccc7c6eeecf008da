"""One diagnosis of each outcome, fitted once for all tests of reports."""

from copy import copy, deepcopy
from dataclasses import replace
from functools import cache

import numpy as np
from few_kinds import all_but

import hybridsurrogate as hs

T = np.linspace(0, 8, 30)
NOISE = 0.1 * np.random.default_rng(0).standard_normal(30)


# a wrong constant has nothing to act on, and the full report says so
FEW = all_but("step", "periodic", "parameter-drift", "noise", "wrong-constant")


def decay(t, level, rate):
    return level * np.exp(-rate * t)


def fragile(t, level, rate):
    """Fail where the rate is large."""
    return np.where(rate < 0.35, decay(t, level, rate), np.nan)


def simulator(function=decay):
    return hs.Simulator(
        function,
        {"t": (0, 12)},
        {
            "level": hs.truncated_normal(10, 2, 4, 16),
            "rate": hs.truncated_normal(0.2, 0.1, 0.02, 0.6),
        },
        output="level <mg>",
    )


def diagnosed(effect, simulation=None, surrogate=None, cv=None, **settings):
    model = hs.PowerScaledSurrogate(
        simulator() if simulation is None else simulation,
        surrogate=surrogate or hs.ExactSurrogate(),
        n_draws=200,
        random_state=0,
    )
    settings = {"n_replicates": 40, "exclude": FEW, "random_state": 0, **settings}
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=cv, **settings)
    return diagnosis.fit(T[:, None], decay(T, 11, 0.25) + effect(T) + NOISE)


def step(t):
    return 2.0 * (t > 5)


def without_gain(diagnosis):
    """Return a diagnosis whose extension predicts worse on held-out rows."""
    diagnosis = copy(diagnosis)
    gain = replace(diagnosis.gain_, elpd_difference=-3.0, standard_error=0.5)
    diagnosis.result_ = replace(diagnosis.result_, gain=gain)
    return diagnosis


def with_doubtful_draws(diagnosis):
    """Return a diagnosis without folds whose importance draws are not to be trusted."""
    diagnosis = deepcopy(diagnosis)
    diagnosis.result_ = replace(diagnosis.result_, gain=None, gain_out_of_range=None)
    model = diagnosis.estimator_
    model.diagnostics_ = replace(model.diagnostics_, khat=0.9)
    return diagnosis


OUTCOMES = {
    "named": lambda: diagnosed(step, cv=3),
    "adequate": lambda: diagnosed(lambda t: 0 * t, cv=3, exclude=all_but("step", "noise")),
    "nearest": lambda: diagnosed(
        lambda t: step(t) + 0.5 * np.sin(2 * np.pi * t / 4), exclude=(), max_causes=1
    ),
    "ambiguous": lambda: diagnosed(lambda t: 0.008 * t**2, exclude=()),
    # a chirp is no kind of the catalogue
    "unexplained": lambda: diagnosed(lambda t: 1.5 * np.sin(0.12 * (t + 2) ** 2), exclude=()),
    "undecided": lambda: diagnosed(
        lambda t: 0.2 * (t > 5),
        simulator().run(6, random_state=0),
        hs.PolynomialChaos(2),
        exclude=all_but("step", "noise"),
    ),
    "two causes": lambda: diagnosed(
        lambda t: step(t) + 0.6 * np.sin(2 * np.pi * t / 1.3), max_causes=2
    ),
    "failed runs": lambda: diagnosed(step, simulator(fragile)),
    "doubtful draws": lambda: with_doubtful_draws(outcome("named")),
    "no gain": lambda: without_gain(outcome("named")),
}


@cache
def outcome(name):
    """Return the diagnosis of an outcome by its name."""
    return OUTCOMES[name]()
