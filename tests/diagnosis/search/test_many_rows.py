"""Many rows: a sample tells what is far behind, and replicates do not test what is certain."""

from functools import cache
from unittest import mock

import numpy as np
import pytest
from few_kinds import all_but
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search import forward_selection
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.search import search
from hybridsurrogate.diagnosis.search.setup import prepare, trained_emulator

N = 150
CHANGES = {
    "nothing": lambda t: 0 * t,
    "step": lambda t: 1.0 * (t > 6),
    "wave": lambda t: 0.4 * np.sin(2 * np.pi * t / 1.7),
    # few rows, most of which a sample lacks
    "glitch": lambda t: 4.0 * ((t > 4) & (t < 4.5)),
}


@cache
def diagnosed(change, sample):
    """Diagnose a line to which something was added, as if twice so many rows were many."""
    t = np.sort(np.random.default_rng(1).uniform(0, 10, N))
    y = 1 + 2 * t + CHANGES[change](t) + 0.3 * np.random.default_rng(2).standard_normal(N)
    simulator = hs.Simulator(
        lambda t, level, slope: level + slope * t,
        {"t": (0, 10)},
        {"level": stats.norm(0, 3), "slope": stats.norm(2, 1)},
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=50, random_state=0
    )
    kinds = all_but("trend", "step", "episode", "periodic", "gain")
    diagnosis = hs.DiscrepancyDiagnosis(
        model, cv=None, random_state=0, n_replicates=40, exclude=kinds
    )
    with mock.patch.object(forward_selection, "_N_SAMPLED_ROWS", sample):
        return diagnosis.fit(t[:, None], y)


@pytest.mark.parametrize("change", CHANGES)
def test_a_sample_changes_neither_verdict_nor_probabilities(change):
    whole, quick = (diagnosed(change, sample) for sample in (1000, 50))
    assert quick.verdict_ == whole.verdict_
    assert quick.p_value_ == pytest.approx(whole.p_value_)
    shares = [
        one.causes_.groupby("kind")["probability"].sum().sort_index() for one in (whole, quick)
    ]
    np.testing.assert_allclose(*shares, atol=0.05)


@pytest.mark.parametrize("sample", [50, 1000])
def test_what_the_evidence_decides_is_not_tested_by_replicates(sample):
    quick = diagnosed("step", sample)
    assert len(quick.result_.test.replicates) == 0
    assert quick.p_value_ == pytest.approx(1 / 41)
    words = " ".join(str(quick.report()).split())
    assert "at most one in" in words
    assert "looks as wrong" in words


def test_what_is_far_behind_in_the_sample_has_its_evidence_and_says_so():
    whole, quick = (diagnosed("step", sample).causes_ for sample in (1000, 50))
    estimated = quick[quick["note"].str.contains("sample")]
    assert {"trend", "gain"} <= {*estimated["kind"]}
    both = estimated.merge(whole, on="form", suffixes=("", "_of_all"))
    # the log likelihood ratio of n rows scatters by about its root, that of a third of them times
    # three by the root of three of that
    of_all = both["log_evidence_of_all"]
    assert np.all(np.abs(both["log_evidence"] - of_all) < 3 * np.sqrt(3 * (np.abs(of_all) + 3)))


def test_a_grid_is_not_refined_for_what_stays_far_behind():
    """A slow wave in 400 rows, which an episode draws better with every finer grid, but poorly."""
    t = np.sort(np.random.default_rng(1).uniform(0, 10, 400))
    y = 1 + 2 * t + np.sin(2 * np.pi * t / 8) + 0.05 * np.random.default_rng(2).normal(size=400)
    simulator = hs.Simulator(
        lambda t, level: level + 2 * t, {"t": (0, 10)}, {"level": stats.norm(0, 3)}
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=20, random_state=0
    ).fit(t[:, None], y)
    prepared = prepare(model, ())
    problem, emulator = trained_emulator(prepared.problem, model)
    context = SearchContext.of(problem, emulator)
    of_kind = {cause.variant or cause.kind: cause for cause in prepared.causes}
    episode, wave = of_kind["factor"], of_kind["periodic"]
    alone, rival, both = (
        search(context, causes).candidates[1:] for causes in ([episode], [wave], [episode, wave])
    )
    assert len(both[0].fit.grid.points) < 0.7 * len(alone[0].fit.grid.points)
    # it is behind all the same, and what leads is as it was
    assert max(both[0].log_evidence, alone[0].log_evidence) < rival[0].log_evidence - 50
    assert both[1].log_evidence == pytest.approx(rival[0].log_evidence, abs=1e-3)
