"""A named cause is tested: noise alone, or structure that it leaves behind."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.residuals import check_residuals
from hybridsurrogate.diagnosis.search.search import search
from hybridsurrogate.diagnosis.search.setup import prepare, trained_emulator
from hybridsurrogate.inference.procedure import at_prior_ends

T = np.linspace(0, 10, 60)


def line(t, a):
    return a * t


SIMULATOR = hs.Simulator(line, {"t": (0, 12)}, {"a": hs.truncated_normal(2, 1, 0, 5)})
MODEL = hs.PowerScaledSurrogate(
    SIMULATOR, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
)


def checked(y, cause=None):
    """Return the check of nothing wrong, or of one cause."""
    fitted = clone(MODEL).set_params(n_draws=50).fit(T[:, None], y)
    prepared = prepare(fitted, [] if cause is None else [cause])
    causes = [c for c in prepared.causes if cause is not None and type(c) is type(cause)][-1:]
    problem, emulator = trained_emulator(prepared.problem, fitted)
    found = search(SearchContext.of(problem, emulator), causes)
    return check_residuals(found, found.candidates[-1])


@pytest.mark.slow
def test_the_chance_is_uniform_where_the_model_is_right():
    chances = [
        checked(2 * T + 0.3 * np.random.default_rng(seed).standard_normal(60)).p_value
        for seed in range(80)
    ]
    assert stats.kstest(chances, "uniform").pvalue > 0.01
    assert np.mean(np.array(chances) <= 0.05) < 0.15


@pytest.mark.parametrize(
    ("left", "statistic"),
    [
        (lambda t, e: 0.6 * np.sin(2 * np.pi * t / 8) + e, "curve over t"),
        (lambda t, e: e * np.exp(0.25 * (t - 5)), "spread over t"),
        (lambda t, e: np.where(np.arange(60) % 15 == 7, 6 * e, 0.5 * e), "tails"),
    ],
)
def test_what_is_left_is_told_by_its_kind(left, statistic):
    check = checked(2 * T + left(T, 0.3 * np.random.default_rng(1).standard_normal(60)))
    assert check.p_value < 0.05
    assert check.statistics[statistic] < 0.05


def diagnosed(hidden, seed, **options):
    y = 2 * T + hidden(T) + 0.2 * np.random.default_rng(seed).standard_normal(60)
    diagnosis = hs.DiscrepancyDiagnosis(
        MODEL, cv=None, n_replicates=39, random_state=0, **options
    )  # fmt: skip
    return diagnosis.fit(T[:, None], y)


@pytest.mark.slow
def test_a_cause_that_leaves_structure_is_the_nearest_one():
    """A saw, which no kind draws: a wave is nearest."""
    found = diagnosed(lambda t: 1.2 * (t % 2.5 - 1.25), 0)
    assert found.verdict_ == "nearest"
    assert found.best_cause_.kind == "periodic"
    report = found.report()
    assert "misses a cycle of y" in report.headline
    assert "closest match" in " ".join([report.headline, *report.lead])
    assert "may be at work too" in report.first.caution
    values = report.to_dict()
    assert values["verdict"] == "nearest"
    assert values["residual_check"]["p_value"] <= 0.05


@pytest.mark.slow
def test_a_cause_that_leaves_noise_is_named():
    verdicts = [diagnosed(lambda t: 2.0 * (t > 5), seed).verdict_ for seed in range(4)]
    assert verdicts.count("named") >= 3
    found = diagnosed(lambda t: 2.0 * (t > 5), 0)
    assert "if the catalogue holds the true cause" in found.report().first.cards[1].detail


def test_nothing_found_and_outliers_have_no_check():
    found = diagnosed(lambda t: 0 * t, 0)
    assert found.residual_check_ is None
    heavy = next(w for w in found.search_.candidates if w.cause and "outliers" in w.cause.acts_on)
    assert check_residuals(found.search_, heavy) is None


@pytest.mark.slow
def test_a_parameter_at_the_end_of_its_prior_is_said():
    bounded = hs.Simulator(line, {"t": (0, 12)}, {"a": stats.uniform(1, 0.8)})
    y = 2 * T + 0.05 * np.random.default_rng(0).standard_normal(60)
    strained = clone(MODEL).set_params(simulation=bounded).fit(T[:, None], y)
    assert [(one.name, one.side) for one in at_prior_ends(strained.posterior_)] == [("a", "high")]
    assert at_prior_ends(clone(MODEL).fit(T[:, None], y).posterior_) == []
    found = diagnosed(lambda t: 2.0 * (t > 5), 0)
    assert found.at_prior_end_ == []
    ends = tuple(at_prior_ends(strained.posterior_))
    extension = replace(found.result_.extension, at_prior_end=ends)
    found.result_ = replace(found.result_, extension=extension)
    text = str(found.report(full=True)).replace("\n", " ")
    assert "The parameter a is at the high end of its prior (1." in text
    assert found.report().to_dict()["at_prior_end"][0]["name"] == "a"
