"""Large batches are worked on in blocks: no result depends on where they are cut."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.estimators.problem import make_problem
from hybridsurrogate.inference.blocks import BLOCK, blocks, in_blocks
from hybridsurrogate.inference.layout import layout
from hybridsurrogate.inference.linearised import coefficient_belief, linearise
from hybridsurrogate.inference.noise import NoiseTable
from hybridsurrogate.inference.scan import scan

N = 3000


@pytest.mark.parametrize("n", [0, 1, 6, 7])
def test_blocks_cover_everything_once(n):
    covered = [k for block in blocks(n, 100, 250) for k in range(n)[block]]
    assert covered == list(range(n))


def test_what_is_run_in_blocks_is_what_is_run_at_once():
    values = np.random.default_rng(0).standard_normal((25, 2))
    sizes = []

    def run(some):
        sizes.append(len(some))
        return some.sum(axis=1), some[:, :, None] * np.ones(3)

    whole = run(values)
    for one, other in zip(whole, in_blocks(run, values, BLOCK // 10), strict=True):
        assert_array_equal(one, other)
    assert sizes == [25, 10, 10, 5]


def decay(t, rate):
    return np.exp(-rate * t)


SIMULATOR = hs.Simulator(decay, {"t": (0, 10)}, {"rate": stats.uniform(0.1, 0.5)})


@pytest.mark.parametrize("surrogate", [hs.ExactSurrogate(), hs.PolynomialChaos(4)], ids=str)
@pytest.mark.parametrize(
    "cause", [hs.Bump("t"), hs.ParameterDrift("rate", "t", "step")], ids=["added", "inside"]
)
def test_nodes_are_weighed_alike_alone_and_together(cause, surrogate):
    """With 3000 rows neither all nodes nor all runs around them fit into one block."""
    rng = np.random.default_rng(1)
    X = np.linspace(0, 10, N)[:, None]
    y = decay(X[:, 0], 0.3) + 0.1 * rng.standard_normal(N)
    runs = SIMULATOR.run(64, random_state=0)
    problem = make_problem(runs, surrogate, hs.Normal(), None, (cause,), ("t",), X, y)
    model = problem.model
    belief = coefficient_belief(model.basis, problem.simulation)
    plan = layout(model)
    assert len(plan.grid) * N * 3 > BLOCK
    noise = NoiseTable(problem.noise_prior, problem.scale, N)
    responses, sizes = np.vstack([y, y[::-1]]), np.array([0.05, 0.5])
    z = plan.neutral + 0.1
    parts = linearise(model, X, belief, plan, z)
    together = scan(parts, responses, 0.1, noise, sizes)
    for node in rng.choice(len(plan.grid), 5, replace=False):
        own = linearise(model, X, belief, plan.at(np.array([node])), z)
        # the emulator's uncertainty is taken at the first node
        alone = scan(replace(own, U=parts.U), responses, 0.1, noise, sizes)
        assert_allclose(alone[:, 0], together[:, node], rtol=1e-9)
