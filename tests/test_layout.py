"""Where the search for a size begins."""

from __future__ import annotations

import numpy as np
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.evidence import search
from hybridsurrogate.estimators.problem import make_context, make_problem
from hybridsurrogate.inference.layout import layout
from hybridsurrogate.inference.linearised import coefficient_belief
from hybridsurrogate.likelihoods import as_likelihood


def test_a_constant_assumed_at_the_end_of_its_prior_is_found():
    """All of a mixture is assumed to be matter, as in the first model of a universe."""
    simulator = hs.Simulator(
        lambda t, start, share: start + 3 * share * np.sqrt(t),
        inputs={"t": (0, 4)},
        parameters={"start": stats.norm(0, 0.3)},
        assumed={"share": hs.Assumed(1.0, stats.uniform(0, 1))},
    )
    t = np.linspace(0, 4, 40)
    y = 0.1 + 3 * 0.3 * np.sqrt(t) + 0.1 * np.random.default_rng(0).standard_normal(40)
    likelihood = as_likelihood("normal")
    X = t[:, None]
    problem = make_problem(simulator, hs.ExactSurrogate(), likelihood, None, (), ("t",), X, y)
    basis = problem.model.basis
    context = make_context(simulator, ("t",), 1, X, problem.scale, likelihood, basis)
    wrong = hs.WrongConstant("share").prepare(context)
    model = problem.model.with_effects((wrong,))
    assert abs(layout(model).neutral).max() < 3
    found = search(problem, [wrong], coefficient_belief(basis, None), False)
    none, one = found.weighed
    assert one.log_evidence > none.log_evidence + 20
    share = model.values(one.peak.z[None])[0, -1]
    assert abs(share - 0.3) < 0.05
