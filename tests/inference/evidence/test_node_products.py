"""Evidence at all nodes from inner products: against normal densities, and its memory."""

import subprocess
import sys
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from hybridsurrogate.diagnosis.search.processes import _of_neighbours as of_neighbours
from hybridsurrogate.inference.conjugate.noise_marginal import KnownNoise
from hybridsurrogate.inference.evidence.linearised import Linearised
from hybridsurrogate.inference.evidence.marginal_likelihood import scan, scan_with_process

SIGMA = 0.5


def fixed_sigma(n):
    """Return the log density of rows of known noise, up to which the squares are scaled."""
    return lambda squares: -0.5 * n * np.log(2 * np.pi * SIGMA**2) - 0.5 * squares / SIGMA**2


def drawn(T, n, d, q, level=1.0, shared=False, emulator=0):
    """Return nodes of which each has a simulation of its own, at a level of a wide prior."""
    rng = np.random.default_rng(7)
    M = 1 if shared else T
    mean, G = level * rng.uniform(1, 2, (M, n)), rng.standard_normal((M, n, d))
    G[:, :, 0] = level
    H = rng.standard_normal((T, n, q))
    parts = Linearised(
        mean,
        G,
        H / np.sqrt(np.mean(H**2, axis=1, keepdims=True)),
        np.ones((T, q)),
        np.full((T, q), np.inf),
        rng.standard_normal((n, emulator)),
        np.log(np.full(T, 1 / T)),
    )
    responses = mean[0] + 0.7 * level + SIGMA * rng.standard_normal((3, n))
    return parts, responses


def dense(parts, y, node, size, extra=0.0):
    """Return the log density of one response at one node, all Gaussian parts in its covariance."""
    at = min(node, len(parts.mean) - 1)
    G, H = parts.G[at], parts.H[node]
    covariance = SIGMA**2 * np.eye(len(y)) + G @ G.T + size**2 * H @ H.T
    covariance += parts.U @ parts.U.T + extra
    return stats.multivariate_normal(parts.mean[at], covariance).logpdf(y)


@pytest.mark.parametrize("shared", [True, False], ids=["one simulation", "one a node"])
@pytest.mark.parametrize(("q", "emulator"), [(0, 0), (1, 0), (2, 3)])
@pytest.mark.parametrize("n_responses", [1, 3])
def test_the_evidence_is_the_density_of_the_rows(shared, q, emulator, n_responses):
    parts, responses = drawn(4, 12, 2, q, shared=shared, emulator=emulator)
    found = scan(parts, responses[:n_responses], SIGMA, fixed_sigma(12), np.array([0.3, 3.0]))
    for r, node in np.ndindex(found.shape):
        terms = [dense(parts, responses[r], node, size) for size in (0.3, 3.0)]
        expected = logsumexp(terms) - np.log(2) + parts.log_weight[node]
        assert found[r, node] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("broken", [np.nan, 1e200])
def test_nodes_at_which_the_simulation_fails_are_impossible(broken):
    """A decomposition of what is not finite raised, and the search with it."""
    parts, responses = drawn(4, 12, 2, 2)
    expected = scan(parts, responses, SIGMA, fixed_sigma(12), np.array([0.3, 3.0]))
    mean, G, H = parts.mean.copy(), parts.G.copy(), parts.H.copy()
    mean[1], G[1], H[1] = broken, broken, broken
    some = replace(parts, mean=mean, G=G, H=H)
    with np.errstate(all="ignore"):
        found = scan(some, responses, SIGMA, fixed_sigma(12), np.array([0.3, 3.0]))
    assert np.all(found[:, 1] == -np.inf) or np.all(found[:, 1] < expected[:, 1] - 1e3)
    np.testing.assert_allclose(found[:, [0, 2, 3]], expected[:, [0, 2, 3]], rtol=1e-9)


@pytest.mark.parametrize("shared", [True, False], ids=["one simulation", "one a node"])
def test_with_a_process_it_is_that_of_correlated_rows(shared):
    parts, responses = drawn(4, 12, 2, 1, shared=shared, emulator=2)
    bases = np.random.default_rng(3).standard_normal((2, 12, 5))
    process_sizes, sizes = np.array([0.2, 1.0, 40.0]), np.array([0.3, 3.0])
    found = scan_with_process(
        parts, responses[0], SIGMA, fixed_sigma(12), sizes, bases, process_sizes
    )
    assert found.shape == (2, 3, 4)
    for length, k, node in np.ndindex(found.shape):
        extra = process_sizes[k] ** 2 * bases[length] @ bases[length].T
        terms = [dense(parts, responses[0], node, size, extra) for size in sizes]
        expected = logsumexp(terms) - np.log(2) + parts.log_weight[node]
        assert found[length, k, node] == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("n_responses", [1, 3])
def test_a_level_far_from_zero_takes_no_digits(n_responses):
    """Responses of 1e8 in noise of 0.5: their squares differ by less than rounding of them.

    At a level of a parameter with a prior of 1e8 only differences of rows say anything, and these
    are the same at every level; less the prior's density there, which is that of the level.
    """
    n, level = 12, 1e8
    rng = np.random.default_rng(5)
    noise = SIGMA * rng.standard_normal((n_responses, n))
    one = np.ones((3, n, 1))
    shape = rng.standard_normal((3, n))
    parts = Linearised(
        shape, level * one, np.empty((3, n, 0)), np.empty((3, 0)), np.empty((3, 0)),
        np.empty((n, 0)), np.zeros(3),
    )  # fmt: skip
    found = scan(parts, 2 * level + noise, SIGMA, fixed_sigma(n), np.ones(1))
    left = noise[:, None] - shape
    left = left - left.mean(axis=2, keepdims=True)
    expected = -0.5 * np.sum(left**2, axis=2) / SIGMA**2 - 0.5 * n * np.log(2 * np.pi * SIGMA**2)
    # g is at 2 of a standard normal prior, and its likelihood as wide as sigma / (level sqrt n)
    expected += -0.5 * 2.0**2 + np.log(SIGMA / (level * np.sqrt(n)))
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_memory_does_not_grow_with_responses_times_nodes():
    """201 responses of 2000 rows at 400 nodes are 1.3 GB: nothing of that size is made."""
    parts, _ = drawn(400, 2000, 2, 1)
    responses = np.random.default_rng(1).standard_normal((201, 2000))
    tracemalloc.start()
    scan(parts, responses, SIGMA, KnownNoise(2000), np.geomspace(0.1, 3, 10))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40e6


DIAGNOSIS = """
import resource, warnings
import numpy as np, hybridsurrogate as hs
from scipy.stats import uniform
rng = np.random.default_rng(1)
simulator = hs.Simulator(
    lambda t, k: 10 * np.exp(-k * t), {"t": (0, 10)}, {"k": uniform(0.1, 0.6)})
t = np.sort(rng.uniform(0, 10, 4000))
y = 10 * np.exp(-0.3 * t) + 0.5 * (t > 6) + 0.5 * rng.standard_normal(4000)
model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(t[:, None], y)
assert diagnosis.best_cause_.kind == "step", diagnosis.best_cause_
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
def test_a_diagnosis_of_4000_rows_stays_below_600_megabytes():
    pytest.importorskip("resource")
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", DIAGNOSIS],
        capture_output=True,
        text=True,
        check=True,
    )
    kilobytes = int(done.stdout.split()[-1]) / (1024 if sys.platform == "darwin" else 1)
    assert kilobytes < 600_000


def test_few_lengths_of_a_process_have_the_prior_mass_and_evidence_of_all():
    """Evidence that changes smoothly with the length: groups of neighbours share one node."""
    parts, _ = drawn(90, 12, 2, 3, shared=True)
    order = np.random.default_rng(2).permutation(90)
    places = np.linspace(0, 1, 90)[order]
    log_weight = np.log(0.5 + places) - 5
    density = -8 * (places - 0.4) ** 2
    few = of_neighbours(replace(parts, log_weight=log_weight), places, density + log_weight)
    assert len(few.H) == 24
    assert logsumexp(few.log_weight) == pytest.approx(logsumexp(log_weight))
    kept = [int(np.argmin(np.abs(parts.H - H).sum(axis=(1, 2)))) for H in few.H]
    total = logsumexp(density[kept] + few.log_weight)
    assert total == pytest.approx(logsumexp(density + log_weight), abs=0.02)
