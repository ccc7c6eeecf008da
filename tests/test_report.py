"""The report says in words and pictures what the attributes say in numbers."""

import json
import re

import numpy as np
import pytest
from matplotlib.axes import Axes

import hybridsurrogate as hs
from hybridsurrogate import plotting


def decay(t, level, rate):
    return level * np.exp(-rate * t)


@pytest.fixture(scope="module")
def diagnose():
    simulator = hs.Simulator(
        decay,
        {"t": (0, 12)},
        {
            "level": hs.truncated_normal(10, 2, 4, 16),
            "rate": hs.truncated_normal(0.2, 0.1, 0.02, 0.6),
        },
        output="level <mg>",
    )
    t = np.linspace(0, 8, 30)
    noise = 0.1 * np.random.default_rng(0).standard_normal(30)

    def run(effect, surrogate=None):
        exact = surrogate is None
        model = hs.PowerScaledSurrogate(
            simulator if exact else simulator.run(64, random_state=0),
            surrogate=hs.ExactSurrogate() if exact else surrogate,
            n_draws=200,
            random_state=0,
        )
        diagnosis = hs.DiscrepancyDiagnosis(model, cv=3, n_replicates=40, random_state=0)
        return diagnosis.fit(t[:, None], decay(t, 11, 0.25) + effect(t) + noise)

    return run


@pytest.fixture(scope="module")
def named(diagnose):
    return diagnose(lambda t: 2.0 * (t > 5))


@pytest.fixture(scope="module")
def report(named):
    t = np.linspace(8.2, 12, 10)
    return named.report(test=(t[:, None], decay(t, 11, 0.25) + 2.0))


def test_the_text_states_verdict_numbers_and_gain(named, report):
    text = str(report)
    location = named.best_cause_.estimates["location"]
    assert "is wrong in a way that the data show" in text
    assert f"step in t, with location {location[0]:.4g}" in text
    assert f"p = {named.p_value_:.3g}" in text
    assert f"{named.gain_.elpd_difference:+.3f}" in text
    assert f"{named.gain_on([[9.0]], [3.0]).n_rows}" in text
    assert "the folds chose: step 3" in text
    assert "not weighed: the simulation has no assumed constants" in text
    assert "On the rows held back (10 rows)" in text


def test_the_page_needs_no_network_and_escapes_names(report, tmp_path):
    report.save(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>")
    assert not re.search(r"(src|href)\s*=\s*['\"](?!data:)", page)
    assert page.count("data:image/png;base64,") == 5
    assert "level <mg>" not in page
    assert "level &lt;mg&gt;" in page


def test_text_and_json_files(named, report, tmp_path):
    report.save(tmp_path / "report.txt")
    assert (tmp_path / "report.txt").read_text(encoding="utf-8").strip() == str(report)
    report.save(tmp_path / "report.json")
    values = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert values["verdict"] == "named"
    assert values["best_cause"]["kind"] == "step"
    assert values["p_value"] == named.p_value_
    assert values["gain"]["n_rows"] == 30


def test_an_adequate_simulation(diagnose):
    diagnosis = diagnose(lambda t: 0 * t)
    assert diagnosis.verdict_ == "adequate"
    text = str(diagnosis.report())
    assert "no reason to doubt" in text
    assert "Nothing was added" in text


# a step under a coarse emulator strains the draws, and the diagnosis says so
@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
def test_an_emulator_gets_its_beta_scan(diagnose):
    diagnosis = diagnose(lambda t: 2.0 * (t > 5), hs.PolynomialChaos(degree=4))
    report = diagnosis.report()
    scan = report.to_dict()["beta_scan"]
    assert [row["beta"] for row in scan] == [0.05, 0.25, 0.5, 0.75, 0.95]
    assert "best weight of the simulation is beta" in str(report)


def test_pictures_use_the_axes_that_they_are_given(named):
    (ax,) = plotting.new_axes()
    for draw in (plotting.plot_fit, plotting.plot_discrepancy, plotting.plot_causes):
        assert draw(named, ax=ax) is ax
        assert isinstance(draw(named), Axes)
    axes = plotting.new_axes(2)
    assert plotting.plot_before_after(named, axes=axes) is axes
    assert plotting.plot_residuals(named, axes=axes) is axes
    assert axes[0].get_xlabel() == "t"
