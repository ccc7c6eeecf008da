"""The scorecard's arithmetic on rows made by hand, and a slice of it."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from hidden_effects import mechanisms
from hidden_effects.cases import make_case
from hidden_effects.fits import fit_kind
from scorecard import beyond, likeness, page, plots, run, tables
from scorecard.__main__ import main
from scorecard.run import Result, Task

import hybridsurrogate as hs
from hybridsurrogate.effects.registry import kinds


def row(
    kind, found, *, size=2.0, rows=40, seed=0, runs=0, places=0, further=0, outside=False, **given
):
    """One row of results, as a run would write it."""
    told = {
        "simulation": "cooling",
        "noise_share": 0.02,
        "verdict": "adequate" if found == "none" else "named",
        "found": found,
        "leader": found,
        "leader_share": 0.8,
        "credible": found,
        "several": found,
        "ratio": 0.5,
    }
    task = Task(kind, size, rows, seed, runs, places, further, outside)
    return asdict(task) | asdict(Result(**(told | given)))


def table(*rows):
    return tables.judged(pd.DataFrame(list(rows)))


# ------------------------------------------------------------------------------------ arithmetic


def test_clopper_pearson():
    # with no hits the limits are powers; 5 of 10 as in Clopper and Pearson's chart
    assert tables.clopper_pearson(0, 10) == pytest.approx((0.0, 1 - 0.025**0.1))
    assert tables.clopper_pearson(5, 10) == pytest.approx((0.1871, 0.8129), abs=1e-4)
    assert tables.upper_limit(0, 59) == pytest.approx(1 - 0.05 ** (1 / 59))
    assert tables.upper_limit(10, 10) == 1.0
    assert tables.clopper_pearson(0, 0) == (0.0, 1.0)


def test_reliability_counts_in_bins():
    stated = [0.1, 0.3, 0.5, 0.5, 0.9, 1.0, np.nan]
    bins = tables.reliability(stated, [0, 1, 1, 0, 1, 1, 1], edges=(0.0, 0.5, 1.0))
    assert bins["cases"].tolist() == [4, 2]
    assert bins["stated"].tolist() == pytest.approx([0.35, 0.95])
    assert bins["right"].tolist() == [0.5, 1.0]
    assert tables.calibration_error(bins) == pytest.approx((4 * 0.15 + 2 * 0.05) / 6)
    # one case at p is off by 2 p (1 - p) on average; two at 1/2 by 0 or 1/2, as often
    one = pd.DataFrame({"cases": [1, 2], "stated": [0.9, 0.5], "right": [1.0, 0.5]})
    assert tables.chance_error(one) == pytest.approx((1 * 0.18 + 2 * 0.25) / 3)
    assert np.isnan(tables.calibration_error(tables.reliability([], [])))
    # 0 belongs to the first bin, an edge to the bin below it
    assert tables.reliability([0.0, 0.2], [1, 1])["cases"].tolist() == [2]


def test_rates():
    found = table(
        row("step", "step", credible="step|bump", several="step|trend"),
        row("step", "none", leader="step", credible="step"),
        row("trend: quadratic", "ramp", ratio=0.1),
        row("trend: quadratic", "trend", ratio=0.3),
        row("delay", "", verdict="", credible="", trouble="ValueError: no"),
        row("none", "none"),
        row("trend+step", "trend"),
    )
    rates = tables.rates(found, "kind")
    assert rates.index.tolist() == ["delay", "step", "trend: quadratic"]
    assert rates["cases"].tolist() == [1, 2, 2]
    assert rates["detected"].tolist() == [0, 0.5, 1]
    assert rates["exact"].tolist() == [0, 0.5, 0.5]
    assert rates["alike"].tolist() == [0, 0.5, 1]
    assert rates["covered"].tolist() == [0, 1, 0.5]
    assert rates.loc["step", "set_size"] == 1.5
    assert rates["further_cause"].tolist() == [0, 0.5, 0]
    assert rates.loc["trend: quadratic", "ratio"] == pytest.approx(0.2)
    # the leader counts for the calibration, found or not
    assert tables.name_calibration(found)["right"].tolist() == [pytest.approx(3 / 5)]
    assert tables.failures(found)["times"].tolist() == [1]
    assert tables.confusions(found).iloc[0].to_dict() == {
        "hidden": "delay",
        "taken for": "-",
        "times": 1,
        "of": 1,
    }


def test_near_copies_are_alike_only_among_themselves():
    found = table(row("decay", "saturation"), row("decay", "bump"), row("step", "ramp"))
    assert found["alike"].tolist() == [True, False, False]


def test_a_kind_that_draws_the_truth_is_not_told_apart():
    found = table(
        row("step", "step"),
        row("decay", "ramp", distance=40.0),
        row("gain", "offset", distance=0.9),
        row("gain", "offset", distance=1.1),
        row("noise: tails", "none", distance=np.inf),
        row("delay", "", verdict="", trouble="ValueError: no"),
    )
    assert found["same"].tolist() == [True, True, True, False, False, False]
    assert tables.rates(found, "word").loc["gain", ["exact", "alike", "same"]].tolist() == [
        0,
        0,
        0.5,
    ]


def test_scores_beyond_the_measured_range():
    told = {"elpd_plain": -3.0, "inside_plain": 0.1}
    far = {"elpd_named": -8.0, "inside_named": 0.2, "elpd_averaged": -2.0, "inside_averaged": 0.8}
    near = {"elpd_named": -1.0, "inside_named": 0.9, "elpd_averaged": -1.1, "inside_averaged": 0.9}
    found = beyond.beyond(
        table(
            row("step", "step", **told, **near),
            row("step", "bump", **told, **far),
            row("bump", "bump", **told, **near),
            row("noise: tails", "none"),
        )
    )
    assert found.loc[("all", 2.0), "cases"] == 3
    assert found.loc[("right", 2.0), "averaging gains"] == pytest.approx(-0.1)
    assert found.loc[("wrong", 2.0), ["elpd_named", "elpd_averaged"]].tolist() == [-8.0, -2.0]
    assert found.loc[("all", 2.0), "inside_named"] == pytest.approx(2 / 3)
    # two gains of -0.1 and one of 6: mean 5.8 / 3, standard deviation 6.1 / sqrt(3)
    assert found.loc[("all", 2.0), "averaging gains"] == pytest.approx(5.8 / 3)
    assert found.loc[("all", 2.0), "its error"] == pytest.approx(6.1 / 3)


def test_scores_beyond_the_measured_range_where_nothing_is_averaged():
    scores = {"elpd_plain": -3.0, "inside_plain": 0.1, "elpd_named": -1.0, "inside_named": 0.9}
    found = beyond.beyond(table(row("step", "step", **scores), row("bump", "step", **scores)))
    assert found.loc[("all", 2.0), ["cases", "elpd_named"]].tolist() == [2, -1.0]
    assert not any("averag" in column for column in found.columns)


def test_first_kinds_and_later_forms():
    kinds = ["step", "trend", "trend: quadratic", "parameter-drift: step"]
    kinds += ["noise", "noise: mean", "noise: tails", "noise: autocorrelation"]
    found = table(
        *[row(kind, "trend", size=size) for kind in kinds for size in (1.0, 2.0)],
        row("step", "step", rows=120),
        row("none", "none", size=0.0),
        row("trend+step", "trend"),
    )
    cases = tables.first_and_later(found)["cases"]
    assert cases["first kinds"].to_dict() == {(1.0, 40): 2, (2.0, 40): 2, (2.0, 120): 1}
    assert cases["later forms"].to_dict() == {(1.0, 40): 6, (2.0, 40): 6}
    assert cases["later forms without noise"].to_dict() == {(1.0, 40): 2, (2.0, 40): 2}
    assert cases["all"].sum() == 17
    # what is in the noise leaves no curve to be carried on
    ratio = tables.rates(found, "kind")["ratio"]
    assert ratio[ratio.isna()].index.tolist() == sorted(kinds[4:])


def test_false_alarms():
    found = table(*[row("none", "step" if s < 2 else "none", seed=s) for s in range(40)])
    alarms = tables.false_alarms(found).loc["all"]
    assert alarms["alarms"] == 2
    assert alarms["rate"] == 0.05
    assert alarms["upper"] == pytest.approx(tables.upper_limit(2, 40))


def test_interval_coverage():
    found = table(
        row("step", "step", estimates=json.dumps({"location": [1, 0, 2], "amplitude": [3, 0, 2]})),
        row("bump", "bump", estimates=json.dumps({"location": [1, 1, 2]})),
        row("bump", "none"),
    )
    coverage = tables.interval_coverage(found)
    assert coverage["cases"].to_dict() == {"amplitude": 1, "location": 2, "all": 3}
    assert coverage["coverage"].to_dict() == {"amplitude": 0, "location": 1, "all": 2 / 3}
    assert coverage.loc["location", "low"] == pytest.approx(0.025**0.5)
    assert np.isnan(coverage.loc["all", "low"])


def test_what_is_stated_beside_what_is_right():
    found = table(
        row("step", "step", leader_share=0.9),
        row("step", "none", leader="step", leader_share=0.4),
        row("step", "bump", leader_share=0.5, size=4.0),
        row("ramp", "ramp", leader_share=1.0),
        row("step", "step", rows=120),
    )
    told = tables.stated_and_right(found)
    assert told.loc[("first kinds", 2.0, 40)].to_dict() == pytest.approx(
        {"cases": 2, "stated": 0.65, "right": 1.0}
    )
    assert told.loc[("first kinds", 4.0, 40), "right"] == 0
    assert told.loc[("all", 2.0, 40), "cases"] == 3


def test_noise_is_held_against_the_best_test():
    found = table(
        row("noise", "noise", size=2.0),
        row("noise", "none", size=2.0),
        row("noise: tails", "none", size=0.01),
        row("noise", "noise", size=8.0, rows=120),
        row("step", "noise"),
    )
    limits = tables.noise_limits(found)
    assert limits["detected"].to_dict() == {("noise", 2.0, 40): 0.5, ("noise: tails", 0.01, 40): 0}
    assert 0.8 < limits.loc[("noise", 2.0, 40), "limit"] < 1
    # what is not there is "found" as often as the test raises a false alarm
    assert limits.loc[("noise: tails", 0.01, 40), "limit"] == pytest.approx(0.05, abs=0.015)
    assert tables.noise_limits(found[found["kind"] == "step"]).empty


def test_all_named():
    found = table(
        row("trend+step", "trend", several="trend|step"),
        row("trend+step", "step", several="step|trend"),
        row("trend+step", "trend", several="trend|bump"),
        row("trend+step", "none", several="none"),
    )
    named = tables.all_named(found, 2).loc["all"]
    assert (named["every"], named["but_one"], named["wrong"]) == (0.5, 0.25, 0.25)
    assert tables.single(found).empty
    assert tables.all_named(found, 3).empty
    three = table(
        row("trend+step+missing-input", "trend", rows=120, several="trend|missing-input|step"),
        row("trend+step+missing-input", "trend", rows=120, several="trend|missing-input"),
        row("trend+step+missing-input", "step", rows=120, several="step|bump"),
    )
    named = tables.all_named(three, 3).loc["trend+step+missing-input"]
    assert tuple(named[["cases", "every", "but_one", "wrong"]]) == (3, 1 / 3, 1 / 3, 1 / 3)
    assert tables.all_named(three, 2).empty


# --------------------------------------------------------------------------- an interrupted run


def test_truths_outside_the_catalogue_have_a_page_of_their_own(tmp_path, monkeypatch, capsys):
    asked = []

    def score(task):
        asked.append(task)
        verdict, share = ("named", 0.95) if task.seed % 2 else ("nearest", 0.99)
        told = {"verdict": verdict, "leader_share": share, "elpd_named": -2.0, "inside_named": 0.5}
        told["right"] = 0.92 if task.seed % 4 == 1 else 0.7
        return row(found="trend", **asdict(task), **told)

    monkeypatch.setattr(run, "score", score)
    path, page = tmp_path / "outside.csv", tmp_path / "outside.md"
    few = ["--kinds", "step", "--sizes", "2", "--seeds", "4", "--nulls", "0", "--pairs", "0"]
    main(["--outside", *few, "--out", str(path), "--page", str(page)])
    assert all(task.outside for task in asked)
    assert run.done(path) == set(asked)
    line = next(line for line in page.read_text().splitlines() if line.startswith("| all"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[1:6] == ["4", "50%", "25%", "76%", "50%"]
    assert "Whatever is named is wrong" in capsys.readouterr().out


def test_mechanisms_have_a_page_of_their_own(tmp_path, monkeypatch, capsys):
    asked = []

    def score(task):
        asked.append(task)
        return row(found="trend", **asdict(task), elpd_named=-2.0, inside_named=0.5, right=0.6)

    monkeypatch.setattr(run, "score", score)
    path, page = tmp_path / "foreign.csv", tmp_path / "foreign.md"
    few = ["--sizes", "2", "--seeds", "1", "--nulls", "0", "--pairs", "0"]
    main(["--mechanisms", *few, "--out", str(path), "--page", str(page)])
    assert [task.kind for task in asked] == list(mechanisms.FORMS)
    assert len(asked) >= 12
    assert "| dead time |" in page.read_text()
    assert "of no kind of the catalogue" in capsys.readouterr().out


@pytest.mark.parametrize("form", mechanisms.FORMS)
def test_a_mechanism_is_hidden_whole(form):
    case = make_case(form, 2.0, 0)
    left, noise = case.truth["left"], case.truth["noise_sd"]
    # its size is what the parameters leave of it, in noise
    assert np.sqrt(np.mean(left**2)) / noise == pytest.approx(2.0)
    assert np.isfinite(case.mu_out).all()
    # and no kind of the catalogue goes by its name
    assert case.truth["kind"] not in kinds()


@pytest.mark.slow
def test_a_case_outside_is_diagnosed_without_its_kind():
    found = run.score(Task("step", 4.0, 40, 0, outside=True))
    assert found["trouble"] == ""
    assert "step" not in found["several"].split("|")


def test_an_interrupted_run_is_carried_on(tmp_path, monkeypatch, capsys):
    path, scored = tmp_path / "card.csv", []

    def score(task):
        scored.append(task)
        return row(found="step", **asdict(task))

    monkeypatch.setattr(run, "score", score)
    todo = run.tasks(["step", "trend"], [1, 2], [40], range(2), range(1), {"trend+step": range(1)})
    assert len(todo) == 10
    assert {task.seed for task in todo[:6]} == {0}  # some of everything first
    results = run.run_into(path, todo)
    for _ in range(4):
        next(results)
    results.close()
    text = path.read_text()
    path.write_text(text[: text.rfind("{}") + 1])  # killed while it wrote the fourth
    assert len(list(run.run_into(path, todo))) == 7
    assert len(scored) == 4 + 7
    assert run.done(path) == set(todo)
    assert len(tables.read(path)) == 10
    assert list(run.run_into(path, todo)) == []

    main(["--from-csv", str(path), "--page", str(tmp_path / "scorecard.md")])
    assert "near copies counted" in capsys.readouterr().out
    text = (tmp_path / "scorecard.md").read_text()
    assert "It rests on 10 cases" in text
    assert "--kinds step trend --sizes 1 2 --rows 40 --seeds 2 --nulls 1 --pairs 1" in text
    for name in plots.PLOTS:
        assert (tmp_path / f"scorecard-{name}.png").exists()
        assert f"(scorecard-{name}.png)" in text


def test_the_page_tells_one_command_for_each_number_of_seeds():
    some = [row(kind, "step", seed=s) for kind in ("step", "noise: mean") for s in (7, 8)]
    found = table(
        *some,
        row("step", "step", size=8.0, seed=7),
        row("none", "none", size=0.0, rows=120, seed=7),
    )
    start = "python -m examples.studies.scorecard "
    three = table(
        row("trend+step+missing-input", "step", rows=120, seed=7), row("none", "none", seed=7)
    )
    assert "--nulls 1 --pairs 0 --triples 1 --first-seed 7" in page.commands(three)[0]
    alone = page.commands(three[three["n_hidden"] == 3])
    assert alone == [
        start + "--sizes --rows 40 --seeds 0 --nulls 0 --pairs 0 --triples 1 --first-seed 7"
    ]
    assert page.commands(found) == [
        start + "--kinds step 'noise: mean' --sizes 2 --rows 40 --seeds 2 --nulls 0 --pairs 0"
        " --first-seed 7",
        start + "--kinds step --sizes 8 --rows 40 --seeds 1 --nulls 0 --pairs 0 --first-seed 7",
        start + "--sizes --rows 120 --seeds 0 --nulls 1 --pairs 0 --first-seed 7",
    ]


def test_a_page_of_emulated_simulations_says_so(tmp_path):
    found = table(row("step", "step", runs=100, left_open=0.5), row("none", "none", runs=100))
    assert page.commands(found)[0].endswith("--pairs 0 --runs 100 --first-seed 0")
    page.write_page(found, tmp_path / "emulated.md", "card.csv", [])
    text = (tmp_path / "emulated.md").read_text()
    assert "it gets 100 runs each" in text
    assert "runs leave open" in text
    page.write_page(table(row("step", "step")), tmp_path / "card.md", "card.csv", [])
    text = (tmp_path / "card.md").read_text()
    assert "The simulations are run directly" in text
    assert "runs leave open" not in text
    assert "one of {trend, ramp" in text


def test_a_diagnosis_that_fails_is_a_row(monkeypatch):
    def fail(case, task):
        raise FloatingPointError("no\nnumbers")

    monkeypatch.setattr(run, "_diagnose", fail)
    found = run.score(Task("step", 2.0, 40, 0))
    assert found["trouble"] == "FloatingPointError: no numbers"
    assert found["simulation"]


# ------------------------------------------------------------------------------------- a slice

KINDS = ("gain", "trend", "step", "wrong-constant", "missing-input")


TASKS = {kind: Task(kind, 4.0, 40, 700) for kind in KINDS}


@pytest.fixture(scope="module")
def diagnosed():
    """Cases with their diagnoses, which compare little more than the kinds of the slice."""
    fit, few = hs.DiscrepancyDiagnosis.fit, all_but(*KINDS, "offset")

    def fit_of_few(self, X, y):
        return fit(self.set_params(exclude=few, n_replicates=39), X, y)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hs.DiscrepancyDiagnosis, "fit", fit_of_few)
        made = {kind: (run._make(task), task) for kind, task in TASKS.items()}
        return {kind: (case, run._diagnose(case, task)) for kind, (case, task) in made.items()}


@pytest.fixture(scope="module")
def slice_():
    return table(*map(run.score, TASKS.values()))


@pytest.mark.slow
def test_effects_of_four_times_the_noise_are_found(slice_):
    assert not tables.failures(slice_).size
    assert slice_["detected"].all()
    # 94 % expected: more than one of five wrong has probability 0.03
    assert slice_["exact"].sum() >= 4
    assert slice_["covered"].sum() >= 4
    assert slice_["seconds"].notna().all()


@pytest.mark.slow
def test_estimates_are_compared_with_the_truth(slice_):
    coverage = tables.interval_coverage(slice_)
    # six numbers at 90 % where all forms were found: below 60 % has probability 0.02
    assert coverage.loc["all", "cases"] >= 4
    assert coverage.loc["all", "coverage"] >= 0.6
    assert slice_["ratio"].median() < 0.25


def test_named_and_averaged_models_foresee_what_the_simulation_does_not(diagnosed, monkeypatch):
    monkeypatch.setattr(run, "_diagnose", lambda case, task: diagnosed[task.kind][1])
    found = beyond.beyond(table(*map(run.score, TASKS.values()))).loc[("all", 4.0)]
    assert found["elpd_named"] > found["elpd_plain"] + 0.5
    assert found["elpd_averaged"] > found["elpd_plain"] + 0.5
    assert 0.7 <= found["inside_averaged"] <= 1


def test_only_numbers_of_the_hidden_form_are_compared(diagnosed):
    case, _ = diagnosed["trend"]
    line = {"slope": (0.0, -1.0, 1.0), "level": (0.0, -1.0, 1.0)}
    assert run._estimates(case, line) == {"slope": (case.truth["slope"], -1.0, 1.0)}
    # a parabola has a slope, too, but at one place only
    assert run._estimates(case, line | {"curvature": (0.0, -1.0, 1.0)}) == {}


@pytest.mark.parametrize("name", ["trend+missing-input", "trend+step+missing-input"])
def test_a_diagnosis_is_not_told_how_many_effects_are_hidden(monkeypatch, name):
    monkeypatch.setattr(run.hs.DiscrepancyDiagnosis, "fit", lambda self, X, y: self)
    (task,) = run.tasks((), (), (), range(0), range(0), {name: range(1)})
    assert task == Task(name, 2.0, 40 * len(name.split("+")), 0)
    assert run._diagnose(run._make(task), task).max_causes is None


# -------------------------------------------------------------------------------------- likeness


def taken_for(kind, diagnosis):
    other = run.hs.DiscrepancyDiagnosis()
    other.search_ = diagnosis.search_
    other.best_cause_ = replace(diagnosis.best_cause_, kind=kind)
    return other


@pytest.mark.parametrize(
    ("hidden", "found"),
    [("gain", "offset"), ("wrong-constant", "offset"), ("trend", "gain"), ("step", "gain")],
)
def test_distance_is_what_a_fit_by_hand_leaves(diagnosed, hidden, found):
    case, diagnosis = diagnosed[hidden]
    by_hand = fit_kind(case.simulator, case.X, case.truth["mu"], found, np.random.default_rng(0))[0]
    expected = by_hand.rss / case.truth["noise_sd"] ** 2
    # priors pull on the parameters, by no more than the few of them against 40 rows
    assert likeness.distance(case, taken_for(found, diagnosis)) == pytest.approx(expected, rel=0.1)


def test_distance_of_a_kind_that_holds_the_truth(diagnosed):
    case, diagnosis = diagnosed["gain"]
    # slow growth is 5 + rate log t + slope t: another rate and a straight line make up a factor
    assert case.simulator.name == "slow_growth"
    assert likeness.distance(case, taken_for("trend", diagnosis)) < 0.01


def test_distance_where_there_is_no_curve(diagnosed):
    case, diagnosis = diagnosed["step"]
    for kind in ("none", "noise", "unexplained"):
        assert likeness.distance(case, taken_for(kind, diagnosis)) == np.inf
    assert np.isnan(likeness.distance(case, taken_for("step", diagnosis)))
    strange = replace(case, truth=case.truth | {"kind": "noise"})
    assert likeness.distance(strange, taken_for("step", diagnosis)) == np.inf
    nothing = replace(case, truth=case.truth | {"kind": "none"})
    assert np.isnan(likeness.distance(nothing, taken_for("step", diagnosis)))
