"""Rows that may be scored though nothing could be fitted to them."""

import numpy as np
import pytest
from sklearn.base import clone

import hybridsurrogate as hs


def test_one_row_can_be_scored_but_not_fitted(fitted, measured):
    X, y = measured
    one = (np.arange(len(y)) == 3).astype(float)
    alone = fitted.score(X[3:4], y[3:4])
    assert fitted.score(X[3:4], y[3:4], sample_weight=[2.0]) == pytest.approx(alone)
    assert fitted.score(X, y, sample_weight=one) == pytest.approx(alone)
    with pytest.raises(ValueError, match="leaves 1 sample"):
        clone(fitted).fit(X, y, sample_weight=one)
