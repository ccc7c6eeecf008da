"""A study in one TOML file, and what is wrong in it."""

import pytest

from hybridsurrogate.command_line import diagnoses
from hybridsurrogate.command_line.commands import COMMANDS
from hybridsurrogate.command_line.main import main
from hybridsurrogate.command_line.study import read_study

STUDY = """
measured = "data/measured.csv"
simulation = "model.py:fall"
inputs = ["t"]
output = "height"
seed = 3
beta = 1
no_folds = true
report = "fall.html"

[prior]
gravity = [9.8, 0.5]
start = "90..110"

[units]
height = "m"
"""


@pytest.fixture
def study(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path / "study.toml"


def test_what_a_study_file_holds(study, monkeypatch):
    seen = []

    def stop(given):
        seen.append(given)
        raise ValueError("enough")

    monkeypatch.setattr(diagnoses, "check_outputs", stop)
    words = ["diagnose", "--config", str(study), "--seed", "5", "--prior", "gravity=9,1"]
    assert main(words) == 2
    (given,) = seen
    folder = study.parent
    assert given.measured == str(folder / "data" / "measured.csv")
    assert given.simulation == str(folder / "model.py:fall")
    assert (given.inputs, given.output) == (["t"], ["height"])
    # what is typed takes precedence, also of two priors of one name
    assert given.seed == 5
    assert given.prior == {"gravity": "9,1", "start": "90..110"}
    assert (given.beta, given.no_folds, given.units) == (1.0, True, {"height": "m"})
    assert given.report == str(folder / "fall.html")
    # what neither has
    assert (given.likelihood, given.jobs, given.check) == ("normal", -1, False)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('inptus = ["t"]', "unknown key 'inptus'. Did you mean 'inputs'?"),
        ("weather = 1", "unknown key 'weather'. The keys are above, "),
        ("config = 'other.toml'", "unknown key 'config'"),
        ("inputs = [1]", """inputs must be a list of names, such as ["t"], got [1] (list)"""),
        ('beta = "half"', "beta must be a number, got 'half' (str)"),
        ("beta = true", "beta must be a number, got True (bool)"),
        ("seed = 1.5", "seed must be a whole number, got 1.5 (float)"),
        ("check = 1", "check must be true or false, got 1 (int)"),
        ("report = 3", "report must be text, got 3 (int)"),
        ('prior = "speed"', "prior must be a table of names, such as {speed = [2, 0.5]}"),
        ("[prior]\nspeed = {mean = 2}", "prior must be a table of names"),
        ('betas = [0, "1"]', "betas must be a list of numbers"),
        ('likelihood = "norml"', "got 'norml'. Did you mean 'normal'?"),
        ("inputs = [", "is no TOML"),
    ],
)
def test_what_is_wrong_in_a_study_file_is_one_line(tmp_path, capsys, text, message):
    path = tmp_path / "study.toml"
    path.write_text(text)
    report = tmp_path / "report.html"
    report.write_text("older")
    assert main(["diagnose", "--config", str(path), "--report", str(report)]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert message in error
    assert str(path) in error
    assert report.read_text() == "older"


def test_a_study_file_that_is_not_there(tmp_path, capsys):
    assert main(["diagnose", "--config", str(tmp_path / "none.toml")]) == 2
    assert "there is no such file" in capsys.readouterr().err


def test_one_study_file_serves_several_commands(tmp_path):
    """What another command takes is no unknown key."""
    path = tmp_path / "study.toml"
    path.write_text('folds = 3\nexclude = ["delay"]\nmethod = "predictive-weighting"')
    known = [option for one in COMMANDS for option in one.options]
    assert read_study(str(path), known) == {
        "folds": 3,
        "exclude": ["delay"],
        "method": "predictive-weighting",
    }
