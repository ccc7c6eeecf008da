"""The report says in words and pictures what the attributes say in numbers."""

import copy
import html.parser
import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs
from hybridsurrogate import digits
from hybridsurrogate.diagnosis.report.summary import plain
from hybridsurrogate.diagnosis.validation import beta_scan as trust


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

    def run(effect, surrogate=None, cv=3, **settings):
        exact = surrogate is None
        model = hs.PowerScaledSurrogate(
            simulator if exact else simulator.run(64, random_state=0),
            surrogate=hs.ExactSurrogate() if exact else surrogate,
            n_draws=200,
            random_state=0,
        )
        settings = {"n_replicates": 40, "random_state": 0, **settings}
        diagnosis = hs.DiscrepancyDiagnosis(model, cv=cv, **settings)
        return diagnosis.fit(t[:, None], decay(t, 11, 0.25) + effect(t) + noise)

    return run


@pytest.fixture(scope="module")
def named(diagnose):
    return diagnose(lambda t: 2.0 * (t > 5))


@pytest.fixture(scope="module")
def report(named):
    t = np.linspace(8.2, 12, 10)
    return named.report(test=(t[:, None], decay(t, 11, 0.25) + 2.0))


def flat(report):
    return " ".join(str(report).split())


def test_the_text_states_verdict_numbers_and_gain(named, report):
    text = flat(report)
    best, gain = named.best_cause_, named.gain_
    assert text.count("Named: the simulation 'decay' is wrong, and 30 measurements") == 1
    assert f"step in t, with location {digits.interval(*best.estimates['location'])}" in text
    assert "location in units of t, amplitude in units of level <mg>" in text
    assert "Of 40 data sets made up by the simulation" in text
    assert "none looked as wrong as yours: p = 0.024" in text
    difference = digits.plus_minus(gain.elpd_difference, gain.standard_error, sign=True)
    assert f"difference {difference}" in text
    assert "it chose: step 3" in text
    assert "wrong-constant (the simulation has no assumed constants)" in text
    assert "On the rows held back (10 rows)" in text
    assert f"In LaTeX: \\text{{level <mg>}} = {best.latex}" in text
    assert "There is no weight to choose" in text


def test_where_it_is_wrong(report):
    thirds = report.to_dict()["discrepancy"]["thirds"]
    assert [third["column"] for third in thirds] == ["t"] * 3
    assert sum(third["share"] for third in thirds) == pytest.approx(1)
    most = max(thirds, key=lambda third: third["share"])
    low, high = (digits.number(most[end]) for end in ("low", "high"))
    assert f"{digits.percent(most['share'])} lies where t is between {low} and {high}" in flat(
        report
    )


class Page(html.parser.HTMLParser):
    """What a page holds: unclosed tags, images, addresses, headings, text."""

    VOID = ("meta", "img", "br")

    def __init__(self, text):
        super().__init__()
        self.open, self.images, self.addresses, self.words = [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)
        attrs = dict(attrs)
        if tag == "img":
            self.images.append(attrs)
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
    assert all(address.startswith("data:image/png;base64,") for address in page.addresses)
    assert all(len(image["alt"]) > 40 for image in page.images)
    style = re.search(r"<style>(.*?)</style>", text, re.S).group(1)
    assert not re.search(r"url\(|@import|http", style)
    assert "<script" not in text
    assert "http" not in "".join(page.words)
    assert "level <mg>" not in text
    assert "level &lt;mg&gt;" in text
    assert "prefers-color-scheme:dark" in style
    assert 'name="viewport"' in text


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
            "i=>i.complete?i.naturalWidth:0).join(' ')+' overflow '+"
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
    assert "Named: the simulation 'decay' is wrong" in dom
    picture = tmp_path / "page.png"
    run(f"--screenshot={picture}")
    assert picture.stat().st_size > 20_000


def test_text_and_json_files(named, report, tmp_path):
    report.save(tmp_path / "report.txt")
    assert (tmp_path / "report.txt").read_text(encoding="utf-8").strip() == str(report)
    report.save(tmp_path / "report.json")
    values = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert values == report.to_dict()
    assert values["schema_version"] == 2
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


def test_an_adequate_simulation(diagnose):
    diagnosis = diagnose(lambda t: 0 * t)
    assert diagnosis.verdict_ == "adequate"
    report = diagnosis.report(test=([[9.0], [10.0]], [1.2, 0.9]))
    text = flat(report)
    assert "give no reason to doubt the simulation 'decay'" in text
    assert "That nothing is wrong has" in text
    assert "Nothing was added" in text
    assert "Nowhere that the data could show" in text
    assert "In LaTeX" not in text
    assert "there is no before and after" in text
    assert report.to_dict()["discrepancy"]["thirds"] == []


def test_without_cross_validation_or_rows_held_back(diagnose):
    diagnosis = diagnose(lambda t: 2.0 * (t > 5), cv=None)
    # what is set after a fit is for the next one
    report = diagnosis.set_params(n_replicates=1000, false_alarm_rate=0.5).report()
    assert "Of 40 data sets made up by the simulation" in flat(report)
    assert "where up to 0.05 counts as wrong" in flat(report)
    assert report.to_dict()["n_replicates"] == 40
    assert "The gain was not measured by cross-validation" in flat(report)
    assert report.to_dict()["gain"] is None
    (gains,) = (s for s in report.sections if s.title == "What it gains")
    assert gains.pictures == ()


def test_a_fault_without_a_name_and_one_with_several(diagnose):
    # a chirp is no kind of the catalogue
    chirp = diagnose(lambda t: 1.5 * np.sin(0.12 * (t + 2) ** 2), cv=None)
    assert chirp.verdict_ == "unexplained"
    text = flat(chirp.report())
    assert "Unexplained: the simulation 'decay' is wrong" in text
    assert "beyond it the curve knows nothing" in text
    # a slow change that several kinds can follow
    unclear = diagnose(lambda t: 0.008 * t**2, cv=None)
    assert unclear.verdict_ == "ambiguous"
    text = flat(unclear.report())
    assert "The data do not single out one cause" in text
    assert "Do not act on the leading cause alone" in text
    assert "in standard deviations of the noise" in text
    for kind in unclear.indistinguishable_:
        assert f"{kind} (" in text
    t = np.linspace(8.2, 12, 10)
    report = unclear.report(test=(t[:, None], decay(t, 11, 0.25) + 0.008 * t**2))
    averaged = report.to_dict()["averaged"]
    assert len(averaged) > 1
    assert f"averages over the {len(averaged)} explanations that have 5 % of" in flat(report)
    np.testing.assert_allclose(sum(one["weight"] for one in averaged), 1)
    assert averaged[0]["causes"] in text


def test_two_causes_at_once(diagnose):
    def effect(t):
        return 2.0 * (t > 5) + 0.6 * np.sin(2 * np.pi * t / 1.3)

    diagnosis = diagnose(effect, cv=None, max_causes=2)
    assert {cause.kind for cause in diagnosis.found_causes_} == {"step", "periodic"}
    report = diagnosis.report()
    text, (first, second) = flat(report), diagnosis.found_causes_
    assert f"The cause: {first.kind} in t, with" in text
    assert f"Beside it a further search found: {second.kind} in t, with" in text
    assert "It holds 2 causes at once" in text
    assert f"Formula, {second.kind} in t: level <mg> = {second.formula}" in text
    assert f"Check {first.kind} in t and {second.kind} in t where" in text
    assert [cause["kind"] for cause in report.to_dict()["found_causes"]] == [
        first.kind,
        second.kind,
    ]
    assert "Something is left beside it" not in text


def test_a_cause_that_is_not_the_whole_story(diagnose):
    diagnosis = diagnose(lambda t: 2.0 * (t > 5) + 0.5 * np.sin(2 * np.pi * t / 4), cv=None)
    text = flat(diagnosis.report())
    assert "a smooth remainder is needed beside it" in text
    assert "Something is left beside it: search on with max_causes=2" in text


def test_what_to_predict_with(named):
    def advice(**gains):
        told = copy.copy(named)
        for name, gain in gains.items():
            setattr(told, name, gain)
        return flat(told.report())

    worse = replace(named.gain_, elpd_difference=-3.0, standard_error=0.5)
    unclear = replace(worse, standard_error=2.0)
    assert "Predict with extended_estimator_." in advice(gain_=unclear, gain_out_of_range_=unclear)
    assert "within the measured range, not beyond it" in advice(gain_out_of_range_=worse)
    assert "Predict with estimator_, the simulation as it is" in advice(gain_=worse)


def scan_of(before, after):
    scores = {"before": before, "after": after, "before_error": 0.1, "after_error": 0.1}
    return pd.DataFrame({"beta": [0.05, 0.5, 0.95], **scores})


# a coarse emulator strains the draws, and the diagnosis says so
@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
def test_an_emulator_gets_its_beta_scan(diagnose, monkeypatch):
    # the scan itself takes seconds, and is tested in test_diagnosis
    asked = []

    def scan(models, betas, folds, X, y, n_jobs, weights, *_):
        asked.append((tuple(betas), [len(held) for _, held in folds]))
        return scan_of([-0.5, -0.9, -1.2], [-0.4, -0.3, -0.6])

    monkeypatch.setattr(trust, "scan_beta", scan)
    diagnosis = diagnose(lambda t: 2 * np.sin(2.5 * t), hs.PolynomialChaos(degree=4), cv=None)
    report = diagnosis.report(beta_scan=True)
    assert asked == [((0.05, 0.25, 0.5, 0.75, 0.95), held) for held in ([10, 10, 10], [4, 4, 4])]
    told = {"beta": 0.5, "before": -0.9, "after": -0.3, "before_error": 0.1, "after_error": 0.1}
    assert report.to_dict()["beta_scan"][1] == told
    assert report.to_dict()["best_beta_out_of_range"] == {"before": 0.05, "after": 0.5}
    text = flat(report)
    assert "Within the measured range the best weight of the simulation is beta = 0.05" in text
    assert "Beyond it the best weight of the simulation is beta = 0.05" in text
    (section,) = (s for s in report.sections if s.title == "Trust in the simulation")
    assert "beyond it best at beta = 0.05 before and 0.5 after" in section.pictures[0].description
