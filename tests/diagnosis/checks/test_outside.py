"""How sure a name is where causes that the catalogue does not hold count as well."""

import numpy as np
import pytest
from few_kinds import all_but
from hidden_effects.cases import make_case

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.fitting.verdict import probability_right


def test_a_surer_search_is_a_surer_name_and_never_surer_than_the_search():
    shares = np.r_[0.0, np.linspace(0.05, 0.95, 19), 0.999, 1.0]
    told = [probability_right(share, False) for share in shares]
    assert np.all(np.diff(told) >= 0)
    assert np.all(told <= shares)
    # what it leaves speaks against it
    assert probability_right(0.99, True) < probability_right(0.99, False)
    assert 0 < probability_right(1.0, False) < 1


def diagnosed(kind, size, seed=0):
    case = make_case(kind, size, seed, simulation="cooling")
    model = hs.PowerScaledSurrogate(
        case.simulator, surrogate=hs.ExactSurrogate(), n_draws=200, random_state=0
    )
    settings = {"exclude": all_but("periodic", "trend", "step"), "cv": None, "n_replicates": 39}
    return hs.DiscrepancyDiagnosis(model, **settings, random_state=0).fit(case.X, case.y)


@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
def test_it_is_told_with_the_name():
    found = diagnosed("periodic", 4.0)
    assert found.verdict_ == "named"
    right = found.probability_right_
    assert 0 < right <= found.best_cause_.probability
    report = found.report()
    assert report.to_dict()["probability_right"] == pytest.approx(right)
    text = " ".join(str(found.report(full=True)).split())
    assert "7 had one that the catalogue does not hold" in text
    assert f"is right with a probability of {100 * right:.0f} %" in text


@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
def test_nothing_found_has_no_name_to_be_sure_of():
    found = diagnosed("none", 0.0)
    assert found.verdict_ == "adequate"
    assert found.probability_right_ is None
