"""What planned measurements would show: rates of detection and of names, before any is made."""

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy.stats import halfnorm, loguniform, norm, uniform

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.planning.detectability import place_at
from hybridsurrogate.diagnosis.search.simulated import refined_log_evidence

NOISE = 0.2
T = np.linspace(0, 10, 40)
FEW = all_but("step", "trend", "periodic", "offset", "noise")


def line(t, slope):
    return slope * t


def two_lines(t, slope):
    return {"low": slope * t, "high": 10.0 - slope * t}


def model_of(**settings):
    simulator = hs.Simulator(line, inputs={"t": (0, 10)}, parameters={"slope": norm(1, 0.5)})
    return hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), random_state=0, **settings
    )


@pytest.fixture(scope="module")
def found():
    return hs.detectability(
        model_of(),
        pd.DataFrame({"t": T}),
        causes=["step", "periodic", "noise"],
        sizes=[0.2, 1.0, 4.0],
        noise=NOISE,
        exclude=FEW,
        random_state=0,
    )


def test_larger_causes_are_detected_and_named_more_often(found):
    detected, named = found.curves(), found.curves("named")
    assert (detected.diff().iloc[1:] >= -0.05).all().all()
    assert (detected.loc[4.0, ["step", "periodic"]] == 1.0).all()
    assert (detected.loc[0.2] < 0.4).all()
    assert (named <= detected).all().all()
    assert (named.loc[4.0, ["step", "periodic"]] > 0.9).all()


def test_false_alarms_have_their_rate(found):
    none = found.confusion().loc["none"]
    # 400 data sets at a rate of 0.05: the probability has to reject, too
    assert 1 - none["none"] < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 400)


def test_the_confusion_matrix_has_all_data_sets(found):
    for size in (None, 1.0):
        matrix = found.confusion(size)
        # in the order in which causes were given
        assert list(matrix.index) == ["none", "step", "periodic", "noise"]
        assert [name for name in matrix.columns if name in matrix.index] == list(matrix.index)
        np.testing.assert_allclose(matrix.sum(axis=1), 1.0)
    right = found.table.set_index(["cause", "size"])["right"]
    assert found.confusion(1.0).loc["step", "step"] == pytest.approx(right["step", 1.0])


def test_the_change_of_a_step_is_its_height():
    """A step h in the middle of rows, of which no parameter follows any, has size h / 2 sigma."""
    fixed = hs.Simulator(line, inputs={"t": (0, 10)}, parameters={"slope": norm(1, 1e-9)})
    step = hs.Step("t", location=norm(5.0, 1e-3))
    model = hs.PowerScaledSurrogate(fixed, surrogate=hs.ExactSurrogate())
    settings = {"noise": NOISE, "exclude": FEW, "n_replicates": 20, "random_state": 0}
    only = hs.detectability(model, T[:, None], causes=[step], sizes=[2.0], **settings)
    # only a slope that is known to a billionth could follow: any could to first order
    basis = T / np.linalg.norm(T)
    jump = (T > 5.0).astype(float)
    left = jump - basis * (basis @ jump)
    height = 2.0 * NOISE / np.sqrt(np.mean(left**2))
    assert only.table["change"].iloc[0] == pytest.approx(height, rel=1e-3)


def test_rows_needed_are_those_that_would_do(found):
    """As many rows as the table asks for detect the cause in about nine of ten data sets."""
    row = found.table.set_index(["cause", "size"]).loc[("periodic", 1.0)]
    n = int(row["rows"])
    planned = np.linspace(0, 10, n)[:, None]
    again = hs.detectability(
        model_of(),
        planned,
        causes=["periodic"],
        sizes=[1.0],
        noise=NOISE,
        exclude=FEW,
        n_replicates=200,
        random_state=1,
    )
    assert again.table["detected"].iloc[0] == pytest.approx(0.9, abs=0.1)


def test_it_is_reproducible(found):
    settings = {"causes": ["step"], "sizes": [1.0], "noise": NOISE, "exclude": FEW}
    one, same, other = (
        hs.detectability(model_of(), T[:, None], **settings, n_replicates=40, random_state=seed)
        for seed in (3, 3, 4)
    )
    pd.testing.assert_frame_equal(one.table, same.table)
    assert not one.rates.equals(other.rates)


def test_text_picture_and_report(found, tmp_path):
    text = str(found)
    assert text.startswith("These 40 rows would detect")
    assert len(text.splitlines()) <= 30
    assert found.plot().get_xlabel().startswith("size")
    found.report().save(tmp_path / "plan.html")
    page = (tmp_path / "plan.html").read_text(encoding="utf-8")
    assert "Confusion" in page
    assert "<svg" not in page  # pictures are inline, as data
    assert set(found.report().to_dict()) >= {"table", "rates", "rows"}
    with pytest.raises(ValueError, match="of must be"):
        found.curves("seen")
    with pytest.raises(ValueError, match="one of"):
        found.confusion(3.0)


def test_sizes_that_a_cause_cannot_have_have_no_row():
    """A constant known to a hair's breadth moves no row far."""

    def constant(t, slope, level):
        return slope * t + level

    simulator = hs.Simulator(
        constant,
        inputs={"t": (0, 10)},
        parameters={"slope": norm(1, 0.5)},
        assumed={"level": hs.Assumed(0.0, uniform(-0.1, 0.2))},
    )
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate())
    few = hs.detectability(
        model,
        T[:, None],
        causes=["wrong-constant", "trend"],
        sizes=[0.2, 8.0],
        noise=NOISE,
        exclude=all_but("wrong-constant", "trend"),
        n_replicates=20,
        random_state=0,
    )
    assert few.table.loc[few.table["cause"] == "wrong-constant", "size"].tolist() == [0.2]
    assert few.table.loc[few.table["cause"] == "trend", "size"].tolist() == [0.2, 8.0]


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"sizes": [0.0, 1.0]}, "sizes must be positive"),
        ({"sizes": [-1.0]}, "sizes must be positive"),
        ({"sizes": []}, "sizes must be positive"),
        ({"causes": ["stepp"]}, "Did you mean"),
        ({"causes": ["interaction"]}, "needs two inputs"),
        ({"noise": -1.0}, "positive"),
        ({"noise": None}, "noise_prior"),
        ({"noise": [0.1, 0.2]}, "positive number"),
        ({"n_replicates": 0}, "n_replicates"),
        ({"exclude": ["stepp"]}, "exclude"),
    ],
)
def test_bad_arguments(settings, match):
    with pytest.raises(ValueError, match=match):
        hs.detectability(model_of(), T[:, None], **{"noise": NOISE, **settings})


@pytest.mark.parametrize("causes", ["step", [], [3], hs.Step("t")])
def test_causes_of_another_type(causes):
    with pytest.raises(TypeError, match="causes"):
        hs.detectability(model_of(), T[:, None], causes=causes, noise=NOISE)


def test_more_rows_than_memory_and_too_few():
    # a million million rows take no memory as a view
    many = np.lib.stride_tricks.as_strided(np.ones(1), shape=(10**7, 1), strides=(0, 8))
    with pytest.raises(ValueError, match="planned rows need about"):
        hs.detectability(model_of(), many, noise=NOISE)
    with pytest.raises(ValueError, match="at least"):
        hs.detectability(model_of(), T[:3, None], noise=NOISE)


def test_noise_from_the_prior_counts_and_several_outputs():
    by_prior = hs.detectability(
        model_of(noise_prior=halfnorm(scale=0.3)),
        T[:, None],
        causes=["step"],
        sizes=[4.0],
        exclude=FEW,
        n_replicates=20,
        random_state=0,
    )
    assert by_prior.table["detected"].iloc[0] == 1.0
    rate = hs.Simulator(
        lambda t, slope: 20.0 + slope * t, inputs={"t": (0, 10)}, parameters={"slope": norm(1, 0.3)}
    )
    counts = hs.PowerScaledSurrogate(rate, surrogate=hs.ExactSurrogate(), likelihood="poisson")
    settings = {
        "causes": ["step"],
        "sizes": [0.2, 4.0],
        "exclude": FEW,
        "n_replicates": 20,
        "random_state": 0,
    }
    seen = hs.detectability(counts, T[:, None], **settings).curves()["step"]
    assert seen[0.2] < 0.5 < seen[4.0]
    with pytest.raises(ValueError, match="no noise"):
        hs.detectability(counts, T[:, None], noise=1.0, **settings)
    both = hs.Simulator(
        two_lines,
        inputs={"t": (0, 10)},
        parameters={"slope": norm(1, 0.5)},
        output=("low", "high"),
    )
    two = hs.PowerScaledSurrogate(both, surrogate=hs.ExactSurrogate())
    seen = hs.detectability(two, T[:, None], noise=[0.1, 0.3], **settings).curves()["step"]
    assert seen[0.2] < 0.5 < seen[4.0]


def test_a_grid_is_fine_enough_for_what_shows_clearly():
    """Where an episode begins and ends is known to a row: it is no step, and no noise."""
    few = hs.detectability(
        model_of(),
        T[:, None],
        causes=["episode"],
        sizes=[8.0],
        noise=NOISE,
        exclude=all_but("episode", "bump", "noise", "step"),
        random_state=0,
    )
    assert few.table["right"].iloc[0] > 0.9


def uptake(s, half):
    return 10 * s / (half + s)


@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
@pytest.mark.parametrize("change", [-2.0, 2.0])
def test_the_evidence_for_a_large_drift_is_that_of_the_search(change):
    """Of 80 to 95 nats, though the drift leaves its tangent by several times the noise."""
    s, noise = np.linspace(0.1, 20, 40), 0.05
    few = all_but("parameter-drift", "trend", "gain")
    simulator = hs.Simulator(
        uptake, inputs={"s": (0.1, 20)}, parameters={"half": hs.truncated_normal(3, 1, 0.5, 8)}
    )
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    y = uptake(s, 4 + change * (s - 10) / 10)
    y = y + noise * np.random.default_rng(0).standard_normal(40)
    settings = {"exclude": few, "cv": None, "n_replicates": 19, "random_state": 0}
    search = hs.DiscrepancyDiagnosis(model, **settings).fit(s[:, None], y).search_
    random = np.random.RandomState(0)
    place, _ = place_at(model, s[:, None], uptake(s, 4.0), np.array([noise]), (), few, random)
    drift = next(c for c in place.causes if c.variant == "linear over s")
    none, found = refined_log_evidence(place, [drift], y[None])[0]
    (there,) = (w for w in search.candidates[1:] if w.cause.variant == drift.variant)
    # to first order: a tangent at no drift misses most of them
    expected = there.log_evidence - search.candidates[0].log_evidence
    assert found - none == pytest.approx(expected, abs=6)


# of a hundred sets some are taken for a trend, next to a slope
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hybridsurrogate.ConfoundingWarning")
@pytest.mark.parametrize("size", [0.5, 1.0])
def test_rates_are_those_of_the_whole_search(size):
    """Data of nonlinear truth, diagnosed one by one: detected and named as often as predicted."""
    # planned waves have their periods from the cause's prior, by default of up to twice the range
    periods = loguniform(10 / 8, 10)
    waves = hs.Periodic("t", period=periods)
    n, settings = 100, {"causes": [waves], "exclude": FEW, "cv": None, "n_replicates": 99}
    plan = hs.detectability(
        model_of(),
        T[:, None],
        causes=[waves],
        sizes=[size],
        noise=NOISE,
        exclude=FEW,
        n_replicates=1000,
        random_state=0,
    ).table.iloc[0]
    outcomes = []
    for seed in range(n):
        rng = np.random.default_rng(seed)
        wave = np.sin(2 * np.pi * (T / periods.rvs(random_state=rng) + rng.uniform()))
        left = wave - T * (T @ wave) / (T @ T)
        wave *= size * NOISE / np.sqrt(np.mean(left**2))
        y = rng.normal(1, 0.5) * T + wave + NOISE * rng.standard_normal(len(T))
        one = hs.DiscrepancyDiagnosis(model_of(), random_state=seed, **settings).fit(T[:, None], y)
        outcomes.append((one.best_cause_.kind != "none", one.best_cause_.kind == "periodic"))
    detected, right = np.mean(outcomes, axis=0)
    for rate, predicted in ((detected, plan["detected"]), (right, plan["right"])):
        error = np.sqrt(predicted * (1 - predicted) / n) + np.sqrt(1 / n) / 4
        assert abs(rate - predicted) < 0.05 + 2 * error
