"""Simulation-based calibration with few data sets; `examples.studies.calibration` has more."""

import pytest
from calibration import MODELS, p_values

pytestmark = pytest.mark.statistical


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "n_sets"), list(zip(MODELS, (30, 20, 20), strict=True)), ids=[*MODELS]
)
def test_ranks_are_uniform(name, n_sets):
    found = p_values(name, n_sets, first_seed=10_000)
    # three quantities of three models: Bonferroni at 1 %
    assert min(found.values()) > 0.01 / 9
