"""Rows with error bars in a diagnosis: search, null test, folds, new measurements, picture."""

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy.stats import norm

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.null_test import replicates
from hybridsurrogate.diagnosis.search.setup import prepare
from hybridsurrogate.effects.registry import kinds
from hybridsurrogate.inference.conjugate.noise_marginal import KnownNoise, NoiseTable

COMPARED = {"offset", "trend", "periodic", "wrong-constant", "noise", "outliers"}


def cooling(t, start, rate, ambient):
    return ambient + start * np.exp(-rate * t)


SIMULATOR = hs.Simulator(
    cooling,
    inputs={"t": (0, 20)},
    parameters={
        "start": hs.truncated_normal(60, 10, 20, 100),
        "rate": hs.truncated_normal(0.3, 0.1, 0.05, 0.8),
    },
    assumed={"ambient": hs.Assumed(20.0, norm(20, 4))},
)


def measured(size=0.0, n=40, seed=0, constant=False):
    """Return a table with errors from 0.3 to 3 of each other, and y with a wave of some size."""
    random = np.random.default_rng(seed)
    t = np.sort(random.uniform(0, 12, n))
    errors = 0.5 * np.exp(random.uniform(np.log(0.3), np.log(3), n))
    errors = np.full(n, 0.5) if constant else errors
    y = cooling(t, 63.0, 0.25, 20.0) + size * np.sin(2 * np.pi * t / 3.1)
    return pd.DataFrame({"t": t, "sd": errors}), y + errors * random.standard_normal(n)


def diagnosis(noise="known", **settings):
    model = hs.PowerScaledSurrogate(
        SIMULATOR, hs.ExactSurrogate(), noise=noise, n_draws=200, random_state=0
    )
    exclude = sorted({*kinds()} - COMPARED)
    settings = {"exclude": exclude, "cv": None, "n_replicates": 50, "random_state": 0, **settings}
    return hs.DiscrepancyDiagnosis(model, **settings)


@pytest.mark.parametrize("noise", ["known", "scaled", "added"])
def test_a_wave_is_named_and_what_it_gains_counts_the_errors(noise):
    table, y = measured(1.5)
    found = diagnosis(noise, cv=2).fit(table, y, y_err="sd")
    assert found.best_cause_.kind == "periodic"
    assert found.gain_.elpd_difference > 0
    assert found.result_.rows.y_err.tolist() == table["sd"].tolist()
    # a table with the errors, one without, and errors apart
    with_column = found.score(table, y)
    assert with_column == pytest.approx(found.score(table[["t"]], y, y_err=table["sd"]), rel=1e-12)
    assert with_column > found.score(table[["t"]], y)
    assert found.gain_on(table, y).elpd_after == pytest.approx(with_column, rel=1e-12)
    assert "jitter" not in str(found.report()) or noise == "added"


def test_errors_that_are_known_leave_no_sigma_to_a_search():
    table, y = measured()
    fitted = {
        noise: diagnosis(noise).estimator.fit(table, y, y_err="sd")
        for noise in ("known", "scaled", "added")
    }
    problem = prepare(fitted["known"], ()).problem
    usual = np.median(table["sd"])
    assert problem.noise_is_known
    assert problem.possible_sigma(np.array([0.1, 7.0])).tolist() == [usual, usual]
    problem = prepare(fitted["added"], ()).problem
    assert problem.possible_sigma(0.1) == pytest.approx(usual)  # the least that errors leave
    assert problem.possible_sigma(7.0) == 7.0
    # a fixed jitter, no more than that of the fit, and none among the unknowns
    (jitter,) = problem.model.errors.jitter
    assert jitter <= np.median(fitted["added"].posterior_.named()["jitter"])
    noise = problem.model.simulated(problem.X, problem.model.values(problem.good))[2][0]
    sd = table["sd"].to_numpy()
    wanted = np.hypot(sd, jitter) / np.hypot(usual, jitter)
    np.testing.assert_allclose(noise[np.argsort(problem.X[:, 0])], wanted, rtol=1e-12)
    assert problem.model.effects == ()
    assert not prepare(fitted["scaled"], ()).problem.noise_is_known


def test_a_fault_of_the_simulation_is_no_jitter_to_a_search():
    jitters = []
    for size, extra in ((0.0, 0.0), (3.0, 0.0), (0.0, 1.0), (3.0, 1.0)):
        each = []
        for seed in range(6):
            table, y = measured(n=80, seed=seed)
            random = np.random.default_rng(seed)
            y = y + size * np.sin(2 * np.pi * table["t"] / 6) + extra * random.standard_normal(80)
            fitted = diagnosis("added").estimator.fit(table, y, y_err="sd")
            each.append(prepare(fitted, ()).problem.model.errors.jitter[0])
        jitters.append(np.mean(each))
    # the wave has an rms of 2.1, and counts as jitter in the fit without a cause
    assert np.median(fitted.posterior_.named()["jitter"]) > 1.5
    assert max(jitters[:2]) < 0.5
    assert jitters[2:] == pytest.approx([1.0, 1.0], abs=0.35)


def test_noise_in_addition_to_a_known_one_is_integrated_over_its_prior():
    prior, least, n = norm(0, 1), 0.5, 12
    half = hs.truncated_normal(0, 1, 0, 40)
    table = NoiseTable(half, 1.0, n, least)
    s = np.linspace(0, 8, 80001)[1:]
    for squares in (1.0, 3.0, 20.0):
        sd = np.hypot(least, s)
        density = 2 * prior.pdf(s) * (2 * np.pi * sd**2) ** (-n / 2) * np.exp(-squares / 2 / sd**2)
        exact = np.log(np.trapezoid(density, s))
        assert table(np.array([squares]))[0] == pytest.approx(exact, abs=0.01)
    exact = norm(0, least).logpdf(np.sqrt([2.0, 1.0])).sum()
    assert KnownNoise(2, least)(np.array([3.0]))[0] == pytest.approx(exact)


def test_replicates_scatter_as_the_errors_say():
    table, y = measured(2.0)
    found = diagnosis().fit(table, y, y_err="sd")
    search = found.search_
    drawn = replicates(search, 4000, np.random.RandomState(0))
    # whatever the wave leaves: the noise is known, and curves of two parameters add little to it
    sd = search.problem.X[:, -1]
    share = np.std(drawn, axis=0) / sd
    assert np.median(share) == pytest.approx(1.0, abs=0.1)
    assert np.all(share > 0.95)


@pytest.mark.usefixtures("verdict_alone")
@pytest.mark.parametrize("noise", ["known", "added"])
def test_a_right_simulation_is_adequate(noise):
    alarms = 0
    for seed in range(8):
        table, y = measured(seed=seed)
        alarms += diagnosis(noise).fit(table, y, y_err="sd").verdict_ != "adequate"
    # 2 of 8 at a rate of 5 % have a probability of 6 %, 3 of 0.6 %
    assert alarms < 3


def test_new_measurements_have_their_errors():
    table, y = measured()
    found = diagnosis().fit(table[:30], y[:30], y_err="sd")
    wild = y[30:] + 5
    # ten times the errors that others have: no reason for an alarm
    assert found.update(table[["t"]][30:], wild, y_err=10 * table["sd"][30:]).holds
    assert not diagnosis().fit(table[:30], y[:30], y_err="sd").update(table[30:], wild).holds


def test_a_picture_has_bars():
    table, y = measured(1.0)
    top, _ = diagnosis().fit(table, y, y_err="sd").plot()
    (bars,) = [one for one in top.containers if one.has_yerr]
    ends = np.sort([path.vertices[:, 1] for path in bars.lines[2][0].get_paths()], axis=0)
    assert len(ends) == len(y)
    widths = np.ptp([path.vertices[:, 1] for path in bars.lines[2][0].get_paths()], axis=1)
    np.testing.assert_allclose(np.sort(widths), np.sort(2 * table["sd"]), rtol=1e-9)


def test_errors_serve_a_heavy_tailed_search():
    table, y = measured(1.0)
    y[5] += 20
    one = diagnosis(exclude=all_but("periodic", "trend"), n_replicates=19)
    one.estimator.set_params(likelihood="student-t")
    assert one.fit(table, y, y_err="sd").best_cause_.kind == "periodic"


# ------------------------------------------------------------------------------------------ rates


@pytest.mark.slow
# in some of eighty sets a short wave or trend imitates the slope, which is said
@pytest.mark.filterwarnings("ignore::hybridsurrogate.ConfoundingWarning")
def test_the_right_cause_is_first_as_often_as_with_equal_errors():
    right = {}
    for constant in (False, True):
        first = []
        for seed in range(100):
            table, y = measured(0.45, seed=seed, constant=constant)
            found = diagnosis("added", n_replicates=19).fit(table, y, y_err="sd")
            first.append(found.causes_["kind"].iloc[0] == "periodic")
        right[constant] = np.mean(first)
    # the standard error of each is at most 5 %
    assert right[False] > right[True] - 2 * 0.05 * np.sqrt(2)
