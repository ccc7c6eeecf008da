"""Large batches are worked on in blocks: no result depends on where they are cut."""

from dataclasses import replace

import numpy as np
import pytest
from agreement import assert_same_numbers
from numpy.testing import assert_allclose
from problems import make_problem
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.inference.conjugate.noise_marginal import NoiseTable
from hybridsurrogate.inference.evidence.grid import make_grid
from hybridsurrogate.inference.evidence.linearised import linearise
from hybridsurrogate.inference.evidence.marginal_likelihood import _normal_equations, scan
from hybridsurrogate.model.statistics import emulator_posterior
from hybridsurrogate.numerics.linear_algebra import BLOCK, blocks, in_blocks

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
        assert_same_numbers(one, other)
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
    emulator = emulator_posterior(model.basis, problem.simulation)
    grid = make_grid(model)
    assert len(grid.points) * N * 3 > BLOCK
    noise = NoiseTable(problem.noise_prior, problem.scale, N)
    responses, sizes = np.vstack([y, y[::-1]]), np.array([0.05, 0.5])
    z = grid.neutral + 0.1
    parts = linearise(model, X, emulator, grid, z)
    together = scan(parts, responses, 0.1, noise, sizes)
    for node in rng.choice(len(grid.points), 5, replace=False):
        own = linearise(model, X, emulator, grid.at(np.array([node])), z)
        # the emulator's uncertainty is taken at the first node
        alone = scan(replace(own, U=parts.U), responses, 0.1, noise, sizes)
        assert_allclose(alone[:, 0], together[:, node], rtol=1e-9)
        # and the climb sees the same linear model there
        (whole, factor), (single, _) = (*parts.by_noise(), *replace(own, U=parts.U).by_noise())
        for one, other in zip(
            _normal_equations(single, y / factor, 0.1)[:4],
            _normal_equations(whole, y / factor, 0.1)[:4],
            strict=True,
        ):
            other = other[[node]] if np.ndim(other) else other
            assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.max(np.abs(other)))


def test_nodes_that_change_nothing_share_the_simulation():
    """At a size of zero a drift is the plain simulation at every node; elsewhere it is not."""
    X = np.linspace(0, 10, 50)[:, None]
    y = decay(X[:, 0], 0.3)
    cause = hs.ParameterDrift("rate", "t", "step")
    problem = make_problem(
        SIMULATOR, hs.ExactSurrogate(), hs.Normal(), None, (cause,), ("t",), X, y
    )
    model = problem.model
    emulator, grid = emulator_posterior(model.basis, None), make_grid(model)
    at_zero = linearise(model, X, emulator, grid, grid.neutral)
    assert len(at_zero.mean) == len(grid.points)
    shared = at_zero.simplified()
    assert len(shared.mean) == len(shared.G) == 1
    noise, sizes = NoiseTable(problem.noise_prior, problem.scale, len(y)), np.array([0.1])
    responses = y + 0.1 * np.random.default_rng(2).standard_normal((3, 50))
    one, other = (scan(parts, responses, 0.1, noise, sizes) for parts in (at_zero, shared))
    assert_allclose(one, other, rtol=1e-9)
    z = grid.neutral.copy()
    z[grid.sizes] += 0.5
    elsewhere = linearise(model, X, emulator, grid, z)
    assert elsewhere.simplified() is elsewhere


@pytest.mark.parametrize(
    "cause", [hs.Autocorrelation("t"), hs.GaussianProcessDiscrepancy(), hs.Periodic("t")], ids=str
)
def test_the_columns_of_a_draw_are_its_own(cause):
    X = np.linspace(0, 10, 20)[:, None]
    y = decay(X[:, 0], 0.3)
    problem = make_problem(
        SIMULATOR, hs.ExactSurrogate(), hs.Normal(), None, (cause,), ("t",), X, y
    )
    model = problem.model
    z = np.random.default_rng(5).standard_normal((4, model.n_unknowns))
    z[2] = z[1]  # neighbours may agree
    z[3, 1] = z[2, 1]  # or differ in some numbers only
    values = model.values(z)
    together = model.added(X, values)
    for j in range(4):
        assert_allclose(together[j], model.added(X, values[[j]])[0], rtol=1e-12)
