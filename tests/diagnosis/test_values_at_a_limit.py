"""Values below a limit in a diagnosis."""

import numpy as np
import pytest
from scipy.stats import norm

import hybridsurrogate as hs


def cooling(t, start, rate, ambient):
    return ambient + start * np.exp(-rate * t)


@pytest.mark.slow
def test_a_cause_is_named_where_a_third_of_the_rows_are_below_a_limit():
    simulator = hs.Simulator(
        cooling,
        inputs={"t": (0, 20)},
        parameters={
            "start": hs.truncated_normal(60, 10, 20, 100),
            "rate": hs.truncated_normal(0.3, 0.1, 0.05, 0.8),
        },
        assumed={"ambient": hs.Assumed(20.0, norm(20, 4))},
    )
    random = np.random.default_rng(0)
    t = np.sort(random.uniform(0, 12, 50))
    y = cooling(t, 63, 0.25, 20) + 1.5 * np.sin(2 * np.pi * t / 3.1)
    y = np.maximum(y + 0.5 * random.standard_normal(50), 27.0)
    named = {}
    for likelihood in ("normal", hs.Censored(below=27.0)):
        model = hs.PowerScaledSurrogate(
            simulator, hs.ExactSurrogate(), likelihood=likelihood, n_draws=200, random_state=0
        )
        diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, n_replicates=50, random_state=0)
        named[likelihood] = diagnosis.fit(t[:, None], y).best_cause_
    # the limit as a value is a bend that no wave has
    without, found = named.values()
    assert without.kind != "periodic"
    assert found.kind == "periodic"
    assert found.estimates["period"][0] == pytest.approx(3.1, rel=0.03)
    top, _ = diagnosis.plot()
    assert "at most" in top.get_legend_handles_labels()[1]
