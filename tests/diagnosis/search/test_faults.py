"""How large a fault would have shown."""

import numpy as np
import pytest
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.null_test import faults_of


@pytest.fixture(scope="module")
def found():
    """A line without a fault."""
    t = np.linspace(0, 10, 30)
    simulator = hs.Simulator(
        lambda t, level: level + 2 * t, {"t": (0, 10)}, {"level": stats.norm()}
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=50, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, n_replicates=20, random_state=0)
    y = 1 + 2 * t + 0.3 * np.random.default_rng(3).standard_normal(30)
    return diagnosis.fit(t[:, None], y)


def test_where_nothing_is_found_the_test_has_looked_at_faults(found):
    """Sixteen times what the null leaves shows in all data sets."""
    assert found.verdict_ == "adequate"
    sizes, statistic = faults_of(found.search_)
    limit = np.quantile(found.result_.test.replicates, 0.95)
    assert np.all(statistic[:, -1] > limit)
    assert 0 < found.smallest_detectable_ <= sizes[-1]
