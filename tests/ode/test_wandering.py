"""A rate that wanders inside the dynamics: the solution is the exponential of its integral."""

import numpy as np
import pytest
from few_kinds import all_but
from scipy.integrate import quad
from scipy.stats import norm, uniform

import hybridsurrogate as hs
from hybridsurrogate.numerics import hilbert
from hybridsurrogate.ode.dynamics import WanderingParameter

DECAY = hs.OdeSimulator(
    lambda t, state, rate: -rate * state,
    initial_state=[8.0],
    observe=lambda state: state[0],
    inputs={"t": (0, 10)},
    states="n",
    parameters={"rate": uniform(0.1, 0.5)},
)


def test_the_solution_follows_the_wandering_rate():
    change = WanderingParameter("rate", 0.0, 10.0, 4)
    names = [change.full(name) for name in change.neutral]
    changed = DECAY.modified([change], dict.fromkeys(names, norm()))
    waves, t = np.array([0.4, -0.3, 0.2, 0.1]), np.array([2.0, 5.0, 9.5])

    def rate(s):
        return 0.3 * np.exp(hilbert.cosines(np.array([(s - 5) / 5]), 4)[0] @ waves)

    true = [8 * np.exp(-quad(rate, 0, end)[0]) for end in t]
    rows = np.tile([0.3, *waves], (3, 1))
    np.testing.assert_allclose(changed(t[:, None], rows), true, rtol=1e-4)


def test_a_parameter_that_is_not_there_is_told():
    with pytest.raises(ValueError, match="Did you mean 'rate'"):
        DECAY.modified([WanderingParameter("rat", 0.0, 10.0, 4)], {})


def test_a_rate_that_wanders_is_detected_and_followed():
    """Twenty waves have a million corners: descents start at those of the first few."""
    t = np.linspace(0.2, 10, 50)

    def rates(s):
        return 0.3 * np.where(s < 4, 1.0, 0.5)

    truth = 8 * np.exp(-0.3 * np.minimum(t, 4) - 0.15 * np.maximum(t - 4, 0))
    y = truth + 0.03 * np.random.default_rng(0).standard_normal(len(t))
    model = hs.PowerScaledSurrogate(
        DECAY, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(
        model,
        causes=[hs.ParameterProcess("rate")],
        exclude=all_but("unexplained", "trend"),
        cv=None,
        n_replicates=40,
        random_state=0,
    ).fit(t[:, None], y)
    assert (diagnosis.best_cause_.kind, diagnosis.best_cause_.target) == ("parameter-drift", "rate")
    course = diagnosis.parameter_course()
    inside = (course["lower"] < rates(course["x"])) & (rates(course["x"]) < course["upper"])
    # of 24 waves the bands miss the jump itself
    assert np.mean(inside) > 0.7
