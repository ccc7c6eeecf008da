"""Words that are typed wrongly, where texts go, and the exit code."""

import contextlib
import json
import os
from types import SimpleNamespace

import pandas as pd
import pytest

import hybridsurrogate as hs
from hybridsurrogate.command_line import diagnoses
from hybridsurrogate.command_line.commands import COMMANDS
from hybridsurrogate.command_line.main import main
from hybridsurrogate.command_line.output import kinds_as_text


def test_the_version(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--version"])
    assert capsys.readouterr().out == f"hybridsurrogate {hs.__version__}\n"


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_the_help_of_each_command_ends_with_an_example_that_it_takes(command, capsys, monkeypatch):
    with pytest.raises(SystemExit, match="0"):
        main([command.name, "--help"])
    *_, title, example = capsys.readouterr().out.strip().splitlines()
    assert title == "Example:"
    words = example.split()
    assert words[0] == "hybridsurrogate"
    seen = []
    monkeypatch.setitem(command.__dict__, "run", lambda given: seen.append(given) or 0)
    assert main(words[1:]) == 0
    assert len(seen) == 1


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["demo", "nyle"], "nile"),
        (["demoo"], "demo"),
        (["diagnose", "a.csv", "--simualtion", "b.csv"], "--simulation"),
        (["diagnose", "a.csv", "--likelihood", "student_t"], "student-t"),
        (["demo", "--lits"], "--list"),
        (["chose-beta", "a.csv"], "choose-beta"),
        (["fit", "a.csv", "--surrogate", "krigging"], "kriging"),
    ],
)
def test_a_misspelt_word_of_the_command_line(capsys, words, meant):
    with pytest.raises(SystemExit, match="2"):
        main(words)
    assert f"Did you mean '{meant}'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "missing"),
    [
        (["diagnose"], "measured is missing"),
        (["diagnose", "a.csv"], "--simulation is missing"),
        (["diagnose", "a.csv", "--simulation", "b.csv"], "--inputs is missing"),
        (["report"], "saved is missing"),
        (["predict", "fit.hs"], "new_inputs is missing"),
    ],
)
def test_what_a_command_lacks(capsys, words, missing):
    assert main(words) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert missing in error


def test_an_interrupt_is_one_line(monkeypatch, capsys):
    def interrupt():
        raise KeyboardInterrupt

    monkeypatch.setitem(diagnoses.DEMONSTRATIONS, "nile", (interrupt, ""))
    assert main(["demo"]) == 130
    assert capsys.readouterr().err == "hybridsurrogate: interrupted.\n"


class Found:
    """A diagnosis as the commands use it, which takes no time."""

    verdict_ = "named"
    causes = pd.DataFrame(
        {"kind": ["step", "none"], "target": ["year", None], "probability": [0.9, 0.1]}
    )
    result_ = SimpleNamespace(causes=causes)

    def __init__(self, *_, **settings):
        self.settings, self.calls = settings, []
        made.append(self)

    def fit(self, X, y, y_err=None):
        self.calls.append("fit")
        return self

    def cross_validate(self):
        self.calls.append("cross_validate")

    def report(self, **_):
        self.calls.append("report")
        section = SimpleNamespace(sentences=("The flow fell.",))

        def save(path):
            with open(path, "w", encoding="utf-8") as file:
                file.write("pictures")

        return SimpleNamespace(
            title="The simulation is wrong",
            sections=(section,),
            headline="The simulation is wrong",
            lead=section.sentences,
            save=save,
            to_dict=lambda: {"verdict": self.verdict_},
        )


made: list[Found] = []


@pytest.fixture
def quick(monkeypatch, tmp_path):
    made.clear()
    monkeypatch.setattr(diagnoses, "DiscrepancyDiagnosis", Found)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_verdict_is_printed_before_the_folds(quick, capsys, monkeypatch):
    printed = []
    monkeypatch.setattr(
        Found, "cross_validate", lambda _: printed.append(capsys.readouterr().out), raising=True
    )
    assert main(["demo"]) == 0
    (before,) = printed
    assert "The simulation is wrong\nThe flow fell." in before
    assert "step in year  90 %" in before
    assert "Now the gain on held-out rows" in before
    assert "With pictures: report.html" in capsys.readouterr().out
    assert made[0].settings["n_jobs"] == -1
    assert made[0].settings["cv"] is None


def test_folds_that_are_interrupted_leave_a_report(quick, capsys, monkeypatch):
    def interrupt(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Found, "cross_validate", interrupt)
    assert main(["demo"]) == 0
    assert (quick / "report.html").exists()


def test_whoever_reads_may_have_seen_enough(quick):
    """As with ``| head -1``: the reader is gone before the first word."""
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as gone, contextlib.redirect_stdout(gone):
        assert main(["demo"]) == 0
    assert (quick / "report.html").exists()


def test_no_folds_and_jobs(quick):
    assert main(["demo", "--no-folds", "--jobs", "1", "--max-causes", "2"]) == 0
    assert "cross_validate" not in made[0].calls
    assert (made[0].settings["n_jobs"], made[0].settings["max_causes"]) == (1, 2)


def test_check_turns_a_finding_into_an_exit_code(quick, monkeypatch):
    assert main(["demo"]) == 0
    assert main(["demo", "--check"]) == 1
    monkeypatch.setattr(Found, "verdict_", "adequate")
    assert main(["demo", "--check"]) == 0


def test_numbers_on_stdout_are_all_that_is_there(quick, capsys):
    assert main(["demo", "--json", "-"]) == 0
    told = capsys.readouterr()
    assert json.loads(told.out) == {"verdict": "named"}
    assert "step in year" in told.err


def test_quiet_prints_nothing_and_writes_all(quick, capsys):
    assert main(["demo", "--quiet", "--json", "numbers.json"]) == 0
    told = capsys.readouterr()
    assert (told.out, told.err) == ("", "")
    assert json.loads((quick / "numbers.json").read_text()) == {"verdict": "named"}
    assert (quick / "report.html").read_text() == "pictures"


def test_verbose_prints_the_seconds_of_each_stage(quick, capsys):
    assert main(["demo", "--verbose"]) == 0
    stages = [line.split(":")[0] for line in capsys.readouterr().err.splitlines()]
    assert stages == ["Search", "Folds", "Report"]


def test_units_are_of_columns_that_there_are(quick, capsys):
    assert main(["demo", "--units", "flow=km3/a", "--units", "mean_flow=km3/a"]) == 0
    assert main(["demo", "--units", "flwo=km3/a", "--report", "new.html"]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert "there is no 'flwo'; there are year, mean_flow, flow. Did you mean 'flow'?" in error
    assert not (quick / "new.html").exists()
    assert main(["demo", "--units", "flow"]) == 2
    assert "--units flow: write NAME=UNIT, such as flow=ppm" in capsys.readouterr().err


def test_a_report_into_a_folder_that_is_not_there(quick, capsys):
    assert main(["demo", "--report", "missing/report.html"]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert "does not exist. Make it first, or name another file." in error
    assert not made


def test_forms_of_a_kind_are_one_line_of_the_table():
    table = pd.DataFrame(
        {
            "kind": ["trend", "step", "step", "none"],
            "target": ["t", "t", "t", None],
            "probability": [0.4, 0.35, 0.2, 0.05],
        }
    )
    lines = kinds_as_text(table).splitlines()
    assert [line.split("  ")[0].strip() for line in lines] == [
        "cause",
        "step in t",
        "trend in t",
        "none",
    ]
