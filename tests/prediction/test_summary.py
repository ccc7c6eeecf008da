"""Estimates as a table, and what ArviZ is given: names, experiments, priors."""

import numpy as np
import pytest
from batches import DECAY, batches
from scipy.stats import halfnorm, lognorm, norm

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin

EXACT = {"surrogate": hs.ExactSurrogate(), "experiment": "batch", "random_state": 0}


@pytest.fixture(scope="module")
def spread():
    X, y, rates = batches(0)
    model = hs.PowerScaledSurrogate(DECAY, **EXACT, by_experiment={"rate": "spread"})
    return model.fit(X, y), rates


@pytest.fixture(scope="module")
def line():
    """A line with a normal prior of its slope and a log-normal one of its noise."""
    simulator = hs.Simulator(lambda t, slope: slope * t, {"t": (0, 4)}, {"slope": norm(2, 0.5)})
    t = np.linspace(0.2, 4, 12)
    y = 2.1 * t + 0.3 * np.random.default_rng(0).standard_normal(12)
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        noise_prior=lognorm(0.5, scale=0.3),
        n_draws=2000,
        random_state=0,
    )
    return model.fit(t[:, None], y), t, y


def test_a_summary_has_every_number_once(line):
    model, _, _ = line
    table = model.summary()
    assert list(table.index) == ["slope", "sigma"]
    draws = model.posterior_.values[:, 0]
    row = table.loc["slope"]
    assert row["mean"] == pytest.approx(draws.mean())
    assert row["sd"] == pytest.approx(draws.std(ddof=1))
    assert (row["q5"], row["q95"]) == pytest.approx(tuple(np.quantile(draws, [0.05, 0.95])))
    assert row["khat"] == model.diagnostics_.khat
    assert 100 < row["ess"] <= 2000
    assert set(table["source"]) == {"data"}


def test_experiments_have_rows_of_their_own(spread):
    model, rates = spread
    table = model.summary()
    each = table[table["experiment"] != ""]
    assert list(each.index) == [f"rate[b{k}]" for k in range(len(rates))]
    assert (np.abs(each["mean"] - rates) < 4 * each["sd"]).all()
    assert {"rate_mean", "rate_spread"} <= set(table.index)
    assert "rate" not in table.index


def test_what_comes_from_the_prior_alone_is_marked():
    case = make_log_sin(random_state=0)
    model = hs.PowerScaledSurrogate(
        case.simulator,
        surrogate=hs.ExactSurrogate(),
        effects=[hs.Periodic("x"), hs.Remainder(1.0)],
        n_draws=200,
        random_state=0,
    ).fit(case.X, case.y)
    table = model.summary()
    assert {"omega", "sigma", "period", "amplitude"} <= set(table.index[table["source"] == "data"])
    by_prior = table[table["source"] == "prior"]
    assert set(by_prior["cause"]) <= {model.posterior_.model.effects[-1].name}
    assert by_prior["ess"].isna().all()
    # in ArviZ a column of draws from a prior would look like an estimate
    posterior = model.to_arviz()["posterior"]
    assert posterior["effect_coefficients"].shape[2] == 2


def test_a_mixture_names_its_models():
    case = make_log_sin(random_state=0)
    model = hs.PredictiveWeightedSurrogate(case.simulation, beta=0.3, n_draws=200, random_state=0)
    table = model.fit(case.X, case.y).summary()
    assert list(table.index) == ["omega", "sigma", "sigma"]
    assert list(table["model"]) == [0, 0, 1]
    assert list(table["weight"]) == pytest.approx([0.3, 0.3, 0.7])


def test_arviz_has_experiments_as_coordinates(spread, arviz):
    model, _ = spread
    data = model.to_arviz()
    rate = data["posterior"]["rate"]
    assert rate.dims == ("chain", "draw", "batch")
    assert list(rate["batch"].values) == [f"b{k}" for k in range(10)]
    assert "rate[b0]" in arviz.summary(data, kind="stats").index
    assert data["prior"]["rate"].dims[2] == data["log_prior"]["rate"].dims[2] == "batch"


def test_priors_are_those_of_the_model(line):
    model, _, _ = line
    data = model.to_arviz()
    slope, sigma = model.posterior_.values[:, 0], model.posterior_.sigma
    log_prior = data["log_prior"]
    np.testing.assert_allclose(log_prior["slope"][0], norm(2, 0.5).logpdf(slope))
    np.testing.assert_allclose(log_prior["sigma"][0], lognorm(0.5, scale=0.3).logpdf(sigma))
    drawn = np.asarray(data["prior"]["slope"])[0]
    assert drawn.mean() == pytest.approx(2, abs=4 * 0.5 / np.sqrt(len(drawn)))
    assert drawn.std() == pytest.approx(0.5, rel=0.12)


def test_the_prior_of_a_spread_is_that_of_its_parts(spread):
    model, _ = spread
    data = model.to_arviz()
    values = data["posterior"]
    expected = norm.logpdf(
        np.asarray(values["rate"])[0],
        np.asarray(values["rate_mean"])[0][:, None],
        np.asarray(values["rate_spread"])[0][:, None],
    )
    np.testing.assert_allclose(data["log_prior"]["rate"][0], expected, atol=1e-6)


def test_units_have_a_column(line):
    model, *_ = line
    table = model.summary(units={"slope": "m/s", "y": "m"})
    assert dict(table["unit"]) == {"slope": "m/s", "sigma": "m"}
    assert "unit" not in model.summary()
    with pytest.raises(ValueError, match=r"units has \['slop'\].*Did you mean 'slope'"):
        model.summary(units={"slop": "m/s"})


def test_arviz_says_how_sensitive_results_are(line, arviz):
    """A prior far tighter than the data moves the slope; one that is wide does not."""
    model, t, y = line
    tight = hs.Simulator(lambda t, slope: slope * t, {"t": (0, 4)}, {"slope": norm(1.9, 0.03)})
    other = hs.PowerScaledSurrogate(
        tight,
        surrogate=hs.ExactSurrogate(),
        noise_prior=halfnorm(scale=1),
        n_draws=2000,
        random_state=0,
    ).fit(t[:, None], y)
    wide_value, tight_value = (sensitivity(arviz, one.to_arviz()) for one in (model, other))
    assert wide_value < 0.05 < tight_value


def sensitivity(arviz, data):
    if arviz.__version__.startswith("0."):
        return float(arviz.psens(data, component="prior")["slope"])
    return float(arviz.psense_summary(data, var_names=["slope"]).loc["slope", "prior"])


def test_counts_without_a_simulation_have_no_unknown_with_a_name():
    X = np.linspace(0, 1, 20)[:, None]
    model = hs.PowerScaledSurrogate(None, likelihood="poisson", n_draws=50, random_state=0)
    table = model.fit(X, np.arange(20)).summary()
    assert table.empty
    assert {"mean", "q5", "q95", "khat"} <= {*table.columns}
