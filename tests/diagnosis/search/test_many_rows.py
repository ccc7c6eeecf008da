"""Many rows: a sample tells what is far behind, and replicates do not test what is certain."""

from functools import cache
from unittest import mock

import numpy as np
import pytest
from few_kinds import all_but
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search import forward_selection

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
    with mock.patch.object(forward_selection, "_SAMPLE", sample):
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
