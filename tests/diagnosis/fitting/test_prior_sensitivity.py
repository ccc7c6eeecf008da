"""Whether a verdict rests on a prior: first order against priors that are really others."""

from functools import cache

import numpy as np
import pytest
from few_kinds import all_but
from scipy.stats import norm

import hybridsurrogate as hs

T = np.linspace(0, 10, 40)


def line(t, level, slope):
    return level + slope * t


@cache
def diagnosed(size, width=1.0):
    y = line(T, 1.5, 2.2) + size * (T > 6) + 0.3 * np.random.default_rng(0).standard_normal(40)
    priors = {"level": norm(0, 3 * width), "slope": norm(2, 0.5 * width)}
    model = hs.PowerScaledSurrogate(
        hs.Simulator(line, {"t": (0, 10)}, priors),
        surrogate=hs.ExactSurrogate(),
        n_draws=100,
        random_state=0,
    )
    diagnosis = hs.DiscrepancyDiagnosis(
        model, cv=None, n_replicates=40, random_state=0, exclude=all_but("trend", "step", "gain")
    )
    return diagnosis.fit(T[:, None], y)


def row(table, prior, factor):
    return table[(table["prior"] == prior) & (table["factor"] == factor)].iloc[0]


@pytest.mark.parametrize("size", [0.0, 0.55, 3.0])
def test_the_first_row_is_the_verdict_as_it_is(size):
    found = diagnosed(size)
    first = found.sensitivity().iloc[0]
    assert first["verdict"] == found.verdict_
    assert first["cause"] == found.best_cause_.kind
    assert first["probability"] == pytest.approx(found.best_cause_.probability)
    assert not first["changes"]


@pytest.mark.parametrize("width", [0.5, 2.0])
def test_other_widths_of_parameters_are_as_in_a_diagnosis_with_them(width):
    """The simulation is linear: first order is all there is."""
    told = row(diagnosed(0.55).sensitivity(), "parameters", width)
    true = diagnosed(0.55, width).sensitivity().iloc[0]
    assert told["nothing"] == pytest.approx(true["nothing"], abs=0.02)


def test_the_odds_of_nothing_are_what_was_asked_for():
    table = diagnosed(0.55).sensitivity()
    nothing = table["nothing"][0]
    for factor in (0.5, 2.0):
        odds = factor * nothing / (1 - nothing)
        told = row(table, "nothing is wrong", factor)["nothing"]
        assert told == pytest.approx(odds / (1 + odds), abs=1e-6)


def test_what_is_certain_rests_on_no_prior_and_what_is_even_rests_on_its_odds():
    assert not diagnosed(3.0).sensitivity()["changes"].any()
    sizes = np.linspace(0.1, 0.3, 5)
    nearly = min(sizes, key=lambda size: abs(np.log(_odds(diagnosed(size)))))
    assert abs(np.log(_odds(diagnosed(nearly)))) < np.log(2)
    table = diagnosed(nearly).sensitivity()
    assert table[table["prior"] == "nothing is wrong"]["changes"].any()


def _odds(found):
    nothing = found.search_.probability[0]
    return nothing / (1 - nothing)
