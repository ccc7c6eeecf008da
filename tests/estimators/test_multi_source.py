"""Several simulations and measured sets: how their rows and metadata are read and joined."""

import tracemalloc

import numpy as np
import pandas as pd
import pytest
from agreement import assert_same_numbers
from scipy.stats import norm
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin

CUBIC = hs.PolynomialChaos(degree=3)


@pytest.fixture(scope="module")
def case():
    return make_log_sin(random_state=0)


def several(*sources, **parameters):
    return hs.MultiSourceSurrogate(
        sources, **{"surrogate": CUBIC, "n_draws": 200, "random_state": 0, **parameters}
    )


# ---------------------------------------------------------------------------- measured sources


def frames(case):
    """Return the measured rows with a further column, as two frames."""
    other = make_log_sin(random_state=1)
    z = np.linspace(50, 60, len(case.y))
    rows = [pd.DataFrame({"x": data.X[:, 0], "z": z}) for data in (case, other)]
    return *rows, other.y


def test_columns_of_a_source_go_by_name(case):
    X, further, y = frames(case)
    runs = hs.Source(case.simulation, 0.5)
    right, turned, plain = (
        several(runs, hs.Source((rows, y))).fit(X, case.y)
        for rows in (further, further[["z", "x"]], further.to_numpy())
    )
    assert_same_numbers(turned.predict(X), right.predict(X))
    assert_same_numbers(plain.predict(X), right.predict(X))


def test_a_named_source_beside_an_array_gives_its_inputs_by_name(case):
    X, further, y = frames(case)
    runs = hs.Source(case.simulation, 0.5)
    right, turned = (
        several(runs, hs.Source((rows, y))).fit(X.to_numpy(), case.y)
        for rows in (further, further[["z", "x"]])
    )
    np.testing.assert_array_equal(turned.predict(X.to_numpy()), right.predict(X.to_numpy()))


def test_sources_that_cannot_be_read(case):
    X, further, y = frames(case)
    gap = case.X.copy()
    gap[3] = np.nan
    text = further.assign(x="warm")
    for given, rows, outputs, match in [
        (X, further.rename(columns={"z": "w"}), y, r"lacks the columns \['z'\]"),
        (X, text, y, "hold no numbers"),
        (case.X, gap, case.y, "contains NaN"),
        (case.X, case.X, np.full(30, np.nan), "contains NaN alone"),
        (case.X, case.X, case.y[1:], "inconsistent numbers of samples"),
    ]:
        with pytest.raises(ValueError, match=match):
            several(hs.Source(case.simulation), hs.Source((rows, outputs))).fit(given, case.y)


def test_a_source_out_of_range_warns_where_fit_was_called(case):
    model = several(hs.Source(case.simulation), hs.Source((case.X + 1000, case.y)))
    with pytest.warns(hs.ExtrapolationWarning, match="30 of 30") as told:
        model.fit(case.X, case.y)
    assert told[0].filename == __file__


def test_rows_are_joined_without_comparing_all_with_all(case):
    X = np.linspace(1, 100, 3000)[:, None]
    y = np.log(X[:, 0]) + 1
    peaks = []
    for model in (
        hs.PowerScaledSurrogate(case.simulation, CUBIC, n_draws=50, random_state=0),
        several(hs.Source(case.simulation), n_draws=50),
    ):
        tracemalloc.start()
        model.fit(X, y)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0]


# ---------------------------------------------------------------------------------- simulations


def runs_of(prior=None, value=0.0, doubt=None):
    simulator = hs.Simulator(
        lambda t, a, c: a * t + c,
        inputs={"t": (0, 1)},
        parameters={"a": prior or norm(1, 0.3)},
        assumed={"c": hs.Assumed(value, doubt or norm(0, 1))},
    )
    return simulator.run(50, random_state=1)


@pytest.mark.parametrize(
    ("other", "match"),
    [
        ({"prior": norm(1, 0.2)}, "prior of 'a' differs"),
        ({"doubt": norm(0, 0.9)}, "prior of 'c' differs"),
        ({"value": 1.5}, "value of 'c' is 0.0 in one and 1.5 in another"),
    ],
)
def test_simulations_with_other_priors_or_constants(other, match):
    t = np.linspace(0, 1, 20)[:, None]
    model = several(hs.Source(runs_of(), 0.5), hs.Source(runs_of(**other)))
    with pytest.raises(ValueError, match=match):
        model.fit(t, t[:, 0])


def test_equal_priors_may_be_written_in_two_ways():
    t = np.linspace(0, 1, 20)[:, None]
    same = runs_of(prior=norm(loc=1.0, scale=0.3))
    y = t[:, 0] + 0.1 * np.random.default_rng(0).standard_normal(20)
    model = several(hs.Source(runs_of(), 0.5), hs.Source(same))
    assert model.fit(t, y).simulation.n_runs > 50


def test_runs_that_are_curves_stay_runs():
    simulator = hs.Simulator(lambda t, a: a * t, {"t": (0, 1)}, {"a": norm()})
    curves, others = (simulator.run(8, random_state=k, along=5) for k in range(2))
    rows = simulator.run(6, random_state=2)
    merged = several(hs.Source(curves, 0.5), hs.Source(others, 0.5), hs.Source(rows, 0.5))
    runs = merged.simulation
    assert (runs.n_rows, runs.n_runs) == (86, 22)
    # each has one value of the parameter
    assert [len(np.unique(runs.omega[runs.run == label])) for label in np.unique(runs.run)] == [
        1
    ] * 22
    assert several(hs.Source(rows), hs.Source(rows)).simulation.run is None


def test_clones_share_the_runs(case):
    model = several(hs.Source(case.simulation, 0.5))
    assert clone(model).sources[0].data is case.simulation
    both = hs.AveragedSurrogate([model, several(hs.Source(case.simulation, 0.2))], [0.5, 0.5])
    assert np.isfinite(clone(both).fit(case.X, case.y).score(case.X, case.y))


@pytest.mark.parametrize(
    ("sources", "match"),
    [
        (lambda simulator: hs.Source(simulator), r"write \[Source"),
        (lambda simulator: [hs.Source(simulator)], r"Source\(simulator.run\(200\)"),
    ],
    ids=["no list", "not run"],
)
def test_sources_that_are_none(simulator, measured, sources, match):
    with pytest.raises(TypeError, match=match):
        hs.MultiSourceSurrogate(sources(simulator)).fit(*measured)


# ------------------------------------------------------------------------------------- no power


def test_measured_rows_of_no_power_carry_step_2(case):
    silent = several(hs.Source(case.simulation), power=0.0).fit(case.X, case.y)
    whole = hs.PowerScaledSurrogate(case.simulation, CUBIC, 1.0, n_draws=200, random_state=0)
    whole.fit(case.X, case.y)
    np.testing.assert_allclose(silent.predict(case.X_in), whole.predict(case.X_in), rtol=1e-6)
    # all measured sets alike, as where their powers are small and equal
    halves = slice(None, None, 2), slice(1, None, 2)
    first, other = ((case.X[half], case.y[half]) for half in halves)
    parts = several(hs.Source(case.simulation), hs.Source(other, 0.0), power=0.0).fit(*first)
    assert parts.score(case.X_in, case.y_in) == pytest.approx(
        whole.score(case.X_in, case.y_in), abs=0.1
    )


def test_effects_beside_a_simulation_of_no_power(case):
    settings = {"effects": [hs.Offset()], "n_draws": 200, "random_state": 0}
    silent = several(hs.Source(case.simulation, 0.0), **settings).fit(case.X, case.y)
    at_zero = hs.PowerScaledSurrogate(case.simulation, CUBIC, 0.0, **settings).fit(case.X, case.y)
    by_row = hs.PowerScaledSurrogate(
        case.simulation, CUBIC, lambda X: np.zeros(len(X)), **settings
    ).fit(case.X, case.y)
    expected = at_zero.score(case.X_in, case.y_in)
    assert silent.score(case.X_in, case.y_in) == pytest.approx(expected, abs=0.1)
    assert by_row.score(case.X_in, case.y_in) == pytest.approx(expected, abs=0.1)


# ------------------------------------------------------------------------------------ diagnosis


def test_a_diagnosis_asks_for_one_simulation_and_one_set(case):
    for model in (several(hs.Source(case.simulation)), hs.KennedyOHaganSurrogate(case.simulation)):
        with pytest.raises(TypeError, match="Diagnose a PowerScaledSurrogate of one simulation"):
            hs.DiscrepancyDiagnosis(model).fit(case.X, case.y)
