"""What a diagnosis cannot work with is told before its search."""

import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs

SIMULATOR = hs.Simulator(lambda t, a: a * t, {"t": (0, 10)}, {"a": hs.truncated_normal(3, 1, 0, 6)})
T = np.linspace(0, 10, 20)
Y = 2 * T + 0.1 * np.random.default_rng(0).standard_normal(20)
MODEL = hs.PowerScaledSurrogate(SIMULATOR, surrogate=hs.ExactSurrogate(), random_state=0)


@pytest.mark.parametrize("causes", [hs.Offset(), [3], ["trend"], [hs.Trend]], ids=repr)
def test_causes_that_are_none(causes):
    diagnosis = hs.DiscrepancyDiagnosis(MODEL, causes=causes)
    with pytest.raises(TypeError, match=r"causes must be a sequence of causes such as"):
        diagnosis.fit(T[:, None], Y)


def test_a_measured_column_that_is_called_like_a_parameter():
    X = pd.DataFrame({"t": T, "a": np.cos(T)})
    with pytest.raises(ValueError, match=r"columns \['a'\] are called like parameters .* rename"):
        hs.DiscrepancyDiagnosis(MODEL).fit(X, Y)
