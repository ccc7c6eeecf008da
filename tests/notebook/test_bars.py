"""Progress bars: whoever asks for one sees how far the work is, and nobody else does."""

import sys

import numpy as np
import pytest
from few_kinds import all_but

import hybridsurrogate as hs
from hybridsurrogate import notebook
from hybridsurrogate.datasets import make_log_sin
from hybridsurrogate.notebook import for_a_person


@pytest.fixture(scope="module")
def case():
    return make_log_sin(random_state=0)


def model(case, **settings):
    return hs.PowerScaledSurrogate(case.simulation, n_draws=100, random_state=0, **settings)


def ensemble(case, progress):
    sampler = hs.EnsembleSampler(max_steps=400, tol=2, progress=progress)
    model(case, sampler=sampler).fit(case.X, case.y)


def runs_at(case, progress):
    simulator = hs.Simulator(lambda x: x, {"x": (0, 1)}, vectorized=False)
    simulator.run(4, random_state=0, progress=progress)


def left_out(case, progress):
    # of twenty draws importance sampling fails for some rows
    y = case.y.copy()
    y[3] += 3.0
    hs.PowerScaledSurrogate(case.simulation, n_draws=20, random_state=0).fit(case.X, y).loo(
        progress=progress
    )


WORK = {
    "run": runs_at,
    "emcee": ensemble,
    "loo": left_out,
    "beta_path": lambda case, progress: hs.beta_path(
        model(case), case.X, case.y, [0.3, 0.5], progress=progress
    ),
    "choose_beta": lambda case, progress: hs.choose_beta(
        model(case), case.X, case.y, [0.3, 0.5], cv=2, progress=progress
    ),
}


@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.SamplingWarning")
@pytest.mark.parametrize("name", WORK)
def test_a_bar_is_drawn_where_one_was_asked_for(name, case, capsys):
    WORK[name](case, False)
    assert capsys.readouterr().err == ""
    WORK[name](case, True)
    assert "%|" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.SamplingWarning")
def test_an_ensemble_has_one_bar_to_its_last_step(case, capsys):
    ensemble(case, True)
    text = capsys.readouterr().err
    assert "Steps of the ensemble, at most" in text
    assert " 200/400 " in text


@pytest.mark.parametrize("name", ["loo", "beta_path", "choose_beta"])
def test_another_word_than_yes_or_no_is_refused(name, case):
    with pytest.raises(TypeError, match="progress must be True or False"):
        WORK[name](case, "yes")


def test_what_a_diagnosis_is_doing_is_shown_to_a_person_alone(capsys, monkeypatch):
    def work(shown):
        with for_a_person("Search", shown):
            pass
        return capsys.readouterr().err

    assert work(True) == ""  # a file, or a pipe
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert "Search" in work(True)
    assert work(False) == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: False, raising=False)
    # output in a notebook is no terminal, but a person reads it
    monkeypatch.setattr(notebook, "IN_NOTEBOOK", True)
    assert "Search" in work(True)
    assert work(False) == ""


def test_a_scan_over_beta_follows_the_diagnosis(monkeypatch, capsys):
    monkeypatch.setattr(notebook, "IN_NOTEBOOK", True)
    rng = np.random.default_rng(0)
    x = np.linspace(0, 1, 20)
    simulator = hs.Simulator(
        lambda x, a: a * x, {"x": (0, 1)}, {"a": hs.truncated_normal(1, 0.5, 0, 3)}
    )
    before = hs.PowerScaledSurrogate(
        simulator.run(40, random_state=0), hs.PolynomialChaos(2), n_draws=100, random_state=0
    )
    y = 1.2 * x + 0.1 * rng.standard_normal(20)
    settings = {"exclude": all_but("trend", "offset"), "cv": None, "n_replicates": 20}
    diagnosis = hs.DiscrepancyDiagnosis(before, **settings, random_state=0)
    diagnosis.fit(x[:, None], y)
    assert capsys.readouterr().err == ""
    diagnosis.set_params(progress=True).beta_scan()
    # a bar is drawn a few times a second: quick folds end between two of them
    assert "of 3" in capsys.readouterr().err
