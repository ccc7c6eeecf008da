"""Gram matrices by factors, against those of rows that are formed for each draw."""

import numpy as np
import pytest
from problems import make_problem
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.inference.conjugate.factored_rows import FactoredRows
from hybridsurrogate.model.observation import MeasuredModel

SIMULATOR = hs.Simulator(
    lambda t, rate: np.exp(-rate * t), {"t": (0, 10)}, {"rate": stats.uniform(0.1, 0.5)}
)
MIXED = (hs.Offset(), hs.Autocorrelation("t"), hs.Periodic("t"), hs.GaussianProcessDiscrepancy())


@pytest.mark.parametrize(
    ("surrogate", "effects", "n_products"),
    [
        # y less what is known is one too where features are
        (hs.PolynomialChaos(2), (), 6 + 1),
        (hs.PolynomialChaos(2), MIXED, 6 + 61 + 24 + 1),
        (hs.PolynomialChaos(2), (hs.Gain(), *MIXED), 61 + 24),
        (hs.ExactSurrogate(), MIXED, 61 + 24),
        (hs.ExactSurrogate(), (hs.Delay("t"), hs.Autocorrelation("t")), 61),
        (hs.PolynomialChaos(2), (hs.Noise("t"), hs.Autocorrelation("t")), 0),
    ],
    ids=["terms", "terms and causes", "causes", "simulation", "delay", "noise"],
)
def test_gram_matrices_are_those_of_the_rows(surrogate, effects, n_products):
    t = np.linspace(0, 10, 50)
    X, y = t[:, None], np.exp(-0.3 * t)
    simulation = (
        SIMULATOR if isinstance(surrogate, hs.ExactSurrogate) else SIMULATOR.run(40, random_state=0)
    )
    model = make_problem(simulation, surrogate, hs.Normal(), None, effects, ("t",), X, y).model
    root = np.sqrt(np.linspace(0.5, 2, 50))
    factored = FactoredRows(model, X, y, root)
    assert np.count_nonzero(factored.products) == n_products
    if not n_products:
        return
    z = np.random.default_rng(0).standard_normal((7, model.n_unknowns))
    values = model.values(z)
    parts = model.parts(X, values)
    rows = np.concatenate([parts.features, parts.columns, (y - parts.known)[..., None]], axis=2)
    rows *= root[:, None]
    expected = np.swapaxes(rows, 1, 2) @ rows
    assert factored.of_rows.shape[1] == n_products
    np.testing.assert_allclose(
        factored.gram(values), expected, rtol=1e-9, atol=1e-12 * expected.max()
    )


class Louder(hs.Autocorrelation):
    """A cause of one's own that changes the columns of one that has factors."""

    def columns(self, X, theta):
        return 2 * super().columns(X, theta)


def test_columns_of_ones_own_are_used_instead_of_inherited_factors():
    t = np.linspace(0, 10, 50)
    added = []
    for cause in (hs.Autocorrelation("t"), Louder("t")):
        model = make_problem(
            SIMULATOR, hs.ExactSurrogate(), hs.Normal(), None, (cause,), ("t",), t[:, None], t
        ).model
        values = model.values(np.zeros((1, model.n_unknowns)))
        factored = FactoredRows(model, t[:, None], t, np.ones(50))
        formed = factored.formed(values)[0, :, :-1]
        added.append(np.hstack([factored.of_rows * factored.of_draws(values), formed]))
    np.testing.assert_allclose(added[1], 2 * added[0])


@pytest.mark.parametrize("effects", [(), (hs.Offset(), hs.Trend("t"))], ids=["alone", "causes"])
def test_rows_are_read_once_however_many_draws_there_are(effects, monkeypatch):
    """So that the time for a draw does not grow with the rows."""
    t = np.linspace(0, 10, 50)
    X, y = t[:, None], np.exp(-0.3 * t)
    simulation = SIMULATOR.run(40, random_state=0)
    surrogate = hs.PolynomialChaos(2)
    model = make_problem(simulation, surrogate, hs.Normal(), None, effects, ("t",), X, y).model
    lengths, factors = [], MeasuredModel.factors
    monkeypatch.setattr(
        MeasuredModel, "factors", lambda m, X, v: (lengths.append(len(X)), factors(m, X, v))[1]
    )
    factored = FactoredRows(model, X, y, np.ones(50))
    for z in np.random.default_rng(0).standard_normal((5, 3, model.n_unknowns)):
        factored.gram(model.values(z))
    assert sum(length == 50 for length in lengths) == 1
