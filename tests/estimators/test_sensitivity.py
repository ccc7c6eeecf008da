"""Sobol indices, against closed forms."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.stats import norm, uniform

import hybridsurrogate as hs
from hybridsurrogate.plotting import plot_sobol

T = np.linspace(0.1, 0.9, 9)[:, None]


def fitted(function, parameters, surrogate=None, **settings):
    simulator = hs.Simulator(function, {"t": (0, 1)}, parameters, **settings)
    simulation = simulator if surrogate is None else simulator.run(128, random_state=0)
    model = hs.PowerScaledSurrogate(
        simulation,
        surrogate=surrogate or hs.ExactSurrogate(),
        sampler="importance",
        n_draws=200,
        random_state=0,
    )
    middle = [prior.median() for prior in parameters.values()]
    return model.fit(T, function(T[:, 0], *middle) + 0.01 * np.cos(99 * T[:, 0]))


def ishigami(t, a, b, c):
    return np.sin(a) + 7 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a) + 0 * t


# one output says nothing of three parameters: the prior is asked for here
@pytest.mark.filterwarnings(
    "ignore:The posterior draws are doubtful:hybridsurrogate.SamplingWarning"
)
def test_ishigamis_function():
    # Ishigami and Homma 1990; Sobol and Levitan 1999: variances in closed form
    model = fitted(ishigami, dict.fromkeys("abc", uniform(-np.pi, 2 * np.pi)))
    table = hs.sobol_indices(model, [[0.5]], n=4096, random_state=0)
    pi4, pi8 = np.pi**4, np.pi**8
    of_a, of_b = 0.5 * (1 + 0.1 * pi4 / 5) ** 2, 49 / 8
    of_ac = 0.01 * pi8 * (1 / 18 - 1 / 50)
    whole = of_a + of_b + of_ac
    assert table["first"].to_numpy() == pytest.approx([of_a / whole, of_b / whole, 0], abs=0.03)
    assert table["total"].to_numpy() == pytest.approx(
        [(of_a + of_ac) / whole, of_b / whole, of_ac / whole], abs=0.03
    )


@pytest.mark.parametrize("surrogate", [hs.PolynomialChaos(3), hs.Kriging()])
def test_over_time_from_runs(surrogate):
    model = fitted(
        lambda t, rise, fall: rise * t - fall * t**2,
        {"rise": norm(1, 0.2), "fall": norm(0.5, 0.4)},
        surrogate,
    )
    table = hs.sobol_indices(model, T, n=1024, random_state=0)
    # by hand: independent terms of variances (0.2 t)^2 and (0.4 t^2)^2
    rise, fall = (0.2 * T[:, 0]) ** 2, (0.4 * T[:, 0] ** 2) ** 2
    for name, share in (("rise", rise / (rise + fall)), ("fall", fall / (rise + fall))):
        own = table[table["parameter"] == name]
        np.testing.assert_allclose(own["first"], share, atol=0.06)
        np.testing.assert_allclose(own["total"], share, atol=0.06)
    ax = plot_sobol(table)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["rise", "fall"]
    plt.close(ax.figure)


def test_after_calibration_what_the_data_tell_matters_less():
    # the data tell the sum of both well and their difference not at all at one time
    model = fitted(
        lambda t, rise, fall: rise * t - fall * t**2,
        {"rise": norm(1, 0.5), "fall": norm(0.5, 0.4)},
    )
    before, after = (
        hs.sobol_indices(model, T, after=after, n=256, random_state=0) for after in (False, True)
    )
    # by hand: independent terms, whose sds are those of prior and posterior
    for table, (rise, fall) in (
        (before, (0.5, 0.4)),
        (after, model.posterior_.values[:, :2].std(axis=0)),
    ):
        parts = (rise * T[:, 0]) ** 2, (fall * T[:, 0] ** 2) ** 2
        own = table[table["parameter"] == "rise"]
        np.testing.assert_allclose(own["total"], parts[0] / sum(parts), atol=0.1)


def test_the_same_seed_gives_the_same_indices_and_a_constant_has_none():
    model = fitted(lambda t, rate: np.exp(-rate * t), {"rate": uniform(0.5, 1)})
    one, two = (hs.sobol_indices(model, T, n=64, random_state=1) for _ in range(2))
    np.testing.assert_array_equal(one["first"], two["first"])
    assert hs.sobol_indices(model, [[0.0]], n=64)["first"].isna().all()


def test_what_has_no_indices_is_refused():
    model = fitted(lambda t, rate: np.exp(-rate * t), {"rate": uniform(0.5, 1)})
    with pytest.raises(ValueError, match=r"n must be a power of two, got 100"):
        hs.sobol_indices(model, T, n=100)
    alone = hs.PowerScaledSurrogate(None, surrogate=hs.PolynomialChaos(2), random_state=0)
    with pytest.raises(ValueError, match=r"no parameters"):
        hs.sobol_indices(alone.fit(T, T[:, 0] + 0.1 * np.cos(99 * T[:, 0])), T)
