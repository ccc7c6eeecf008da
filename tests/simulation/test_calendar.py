"""A column of dates stands for weekday, weekend and month."""

import datetime

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but

import hybridsurrogate as hs
from hybridsurrogate.simulation.arrays import complete_table

NAMES = ["t", "weekday of day", "weekend of day", "month of day"]


def dated(n=42, start="2026-09-28"):
    days = pd.date_range(start, periods=n)
    return pd.DataFrame({"t": np.arange(float(n)), "day": days})


def test_weekdays_are_those_of_iso_8601():
    frame = dated(800, "2023-12-30")
    table = complete_table(frame)
    assert list(table) == NAMES
    told = [datetime.date(2023, 12, 30) + datetime.timedelta(k) for k in range(800)]
    assert table["weekday of day"].tolist() == [day.isoweekday() for day in told]
    assert table["month of day"].tolist() == [day.month for day in told]
    assert table["weekend of day"].tolist() == [float(day.isoweekday() > 5) for day in told]
    assert "day" in frame


@pytest.mark.parametrize("zone", ["UTC", "Europe/Rome"])
def test_dates_with_a_time_zone_are_local(zone):
    frame = dated()
    there = frame.assign(day=frame["day"].dt.tz_localize(zone))
    pd.testing.assert_frame_equal(complete_table(there), complete_table(frame))


def test_a_date_that_is_missing_is_told_by_its_name():
    frame = dated()
    frame.loc[4, "day"] = pd.NaT
    with pytest.raises(ValueError, match=r"column 'day' are missing \(NaN\), the first in row 5"):
        complete_table(frame)


def test_an_input_of_the_simulation_is_a_number():
    frame = dated().rename(columns={"t": "count", "day": "t"})
    simulator = hs.Simulator(lambda t: t, {"t": (0, 42)})
    model = hs.PowerScaledSurrogate(simulator, hs.ExactSurrogate())
    with pytest.raises(ValueError, match=r"inputs \['t'\] hold dates, not numbers: count them"):
        model.fit(frame, frame["count"])


def test_dates_as_text_are_dates():
    table = pd.DataFrame(
        {
            "t": [1.0, 2.0, 3.0],
            "day": ["2026-11-27", "2026-11-28", "2026-11-29"],
            "at": ["2026-11-27T10:00:00", "2026-11-28 11:30", "2026-11-29T12:00:00+00:00"],
            "lab": ["A", "B", "A"],
        }
    )
    assert complete_table(table)["weekday of day"].tolist() == [5, 6, 7]
    assert complete_table(table)["weekday of at"].tolist() == [5, 6, 7]
    # no day of any calendar
    wrong = table.assign(day=["2026-11-27", "2026-11-28", "2026-11-31"])
    assert "day" in complete_table(wrong)


def line(t, level, slope):
    return level + slope * t


SIMULATOR = hs.Simulator(
    line,
    {"t": (0, 60)},
    {"level": hs.truncated_normal(10, 5, 0, 30), "slope": hs.truncated_normal(0, 1, -3, 3)},
)


FEW = all_but("missing-input", "step", "trend")


def diagnosed(effect, seed, n=42, exclude=FEW):
    """A line with an effect of the calendar, and a diagnosis that knows the dates."""
    frame = dated(n)
    t, day = frame["t"].to_numpy(), frame["day"].dt
    rng = np.random.default_rng(seed)
    y = 8 + 0.2 * t + effect(day) + 0.5 * rng.standard_normal(n)
    model = hs.PowerScaledSurrogate(SIMULATOR, hs.ExactSurrogate(), n_draws=200, random_state=0)
    settings = {"exclude": exclude, "cv": None, "n_replicates": 39, "random_state": 0}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings)
    return diagnosis.fit(frame, y), frame


def test_a_weekend_that_the_simulation_does_not_know():
    found, _ = diagnosed(lambda day: -1.5 * (day.day_of_week >= 5).to_numpy(), 0)
    best = found.best_cause_
    assert (best.kind, best.target) == ("missing-input", "weekend of day")
    assert found.verdict_ in ("named", "ambiguous")
    _, low, high = best.estimates["slope"]
    assert low < -1.5 < high
    assert "weekend of day" in str(found.report(full=True))
    # predictions take dates as well, of rows that follow
    later = dated(14, "2026-11-09").assign(t=42.0 + np.arange(14))
    told = found.predict(later)
    saturday = later["day"].dt.day_of_week.to_numpy() == 5
    trend = 8 + 0.2 * later["t"].to_numpy()
    assert (told - trend)[saturday].mean() < -0.75
    assert found.update(later, trend - 1.5 * (later["day"].dt.day_of_week >= 5)).holds


def test_one_weekday_is_off():
    found, _ = diagnosed(lambda day: 2.0 * (day.day_of_week == 0).to_numpy(), 1)
    assert (found.best_cause_.kind, found.best_cause_.target) == ("missing-input", "weekday of day")
    assert found.extended_estimator_.effects[0].level == 1


def test_nothing_of_the_calendar_is_an_axis():
    found, _ = diagnosed(lambda day: 0.0, 2, exclude=())
    assert found.verdict_ == "adequate"
    assert found.best_cause_.kind == "none"
    told = found.causes_[found.causes_["log_evidence"].notna()]
    of_weekday = set(told.loc[told["target"] == "weekday of day", "form"])
    assert of_weekday
    assert not any("trend" in form or "periodic" in form for form in of_weekday)


@pytest.mark.slow
def test_effects_of_the_calendar_are_found_and_nothing_else_is():
    rng = np.random.default_rng(0)
    week = rng.standard_normal(7)
    week *= 1.5 / np.std(week)
    hidden = {
        "weekend": lambda day: -1.5 * (day.day_of_week >= 5).to_numpy(),
        "weekday": lambda day: week[day.day_of_week],
        "month": lambda day: 1.5 * (day.month == 10).to_numpy(),
    }
    shares = {}
    for name, effect in hidden.items():
        right = []
        for seed in range(10):
            diagnosis, _ = diagnosed(effect, 100 + seed, n=60)
            # a level that differs by weekday, or by month, is the same curve
            leading = diagnosis.causes_[["form", "target"]].iloc[0]
            right.append(f"{name} of day" in " ".join(leading))
            assert "missing-input" in diagnosis.indistinguishable_
        shares[name] = np.mean(right)
    # two standard errors of ten below 90 %
    assert min(shares.values()) >= 0.7, shares
    alarms = [diagnosed(lambda day: 0.0, 200 + s)[0].verdict_ != "adequate" for s in range(20)]
    assert np.mean(alarms) <= 0.15
