"""Runs that are curves, recognised in rows and taken apart."""

import numpy as np
import pytest

from hybridsurrogate.surrogates.emulation.curves import curves_of

T = np.linspace(0, 6, 40)
RATES = np.random.default_rng(0).uniform(0.2, 1, 30)
FALL = np.exp(-RATES[:, None] * T)


def rows(times=T, outputs=FALL, rates=RATES):
    """Return inputs, parameters and outputs of all rows, in no order."""
    t = np.broadcast_to(times, outputs.shape)
    order = np.random.default_rng(1).permutation(outputs.size)
    there = np.isfinite(outputs.ravel()[order])
    table = [t.ravel(), np.repeat(rates, outputs.shape[1]), outputs.ravel()]
    t, rate, y = (column[order][there] for column in table)
    return t[:, None], rate[:, None], y


def test_rows_of_equal_parameters_are_one_run():
    curves = curves_of(*rows())
    order = np.argsort(RATES)
    np.testing.assert_array_equal(curves.places, T)
    np.testing.assert_array_equal(curves.others[:, 0], RATES[order])
    np.testing.assert_allclose(curves.outputs, FALL[order])


def test_single_rows_are_no_curves():
    rng = np.random.default_rng(0)
    X, omega = rng.uniform(size=(300, 1)), rng.uniform(size=(300, 1))
    assert curves_of(X, omega, X[:, 0]) is None
    assert curves_of(X, np.empty((300, 0)), X[:, 0]) is None
    # nor are a few runs, from which nothing is learned about parameters
    assert curves_of(*rows(outputs=FALL[:5], rates=RATES[:5])) is None


def test_the_input_along_which_runs_are_curves_is_found():
    X, omega, y = rows()
    depth = np.interp(omega[:, 0], np.sort(RATES), np.linspace(1, 2, 30))
    curves = curves_of(np.column_stack([depth, X[:, 0]]), omega, y)
    assert curves.along == 1
    assert curves.others.shape == (30, 2)


@pytest.mark.parametrize("step", [1e-3, 0.03])
def test_runs_with_places_of_their_own_meet_on_one_grid(step):
    own = T + np.random.default_rng(2).uniform(-step, step, (30, 1))
    curves = curves_of(*rows(own, np.exp(-RATES[:, None] * own)))
    exact = np.exp(-curves.others * curves.places)
    inner = slice(2, -2)
    np.testing.assert_allclose(curves.outputs[:, inner], exact[:, inner], atol=2e-3)


def test_missing_pieces_are_what_the_other_runs_say():
    outputs = FALL.copy()
    outputs[3, 30:] = np.nan
    outputs[7, :5] = np.nan
    outputs[9, 10:14] = np.nan
    curves = curves_of(*rows(outputs=outputs))
    np.testing.assert_allclose(curves.outputs, FALL[np.argsort(RATES)], atol=0.01)


def test_the_error_between_places_is_told():
    between = np.linspace(0, 6, 301)
    fall = curves_of(*rows())
    _, parts, error = fall.components.at(between)
    assert parts.shape[1] < 8
    assert np.hypot(error, fall.between.sd(between)).max() < 1e-3
    # steps are met by lines, which do not swing
    stepped = curves_of(*rows(outputs=(FALL > 0.4).astype(float)))
    assert stepped.degree == 1
    bent = curves_of(*rows(outputs=np.maximum(FALL, 0.4)))
    mean, parts, _ = bent.components.at(between)
    told = mean + bent.components.coefficients @ parts.T
    missed = np.sqrt(np.mean((told - np.maximum(np.exp(-bent.others * between), 0.4)) ** 2))
    said = np.sqrt(np.mean(bent.between.sd(between) ** 2))
    assert 0.3 < missed / np.hypot(said, 1e-3 * np.std(bent.outputs)) < 3


def test_components_hold_all_but_a_thousandth():
    curves = curves_of(*rows())
    mean, parts, error = curves.components.at(T)
    told = mean + curves.components.coefficients @ parts.T
    missed = np.sqrt(np.mean((told - curves.outputs) ** 2))
    assert missed < 1e-3 * np.std(curves.outputs)
    # what they leave at the runs themselves is what is stated
    np.testing.assert_allclose(np.sqrt(np.mean(error**2)), missed, rtol=1e-6)


def test_places_beyond_the_runs_are_held_at_the_ends():
    components = curves_of(*rows()).components
    at, beyond = components.at(np.array([0.0, 6.0])), components.at(np.array([-5.0, 50.0]))
    for one, other in zip(at, beyond, strict=True):
        np.testing.assert_array_equal(one, other)
