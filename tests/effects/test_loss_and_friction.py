"""A share that is lost from some place on, and what turns with the sign of a column."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm
from tide import FRAME, SIMULATOR, context_of

import hybridsurrogate as hs
from hybridsurrogate.catalogue import catalogue


def diagnosed(simulator, X, y):
    model = hs.PowerScaledSurrogate(simulator, hs.ExactSurrogate(), n_draws=400, random_state=0)
    return hs.DiscrepancyDiagnosis(model, cv=None, n_replicates=39, random_state=0).fit(X, y)


def holds(found, name, truth):
    """Return whether the 99 % interval of the leading cause's number holds the truth."""
    after = found.extended_estimator_
    leading = getattr(after, "estimators_", [after])[0]
    low, high = np.quantile(leading.posterior_.estimates(0)[name], [0.005, 0.995])
    return low < truth < high


def test_a_loss_is_told_from_a_straight_line_and_foresees_what_is_left():
    """Blind: a vaccine from 1963 on, after which cases halve every two years."""
    rng = np.random.default_rng(4)
    year = np.arange(1945.0, 1985.0)
    cases = 300 * np.exp(-np.maximum(year - 1963, 0) * np.log(2) / 2)
    y = cases + 20 * rng.standard_normal(len(year))
    simulator = hs.Simulator(
        lambda year, mean: mean + 0 * year,
        inputs={"year": (1945, 2000)},
        parameters={"mean": hs.truncated_normal(300, 50, 100, 500)},
    )
    seen = year < 1972
    found = diagnosed(simulator, year[seen, None], y[seen])
    best = found.best_cause_
    assert (best.kind, best.target) == ("ramp", "year")
    leading = found.search_.candidates[int(np.argmax(found.search_.probability))].cause
    assert leading.variant == "loss"
    assert holds(found, "location", 1963.0)
    assert holds(found, "scale", 2 / np.log(2))
    # a line would be far below zero by now
    later = found.extended_estimator_.predict(year[~seen, None])
    assert np.sqrt(np.mean((later - cases[~seen]) ** 2)) < 20


def test_a_loss_of_a_logarithmic_output_is_a_ramp():
    with pytest.raises(ValueError, match=r"use Ramp\('t'\), which is the same"):
        hs.Loss("t").prepare(context_of(likelihood="lognormal"))
    causes, skipped = catalogue(context_of(likelihood="lognormal"))
    assert not any(isinstance(cause, hs.Loss) for cause in causes)
    assert any(s.kind == "ramp" and "ramp is the same" in s.reason for s in skipped)


def test_an_episode_of_a_logarithmic_output_is_a_factor_already():
    with pytest.raises(ValueError, match=r"Episode\('t'\) is a factor"):
        hs.Episode("t", factor=True).prepare(context_of(likelihood="lognormal"))
    causes, skipped = catalogue(context_of(likelihood="lognormal"))
    assert [c.variant for c in causes if isinstance(c, hs.Episode)] == [""] * 2
    assert any(s.kind == "episode" and "episode is the same" in s.reason for s in skipped)


def test_another_unit_for_some_years_is_named_and_foresees_the_years_after():
    """Blind: minutes were written down instead of calls, of six minutes each."""
    rng = np.random.default_rng(12)
    year = np.arange(1950.0, 1980.0)
    calls = 2 + 0.8 * (year - 1950)
    recorded = np.where((year >= 1962) & (year < 1970), 6 * calls, calls)
    y = recorded + 0.8 * rng.standard_normal(len(year))
    simulator = hs.Simulator(
        lambda year, start, growth: start + growth * (year - 1950),
        inputs={"year": (1950, 1990)},
        parameters={"start": norm(3, 3), "growth": norm(1, 1)},
    )
    seen = year < 1974
    found = diagnosed(simulator, year[seen, None], y[seen])
    assert (found.best_cause_.kind, found.best_cause_.target) == ("episode", "year")
    assert holds(found, "factor", 6.0)
    later = found.extended_estimator_.predict(year[~seen, None])
    assert np.sqrt(np.mean((later - calls[~seen]) ** 2)) < 1.5


def measured_carriage(n=60):
    rng = np.random.default_rng(7)
    frame = pd.DataFrame({"acceleration": rng.uniform(-3, 3, n), "velocity": rng.normal(0, 0.1, n)})
    y = 95 * frame.acceleration + 200 * frame.velocity + 20 * np.sign(frame.velocity)
    return frame, y.to_numpy() + 5 * rng.standard_normal(n)


CARRIAGE = hs.Simulator(
    lambda acceleration, mass: mass * acceleration,
    inputs={"acceleration": (-3, 3)},
    parameters={"mass": norm(90, 10)},
    output="force",
)


def test_friction_is_found_in_a_carriage_that_knows_none():
    """Blind: viscous and dry friction as in EMPS, the mass unknown."""
    frame, y = measured_carriage()
    found = diagnosed(CARRIAGE, frame, y)
    best = found.best_cause_
    assert (found.verdict_, best.kind, best.target) == ("named", "missing-input", "velocity")
    assert holds(found, "viscous", 200.0)
    assert holds(found, "dry", 20.0)
    assert "depends on velocity as by friction" in str(found.report(full=True))
    # its slope is that over the column in half spans
    slope = 200.0 * np.ptp(frame["velocity"]) / 2
    rows = np.array([[0.0, 0.1], [0.0, -0.1]])
    forces = found.extended_simulator_(rows, np.tile([95.0, slope, 20.0], (2, 1)))
    np.testing.assert_allclose(forces, [40.0, -40.0])


def test_friction_needs_rows_on_both_sides_of_zero():
    def offered(wind):
        causes, skipped = catalogue(context_of(FRAME.assign(wind=wind), SIMULATOR))
        reasons = [s.reason for s in skipped if "side of zero" in s.reason]
        return any(isinstance(cause, hs.Friction) for cause in causes), reasons

    wind = FRAME.wind - FRAME.wind.mean()
    assert offered(wind) == (True, [])
    taken, reasons = offered(wind - wind.min())
    assert not taken
    assert reasons == ["friction: wind has fewer than 3 distinct values on one side of zero"]
