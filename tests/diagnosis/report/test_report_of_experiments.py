"""A report on experiments that differ: one panel for each, by its name."""

import numpy as np
import pytest
from batches import DECAY, batches

import hybridsurrogate as hs


@pytest.fixture(scope="module")
def report():
    X, y, _ = batches(0, n=5, spread=0.3)
    model = hs.PowerScaledSurrogate(
        DECAY, surrogate=hs.ExactSurrogate(), experiment="batch", random_state=0
    )
    found = hs.DiscrepancyDiagnosis(model, cv=None, n_replicates=20, random_state=0).fit(X, y)
    assert found.best_cause_.kind == "parameter-by-experiment"
    return found.report()


def test_each_experiment_has_a_panel(report):
    (place,) = (s for s in report.sections if s.title == "Where the simulation is wrong")
    picture = place.pictures[1].drawn
    assert picture.description.startswith("For each batch: measured minus simulated y over x")
    assert picture.svg.startswith(b"<?xml")
    assert picture.description in report.to_html()
    assert report.headline == "rate differs between experiments, and the simulation has one value."


def test_without_experiments_there_is_none():
    rng = np.random.default_rng(0)
    x = rng.uniform(0, 4, 40)
    y = 3 * np.exp(-0.5 * x) + 0.3 * (x > 2) + 0.05 * rng.standard_normal(40)
    model = hs.PowerScaledSurrogate(DECAY, surrogate=hs.ExactSurrogate(), random_state=0)
    found = hs.DiscrepancyDiagnosis(model, cv=None, n_replicates=20, random_state=0)
    sections = found.fit(x[:, None], y).report().sections
    (place,) = (s for s in sections if s.title == "Where the simulation is wrong")
    assert len(place.pictures) == 1


@pytest.mark.slow
def test_a_curve_beside_another_cause_hides_no_parameter():
    """A smooth curve of unknown shape has no waves in the extended simulator."""
    X, y, _ = batches(501, n=8)
    X = X.assign(batch=X.batch.str[1:].astype(int) + 1)
    model = hs.PowerScaledSurrogate(DECAY, surrogate=hs.ExactSurrogate(), random_state=0)
    found = hs.DiscrepancyDiagnosis(
        model, cv=None, max_causes=2, n_replicates=50, random_state=0
    ).fit(X, y + 0.15 * (X.x > 2))
    kinds = [cause.kind for cause in found.found_causes_]
    assert kinds == ["parameter-by-experiment", "unexplained"]
    text = " ".join(str(found.report(full=True)).split())
    assert "with the parameters rate, level, spread" in text
    assert "amplitudes of waves" not in text
