"""How fast a wave may be that rows resolve."""

import numpy as np
import pandas as pd
import pytest
from tide import context_of

import hybridsurrogate as hs
from hybridsurrogate.effects.context import highest_frequency

RNG = np.random.default_rng(0)


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (np.arange(100.0), 0.5),
        (np.arange(2000) * 0.1, 5.0),
        (np.linspace(0, 14, 40), 39 / 28),
        # a quarter of the days is missing
        (np.delete(np.arange(100.0), RNG.choice(98, 25, replace=False) + 1), 0.5),
        # days whose hour varies little, and two rows each
        (np.arange(100) + 0.05 * RNG.standard_normal(100), 0.5),
        (np.repeat(np.arange(50.0), 2) + np.tile([0, 0.01], 50), 0.5),
    ],
    ids=["even", "many", "to the end", "gaps", "jitter", "pairs"],
)
def test_even_rows_resolve_their_nyquist_frequency(rows, expected):
    assert highest_frequency(rows, 2500) == pytest.approx(expected, rel=0.01)


def test_irregular_rows_resolve_faster_waves_than_even_ones():
    rows = RNG.uniform(0, 1000, 200)
    even = 199 / (2 * np.ptp(rows))
    assert highest_frequency(rows, 2500) == pytest.approx(5 * even)
    # rows without end have no end of frequencies to try
    many = RNG.uniform(0, 1000, 20_000)
    assert highest_frequency(many, 2500) == pytest.approx(2.5, rel=1e-3)


def test_rows_of_which_one_is_far_off_resolve_what_the_others_do():
    """All but one within a unit: their phases agree up to periods of that unit, for no alias."""
    rows = np.append(RNG.uniform(0, 1, 99), 50.0)
    assert highest_frequency(rows, 2500) == pytest.approx(5 * 99 / (2 * np.ptp(rows)))


def test_the_prior_of_a_period_begins_there():
    frame = pd.DataFrame({"t": RNG.uniform(0, 12, 50)})
    context = context_of(frame, hs.Simulator(lambda t: t, inputs={"t": (0, 12)}))
    shortest = hs.Periodic("t").prepare(context).parameters["period"].support()[0]
    assert shortest == pytest.approx(1 / highest_frequency(frame["t"].to_numpy(), 2500))
    assert shortest == pytest.approx(2 * np.ptp(frame["t"]) / (5 * 49))
