"""Where measured rows lie along a column, and causes that carry it with them."""

import copy
import pickle

import numpy as np
import pytest
from sklearn.base import clone
from tide import FRAME, context_of

import hybridsurrogate as hs
from hybridsurrogate.effects.context import UNKNOWN, Axis


def test_what_an_axis_knows():
    axis = Axis.of([3.0, 1.0, 1.0, 9.0])
    assert (axis.origin, axis.center, axis.mean, axis.span) == (1.0, 5.0, 3.5, 8.0)
    assert axis.spacing == 4.0
    assert axis.rows.tolist() == [1.0, 3.0, 9.0]
    assert axis.is_known
    assert not UNKNOWN.is_known
    np.testing.assert_allclose(axis.location_prior.support(), (1.0, 9.0))


def test_rows_that_are_all_the_same_have_a_span_of_one():
    axis = Axis.of([2.0, 2.0])
    assert (axis.span, axis.spacing) == (1.0, 1.0)


def test_a_jump_is_between_rows_and_within_its_prior():
    from scipy.stats import uniform

    gaps = Axis.of([0.0, 1.0, 4.0, 9.0]).gaps(uniform(0.5, 4.5))
    np.testing.assert_allclose(gaps, [[0.5, 1.0], [1.0, 4.0], [4.0, 5.0]])


@pytest.mark.parametrize(
    "cause",
    [hs.Step("t"), hs.Trend("t"), hs.MissingInput("wind", center=1.0), hs.Interaction("t", "dose")],
    ids=lambda cause: cause.kind,
)
def test_a_prepared_cause_keeps_its_axis(cause):
    """When it is copied, and when it is fitted to other rows."""
    prepared = cause.prepare(context_of())
    rows = {name: FRAME[name].to_numpy() for name in FRAME}
    theta = {
        name: np.full(len(FRAME), prior.median()) for name, prior in prepared.parameters.items()
    }
    expected = prepared.columns(rows, theta)
    again = prepared.prepare(context_of(FRAME.iloc[:40]))
    copies = [clone(prepared), copy.deepcopy(prepared), pickle.loads(pickle.dumps(prepared)), again]
    for one in copies:
        np.testing.assert_array_equal(one.columns(rows, theta), expected)


def test_causes_share_the_axis_of_a_column():
    context = context_of()
    assert hs.Step("t").prepare(context).axis is hs.Bump("t").prepare(context).axis


def test_an_axis_is_checked():
    rows = [[1.0], [2.0]], [1, 2]
    with pytest.raises(TypeError, match="axis of Trend must be an Axis of measured rows, got 3"):
        hs.PowerScaledSurrogate(None, effects=[hs.Trend("t", axis=3)]).fit(*rows)
    with pytest.raises(TypeError, match="measured of Limit must be an OutputScale"):
        hs.PowerScaledSurrogate(None, effects=[hs.Limit(measured=3)]).fit(*rows)
