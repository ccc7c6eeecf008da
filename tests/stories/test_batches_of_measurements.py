"""Measurements of several batches, and a parameter that is not the same in all of them."""

import numpy as np
import pandas as pd
import pytest
from batches import DECAY, batches
from experiments import main
from few_kinds import all_but
from shared_files import shared_path

import hybridsurrogate as hs
from hybridsurrogate.command_line.main import main as command_line
from hybridsurrogate.diagnosis.answers.finding import form_of
from hybridsurrogate.diagnosis.search.setup import prepare


def diagnosed(X, y, simulation=DECAY, cv=None, exclude=(), **options):
    model = hs.PowerScaledSurrogate(
        simulation, **{"surrogate": hs.ExactSurrogate(), "random_state": 0} | options
    )
    settings = {"exclude": exclude, "cv": cv, "n_replicates": 50, "random_state": 0}
    return hs.DiscrepancyDiagnosis(model, **settings).fit(X, y)


def numbered(X):
    """Batches as somebody numbers them who has heard nothing of ``experiment``."""
    return X.assign(batch=X.batch.str[1:].astype(int) + 1)


@pytest.mark.slow
def test_a_rate_that_differs_is_named_without_being_told():
    X, y, rates = batches(0, n=8)
    diagnosis = diagnosed(numbered(X), y, cv=3)
    assert diagnosis.verdict_ == "named"
    best = diagnosis.best_cause_
    assert (best.kind, best.target) == ("parameter-by-experiment", "rate")
    low, high = np.quantile(
        diagnosis.extended_estimator_.posterior_.estimates(0)["spread"], [0.01, 0.99]
    )
    assert low < rates.std(ddof=1) < high
    assert diagnosis.gain_.elpd_after > diagnosis.gain_.elpd_before + 0.3
    text = str(diagnosis.report(full=True))
    assert "rate differs between experiments" in text


def test_nothing_is_wrong_once_it_is_declared():
    X, y, _ = batches(1, n=6)
    told = {"experiment": "batch", "by_experiment": {"rate": "spread"}}
    few = all_but("parameter-by-experiment", "missing-input", "step", "trend", "noise")
    diagnosis = diagnosed(X, y, cv=2, exclude=few, n_draws=300, **told)
    assert diagnosis.verdict_ == "adequate"
    kinds = set(zip(diagnosis.causes_.kind, diagnosis.causes_.target, strict=True))
    assert ("parameter-by-experiment", "level") in kinds
    assert ("parameter-by-experiment", "rate") not in kinds
    assert "rate" in str(diagnosis.report(full=True))
    assert diagnosis.predict(X.head(2).assign(batch="another")).shape == (2,)
    # batches go by their names, in what to measure next and in what is measured since
    assert set(diagnosis.next_measurements(2)["batch"]) <= set(X["batch"])
    since = diagnosis.update(X.iloc[::9], y[::9])
    assert since.holds
    assert since.table["batch"].tolist() == X["batch"].iloc[::9].tolist()


def test_what_sets_a_parameter_that_is_known_to_differ_is_named():
    """The spread of the batches must not hold already what their temperature explains."""
    rng = np.random.default_rng(7)
    celsius, x = rng.uniform(15, 35, 10), rng.uniform(0, 4, (10, 8))
    rates = 0.5 + 0.02 * (celsius - 25) + 0.04 * rng.standard_normal(10)
    y = 3 * np.exp(-rates[:, None] * x) + 0.05 * rng.standard_normal(x.shape)
    rows = {"x": x.ravel(), "celsius": np.repeat(celsius, 8), "batch": np.repeat(range(10), 8)}
    told = {"experiment": "batch", "by_experiment": {"rate": "spread"}}
    few = all_but("parameter-drift", "missing-input", "trend")
    diagnosis = diagnosed(pd.DataFrame(rows), y.ravel(), exclude=few, **told)
    best = diagnosis.best_cause_
    assert diagnosis.verdict_ == "named"
    assert (best.kind, best.target) == ("parameter-drift", "rate")
    assert best.estimates["slope"][1] < 0.02 < best.estimates["slope"][2]


@pytest.mark.slow
def test_a_second_cause_is_found_beside_a_rate_that_differs():
    right = 0
    for seed in range(700, 706):
        X, y, _ = batches(seed, n=8)
        model = hs.PowerScaledSurrogate(DECAY, surrogate=hs.ExactSurrogate(), random_state=0)
        found = hs.DiscrepancyDiagnosis(
            model, cv=None, max_causes=2, n_replicates=50, random_state=0
        ).fit(numbered(X), y + 0.2 * (X.x > 2))
        kinds = [cause.kind for cause in found.found_causes_]
        right += sorted(kinds) == ["parameter-by-experiment", "step"]
    # where the search ended with the rate none was
    assert right >= 4


@pytest.mark.slow
def test_what_else_is_wrong_is_found_beside_it():
    X, y, _ = batches(2, n=6)
    y = y + 0.2 * (X.x > 2)
    told = {"experiment": "batch", "by_experiment": {"rate": "spread"}}
    diagnosis = diagnosed(X, y, **told)
    assert diagnosis.best_cause_.kind == "step"
    assert diagnosis.extended_estimator_.by_experiment == {"rate": "spread"}


@pytest.mark.slow
@pytest.mark.parametrize("what", ["output", "noise"])
def test_one_batch_is_off(what):
    X, y, _ = batches(3, spread=0.0, n=8)
    bad = (X.batch == "b2").to_numpy()
    rng = np.random.default_rng(1)
    y = y + (0.15 if what == "output" else 0.2 * rng.standard_normal(len(y))) * bad
    diagnosis = diagnosed(X, y, experiment="batch")
    first = diagnosis.causes_.iloc[0]
    assert first.kind == {"output": "missing-input", "noise": "noise"}[what]
    assert "level 2" in first.form


def test_labels_are_no_axis():
    X, y, _ = batches(4, spread=0.0, n=6)

    def over(column, X):
        """Return the forms over a column that a search compares."""
        model = hs.PowerScaledSurrogate(DECAY, surrogate=hs.ExactSurrogate(), random_state=0)
        compared = prepare(model.fit(X, y), ()).causes
        return {form_of(cause) for cause in compared if cause.target == column}

    assert all("level" in form or "categorical" in form for form in over("batch", numbered(X)))
    # a quantity that happens to be whole is one, if it does not count experiments
    dose = np.tile([0.0, 5.0, 10.0], len(y) // 3)
    assert "missing-input" in over("dose", X[["x"]].assign(dose=dose))


@pytest.mark.slow
def test_numbers_of_subjects_may_have_gaps():
    """308, 310, 333 ... are labels where they are declared, and a quantity elsewhere."""
    X, y, _ = batches(5, n=8)
    subjects = np.random.default_rng(5).choice(np.arange(300, 380), X.batch.nunique(), False)
    X = X.assign(batch=subjects[X.batch.str[1:].astype(int)])
    diagnosis = diagnosed(X, y, experiment="batch")
    assert (diagnosis.best_cause_.kind, diagnosis.best_cause_.target) == (
        "parameter-by-experiment",
        "rate",
    )


@pytest.mark.slow
def test_the_study_keeps_its_rows(tmp_path, capsys):
    few = ["--cases", "1", "--nulls", "0", "--intervals", "1", "--rows", str(tmp_path / "r.csv")]
    main(few)
    first = capsys.readouterr().out
    main(few)
    assert capsys.readouterr().out == first
    assert "| size 2 | 1 | 100 % | 0 % | 100 % |" in first


@pytest.mark.slow
def test_the_command_line_knows_experiments(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    X, y, _ = batches(0, n=5)
    X.assign(y=y).to_csv("measured.csv", index=False)
    runs = DECAY.run(40, random_state=0, along=20)
    frame = runs.to_frame()
    frame.to_csv("runs.csv", index=False)
    settings = ["--simulation", "runs.csv", "--inputs", "x", "--parameters", "rate", "level"]
    settings += ["--prior", "rate=0.5,0.3", "--prior", "level=3,1", "--output", "y"]
    settings += ["--experiment", "batch", "--jobs", "1"]
    assert command_line(["diagnose", "measured.csv", *settings, "--by-experiment", "rate"]) == 2
    assert "write NAME=HOW" in capsys.readouterr().err
    assert command_line(["diagnose", "measured.csv", *settings]) == 0
    assert "parameter-by-experiment in rate" in capsys.readouterr().out


def enzyme():
    """Treloar's rates of an enzyme with and without puromycin, and the law for one batch."""
    frame = pd.read_csv(shared_path("data", "puromycin_enzyme.csv"), comment="#")
    simulator = hs.Simulator(
        lambda concentration, fastest, half: fastest * concentration / (half + concentration),
        inputs={"concentration": (0.01, 1.2)},
        parameters={
            "fastest": hs.truncated_normal(180, 50, 50, 350),
            "half": hs.truncated_normal(0.06, 0.04, 0.005, 0.3),
        },
    )
    X = frame[["conc_ppm", "state"]].rename(columns={"conc_ppm": "concentration"})
    return X, frame["rate"].to_numpy(dtype=float), simulator


def test_two_batches_of_an_enzyme_differ_in_the_documented_parameter():
    X, y, simulator = enzyme()
    best = diagnosed(X, y, simulator, experiment="state").best_cause_
    assert (best.kind, best.target) == ("parameter-by-experiment", "fastest")
    # Bates and Watts (1988), as INDEX.md of the data quotes them: 166.6, and 42.0 more when treated
    told = {"experiment": "state", "by_experiment": {"fastest": "own"}}
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), random_state=0, **told
    ).fit(X, y)
    draws = model.posterior_.estimates(0)
    for state, documented in (("untreated", 166.6), ("treated", 208.6)):
        low, high = np.quantile(draws[f"state = {state}"], [0.05, 0.95])
        assert low < documented < high
