"""The command line, as a newcomer types it."""

import io
import json
import os
import re
import subprocess
import sys
from argparse import Namespace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.command_line import diagnoses, study
from hybridsurrogate.command_line.main import main
from hybridsurrogate.command_line.study import largest_degree, surrogate_for
from hybridsurrogate.diagnosis.report.report import Report
from hybridsurrogate.effects.registry import kinds


@pytest.fixture
def files(tmp_path):
    rng = np.random.default_rng(0)
    runs = pd.DataFrame({"t": rng.uniform(0, 10, 80), "speed": rng.uniform(1, 3, 80)})
    runs["distance"] = runs["t"] * runs["speed"]
    runs.to_csv(tmp_path / "runs.csv", index=False)
    t = np.linspace(0, 9, 30)
    measured = pd.DataFrame({"t": t, "wind": rng.standard_normal(30)})
    measured["distance"] = 2 * t + 1.5 * measured["wind"] + 0.2 * rng.standard_normal(30)
    measured.to_csv(tmp_path / "measured.csv", index=False)
    return tmp_path


def arguments(folder, *more):
    return [
        "diagnose",
        str(folder / "measured.csv"),
        "--simulation",
        str(folder / "runs.csv"),
        *("--inputs", "t", "--parameters", "speed", "--output", "distance", "--degree", "2"),
        *("--report", str(folder / "report.html"), "--jobs", "1"),
        *more,
    ]


@pytest.mark.parametrize(
    ("n_runs", "n_parameters", "degree"), [(8, 0, 3), (12, 0, 5), (69, 3, 2), (70, 3, 3), (5, 4, 1)]
)
def test_the_degree_leaves_two_runs_for_each_term(n_runs, n_parameters, degree):
    # 35 terms of degree three in four dimensions
    names = [f"p{k}" for k in range(n_parameters)]
    rng = np.random.default_rng(0)
    runs = hs.SimulationData(
        rng.uniform(size=(n_runs, 1)),
        rng.uniform(size=(n_runs, n_parameters)),
        rng.uniform(size=n_runs),
        inputs=["t"],
        parameters={name: stats.uniform(0, 1) for name in names},
    )
    assert largest_degree(runs) == degree
    free = Namespace(surrogate=None, degree=None)
    assert surrogate_for(free, runs, 201).degree == degree
    assert isinstance(surrogate_for(free, runs, 200), hs.Kriging)
    for word, kind in (("kriging", hs.Kriging), ("gaussian-process", hs.GaussianProcess)):
        assert isinstance(surrogate_for(Namespace(surrogate=word, degree=None), runs, 201), kind)
    chosen = Namespace(surrogate="polynomial-chaos", degree=None)
    assert surrogate_for(chosen, runs, 40).degree == degree
    if n_runs > 5:  # of which degree 1 has six terms
        named = Namespace(surrogate=None, degree=1)
        assert [surrogate_for(named, runs, n).degree for n in (40, 201)] == [1, 1]


@pytest.mark.slow
def test_files_of_ones_own(files, capsys):
    numbers = files / "numbers.json"
    more = ("--prior", "speed=2,0.5", "--exclude", "delay", "noise", "--json", str(numbers))
    assert main(arguments(files, *more)) == 0
    assert json.loads(numbers.read_text(encoding="utf-8"))["best_cause"]["target"] == "wind"
    assert "depends on wind" in " ".join(capsys.readouterr().out.split())
    # a row of the table in the folded part
    report = (files / "report.html").read_text(encoding="utf-8")
    for kind in ("delay", "noise"):
        assert f"<td>{kind}</td><td>you excluded it</td>" in report


ALL_BUT_TREND = sorted({*kinds()} - {"trend", "offset"})


def as_text(folder):
    """Return options of a report without pictures."""
    return "--report", str(folder / "report.txt")


def test_measurements_that_came_in_later_are_watched(files, capsys):
    """One file of a line that goes on, and one of a line that jumps by six noise sd."""
    rng = np.random.default_rng(1)
    later = pd.DataFrame({"t": np.linspace(9, 10, 15)})
    later["distance"] = 2 * later["t"] + 0.2 * rng.standard_normal(15)
    later.to_csv(files / "later.csv", index=False)
    later.assign(distance=later["distance"] + 1.2).to_csv(files / "jumped.csv", index=False)
    measured = pd.read_csv(files / "measured.csv")
    measured["distance"] -= 1.5 * measured["wind"]
    measured.drop(columns="wind").to_csv(files / "measured.csv", index=False)
    for name, told in (("later.csv", "holds over 15"), ("jumped.csv", "no longer holds")):
        more = ("--exclude", *ALL_BUT_TREND, "--new", str(files / name), *as_text(files))
        assert main(arguments(files, *more)) == 0
        out = " ".join(capsys.readouterr().out.split())
        assert f"The extension {told}" in out


def test_a_file_of_later_measurements_needs_the_same_columns(files, capsys):
    pd.DataFrame({"t": [9.5], "distance": [19.0]}).to_csv(files / "later.csv", index=False)
    assert main(arguments(files, "--new", str(files / "later.csv"))) == 2
    error = capsys.readouterr().err
    assert "later.csv has no columns ['wind']; its columns are ['t', 'distance']" in error


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("--prior", "speed=fast"), "write NAME=MEAN,SD"),
        (("--prior", "speed=50,0.1"), "Only 0.0% of the prior of 'speed' lies in"),
        (("--prior", "mass=1,2"), "'mass' is not one of --parameters"),
        (("--inputs", "depth"), "has no columns ['depth']"),
        (("--parameters", "mass"), "has no columns ['mass']"),
        (("--parameters", "sped"), "Did you mean 'speed'?"),
        (("--inputs", "T"), "Did you mean 't'?"),
        (("--output", "distnace"), "Did you mean 'distance'?"),
        (("--prior", "sped=1,2"), "Did you mean 'speed'?"),
        (("--exclude", "delya"), "Did you mean 'delay'?"),
        (("--simulation", "nowhere.csv"), "nowhere.csv"),
        (("--max-causes", "0"), "max_causes == 0, must be >= 1"),
        (("--exclude", "weather"), "the kinds are build-up, bump, "),
    ],
)
def test_a_mistake_ends_with_one_clear_line(files, capsys, change, message):
    assert main(arguments(files, *change)) == 2
    # warnings may come before it
    *before, error = capsys.readouterr().err.splitlines()
    assert message in error
    assert all(line.startswith("Warning: ") for line in before)


@pytest.mark.parametrize(("separator", "word"), [(";", "semicolons"), ("\t", "tabs")])
def test_a_table_with_other_separators_is_told_with_what_to_do(files, capsys, separator, word):
    table = pd.read_csv(files / "measured.csv")
    table.to_csv(files / "measured.csv", sep=separator, decimal=",", index=False)
    assert main(arguments(files)) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert f"the columns are separated by {word}" in error
    # what it says to do is right
    path = files / "measured.csv"
    pd.read_csv(path, sep=separator, decimal=",").to_csv(path, index=False)
    pd.testing.assert_frame_equal(pd.read_csv(path), table)


def test_a_semicolon_in_a_name_is_no_separator(files):
    table = pd.read_csv(files / "runs.csv").rename(columns={"speed": "speed; m/s"})
    table.to_csv(files / "runs.csv", index=False)
    names = {"inputs": ["t"], "parameters": {"speed; m/s": stats.uniform(1, 2)}}
    runs = hs.read_simulation(files / "runs.csv", **names, output="distance")
    assert runs.n_runs == 80


def test_spaces_after_commas_belong_to_no_name(files, capsys):
    for name in ("runs.csv", "measured.csv"):
        text = (files / name).read_text()
        (files / name).write_text(text.replace(",", ", "))
    # the columns are found: what is wrong is the number that is checked after them
    assert main(arguments(files, "--max-causes", "0")) == 2
    assert "max_causes == 0" in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_as_a_module():
    run = subprocess.run(
        [sys.executable, "-m", "hybridsurrogate", "demo", "--list"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "nile" in run.stdout


def test_a_report_that_cannot_be_written_is_told_at_once(files, capsys):
    assert main([*arguments(files), "--report", str(files / "report.pdf")]) == 2
    told = capsys.readouterr()
    assert "to a file .html, .txt or .json" in told.err
    assert "Verdict" not in told.out


@pytest.mark.parametrize("option", ["--report", "--json"])
def test_a_folder_that_is_not_there_is_told_before_anything_is_computed(
    files, capsys, monkeypatch, option
):
    monkeypatch.setattr(hs.DiscrepancyDiagnosis, "fit", None)
    monkeypatch.setattr(study, "read_table", None)
    missing = str(files / "missing" / "r.html")
    for command in (["demo", "nile"], arguments(files)):
        assert main([*command, option, missing]) == 2
        told = capsys.readouterr()
        assert "the folder" in told.err
        assert "does not exist" in told.err
        assert not told.out
    assert main(["demo", "nile", option, str(files)]) == 2
    assert "a folder: name a file in it" in capsys.readouterr().err


@pytest.mark.slow
def test_a_report_that_fails_to_be_written_leaves_the_text(files, capsys, monkeypatch):
    def full(*_):
        raise OSError("No space left on device")

    monkeypatch.setattr(Report, "save", full)
    numbers = files / "numbers.json"
    assert main([*arguments(files), "--json", str(numbers)]) == 2
    told = capsys.readouterr()
    assert "missing-input in wind" in told.out
    assert f"Numbers: {numbers}" in told.out
    assert "With pictures" not in told.out
    assert "report.html was not written: No space left on device" in told.err
    assert json.loads(numbers.read_text())["verdict"]


class Terminal(io.StringIO):
    """A stderr that is a terminal."""

    def isatty(self):
        return True


@pytest.mark.slow
def test_a_terminal_is_told_what_is_being_done(files, capsys, monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert main(arguments(files)) == 0
    told = terminal.getvalue()
    assert "Search" in told
    assert re.search(r"Folds \d+ of 8", told)
    assert told.index("Search") < told.index("Folds") < told.index("Report")
    # else there is nothing but warnings
    assert "Folds" not in capsys.readouterr().out
    monkeypatch.undo()
    assert main(arguments(files)) == 0
    assert "Folds" not in capsys.readouterr().err


def test_gaps_are_left_out_with_a_word(files, capsys):
    measured = pd.read_csv(files / "measured.csv").drop(columns="wind")
    measured["distance"] = 2 * measured["t"] + 0.2 * np.random.default_rng(1).standard_normal(30)
    measured.loc[[4, 7], "distance"] = np.nan
    measured.loc[7, "t"] = np.nan  # nothing in this line
    measured.to_csv(files / "measured.csv", index=False)
    more = ("--exclude", *ALL_BUT_TREND, "--json", str(files / "numbers.json"), *as_text(files))
    assert main(arguments(files, *more)) == 0
    told = capsys.readouterr()
    assert "2 of 30 rows have no measurement" in told.err
    assert "the first is row 5" in told.err
    assert json.loads((files / "numbers.json").read_text(encoding="utf-8"))["n_rows"] == 28


def test_without_priors_the_command_line_says_what_it_takes(files, capsys):
    assert main(arguments(files, "--max-causes", "0")) == 2
    assert "Warning: No prior was given for 'speed': it is taken" in capsys.readouterr().err
    assert main(arguments(files, "--max-causes", "0", "--prior", "speed=2,0.5")) == 2
    assert "No prior was given" not in capsys.readouterr().err


def dated(folder, form="%Y-%m-%d"):
    """Days in place of numbers: of the runs the first is 2026-03-01, of the rows 2026-03-02."""
    day = pd.Timedelta("1D")
    for name, first in (("runs.csv", "2026-03-01"), ("measured.csv", "2026-03-02")):
        table = pd.read_csv(folder / name)
        days = (table["t"] * 10).round() * day
        table["t"] = (pd.Timestamp(first) + days - days.min()).dt.strftime(form)
        table.to_csv(folder / name, index=False)


@pytest.mark.parametrize("form", ["%Y-%m-%d", "%Y-%m-%dT%H:%M:%S", "%Y-%m-%d %H:%M:%S+00:00"])
def test_dates_are_counted_in_days_from_the_first_run(files, capsys, monkeypatch, form):
    dated(files, form)
    seen = {}

    def stop(model, study, *_):
        seen.update(simulation=model.simulation, X=study.X)
        raise ValueError("enough")

    monkeypatch.setattr(diagnoses, "_diagnosed", stop)
    assert main(arguments(files)) == 2
    told = capsys.readouterr()
    assert "enough" in told.err
    assert "t counts days from 2026-03-01" in told.out
    runs = pd.read_csv(files / "runs.csv")["t"]
    days = (pd.to_datetime(runs) - pd.to_datetime(runs).min()).dt.days
    np.testing.assert_allclose(np.sort(seen["simulation"].X[:, 0]), np.sort(days))
    # one day after the first run
    assert seen["X"]["t"].min() == pytest.approx(1.0)
    assert seen["X"]["t"].tolist() == pytest.approx(list(1 + np.linspace(0, 90, 30).round()))


@pytest.mark.parametrize("which", ["runs.csv", "measured.csv"])
def test_dates_in_one_of_the_files_alone(files, capsys, which):
    text = (files / which).read_text()
    dated(files)
    (files / which).write_text(text)
    assert main(arguments(files)) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert "'t' holds dates in" in error
    assert f"{which}" in error
    assert "Write dates in both files, or numbers in both" in error


def test_dates_in_another_form(files, capsys):
    dated(files, "%d.%m.%Y")
    assert main(arguments(files)) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert "Write dates as 2026-11-27" in error


def test_a_wide_table_of_runs(files, capsys, monkeypatch):
    speed, t = np.linspace(1, 3, 20), np.linspace(0, 10, 11)
    wide = pd.DataFrame(np.outer(speed, t), columns=t)
    wide.insert(0, "speed", speed)
    wide.insert(0, "run", np.arange(20))
    wide.to_csv(files / "runs.csv", index=False)
    seen = []

    def stop(model, *_):
        seen.append(model.simulation)
        raise ValueError("enough")

    monkeypatch.setattr(diagnoses, "_diagnosed", stop)
    assert main(arguments(files)) == 2
    said = capsys.readouterr().err
    assert "enough" in said
    assert "differ between runs" not in said
    (data,) = seen
    assert (data.n_runs, data.n_rows) == (20, 220)
    np.testing.assert_allclose(data.y, data.X[:, 0] * data.omega[:, 0])


def test_a_degree_beyond_the_runs_is_refused_at_once(files, capsys):
    assert main([*arguments(files), "--degree", "100"]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    # 78 terms of degree 11 in two dimensions, 91 of degree 12; 80 runs
    assert "--degree 100 has 5151 terms, more than the 80 rows of the runs" in error
    assert "at most --degree 11" in error


@pytest.mark.slow
def test_names_are_labels_and_other_text_is_left_out_with_a_word(files, capsys):
    measured = pd.read_csv(files / "measured.csv").drop(columns="wind")
    rng = np.random.default_rng(1)
    measured["operator"] = rng.choice(["ann", "bo"], len(measured))
    measured["note"] = [f"row {k + 1}" for k in range(len(measured))]
    measured["distance"] = 2 * measured["t"] + 1.5 * (measured["operator"] == "bo")
    measured["distance"] += 0.2 * rng.standard_normal(len(measured))
    measured.to_csv(files / "measured.csv", index=False)
    assert main(arguments(files, "--json", str(files / "report.json"))) == 0
    told = capsys.readouterr()
    assert "The column 'note' is left out" in told.err
    verdict = json.loads((files / "report.json").read_text())
    assert "missing-input in operator" in told.out
    assert verdict["verdict"] in ("named", "ambiguous")


@pytest.mark.parametrize("column", ["distance", "t", "wind"])
def test_a_cell_that_is_no_number_is_found(files, capsys, column):
    measured = pd.read_csv(files / "measured.csv")
    measured[column] = measured[column].astype(object)
    measured.loc[4, column] = None if column == "wind" else "n.d."
    measured.to_csv(files / "measured.csv", index=False)
    assert main(arguments(files)) == 2
    error = capsys.readouterr().err
    assert f"1 of 30 values of '{column}' are no numbers, the first" in error
    assert "in row 5 of the data" in error


@pytest.mark.slow
def test_an_empty_column_and_a_failed_run_are_left_out(files, capsys):
    for name in ("measured.csv", "runs.csv"):
        lines = (files / name).read_text().splitlines()
        (files / name).write_text("\n".join(line + "," for line in lines))
    runs = pd.read_csv(files / "runs.csv")
    runs.loc[3, "distance"] = np.inf
    runs["load"] = np.arange(80)
    runs.to_csv(files / "runs.csv", index=False)
    assert main(arguments(files)) == 0
    told = capsys.readouterr().err
    assert "1 of 80 runs" in told
    assert "The columns ['load'] differ between runs and are not among" in told


def test_files_are_written_where_the_text_is_cut_off(files):
    command = [sys.executable, "-m", "hybridsurrogate"]
    more = ("--exclude", *ALL_BUT_TREND, "--json", str(files / "report.json"))
    command += arguments(files, *more)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    # written line by line, or a short text would go out at the end and all at once
    with subprocess.Popen(command, env=os.environ | {"PYTHONUNBUFFERED": "1"}, **pipes) as run:
        run.stdout.close()
        assert "Broken pipe" not in run.stderr.read()
    assert run.returncode == 0
    assert json.loads((files / "report.json").read_text())["verdict"]
    assert (files / "report.html").exists()


@pytest.mark.slow
def test_a_warning_is_printed_once(files, capsys):
    measured = pd.read_csv(files / "measured.csv")
    measured["note"] = [f"row {k + 1}" for k in range(len(measured))]
    measured.loc[0, "t"] = -1.0  # outside the runs: every fit and prediction warns of it
    measured.to_csv(files / "measured.csv", index=False)
    assert main(arguments(files)) == 0
    told = capsys.readouterr().err.splitlines()
    assert len(told) == len(set(told))
    assert sum("outside the simulated range" in line for line in told) == 1
    assert sum("'note' is left out" in line for line in told) == 1
    # another run of the same process tells it anew
    assert main(arguments(files)) == 0
    assert capsys.readouterr().err.splitlines() == told


def test_a_degree_without_end(files, capsys):
    assert main([*arguments(files), "--degree", "1000000000"]) == 2
    assert "--degree 1000000000 has 5e+17 terms" in capsys.readouterr().err
