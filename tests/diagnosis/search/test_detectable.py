"""What a fitted diagnosis says of causes that it did not detect."""

import numpy as np
import pytest
from few_kinds import all_but
from scipy.stats import norm

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.simulated import size_at

# every tenth data set confounds a quadratic trend and the slope
pytestmark = pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
NOISE, T = 0.2, np.linspace(0, 10, 40)
FEW = all_but("step", "trend", "periodic")


def line(t, slope):
    return slope * t


def diagnosed(y):
    simulator = hs.Simulator(line, inputs={"t": (0, 10)}, parameters={"slope": norm(1, 0.5)})
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    settings = {"exclude": FEW, "cv": None, "n_replicates": 99}
    return hs.DiscrepancyDiagnosis(model, random_state=0, **settings).fit(T[:, None], y)


def clean(seed):
    return T + NOISE * np.random.default_rng(seed).standard_normal(len(T))


def test_a_step_of_that_height_is_detected_in_nine_of_ten_data_sets():
    found = diagnosed(clean(0))
    assert found.verdict_ == "adequate"
    table = found.detectable_.set_index("kind")
    assert set(table.index) >= {"step", "trend", "periodic"}
    assert table["size"].between(0.3, 4).all()
    height, seen = table.loc["step", "change"], []
    for seed in range(1, 21):
        # jumps from 0 and jumps to 0, anywhere
        rng = np.random.default_rng(seed)
        after = rng.uniform(0, 10) < T
        jump = rng.choice([-1, 1]) * height * (after if rng.uniform() < 0.5 else ~after)
        seen.append(diagnosed(clean(seed) + jump))
    # binomial, 20 data sets at nine of ten or more: 13 or fewer in 1 of 400
    assert sum(one.verdict_ != "adequate" for one in seen) >= 14
    assert all(one.detectable_ is None for one in seen if one.found_causes_[0].kind != "none")
    assert "a step from" in str(found.report())


def test_where_a_rate_rises_to_a_power():
    sizes = np.array([1.0, 2.0, 4.0])
    assert size_at(sizes, np.array([0.95, 1.0, 1.0]), 0.9) == 1.0
    assert size_at(sizes, np.array([0.0, 0.8, 1.0]), 0.9) == pytest.approx(2 * np.sqrt(2))
    # a rate that falls by chance
    assert size_at(sizes, np.array([0.0, 0.9, 0.85]), 0.9) == pytest.approx(2.0)
    assert np.isnan(size_at(sizes, np.array([0.0, 0.5, 0.8]), 0.9))
