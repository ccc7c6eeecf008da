"""A fault hidden in one of several outputs, or in what they share: found, blind."""

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy.special import polygamma
from scipy.stats import norm
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.null_test import replicates
from hybridsurrogate.exceptions import DiagnosisWarning

N = 40
NOISE = np.array([0.05, 0.4])


def level_and_flow(t, a, k):
    level = a * np.exp(-k * t)
    return level, 30 * k * level


SIMULATOR = hs.Simulator(
    level_and_flow,
    {"t": (0, 10)},
    {"a": hs.truncated_normal(2, 0.5, 0.5, 4), "k": hs.truncated_normal(0.3, 0.1, 0.05, 0.8)},
    output=("h", "q"),
)
DIAGNOSIS = hs.DiscrepancyDiagnosis(
    hs.PowerScaledSurrogate(SIMULATOR, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0),
    n_replicates=39,
    cv=None,
    random_state=0,
)


def measured(seed, k=0.25):
    """Return measurements of the simulation as it is, some of them missing."""
    random = np.random.default_rng(4000 + seed)
    t = np.sort(random.uniform(0, 10, N))
    Y = np.column_stack(level_and_flow(t, 2.0, k(t) if callable(k) else k))
    Y += NOISE * random.normal(size=Y.shape)
    Y[random.random(Y.shape) < 0.1] = np.nan
    return t[:, None], Y


def fitted(X, Y, **options):
    return clone(DIAGNOSIS).set_params(**options).fit(X, Y)


def leading(diagnosis):
    wrong = diagnosis.causes_[diagnosis.causes_["kind"] != "none"]
    return wrong.iloc[0][["kind", "target"]].tolist()


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_hidden():
    verdicts = [fitted(*measured(seed)).verdict_ for seed in range(5)]
    # of 5 with a chance of at most 5 % each, 2 or more have one of 2.3 %
    assert verdicts.count("adequate") >= 4


@pytest.mark.slow
@pytest.mark.parametrize("output", [0, 1])
def test_a_step_in_one_output_is_found_there(output):
    found = 0
    for seed in range(3):
        X, Y = measured(seed)
        Y[:, output] += 4 * NOISE[output] * (X[:, 0] > 5)
        diagnosis = fitted(X, Y)
        found += leading(diagnosis) == ["step", f"{('h', 'q')[output]}: t"]
        assert diagnosis.verdict_ != "adequate"
    assert found >= 2


@pytest.mark.slow
def test_a_parameter_that_changes_is_one_cause_in_all_outputs():
    X, Y = measured(0, k=lambda t: 0.25 * (1 + 0.5 * (t > 5)))
    diagnosis = fitted(X, Y)
    assert leading(diagnosis) == ["parameter-drift", "k"]
    assert "shared by all outputs" in str(diagnosis.report(full=True))
    # the extended simulation is one of both outputs
    extended = diagnosis.extended_simulator_
    assert extended.outputs == ("h", "q")


@pytest.mark.slow
def test_the_evidence_is_that_of_the_output_alone():
    """Outputs that share nothing: what is wrong with one is weighed as if it were alone."""
    priors = {"a": norm(1, 1), "b": norm(1, 1)}
    both = hs.Simulator(
        lambda t, a, b: (a * t, b * np.sqrt(t)), {"t": (0, 10)}, priors, output=("u", "v")
    )
    alone = hs.Simulator(lambda t, b: b * np.sqrt(t), {"t": (0, 10)}, {"b": norm(1, 1)})
    random = np.random.default_rng(5)
    t = np.sort(random.uniform(0, 10, N))
    Y = np.column_stack([t, np.sqrt(t)]) + random.normal(size=(N, 2)) * [0.3, 0.2]
    Y[:, 1] += 0.5 * (t > 6)

    def evidence(diagnosis, of):
        table = diagnosis.causes_
        own = table["target"].fillna("").str.startswith("v") if of else table["target"] == "t"
        rows = table[own & table["kind"].isin(["step", "trend", "ramp", "bump", "periodic"])]
        return rows.set_index("form")["log_evidence"].sort_index()

    exact = hs.ExactSurrogate()
    together = fitted(
        t[:, None], Y, estimator=hs.PowerScaledSurrogate(both, surrogate=exact, random_state=0)
    )
    single = fitted(
        t[:, None],
        Y[:, 1],
        estimator=hs.PowerScaledSurrogate(alone, surrogate=exact, random_state=0),
    )
    one, other = evidence(together, "v"), evidence(single, None)
    assert one.idxmax() == other.idxmax() == "step"
    # differences of priors: of the noise, and of sizes down from its smallest
    assert np.all(np.abs(one - other)[other > 0] < 1.0)


@pytest.fixture(scope="module")
def biased():
    X, Y = measured(1)
    Y[:, 1] += 3 * NOISE[1] * np.sin(2 * np.pi * X[:, 0] / 3)
    return X, Y, fitted(X, Y, cv=3)


@pytest.mark.slow
def test_each_output_has_its_own_in_the_report(biased):
    _, Y, diagnosis = biased
    assert diagnosis.verdict_ == "named"
    assert (diagnosis.best_cause_.kind, diagnosis.best_cause_.target) == ("periodic", "q: t")
    text = str(diagnosis.report(full=True))
    n = np.isfinite(Y).sum(axis=0)
    for part in (
        f"{n[0]} measurements of h and {n[1]} measurements of q",
        "periodic in t, output q",
        "h: the simulation stands as it is.",
        "noise of h",
    ):
        assert part in text.replace("\n", " ")
    assert set(diagnosis.discrepancies_) == {"h", "q"}
    assert diagnosis.discrepancy_ is diagnosis.discrepancies_["q"]
    summary = diagnosis.report().to_dict()
    assert summary["output"] == "q"
    assert summary["parameters"]["noise of h"]["after"][0] == pytest.approx(NOISE[0], rel=0.4)
    assert summary["parameters"]["noise of q"]["after"][0] == pytest.approx(NOISE[1], rel=0.4)


@pytest.mark.slow
def test_estimates_and_the_extended_simulation_have_the_units_of_the_output(biased):
    X, Y, diagnosis = biased
    mean, low, high = diagnosis.best_cause_.estimates["amplitude"]
    assert low < 3 * NOISE[1] < high
    assert high - low < 2 * NOISE[1]
    assert low < mean < high
    draws = diagnosis.extended_estimator_.posterior_
    names = diagnosis.extended_simulator_.parameter_names
    assert {"a", "k", "period"} <= set(names)
    # one draw, run by the extended simulation, is that draw's prediction
    values = {"a": draws.values[0, 0], "k": draws.values[0, 1], "period": draws.values[0, 2]}
    columns = [name for name in names if name not in values]
    scale = diagnosis.estimator_.data_.stacking.scale[1]
    # what follows is the remainder beyond the measured range
    values |= dict(zip(columns, scale * draws.effect_coefficients[0], strict=False))
    told = diagnosis.extended_simulator_(X, np.tile([values[n] for n in names], (len(X), 1)))
    rows = diagnosis.extended_estimator_.checked_rows(X)
    eta = draws.take(np.array([0])).eta(rows)[0]
    expected = diagnosis.estimator_.data_.stacking.back(eta)[0]
    # at the ends, where only the other output was measured, a remainder comes to it
    there = np.isfinite(Y)
    np.testing.assert_allclose(told[there], expected[there], rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_gain_and_next_measurement_know_the_outputs(biased):
    X, Y, diagnosis = biased
    assert diagnosis.gain_.n_rows == np.isfinite(Y).sum()
    assert diagnosis.gain_.elpd_difference > 0
    assert diagnosis.next_measurement_["output"] in ("h", "q")
    assert set(diagnosis.next_measurement_) == {"t", "output"}
    batch = diagnosis.next_measurements(2, places=[[1.0], [2.0]], cost=[1, 1e6, 1e6, 1e6])
    assert batch[["t", "output"]].iloc[0].tolist() == [1.0, "h"]
    assert diagnosis.gain_on(X, Y).elpd_difference > 0
    assert diagnosis.predict(X).shape == Y.shape
    text = str(diagnosis.report(test=(X, Y), full=True))
    assert "On the rows that you held out" in text


@pytest.mark.slow
def test_runs_that_are_curves_of_several_outputs():
    X, Y = measured(2)
    Y[:, 0] += 4 * NOISE[0] * (X[:, 0] > 5)
    runs = SIMULATOR.run(30, along=25, random_state=0)
    model = hs.PowerScaledSurrogate(runs, surrogate=hs.Kriging(), random_state=0)
    diagnosis = fitted(X, Y, estimator=model)
    assert leading(diagnosis) == ["step", "h: t"]
    assert diagnosis.emulator_check_.left_open < 0.2
    asked = diagnosis.next_runs(3)
    assert list(asked.columns) == ["a", "k"]
    further = runs.with_rows(SIMULATOR.run_at(asked, along=25))
    assert further.n_runs == 33
    assert further.y.shape == (33 * 25, 2)


@pytest.mark.slow
def test_counts_of_several_outputs():
    random = np.random.default_rng(0)
    t = np.sort(random.uniform(0, 10, N))
    simulator = hs.Simulator(
        lambda t, a, k: (50 * a * np.exp(-k * t) + 2, 150 * k * a * np.exp(-k * t) + 2),
        SIMULATOR.input_ranges,
        SIMULATOR.parameters,
        output=("seen", "heard"),
    )
    Y = random.poisson(np.column_stack(simulator.function(t, 2.0, 0.25)) * [1, 1.0]).astype(float)
    Y[:, 1] = random.poisson(simulator.function(t, 2.0, 0.25)[1] * (1 + 0.9 * (t > 5)))
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), likelihood="poisson", random_state=0
    )
    diagnosis = fitted(t[:, None], Y, estimator=model)
    assert leading(diagnosis) == ["step", "heard: t"]
    assert "heard" in str(diagnosis.report(full=True))


@pytest.mark.slow
def test_a_cause_of_ones_own_is_weighed_in_each_output():
    class Wobble(hs.Cause):
        kind = "wobble"
        target = "t"
        coefficients = ("height",)

        def columns(self, X, theta):
            return np.sin(2 * X["t"])[:, None]

    X, Y = measured(3)
    Y[:, 0] += 3 * NOISE[0] * np.sin(2 * X[:, 0])
    diagnosis = fitted(X, Y, causes=[Wobble()])
    targets = diagnosis.causes_.loc[diagnosis.causes_["kind"] == "wobble", "target"]
    assert set(targets) == {"h: t", "q: t"}
    assert leading(diagnosis) == ["wobble", "h: t"]
    only = fitted(X, Y, causes=[hs.InOutput(Wobble(), "h")])
    targets = only.causes_.loc[only.causes_["kind"] == "wobble", "target"]
    assert set(targets) == {"h: t"}


@pytest.mark.parametrize(
    "exclude",
    [
        all_but("step", "periodic", "trend", "bump", "offset"),
        pytest.param((), marks=pytest.mark.slow),
    ],
    ids=["few kinds", "all"],
)
def test_two_causes_in_two_outputs(exclude):
    X, Y = measured(4)
    Y[:, 0] += 5 * NOISE[0] * (X[:, 0] > 6)
    Y[:, 1] += 4 * NOISE[1] * np.sin(2 * np.pi * X[:, 0] / 2.5)
    diagnosis = fitted(X, Y, max_causes=2, exclude=exclude)
    found = {(f.kind, f.target) for f in diagnosis.found_causes_}
    assert found == {("step", "h: t"), ("periodic", "q: t")}


@pytest.mark.slow
def test_a_frame_with_a_column_that_the_simulation_ignores():
    X, Y = measured(5)
    frame = pd.DataFrame({"batch": np.arange(N) % 2, "t": X[:, 0]})
    named = pd.DataFrame(Y, columns=["h", "q"])
    named["h"] += 4 * NOISE[0] * frame["batch"]
    diagnosis = fitted(frame, named[["q", "h"]])
    assert leading(diagnosis) == ["missing-input", "h: batch"]


def test_an_output_with_few_values_is_refused():
    X, Y = measured(6)
    Y[3:, 1] = np.nan
    with pytest.raises(ValueError, match="at least 8 measured rows of each output, got 3 of 'q'"):
        DIAGNOSIS.fit(X, Y)


@pytest.mark.slow
def test_warnings_are_those_of_one_output():
    X, Y = measured(7)
    twice = np.vstack([X, X]), np.vstack([Y, Y])
    with pytest.warns(DiagnosisWarning, match="copies"):
        fitted(*twice)


def test_replicates_know_the_ratio_of_two_noises_from_their_rows_only():
    t = np.linspace(0, 1, 12)
    y = np.random.default_rng(0).normal(size=(12, 2)) * [0.3, 5.0]
    simulator = hs.Simulator(
        lambda t, level: np.stack([level + 0 * t, 10 * level + 0 * t], axis=-1),
        {"t": (0, 1)},
        {"level": norm(0, 1e-6)},
        output=("small", "large"),
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=50, random_state=0
    )
    found = hs.DiscrepancyDiagnosis(
        model, exclude=all_but("offset"), cv=None, n_replicates=20, random_state=0
    ).fit(t[:, None], y)
    drawn = replicates(found.search_, 4000, np.random.RandomState(0)).reshape(4000, 12, 2)
    small, large = np.mean(drawn**2, axis=1).T
    ratio = np.log(small / large)
    # of each output: scatter of twelve rows, of a variance that half of 24 rows less the level tell
    exact = 2 * (polygamma(1, 12 / 2) + polygamma(1, 11.5 / 2))
    assert np.var(ratio) == pytest.approx(exact, rel=0.1)
