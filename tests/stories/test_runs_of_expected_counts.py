"""Runs of a simulation that are expected counts or expected successes, not whole numbers."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import uniform

import hybridsurrogate as hs
from hybridsurrogate.command_line.main import main
from hybridsurrogate.effects.registry import kinds
from hybridsurrogate.likelihoods import Binomial

RATE = {"first": uniform(0.5, 4), "rate": uniform(0.05, 0.3)}
FEW = [kind for kind in kinds() if kind not in ("step", "trend")]


def _falling(t, first, rate):
    return first * np.exp(-rate * t)


def _simulator():
    return hs.Simulator(_falling, {"t": (0, 10)}, RATE, output="n")


@pytest.mark.parametrize("likelihood", ["poisson", "negative-binomial", Binomial(6)])
def test_an_estimator_learns_small_means(likelihood):
    simulation = _simulator().run(80, random_state=0)
    t = np.linspace(0.5, 9.5, 40)
    truth = _falling(t, 2.5, 0.15)
    y = np.random.default_rng(0).poisson(truth).astype(float)
    model = hs.PowerScaledSurrogate(
        simulation, beta=0.5, likelihood=likelihood, n_draws=300, random_state=0
    ).fit(t[:, None], np.minimum(y, 6))
    # two standard errors of a level from 40 counts of mean 1.3 are 28 %
    assert np.median(np.abs(model.predict(t[:, None]) / truth - 1)) < 0.28
    # runs are trained on as draws, so that coefficients scatter, but around those of the means
    told = model.posterior_
    eta = told.likelihood.inverse(told.eta(t[:, None])[0])
    own = _falling(t, *told.values[:, :2].T[:, :, None])
    assert abs(np.mean(np.log(eta / own))) < 0.1


def test_measured_values_are_whole_numbers_still():
    model = hs.PowerScaledSurrogate(_simulator().run(40, random_state=0), likelihood="poisson")
    with pytest.raises(ValueError, match=r"needs counts 0, 1, 2, .* is no whole number"):
        model.fit(np.arange(10.0)[:, None], np.arange(10) + 0.5)


@pytest.mark.parametrize(
    ("likelihood", "worst", "match"),
    [
        ("poisson", -0.5, r"needs expected counts of zero or more, .* simulated .* is negative"),
        (Binomial(6), 6.5, r"needs successes 0 to 6, .* simulated values are not"),
    ],
)
def test_means_that_there_are_not(likelihood, worst, match):
    runs = _simulator().run(40, random_state=0)
    y = runs.y.copy()
    y[3] = worst
    bad = hs.SimulationData(runs.X, runs.omega, y, inputs={"t": (0, 10)}, parameters=RATE)
    with pytest.raises(ValueError, match=match):
        hs.PowerScaledSurrogate(bad, likelihood=likelihood).fit(
            np.arange(6.0)[:, None], np.arange(6.0)
        )


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hybridsurrogate.DiagnosisWarning")
def test_what_runs_leave_open_is_in_units_of_the_noise_of_counts():
    """Of means a hundred times as large the noise is a tenth, and what runs leave open the same."""
    t = np.sort(np.random.default_rng(1).uniform(0, 10, 40))
    left_open = []
    for size in (100.0, 1e4):
        simulator = hs.Simulator(
            lambda t, first, rate, size=size: size * first * np.exp(-rate * t + np.sin(t * rate)),
            {"t": (0, 10)},
            RATE,
            output="n",
        )
        y = np.random.default_rng(2).poisson(simulator(t[:, None], np.tile([2.5, 0.15], (40, 1))))
        model = hs.PowerScaledSurrogate(
            simulator.run(15, random_state=0), likelihood="poisson", n_draws=200, random_state=0
        )
        diagnosis = hs.DiscrepancyDiagnosis(
            model, exclude=FEW, cv=None, n_replicates=19, random_state=0
        ).fit(t[:, None], y)
        left_open.append(diagnosis.emulator_check_.left_open)
    assert left_open[1] == pytest.approx(10 * left_open[0], rel=0.5)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hybridsurrogate.DiagnosisWarning")
def test_a_jump_is_found_through_expected_counts():
    means = _verdict(1.0, 3.0, lambda y: y)
    assert means.causes_["kind"].iloc[0] == "step"
    assert means.undecided_by_ != "runs"
    assert means.emulator_check_.rounding is None
    assert "runs" not in [one.about for one in means.cautions_]


@pytest.mark.slow
def test_the_command_line_takes_expected_counts(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runs = _simulator().run(60, random_state=0)
    pd.DataFrame(
        {"t": runs.X[:, 0], "first": runs.omega[:, 0], "rate": runs.omega[:, 1], "n": runs.y}
    ).to_csv("runs.csv", index=False)
    t = np.linspace(0.2, 9.8, 40)
    y = np.random.default_rng(0).poisson(_falling(t, 2.5, 0.15))
    pd.DataFrame({"t": t, "n": y}).to_csv("measured.csv", index=False)
    given = ["diagnose", "measured.csv", "--simulation", "runs.csv", "--inputs", "t"]
    given += ["--parameters", "first", "rate", "--output", "n", "--likelihood", "poisson"]
    given += ["--jobs", "1"]
    assert main(given) == 0


def _verdict(size, jump, values, seed=3, exact=False):
    """Diagnose 150 counts of a simulation of so many; after t = 5 there are ``jump`` as many."""
    random = np.random.default_rng(seed)
    t = np.sort(random.uniform(0, 10, 150))
    y = random.poisson(size * _falling(t, 2.5, 0.15) * np.where(t > 5, jump, 1.0))
    simulator = hs.Simulator(
        lambda t, first, rate: size * _falling(t, first, rate), {"t": (0, 10)}, RATE, output="n"
    )
    runs = simulator.run(120, random_state=seed)
    simulation = hs.SimulationData(
        runs.X, runs.omega, values(runs.y), inputs={"t": (0, 10)}, parameters=RATE
    )
    model = hs.PowerScaledSurrogate(
        simulator if exact else simulation,
        surrogate=hs.ExactSurrogate() if exact else None,
        likelihood="poisson",
        n_draws=200,
        random_state=0,
    )
    diagnosis = hs.DiscrepancyDiagnosis(
        model, exclude=FEW, cv=None, n_replicates=99, random_state=0
    )
    return diagnosis.fit(t[:, None], y)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hybridsurrogate.DiagnosisWarning")
def test_rounded_runs_of_few_counts_leave_open_what_they_hide():
    """The simulation itself finds the jump by 24 nats; through stairs it was "adequate"."""
    assert _verdict(0.4, 6.0, np.round, exact=True).verdict_ == "named"
    rounded = _verdict(0.4, 6.0, np.round)
    assert (rounded.verdict_, rounded.undecided_by_) == ("undecided", "runs")
    assert rounded.emulator_check_.remedy.startswith(
        "Give the expected counts as runs, not rounded"
    )
    assert "whole numbers, rounded or drawn" in " ".join(rounded.report().lead)
    assert "Give the expected counts" in str(rounded.report())
    assert "runs" in [one.about for one in rounded.cautions_]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hybridsurrogate.DiagnosisWarning")
def test_rounding_of_many_counts_decides_nothing():
    """A step of one in forty is a twentieth of their noise."""
    rounded = _verdict(40.0, 1.0, np.round)
    assert rounded.verdict_ == "adequate"
    assert rounded.emulator_check_.rounding < 0.06
    assert "runs" not in [one.about for one in rounded.cautions_]
