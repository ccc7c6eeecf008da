"""The report says in words and pictures what the attributes say in numbers."""

import base64
import copy
import html.parser
import json
import re
import shutil
import subprocess
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from outcomes import outcome
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.report.html import mathml
from hybridsurrogate.diagnosis.report.summary import plain
from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.validation import beta_scan as trust
from hybridsurrogate.numerics import digits


def decay(t, level, rate):
    return level * np.exp(-rate * t)


@pytest.fixture(scope="module")
def named():
    return outcome("named")


@pytest.fixture(scope="module")
def report(named):
    t = np.linspace(8.2, 12, 10)
    units = {"level <mg>": "mg", "t": "h"}
    return named.report(test=(t[:, None], decay(t, 11, 0.25) + 2.0), units=units)


def flat(report):
    return " ".join(str(replace(report, full=True)).split())


def cards(report):
    return {card.question: f"{card.answer}: {card.detail}" for card in report.first.cards}


def test_the_headline_the_cards_and_the_next_calls(named, report):
    location, amplitude = (named.best_cause_.estimates[k][0] for k in ("location", "amplitude"))
    found = re.fullmatch(
        r"At t = ([\d.]+) level <mg> rises by ([\d.]+) mg, and the simulation does not.",
        report.headline,
    )
    assert float(found.group(1)) == pytest.approx(location, abs=0.1)
    assert float(found.group(2)) == pytest.approx(amplitude, abs=0.1)
    told = cards(report)
    assert told["Is something wrong?"].startswith("Yes: p ≤ 0.024: at most one in ")
    assert f"{digits.probability(named.probability_right_)} right" in told["How sure is the cause?"]
    gain = named.gain_
    score = digits.plus_minus(gain.elpd_difference, gain.standard_error, sign=True)
    assert "% error" in told["What is gained?"]
    assert score in told["What is gained?"]
    assert told["How far to trust it?"].startswith("Within t 0 to 8 h")
    calls = [one.call for one in report.first.advice]
    assert "diagnosis.predict(X)" in calls
    assert 'diagnosis.to_python("extended.py")' in calls


def test_the_text_is_short_and_the_full_one_has_all(named, report):
    assert str(report).startswith(report.headline)
    assert len(str(report).splitlines()) <= 30
    text, best, gain = flat(report), named.best_cause_, named.gain_
    assert str(report) in str(replace(report, full=True))
    difference = digits.plus_minus(gain.elpd_difference, gain.standard_error, sign=True)
    assert difference in text
    assert "its folds chose step (3)" in text
    assert "the simulation has no assumed constants" in text
    assert "On the rows that you held out (10 rows)" in text
    assert f"\\text{{level <mg>}} = {best.latex}" in text
    assert "Weight of the simulation" not in text
    assert "arXiv:2412.11875" in text


def test_where_it_is_wrong(report):
    thirds = report.to_dict()["discrepancy"]["thirds"]
    assert [third["column"] for third in thirds] == ["t"] * 3
    assert sum(third["share"] for third in thirds) == pytest.approx(1)
    most = max(thirds, key=lambda third: third["share"])
    low, high = (digits.number(most[end]) for end in ("low", "high"))
    assert f"{digits.percent(most['share'])} lies where t is {low} to {high}" in flat(report)


class Page(html.parser.HTMLParser):
    """What a page holds: unclosed tags, images, addresses, headings, text."""

    VOID = ("meta", "img", "br")

    def __init__(self, text):
        super().__init__()
        self.open, self.images, self.addresses, self.words, self.names = [], [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)
        attrs = dict(attrs)
        if tag == "img":
            self.images.append(attrs)
        self.names += [attrs["id"]] if "id" in attrs else []
        self.addresses += [attrs[k] for k in ("src", "href", "srcset", "data") if k in attrs]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def test_the_page_is_whole_and_needs_no_network(report, tmp_path):
    report.save(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert text.startswith("<!doctype html>")
    assert page.open == []
    assert len(page.images) == 6
    inside = ("data:image/svg+xml;base64,", "data:text/csv;base64,", "#")
    assert all(address.startswith(inside) for address in page.addresses)
    assert {f"#{name}" for name in page.names} == {a for a in page.addresses if a[0] == "#"}
    assert all(len(image["alt"]) > 40 for image in page.images)
    style = re.search(r"<style>(.*?)</style>", text, re.S).group(1)
    assert not re.search(r"url\(|@import|http", style)
    assert "<script" not in text
    assert "level <mg>" not in text
    assert "level &lt;mg&gt;" in text
    assert "prefers-color-scheme:dark" in style
    assert "@media print" in style
    assert 'name="viewport"' in text
    assert "<math" in text


def test_the_numbers_of_a_picture_are_in_the_page(named, report):
    data = report.first.picture.drawn.data
    assert list(data)[:3] == ["t", "measured level <mg>", "simulation"]
    y = named.estimator_.measured_[1]
    np.testing.assert_allclose(data["measured level <mg>"], y)
    np.testing.assert_allclose(
        data["extended model, residual"], y - data["extended model"], atol=1e-12
    )
    csv = base64.b64encode(data.to_csv(index=False).encode()).decode()
    assert csv in report.to_html()


BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def test_the_page_opens_in_a_browser(report, tmp_path):
    browser = next((path for path in map(shutil.which, BROWSERS) if path), None)
    if browser is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is on the PATH")
    report.save(tmp_path / "report.html")
    # the page asks, once it is laid out, how its pictures came out
    asked = (
        (tmp_path / "report.html")
        .read_text(encoding="utf-8")
        .replace(
            "</body>",
            "<script>document.title='widths '+Array.from(document.images,"
            "i=>i.complete?i.width:0).filter(w=>w).join(' ')+' overflow '+"
            "(document.documentElement.scrollWidth>innerWidth)</script></body>",
        )
    )
    (tmp_path / "asked.html").write_text(asked, encoding="utf-8")

    def run(*arguments):
        flags = ("--headless", "--no-sandbox", "--disable-gpu", "--window-size=500,1200")
        profile = f"--user-data-dir={tmp_path / 'profile'}"
        address = (tmp_path / "asked.html").as_uri()
        done = subprocess.run(
            [browser, *flags, profile, *arguments, address],
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        )
        return done.stdout

    dom = run("--dump-dom", "--virtual-time-budget=2000")
    told = re.search(r"<title>widths ([\d ]+) overflow (\w+)</title>", dom)
    widths = [int(width) for width in told.group(1).split()]
    assert len(widths) == 6
    assert min(widths) > 400
    assert told.group(2) == "false"
    assert "rises by" in dom
    picture = tmp_path / "page.png"
    run(f"--screenshot={picture}")
    assert picture.stat().st_size > 20_000


def test_text_and_json_files(named, report, tmp_path):
    report.save(tmp_path / "report.txt")
    assert (tmp_path / "report.txt").read_text(encoding="utf-8").strip() == str(
        replace(report, full=True)
    )
    report.save(tmp_path / "report.json")
    values = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert values == report.to_dict()
    assert values["schema_version"] == 3
    assert values["verdict"] == "named"
    assert values["best_cause"]["kind"] == "step"
    assert values["best_cause"]["latex"] == named.best_cause_.latex
    assert values["p_value"] == named.p_value_
    assert values["gain"]["n_rows"] == 30
    assert [fold["kind"] for fold in values["gain"]["folds"]] == ["step"] * 3
    assert sum(fold["n_rows"] for fold in values["gain"]["folds"]) == 30
    assert values["parameters"]["level"]["after"][0] == pytest.approx(11, abs=0.5)
    said = [sentence for section in values["sections"] for sentence in section["sentences"]]
    assert all(sentence in flat(report) for sentence in said)
    assert values["headline"] == report.headline
    assert values["units"] == {"level <mg>": "mg", "t": "h"}
    assert [card["question"] for card in values["cards"]] == list(cards(report))


def test_no_other_kind_of_file_is_written(report, tmp_path):
    with pytest.raises(
        ValueError, match=r"to a file \.html, \.txt or \.json, not to .*report\.pdf"
    ):
        report.save(tmp_path / "report.pdf")
    assert not list(tmp_path.iterdir())


def test_the_dict_is_a_copy_and_nan_is_none(report):
    report.to_dict()["verdict"] = "changed"
    assert report.to_dict()["verdict"] == "named"
    given = {"a": np.nan, 1: (np.float64(2.0), np.array([np.inf, 1.0])), "b": np.bool_(True)}
    assert plain(given) == {"a": None, "1": [2.0, [None, 1.0]], "b": True}


def test_an_adequate_simulation():
    diagnosis = outcome("adequate")
    assert diagnosis.verdict_ == "adequate"
    report = diagnosis.report(test=([[9.0], [10.0]], [1.2, 0.9]))
    text = flat(report)
    assert report.headline == "The measurements give no reason to doubt the simulation."
    assert "would have been detected in nine of ten such data sets" in " ".join(report.lead)
    assert cards(report)["Is something wrong?"].startswith("No sign of it")
    assert "that nothing is wrong has" in cards(report)["How sure is the cause?"]
    assert "Nothing was added" in text
    assert "Nowhere that the data show" in text
    assert "In LaTeX" not in text
    assert "the extension changes nothing" in text
    assert report.to_dict()["discrepancy"]["thirds"] == []


def test_without_cross_validation_or_held_out_rows(named):
    diagnosis = copy.copy(named)
    diagnosis.result_ = replace(named.result_, gain=None, gain_out_of_range=None)
    # what is set after a fit is for the next one
    report = diagnosis.set_params(n_replicates=1000, false_alarm_rate=0.5).report()
    assert "p ≤ 0.024: at most one in " in cards(report)["Is something wrong?"]
    assert report.to_dict()["n_replicates"] == 40
    assert cards(report)["What is gained?"].startswith("Not measured")
    assert "nothing was tested" in cards(report)["How far to trust it?"]
    assert report.to_dict()["gain"] is None
    (gains,) = (s for s in report.sections if s.title == "Gain in detail")
    assert gains.pictures == ()


def test_a_fault_without_a_name_and_one_with_several():
    chirp = outcome("unexplained")
    assert chirp.verdict_ == "unexplained"
    report = chirp.report()
    assert "that no cause of the catalogue explains" in report.headline
    assert cards(report)["How sure is the cause?"].startswith("Not known")
    assert "causes=[MyCause()]" in str(report)
    # a slow change that several kinds can follow
    unclear = outcome("ambiguous")
    assert unclear.verdict_ == "ambiguous"
    report = unclear.report()
    assert report.headline.startswith("The simulation is wrong, and the data leave open how: ")
    assert unclear.best_cause_.kind in report.headline
    assert "Before you act on one cause" in str(report)
    assert "deviations of the noise" in flat(report)
    t = np.linspace(8.2, 12, 10)
    report = unclear.report(test=(t[:, None], decay(t, 11, 0.25) + 0.008 * t**2))
    averaged = report.to_dict()["averaged"]
    assert len(averaged) > 1
    assert f"average over the {len(averaged)} explanations with 5 % of" in flat(report)
    np.testing.assert_allclose(sum(one["weight"] for one in averaged), 1)
    assert averaged[0]["causes"] in flat(report)


def test_two_causes_at_once():
    diagnosis = outcome("two causes")
    assert {cause.kind for cause in diagnosis.found_causes_} == {"step", "periodic"}
    report = diagnosis.report()
    text, (first, second) = flat(report), diagnosis.found_causes_
    wave = {"step": "rises by", "periodic": "misses a cycle"}
    assert wave[first.kind] in report.headline
    assert wave[second.kind] in report.lead[-1]
    assert report.lead[-1].startswith("A further fault: ")
    assert "It holds 2 causes at once" in text
    assert f"Formula, {second.kind} in t: level <mg> = {second.formula}" in text
    assert f"Check {first.kind} in t and {second.kind} in t where" in text
    assert [cause["kind"] for cause in report.to_dict()["found_causes"]] == [
        first.kind,
        second.kind,
    ]
    assert "max_causes" not in str(report)


def test_a_further_fault_that_others_draw_as_well_is_told_with_its_share():
    diagnosis = copy.deepcopy(outcome("two causes"))
    first, second = diagnosis.result_.steps
    candidates = second.conditional.candidates
    level = [Candidate(w.cause, w.fit, log_evidence=0.0) for w in candidates]
    unsure = replace(second, conditional=replace(second.conditional, candidates=level))
    diagnosis.result_ = replace(diagnosis.result_, steps=(first, unsure))
    share = unsure.conditional.kind_shares[unsure.chosen.kind]
    assert share < 0.6
    told = f"A further fault, most probably ({100 * share:.0f} % of the evidence): "
    assert diagnosis.report().lead[-1].startswith(told)


def test_residual_structure_is_the_caution():
    report = outcome("nearest").report()
    assert "may be at work too" in report.first.caution
    assert "Search for a further cause: max_causes=2" in " ".join(str(report).split())


def test_what_to_predict_with(named):
    def first(**gains):
        changed = copy.copy(named)
        changed.result_ = replace(named.result_, **gains)
        return changed.report().first

    worse = replace(named.gain_, elpd_difference=-3.0, standard_error=0.5)
    unclear = replace(worse, standard_error=2.0)
    fine = first(gain=unclear, gain_out_of_range=unclear)
    assert fine.advice[0] == ("Use the extended model:", "diagnosis.predict(X)")
    assert fine.cards[2].answer == "No clear gain"
    near = first(gain_out_of_range=worse)
    assert near.advice[0].sentence == "Use the extended model, within the measured range:"
    assert "predicts worse" in near.cards[3].detail
    bad = first(gain=worse)
    assert bad.advice[0].call == "diagnosis.estimator_.predict(X)"
    assert bad.cards[2].answer == "Worse"
    assert "predicts worse than the simulation" in bad.caution


def test_units_of_unknown_columns_are_an_error(named):
    with pytest.raises(
        ValueError, match=r"units: there is no 'tt'; there are t, .*Did you mean 't'"
    ):
        named.report(units={"tt": "h"})


def test_units_are_a_dict_of_text(named):
    for wrong in ("kW", {"t": 1000}):
        with pytest.raises(TypeError, match="units must be a dict of names and units as text"):
            named.report(units=wrong)


def test_spaces_of_a_formula_are_no_commas():
    assert "," not in mathml(r"244 \, x \quad \text{where} \; y")
    assert mathml(r"f(a, b)").count("<mo>,</mo>") == 1


def test_the_picture_alone(named):
    figure, axes = plt.subplots(2, 1)
    top, below = named.plot(axes=axes, units={"t": "h"})
    assert top is axes[0]
    assert below.get_xlabel() == "t (h)"
    plt.close(figure)


def scan_of(before, after):
    scores = {"before": before, "after": after, "before_error": 0.1, "after_error": 0.1}
    return pd.DataFrame({"beta": [0.05, 0.5, 0.95], **scores})


# a coarse emulator strains the draws, and the diagnosis says so
@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
def test_an_emulator_gets_its_beta_scan(named, monkeypatch):
    # the scan itself takes seconds, and is tested in test_diagnosis
    asked = []

    def scan(models, betas, folds, *_):
        asked.append((tuple(betas), [len(held) for _, held in folds]))
        return scan_of([-0.5, -0.9, -1.2], [-0.4, -0.3, -0.6])

    monkeypatch.setattr(trust, "scan_beta", scan)
    t = named.estimator_.measured_[0]
    model = clone(named.estimator).set_params(
        simulation=named.estimator.simulation.run(64, random_state=0),
        surrogate=hs.PolynomialChaos(degree=4),
    )
    settings = {"exclude": all_but("periodic", "trend"), "cv": None, "n_replicates": 40}
    diagnosis = hs.DiscrepancyDiagnosis(model, random_state=0, **settings)
    diagnosis.fit(t, decay(t[:, 0], 11, 0.25) + 2 * np.sin(2.5 * t[:, 0]))
    report = diagnosis.report(beta_scan=True)
    assert asked == [((0.05, 0.25, 0.5, 0.75, 0.95), held) for held in ([10, 10, 10], [4, 4, 4])]
    told = {"beta": 0.5, "before": -0.9, "after": -0.3, "before_error": 0.1, "after_error": 0.1}
    assert report.to_dict()["beta_scan"][1] == told
    assert report.to_dict()["best_beta_out_of_range"] == {"before": 0.05, "after": 0.5}
    text = flat(report)
    assert "Within the measured range the best weight is beta = 0.05" in text
    assert "Beyond it the best weight is beta = 0.05" in text
    (section,) = (s for s in report.sections if s.title == "Weight of the simulation")
    description = section.pictures[0].drawn.description
    assert "beyond it best at beta = 0.05 before and 0.5 after" in description
