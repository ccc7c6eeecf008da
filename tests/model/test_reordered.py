"""Causes of a model in another order."""

import numpy as np
from problems import make_problem
from scipy.stats import norm, uniform

import hybridsurrogate as hs

SIMULATOR = hs.Simulator(
    lambda t, level: level + t, inputs={"t": (0, 10)}, parameters={"level": norm(1, 0.5)}
)


def test_unknowns_follow_their_causes():
    t = np.linspace(0, 10, 20)
    causes = (hs.Bump("t", location=uniform(2, 3)), hs.Offset(), hs.Step("t", uniform(6, 2)))
    problem = make_problem(
        SIMULATOR, hs.ExactSurrogate(), hs.Normal(), None, causes, ("t",), t[:, None], t
    )
    model = problem.model
    bump, offset, step = model.effects
    values = model.values(np.full((1, model.n_unknowns), 0.3))
    for some in ((step, bump, offset), (offset, step), (bump,), ()):
        other, order = model.reordered(some)
        assert other.effects == some
        named = [other.effects[k].kind + name for k, name in other.theta_names]
        before = [model.effects[k].kind + name for k, name in model.theta_names]
        assert [before[k - 1] for k in order[1:]] == named
        z = np.full((1, other.n_unknowns), 0.3)
        np.testing.assert_allclose(other.values(z), values[:, order])
