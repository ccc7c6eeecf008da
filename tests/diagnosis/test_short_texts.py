"""What a notebook shows of a fitted diagnosis: short, quick, the verdict in it."""

from html import unescape

import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin
from hybridsurrogate.diagnosis.validation.gain import Scores, gain_from
from hybridsurrogate.effects.registry import kinds


@pytest.fixture(scope="module")
def fitted():
    case = make_log_sin(random_state=0)
    model = hs.PowerScaledSurrogate(
        case.simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    )
    exclude = sorted({*kinds()} - {"offset", "trend", "periodic"})
    return hs.DiscrepancyDiagnosis(
        model, exclude=exclude, cv=2, n_replicates=50, random_state=0
    ).fit(case.X, case.y)


def test_the_notebook_shows_the_verdict_at_once(fitted, monkeypatch):
    def slow(*_, **__):
        raise AssertionError("nothing is fitted or drawn for a cell of a notebook")

    for name in ("fit", "fit_data", "sample_posterior_predictive"):
        monkeypatch.setattr(hs.PowerScaledSurrogate, name, slow)
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", slow)
    shown = unescape(fitted._repr_mimebundle_()["text/html"])
    monkeypatch.undo()
    assert fitted.report().headline in shown
    assert "How sure is the cause?" in shown
    assert "n_replicates=50" in shown  # the settings are there, folded
    assert unescape(fitted._repr_html_()) == shown


def test_before_fit_the_notebook_shows_the_settings():
    shown = hs.DiscrepancyDiagnosis(max_causes=2)._repr_html_()
    assert "max_causes" in shown


def test_everything_prints_in_a_few_lines(fitted):
    tables = pd.DataFrame | hs.DiscrepancyDiagnosis
    found = {k: v for k, v in vars(fitted).items() if k.endswith("_") and not isinstance(v, tables)}
    step = fitted.result_.steps[0]
    inside = [step, step.search, step.chosen, step.test, step.search.problem, step.chosen.fit.model]
    estimator = fitted.estimator_
    inside += [estimator.posterior_, estimator.simulation, estimator.simulation.run(8)]
    for value in [*found.values(), *inside]:
        assert len(repr(value)) < 2000, type(value)
    for value in (fitted.result_, fitted.search_, fitted.gain_, *inside):
        assert len(repr(value)) < 300, repr(value)


def test_a_gain_prints_as_a_table():
    random = np.random.default_rng(0)
    error = random.normal(0, [[2.0], [1.0]], (2, 400))
    one = np.ones(400)
    before, after = (
        Scores(-np.abs(e), e, 1.0 * (np.abs(e) < 2.5), 1.0 * (np.abs(e) < 1), one) for e in error
    )
    gain = gain_from(before, after)
    lines = str(gain).splitlines()
    assert lines[0].split() == ["before", "after", "difference"]
    assert [line.split("  ")[0] for line in lines[1:5]] == [
        "ELPD a row", "RMSE", "in 90 % intervals", "in 50 % intervals",
    ]  # fmt: skip
    assert max(map(len, lines)) < 80
    # the error of a difference of two roots, against rows drawn anew
    roots = []
    for _ in range(2000):
        some = error[:, random.integers(0, 400, 400)]
        roots.append(np.diff(np.sqrt(np.mean(some**2, axis=1)))[0])
    assert gain.rmse_error == pytest.approx(np.std(roots), rel=0.1)


def test_predictions_whose_squares_overflow_have_an_infinite_error_and_no_warning_of_numpy():
    one = np.ones(3)
    near, far = (Scores(-one, k * one, one, one, one) for k in (1.0, 1e200))
    gain = gain_from(near, far)
    assert gain.rmse_before == 1
    assert gain.rmse_after == np.inf


def test_a_row_of_weight_two_scores_like_two_rows():
    log_density, error = np.array([-1.0, -2.0, -4.0]), np.array([0.1, -0.2, 1.0])
    inside, twice = np.array([1.0, 1.0, 0.0]), np.array([0, 1, 2, 2])
    weighted = gain_from(
        Scores(log_density, error, inside, inside, np.array([1.0, 1.0, 2.0])),
        Scores(log_density + 1, error / 2, inside, inside, np.array([1.0, 1.0, 2.0])),
    )
    repeated = gain_from(
        Scores(log_density[twice], error[twice], inside[twice], inside[twice], np.ones(4)),
        Scores(log_density[twice] + 1, error[twice] / 2, inside[twice], inside[twice], np.ones(4)),
    )
    for name in ("elpd_before", "elpd_difference", "rmse_before", "rmse_after", "coverage_before"):
        assert getattr(weighted, name) == pytest.approx(getattr(repeated, name)), name
