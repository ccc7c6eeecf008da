"""Showing a fitted object takes no time: attributes never compute, methods do."""

import inspect
from types import SimpleNamespace

import numpy as np
import pytest
from few_kinds import all_but
from scipy.stats import norm

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.validation import beta_scan as trust
from hybridsurrogate.diagnosis.validation.beta_scan import best_beta

CALLS = []


def line(t, level):
    CALLS.append(len(t))
    return level + t


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 14, 24))
    y = line(t, 1.0) + 2.0 * (t > 7) + 0.3 * rng.standard_normal(24)
    return SimpleNamespace(
        X=t[:, None], y=y, simulator=hs.Simulator(line, {"t": (0, 14)}, {"level": norm(0, 3)})
    )


def diagnosed(data, simulation, surrogate, cv=2):
    model = hs.PowerScaledSurrogate(simulation, surrogate=surrogate, n_draws=200, random_state=0)
    settings = {"exclude": all_but("step", "trend", "noise"), "cv": cv, "n_replicates": 20}
    return hs.DiscrepancyDiagnosis(model, **settings, random_state=0).fit(data.X, data.y)


@pytest.fixture(scope="module")
def exact(data):
    return diagnosed(data, data.simulator, hs.ExactSurrogate())


@pytest.fixture(scope="module")
def emulated(data):
    return diagnosed(data, data.simulator.run(40, random_state=0), hs.PolynomialChaos(2), None)


@pytest.fixture
def no_fit(monkeypatch):
    """Every way to a fit fails, and no run of the simulation goes unseen."""

    def refuse(*_, **__):
        raise RuntimeError("a fit")

    for estimator in (
        hs.PowerScaledSurrogate,
        hs.PredictiveWeightedSurrogate,
        hs.KennedyOHaganSurrogate,
        hs.MultiSourceSurrogate,
        hs.AveragedSurrogate,
    ):
        monkeypatch.setattr(estimator, "fit", refuse)
    monkeypatch.setattr(trust, "beta_path", refuse)
    CALLS.clear()


@pytest.mark.slow
def test_showing_a_diagnosis_fits_and_runs_nothing(exact, emulated, request):
    request.getfixturevalue("no_fit")
    for diagnosis in (exact, emulated):
        assert "DiscrepancyDiagnosis" in diagnosis._repr_html_()
        assert "verdict_" in dir(diagnosis)
        inspect.getmembers(diagnosis)
        inspect.getmembers(diagnosis.gain_)
    assert not CALLS


@pytest.mark.slow
def test_showing_an_estimator_fits_and_runs_nothing(data, request):
    runs = data.simulator.run(40, random_state=0)
    settings = {"surrogate": hs.PolynomialChaos(2), "n_draws": 100, "random_state": 0}
    one = hs.PowerScaledSurrogate(runs, **settings)
    models = [
        one,
        hs.PowerScaledSurrogate(data.simulator, hs.ExactSurrogate(), n_draws=100, random_state=0),
        hs.PredictiveWeightedSurrogate(runs, **settings),
        hs.KennedyOHaganSurrogate(runs, **settings),
        hs.MultiSourceSurrogate([hs.Source(runs)], **settings),
        hs.AveragedSurrogate([one], [1.0], random_state=0),
    ]
    for model in models:
        model.fit(data.X, data.y)
    request.getfixturevalue("no_fit")
    for model in models:
        assert type(model).__name__ in model._repr_html_()
        inspect.getmembers(model)
    assert not CALLS


@pytest.mark.parametrize(
    ("name", "method"),
    [
        ("averaged_estimator_", "extended_estimator_"),
        ("averaged_estimator", "extended_estimator_"),
        ("beta_scan_", "beta_scan()"),
        ("beta_scan_out_of_range_", "beta_scan(out_of_range=True)"),
    ],
)
def test_a_former_attribute_names_its_method(exact, name, method):
    assert not hasattr(exact, name)
    with pytest.raises(AttributeError) as error:
        getattr(exact, name)
    assert method in str(error.value)
    # other names are as unknown as ever
    with pytest.raises(AttributeError, match="'DiscrepancyDiagnosis' object has no attribute 'x_'"):
        exact.x_  # noqa: B018


@pytest.mark.slow
def test_methods_compute_once(emulated, monkeypatch):
    scan, beyond = emulated.beta_scan(), emulated.beta_scan(out_of_range=True)
    assert len(scan) == len(beyond) == 5
    monkeypatch.setattr(trust, "beta_path", None)
    assert emulated.beta_scan() is scan
    assert emulated.beta_scan(out_of_range=True) is beyond
    scans = emulated.beta_scans_
    assert scans.best_beta_after() == best_beta(scan, "after")
    assert scans.best_beta_before(out_of_range=True) == best_beta(beyond, "before")


def test_data_or_weights_of_ones_own_are_scanned_within_the_range(emulated, data):
    assert list(emulated.beta_scan(betas=[0.5, 0.25])["beta"]) == [0.25, 0.5]
    with pytest.raises(ValueError, match="X and y"):
        emulated.beta_scan(data.X)
    with pytest.raises(ValueError, match="out_of_range"):
        emulated.beta_scan(data.X, data.y, out_of_range=True)


@pytest.mark.slow
def test_a_report_scans_beta_when_it_is_asked_to(data, monkeypatch):
    diagnosis = diagnosed(data, data.simulator.run(40, random_state=0), hs.PolynomialChaos(2))
    with monkeypatch.context() as patched:
        patched.setattr(trust, "beta_path", None)
        report = diagnosis.report()
    assert report.to_dict()["beta_scan"] is None
    assert "report(beta_scan=True)" in " ".join(str(diagnosis.report(full=True)).split())
    told = diagnosis.report(beta_scan=True).to_dict()
    assert [row["beta"] for row in told["beta_scan"]] == list(diagnosis.beta_scan()["beta"])
    # known by now, it costs nothing
    assert diagnosis.report().to_dict()["best_beta"] == told["best_beta"]
