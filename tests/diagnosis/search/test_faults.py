"""How large a fault would have shown: the same in one batch with the null test as by itself."""

import numpy as np
import pytest
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.null_test import faults_of, null_test
from hybridsurrogate.diagnosis.search.simulated import smallest_detectable


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


def test_faults_in_one_batch_are_those_by_themselves(found):
    search = found.search_
    alone, by_itself = null_test(search, 20, np.random.RandomState(1)), faults_of(search)
    both = null_test(search, 20, np.random.RandomState(1), with_faults=True)
    np.testing.assert_allclose(both.statistic, alone.statistic, atol=1e-6)
    np.testing.assert_allclose(both.replicates, alone.replicates, atol=1e-6)
    np.testing.assert_allclose(both.faults.statistic, by_itself.statistic, rtol=1e-6, atol=1e-6)
    assert smallest_detectable(search, both, 0.05) == pytest.approx(
        smallest_detectable(search, alone, 0.05)
    )


def test_where_nothing_is_found_the_test_has_looked_at_faults(found):
    """Sixteen times what the null leaves shows in all data sets."""
    assert found.verdict_ == "adequate"
    faults = found.result_.test.faults
    limit = np.quantile(found.result_.test.replicates, 0.95)
    assert np.all(faults.statistic[:, -1] > limit)
    assert 0 < found.smallest_detectable_ <= faults.sizes[-1]
