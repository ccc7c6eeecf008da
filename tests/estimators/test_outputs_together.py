"""Several outputs in every estimator: y of shape (n, k), NaN where one was not measured."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import halfnorm, lognorm, norm, uniform
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

import hybridsurrogate as hs
from hybridsurrogate.plotting import plot_sobol

N = 30


def level_and_flow(t, a, k):
    level = a * np.exp(-k * t)
    return level, 3 * k * level


SIMULATOR = hs.Simulator(
    level_and_flow,
    {"t": (0, 10)},
    {"a": hs.truncated_normal(2, 0.5, 0.5, 4), "k": hs.truncated_normal(0.3, 0.1, 0.05, 0.8)},
    output=("h", "q"),
)


@pytest.fixture(scope="module")
def data():
    random = np.random.default_rng(0)
    t = np.sort(random.uniform(0, 10, N))
    Y = np.column_stack(level_and_flow(t, 2.0, 0.25))
    Y += random.normal(size=Y.shape) * [0.05, 0.02]
    Y[::4, 1] = np.nan
    Y[5, 0] = np.nan
    return t[:, None], Y


def exact(**options):
    return hs.PowerScaledSurrogate(
        SIMULATOR, surrogate=hs.ExactSurrogate(), random_state=0, **options
    )


def test_the_posterior_is_that_of_quadrature():
    """One parameter in two outputs: the integral over it, sigma and the ratio on a grid."""
    simulator = hs.Simulator(
        lambda x, a: (a * x, a * x**2), {"x": (0, 1)}, {"a": norm(1, 1)}, output=("u", "v")
    )
    random = np.random.default_rng(3)
    x = np.linspace(0.1, 1, 12)
    Y = np.column_stack([1.4 * x, 1.4 * x**2]) + random.normal(size=(12, 2)) * [0.4, 0.1]
    Y[:4, 1] = np.nan
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), noise_prior=halfnorm(0, 1), n_draws=8000,
        random_state=0,
    ).fit(x[:, None], Y)  # fmt: skip
    scale = np.nanstd(Y, axis=0)
    a = np.linspace(0.5, 2.5, 201)[:, None, None]
    sigma = np.geomspace(0.05, 3, 90)[:, None]
    ratio = np.geomspace(0.005, 20, 160)
    log_density = norm(1, 1).logpdf(a) + halfnorm(0, 1).logpdf(sigma) + np.log(sigma)
    log_density = log_density + lognorm(2.0).logpdf(ratio) + np.log(ratio)
    for k, (shape, noise) in enumerate([(x, sigma), (x**2, sigma * ratio)]):
        there = np.isfinite(Y[:, k])
        for value, size in zip(Y[there, k], shape[there], strict=True):
            log_density = log_density + norm.logpdf(value / scale[k], a * size / scale[k], noise)
    weight = np.exp(log_density - log_density.max())
    weight /= weight.sum()
    draws = model.posterior_.named()
    for name, grid, axis in [
        ("a", a.ravel(), (1, 2)), ("sigma", sigma.ravel(), (0, 2)), ("noise of v", ratio, (0, 1)),
    ]:  # fmt: skip
        marginal = weight.sum(axis=axis)
        mean = marginal @ grid
        sd = np.sqrt(marginal @ (grid - mean) ** 2)
        assert abs(draws[name].mean() - mean) < 5 * sd / np.sqrt(2000), name
        assert draws[name].std() == pytest.approx(sd, rel=0.12), name


def test_predictions_have_a_column_for_each_output(data):
    X, Y = data
    model = exact().fit(X, Y)
    mean, std = model.predict(X, return_std=True)
    assert mean.shape == std.shape == Y.shape
    low, high = model.predict_interval(X)
    inside = model.interval_holds(X, Y)[0]
    there = np.isfinite(Y)
    np.testing.assert_array_equal(np.isnan(inside), ~there)
    np.testing.assert_array_equal(inside[there], ((low <= Y) & (high >= Y))[there])
    assert model.sample_posterior_predictive(X, 7).shape == (7, N, 2)
    assert model.sample_predictive_mean(X, 7).shape == (7, N, 2)
    density = model.log_predictive_density(X, Y)
    np.testing.assert_array_equal(np.isnan(density), ~there)
    assert model.score(X, Y) == pytest.approx(np.nanmean(density))
    # each output has a noise of its own, in its own units
    left = np.nanstd(Y - mean, axis=0)
    np.testing.assert_allclose(np.median(std, axis=0), left, rtol=0.2)
    groups = model.to_arviz()
    assert groups["posterior"]["noise of q"].size == 1000


def test_units_of_an_output_do_not_matter(data):
    X, Y = data
    factors = np.array([1.0, 1000.0])
    scaled = hs.Simulator(
        lambda t, a, k: np.column_stack(level_and_flow(t, a, k)) * factors,
        SIMULATOR.input_ranges,
        SIMULATOR.parameters,
        output=("h", "q"),
    )
    one, other = exact().fit(X, Y), exact().set_params(simulation=scaled).fit(X, Y * factors)
    np.testing.assert_allclose(other.predict(X), one.predict(X) * factors, rtol=1e-6)
    moved = one.log_predictive_density(X, Y) - other.log_predictive_density(X, Y * factors)
    np.testing.assert_allclose(moved[np.isfinite(moved[:, 1]), 1], np.log(1000), rtol=1e-6)
    np.testing.assert_allclose(moved[np.isfinite(moved[:, 0]), 0], 0, atol=1e-6)
    gap = one.loo().elpd - other.loo().elpd
    share = np.isfinite(Y[:, 1]).sum() / np.isfinite(Y).sum()
    assert gap == pytest.approx(share * np.log(1000), rel=1e-4)


def test_the_leave_one_out_score_is_that_of_densities_in_the_units_of_the_outputs(data):
    X, Y = data
    weights = np.where(np.arange(N) < 10, 3.0, 1.0)
    loo = exact().fit(X, 100 * Y / [1, 7], sample_weight=weights).loo()
    own = np.repeat(weights[:, None], 2, axis=1)[np.isfinite(Y)]
    mean = np.average(loo.pointwise, weights=own)
    assert loo.elpd == pytest.approx(mean)
    spread = np.average((loo.pointwise - mean) ** 2, weights=own)
    assert loo.standard_error == pytest.approx(np.sqrt(spread / (own.sum() - 1)))


def test_leaving_one_out_agrees_with_fits_without_it(data):
    X, Y = data
    loo = exact().fit(X, Y).loo()
    assert len(loo.pointwise) == np.isfinite(Y).sum()
    measured = np.argwhere(np.isfinite(Y))[:12]
    for position, (row, column) in enumerate(measured):
        without = Y.copy()
        without[row, column] = np.nan
        told = exact().fit(X, without).log_predictive_density(X[[row]], Y[[row]])[0, column]
        assert loo.pointwise[position] == pytest.approx(told, abs=0.15)


def test_columns_go_by_name(data):
    X, Y = data
    frame = pd.DataFrame(Y[:, ::-1], columns=["q", "h"])
    named = exact().fit(pd.DataFrame({"t": X[:, 0]}), frame)
    np.testing.assert_array_equal(
        named.predict(pd.DataFrame({"t": X[:, 0]})), exact().fit(X, Y).predict(X)
    )
    assert named.score(pd.DataFrame({"t": X[:, 0]}), frame) == pytest.approx(
        exact().fit(X, Y).score(X, Y)
    )
    t = pd.DataFrame({"t": X[:, 0]})
    np.testing.assert_array_equal(
        named.interval_holds(t, frame)[0], exact().fit(X, Y).interval_holds(X, Y)[0]
    )
    for scorer in hs.scoring.SCORERS.values():
        assert scorer(named, t, frame) == pytest.approx(scorer(named, t, Y))
    piped = make_pipeline(FunctionTransformer(), exact()).fit(t, frame)
    rmse = hs.scoring.neg_rmse_scorer
    assert rmse(piped, t, frame) == pytest.approx(rmse(named, t, Y))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("surrogate", "n_runs", "along"),
    [(hs.PolynomialChaos(6), 150, None), (hs.PolynomialChaos(6), 40, 12), (hs.Kriging(), 40, 12)],
)
def test_runs_of_several_outputs_train_a_surrogate_of_each(data, surrogate, n_runs, along):
    X, Y = data
    runs = SIMULATOR.run(n_runs, along=along, random_state=0)
    model = hs.PowerScaledSurrogate(runs, surrogate=surrogate, beta=0.9, random_state=0)
    told = model.fit(X, Y).predict(X)
    noise = np.array([0.05, 0.02])
    assert np.all(np.sqrt(np.mean((told - exact().fit(X, Y).predict(X)) ** 2, axis=0)) < noise)


@pytest.mark.slow
def test_every_estimator_takes_several_outputs(data):
    X, Y = data
    runs = SIMULATOR.run(60, random_state=0)
    options = {"surrogate": hs.PolynomialChaos(4), "random_state": 0, "n_draws": 300}
    power = hs.PowerScaledSurrogate(runs, beta=0.9, **options)
    models = [
        hs.PredictiveWeightedSurrogate(runs, beta=0.7, **options),
        hs.MultiSourceSurrogate([hs.Source(runs), hs.Source((X, Y), 0.3)], **options),
        hs.AveragedSurrogate(
            [clone(power), clone(power).set_params(effects=[hs.InOutput(hs.Offset(), "q")])],
            [0.6, 0.4],
        ),
        hs.PowerScaledSurrogate(None, surrogate=hs.PolynomialChaos(2), n_draws=300),
    ]
    for model in models:
        fitted = model.fit(X, Y)
        assert fitted.predict(X).shape == Y.shape, model
        assert np.isfinite(fitted.score(X, Y)), model
        if isinstance(model, hs.MultiSourceSurrogate):
            assert np.isfinite(fitted.loo().elpd)


def test_calibration_has_a_discrepancy_of_each_output(data):
    X, Y = data
    bent = Y + np.column_stack([0.4 * np.sin(X[:, 0]), np.zeros(N)])
    runs = SIMULATOR.run(40, along=12, random_state=0)
    model = hs.KennedyOHaganSurrogate(runs, surrogate=hs.Kriging(), n_draws=200, random_state=0)
    model.fit(X, bent)
    left = np.nanstd(bent - model.predict(X), axis=0)
    assert np.all(left < [0.12, 0.05])
    assert [effect.output for effect in model.effects] == ["h", "q"]


def test_calibration_of_scattered_runs_shares_its_proposals(data):
    """Eight unknowns: a mode and a Hessian for each coefficient draw took 30 CPU seconds."""
    X, Y = data
    runs = SIMULATOR.run(60, random_state=0)
    model = hs.KennedyOHaganSurrogate(runs, n_draws=300, random_state=0)
    diagnostics = model.fit(X, Y).diagnostics_
    assert diagnostics.second_khat < 0.7
    # of 60 separate proposals for each draw 12 counted
    assert diagnostics.second_effective_draws > 60


def test_a_grid_search_over_beta(data):
    X, Y = data
    runs = SIMULATOR.run(40, random_state=0)
    model = hs.PowerScaledSurrogate(
        runs, surrogate=hs.PolynomialChaos(2), n_draws=50, sampler="importance", random_state=0
    )
    search = GridSearchCV(model, {"beta": [0.3, 0.9]}, cv=2).fit(X, Y)
    assert np.isfinite(search.cv_results_["mean_test_score"]).all()


@pytest.mark.slow
def test_scores_paths_and_indices_know_the_outputs(data):
    X, Y = data
    model = exact().fit(X, Y)
    there = np.isfinite(Y)
    assert hs.scoring.elpd_scorer(model, X, Y) == pytest.approx(model.score(X, Y))
    error = np.sqrt(np.mean((model.predict(X) - Y)[there] ** 2))
    assert hs.scoring.neg_rmse_scorer(model, X, Y) == pytest.approx(-error)
    assert hs.scoring.neg_crps_scorer(model, X, Y) < 0
    assert hs.scoring.interval_score_scorer(model, X, Y) < 0
    table = hs.sobol_indices(model, [[1.0], [8.0]], n=64, random_state=0)
    assert table["output"].unique().tolist() == ["h", "q"]
    # at the start the level has nothing of the rate, and the flow much
    start = table[table["t"] == 1.0].set_index(["output", "parameter"])["total"]
    assert start["h", "k"] < 0.2 < start["q", "k"]
    assert len(plot_sobol(table).get_legend_handles_labels()[1]) == 4
    runs = SIMULATOR.run(60, random_state=0)
    trained = hs.PowerScaledSurrogate(
        runs, surrogate=hs.PolynomialChaos(3), n_draws=100, sampler="importance", random_state=0
    )
    frame = pd.DataFrame(Y[:, ::-1], columns=["q", "h"])
    chosen = [hs.choose_beta(trained, X, y, betas=[0.2, 0.9], cv=2) for y in (Y, frame)]
    assert chosen[0].beta == chosen[1].beta
    assert np.isfinite(chosen[0].table["elpd"]).all()


def test_counts_of_several_outputs_have_no_noise_to_infer():
    simulator = hs.Simulator(
        lambda t, a: (a * (1 + t), 3 * a * (1 + t)), {"t": (0, 5)}, {"a": uniform(1, 9)},
        output=("seen", "heard"),
    )  # fmt: skip
    random = np.random.default_rng(0)
    t = np.linspace(0, 5, 20)
    Y = random.poisson(np.column_stack(simulator.function(t, 4.0))).astype(float)
    Y[3, 1] = np.nan
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), likelihood="poisson", random_state=0
    ).fit(t[:, None], Y)
    assert set(model.posterior_.named()) == {"a"}
    # a Gamma posterior but for the flat prior's ends
    total, exposure = np.nansum(Y), np.sum((1 + t) * (1 + 3 * np.isfinite(Y[:, 1])))
    assert model.posterior_.named()["a"].mean() == pytest.approx((total + 1) / exposure, rel=0.01)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda X, Y: (X, Y[:, 0]), r"y must have shape \(n, 2\), a column for each of the outp"),
        (lambda X, Y: (X, np.column_stack([Y, Y])), r"y must have shape \(n, 2\)"),
        (lambda X, Y: (X, Y[:-1]), "inconsistent numbers of samples"),
        (lambda X, Y: (X, np.where(np.isnan(Y), np.inf, Y)), "contains infinity"),
        (lambda X, Y: (X, Y * [1, np.nan]), "The output 'q' has fewer than 2 measured values"),
        (lambda X, Y: (X, pd.DataFrame(Y, columns=["h", "flow"])), r"y lacks the outputs \['q'\]"),
        (
            lambda X, Y: (pd.DataFrame({"t": X[:, 0], "output_of_row": 0.0}), Y),
            "a name that the package uses",
        ),
    ],
)
def test_what_does_not_fit_is_refused(data, change, text):
    with pytest.raises(ValueError, match=text):
        exact().fit(*change(*data))


def test_rows_of_no_weight_are_as_if_they_were_not_there(data):
    X, Y = data
    weights = np.where(np.arange(N) < 20, 1.0, 0.0)
    some, fewer = exact().fit(X, Y, sample_weight=weights), exact().fit(X[:20], Y[:20])
    np.testing.assert_allclose(some.predict(X), fewer.predict(X), rtol=1e-9)
    only = np.where(np.isnan(Y[:, 1]), 1.0, 0.0)
    with pytest.raises(ValueError, match="'q' has fewer than 2 measured values"):
        exact().fit(X, Y, sample_weight=only)


def test_a_cause_that_moves_the_simulation_concerns_all_outputs(data):
    with pytest.raises(ValueError, match="changes the simulation itself"):
        exact(effects=[hs.InOutput(hs.ParameterDrift("k", "t"), "q")]).fit(*data)
    with pytest.raises(ValueError, match="There is no output 'z'"):
        exact(effects=[hs.InOutput(hs.Offset(), "z")]).fit(*data)


def test_a_cause_in_one_output_leaves_the_others(data):
    X, Y = data
    moved = Y + np.array([0.0, 0.3])
    model = exact(effects=[hs.InOutput(hs.Offset(), "q")]).fit(X, moved)
    estimates = model.posterior_.estimates(0)["amplitude"]
    assert abs(estimates.mean() - 0.3) < 4 * estimates.std()
    assert estimates.std() < 0.05
    np.testing.assert_allclose(
        model.predict(X)[:, 0], exact().fit(X, Y).predict(X)[:, 0], atol=0.05
    )
