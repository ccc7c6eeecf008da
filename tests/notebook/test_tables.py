"""What a notebook shows: tables that are escaped, agree with the numbers, and cost nothing."""

import re
import time
from html.parser import HTMLParser

import numpy as np
import pytest
from few_kinds import all_but

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin
from hybridsurrogate.notebook import table

EVIL = "<script>alert('x')</script>"
SECONDS = 0.25


class Cells(HTMLParser):
    """Collects the texts of the cells of tables, and every tag."""

    def __init__(self, text):
        super().__init__()
        self.cells, self.tags, self._open = [], set(), False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self._open = tag in ("td", "th")
        if self._open:
            self.cells.append("")

    def handle_endtag(self, tag):
        self._open = self._open and tag not in ("td", "th")

    def handle_data(self, data):
        if self._open:
            self.cells[-1] += data


def shown(thing):
    return Cells(thing._repr_html_())


@pytest.fixture(scope="module")
def case():
    return make_log_sin(random_state=0)


@pytest.fixture(scope="module")
def model(case):
    return hs.PowerScaledSurrogate(
        case.simulation, effects=[hs.Periodic("x")], beta=0.3, random_state=0
    ).fit(case.X, case.y)


@pytest.fixture(scope="module")
def diagnosis(case):
    exact = hs.PowerScaledSurrogate(
        case.simulator, hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    settings = {"exclude": all_but("periodic", "trend", "step"), "cv": 2, "n_replicates": 39}
    return hs.DiscrepancyDiagnosis(exact, **settings, random_state=0).fit(case.X, case.y)


def evil_runs():
    rng = np.random.default_rng(0)
    x, rate = rng.uniform(0, 1, (40, 1)), rng.uniform(1, 2, (40, 1))
    runs = (x * rate)[:, 0]
    prior = hs.truncated_normal(1.5, 0.2, 1, 2)
    return hs.SimulationData(x, rate, runs, [f"x{EVIL}"], {f"rate{EVIL}": prior}, output=EVIL)


def test_a_table_escapes_all_that_it_is_given():
    text = table([(EVIL, "1 < 2")], ("name", "<b>"), EVIL)
    assert "<script" not in text
    assert Cells(text).cells == ["name", "<b>", EVIL, "1 < 2"]


def test_names_are_escaped_wherever_they_are_shown():
    data = evil_runs()
    fitted = hs.PowerScaledSurrogate(data, hs.PolynomialChaos(1), random_state=0)
    fitted.fit(data.X, data.y + 0.1 * np.random.default_rng(1).standard_normal(40))
    finding = hs.CauseFinding(EVIL, EVIL, EVIL, 0.9, {EVIL: (1.0, 0.5, 1.5)})
    for thing in (data, fitted, finding):
        assert "<script>alert" not in thing._repr_html_()
    assert any(EVIL in cell for cell in shown(data).cells)
    assert shown(finding).cells.count(EVIL) >= 2


def test_runs_show_their_numbers_and_ranges(case):
    cells = shown(case.simulation).cells
    assert cells[0].startswith("100 runs")
    (low, high), prior = case.simulation.input_ranges["x"], case.simulation.parameter_ranges
    assert f"{low:.4g} to {high:.4g}" in cells
    assert "{:.4g} to {:.4g}".format(*prior["omega"]) in cells


def test_an_estimator_shows_what_is_fitted_and_how_good_its_draws_are(model):
    cells = shown(model).cells
    found = model.diagnostics_
    assert "30 rows" in cells
    assert "0.3" in cells
    assert any("periodic" in cell for cell in cells)
    assert any(f"{found.effective_draws:.0f}" in cell for cell in cells)
    assert any(f"k-hat {found.khat:.2f}" in cell for cell in cells)


def test_two_posteriors_show_their_weights(case):
    two = hs.PredictiveWeightedSurrogate(case.simulation, beta=0.25, random_state=0)
    cells = shown(two.fit(case.X, case.y)).cells
    assert {"simulation", "measured", "25 %", "75 %"} <= set(cells)
    # omega is one of the second posterior alone
    assert "omega" in cells[cells.index("Unknowns") + 1]


def test_an_average_shows_its_weights(case, model):
    other = hs.PowerScaledSurrogate(case.simulation, beta=0.3, random_state=0)
    average = hs.AveragedSurrogate.of_fitted([model, other.fit(case.X, case.y)], [3, 1])
    cells = shown(average).cells
    assert {"75 %", "25 %"} <= set(cells)


def test_doubtful_draws_are_shown_as_such(case):
    with pytest.warns(hs.SamplingWarning):
        few = hs.PowerScaledSurrogate(
            case.simulation, sampler=hs.EnsembleSampler(max_steps=20), random_state=0
        ).fit(case.X, case.y)
    assert any("doubtful" in cell for cell in shown(few).cells)


def test_what_is_not_fitted_shows_its_settings_alone(case):
    text = hs.PowerScaledSurrogate(case.simulation)._repr_html_()
    assert "Fitted to" not in text
    assert "PowerScaledSurrogate" in text


def test_a_gain_shows_the_numbers_that_it_prints(diagnosis):
    printed = re.findall(r"\S+", str(diagnosis.gain_))
    cells = " ".join(shown(diagnosis.gain_).cells).split()
    assert [word for word in cells if word not in printed] == []
    assert f"{diagnosis.gain_.elpd_before:.2f}" in cells


def test_a_finding_shows_its_estimates_with_intervals(diagnosis):
    best = diagnosis.best_cause_
    cells = shown(best).cells
    assert best.formula in cells
    assert set(best.estimates) <= set(cells)


def test_nothing_is_computed_to_show_or_to_complete(model, diagnosis):
    """TAB asks for the value of every public attribute, and a notebook for the HTML."""
    diagnosis._repr_html_()  # imports what draws reports
    things = [model, diagnosis, diagnosis.extended_estimator_, diagnosis.gain_]
    things += [diagnosis.best_cause_, model.simulation, diagnosis.extended_simulator_]
    for thing in things:
        start = time.process_time()
        for name in dir(thing):
            if not name.startswith("_"):
                getattr(thing, name)
        assert time.process_time() - start < SECONDS, type(thing)
        start = time.process_time()
        getattr(thing, "_repr_html_", str)()
        assert time.process_time() - start < SECONDS, type(thing)


def test_showing_runs_no_simulation(case, monkeypatch):
    def refuse(*args, **kwargs):
        raise AssertionError("showing ran the simulation")

    exact = hs.PowerScaledSurrogate(case.simulator, hs.ExactSurrogate(), random_state=0)
    exact.fit(case.X, case.y)
    monkeypatch.setattr(hs.Simulator, "evaluate", refuse)
    monkeypatch.setattr(hs.Simulator, "cached", refuse)
    monkeypatch.setattr(type(exact.posterior_), "eta", refuse)
    for name in dir(exact):
        if not name.startswith("_"):
            getattr(exact, name)
    assert "Fitted to" in exact._repr_html_()
