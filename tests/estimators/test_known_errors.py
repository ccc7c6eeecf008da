"""Rows with error bars: against closed forms, in every estimator, and what is refused."""

import numpy as np
import pandas as pd
import pytest
from scipy import integrate, stats
from sklearn.model_selection import GridSearchCV, KFold, cross_val_score

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin

PRIOR_SD = 5.0
KINDS = ("known", "scaled", "added")


def line(x, a, b):
    return a + b * x


SIMULATOR = hs.Simulator(
    line,
    inputs={"x": (-1, 1)},
    parameters={"a": stats.norm(0, PRIOR_SD), "b": stats.norm(0, PRIOR_SD)},
)


def measured(n=25, seed=0, jitter=0.0):
    random = np.random.default_rng(seed)
    x = random.uniform(-1, 1, n)
    errors = 0.2 * np.exp(random.uniform(np.log(0.3), np.log(3), n))
    y = 1 + 2 * x + np.hypot(errors, jitter) * random.standard_normal(n)
    return x[:, None], y, errors


def model(noise="added", **settings):
    settings = {"n_draws": 4000, "random_state": 0, **settings}
    return hs.PowerScaledSurrogate(SIMULATOR, hs.ExactSurrogate(), noise=noise, **settings)


def least_squares(X, y, sd):
    """Return mean and sd of the two parameters: generalised least squares with their prior."""
    design = np.column_stack([np.ones(len(y)), X])
    precision = design.T @ (design / sd[:, None] ** 2) + np.eye(2) / PRIOR_SD**2
    covariance = np.linalg.inv(precision)
    return covariance @ design.T @ (y / sd**2), np.sqrt(np.diag(covariance))


def evidence(X, y, sd):
    design = np.column_stack([np.ones(len(y)), X])
    covariance = np.diag(sd**2) + PRIOR_SD**2 * design @ design.T
    return stats.multivariate_normal(np.zeros(len(y)), covariance).logpdf(y)


# --------------------------------------------------------------------------------- closed forms


def test_known_errors_are_generalised_least_squares():
    X, y, errors = measured()
    fitted = model("known").fit(X, y, y_err=errors)
    mean, sd = least_squares(X, y, errors)
    draws = fitted.posterior_.values
    # 4000 independent draws
    assert np.all(np.abs(draws.mean(axis=0) - mean) < 5 * sd / np.sqrt(4000))
    np.testing.assert_allclose(draws.std(axis=0), sd, rtol=0.06)
    found = fitted.diagnostics_
    exact = evidence(X, y, errors)
    assert found.log_evidence == pytest.approx(exact, abs=5 * found.log_evidence_error + 1e-3)
    assert list(fitted.summary().index) == ["a", "b"]


@pytest.mark.parametrize("noise", ["scaled", "added"])
def test_what_is_inferred_of_the_noise_has_the_posterior_of_a_grid(noise):
    X, y, errors = measured(jitter=0.15)
    fitted = model(noise).fit(X, y, y_err=errors)
    usual = np.median(errors)
    if noise == "scaled":
        nodes, name = np.geomspace(0.2, 6, 400), "error_factor"
        prior = stats.lognorm(1.0)
        rows = nodes[:, None] * errors
    else:
        nodes, name = np.linspace(0, 3, 1200)[1:], "jitter"
        prior = stats.halfnorm(scale=np.std(y))
        rows = np.hypot(errors, nodes[:, None])
    log_density = prior.logpdf(nodes) + [evidence(X, y, sd) for sd in rows]
    density = np.exp(log_density - log_density.max())
    mass = integrate.trapezoid(density, nodes)
    mean = integrate.trapezoid(nodes * density, nodes) / mass
    sd = np.sqrt(integrate.trapezoid((nodes - mean) ** 2 * density, nodes) / mass)
    summary = fitted.summary()
    assert summary.loc[name, "mean"] == pytest.approx(mean, abs=5 * sd / np.sqrt(2000))
    assert summary.loc[name, "sd"] == pytest.approx(sd, rel=0.1)
    exact = np.log(mass) + log_density.max()
    found = fitted.diagnostics_
    assert found.log_evidence == pytest.approx(exact, abs=5 * found.log_evidence_error + 0.01)
    if noise == "scaled":
        assert summary.loc["sigma", "mean"] == pytest.approx(usual * mean, rel=0.05)


def test_equal_errors_with_a_factor_are_no_errors():
    X, y, _ = measured()
    plain = model(noise_prior=stats.halfnorm(scale=1.0)).fit(X, y)
    scaled = model("scaled", noise_prior=stats.halfnorm(scale=1.0)).fit(X, y, y_err=0.3)
    ours, theirs = scaled.summary(), plain.summary()
    for name in ("a", "b", "sigma"):
        slack = 5 * theirs.loc[name, "sd"] / np.sqrt(2000)
        assert ours.loc[name, "mean"] == pytest.approx(theirs.loc[name, "mean"], abs=slack)


def test_a_likelihood_on_a_log_scale_takes_errors_in_the_units_of_y():
    X, log_y, errors = measured()
    y = np.exp(log_y)
    growth = hs.Simulator(
        lambda x, a, b: np.exp(a + b * x), inputs={"x": (-1, 1)}, parameters=SIMULATOR.parameters
    )
    fitted = hs.PowerScaledSurrogate(
        growth, hs.ExactSurrogate(), likelihood="lognormal", noise="known", n_draws=4000,
        random_state=0,
    ).fit(X, y, y_err=errors * y)  # fmt: skip
    mean, sd = least_squares(X, log_y, errors)
    draws = fitted.posterior_.values
    assert np.all(np.abs(draws.mean(axis=0) - mean) < 5 * sd / np.sqrt(4000))
    # the same relative error at a new place: of y where it is known, else of what is predicted
    new, relative = np.array([[0.3]]), 0.5
    expected = np.exp(mean[0] + 0.3 * mean[1])
    low, high = fitted.predict_interval(new, 0.9, y_err=relative * expected)
    width = 2 * stats.norm.ppf(0.95) * np.hypot(relative, sd[0])
    assert np.log(high / low) == pytest.approx(width, rel=0.05)
    density = fitted.log_predictive_density(new, [7.0], y_err=[relative * 7.0])
    exact = stats.norm(mean @ [1, 0.3], relative).logpdf(np.log(7.0)) - np.log(7.0)
    assert density[0] == pytest.approx(exact, abs=0.05)


def test_a_heavy_tailed_row_has_its_error_as_scale():
    X, y, errors = measured()
    y[0] += 30.0
    fitted = model("known", likelihood="student-t", n_draws=1000).fit(X, y, y_err=errors)

    a, b = np.meshgrid(np.linspace(0.5, 1.5, 121), np.linspace(1.2, 2.8, 121), indexing="ij")
    residual = (y - a[..., None] - b[..., None] * X[:, 0]) / errors
    density = stats.t(4).logpdf(residual).sum(axis=2)
    density += stats.norm(0, PRIOR_SD).logpdf([a, b]).sum(axis=0)
    density = np.exp(density - density.max())
    mean = np.sum(a * density) / density.sum()
    sd = np.sqrt(np.sum((a - mean) ** 2 * density) / density.sum())
    assert fitted.summary().loc["a", "mean"] == pytest.approx(mean, abs=5 * sd / np.sqrt(500))
    assert fitted.summary().loc["a", "sd"] == pytest.approx(sd, rel=0.15)


def test_leave_one_out_of_rows_with_errors():
    X, y, errors = measured(n=12)
    fitted = model("known").fit(X, y, y_err=errors)
    exact = []
    for k in range(len(y)):
        kept = np.arange(len(y)) != k
        mean, _ = least_squares(X[kept], y[kept], errors[kept])
        design = np.column_stack([np.ones(len(y)), X])
        precision = design[kept].T @ (design[kept] / errors[kept, None] ** 2)
        covariance = np.linalg.inv(precision + np.eye(2) / PRIOR_SD**2)
        sd = np.sqrt(errors[k] ** 2 + design[k] @ covariance @ design[k])
        exact.append(stats.norm(design[k] @ mean, sd).logpdf(y[k]))
    np.testing.assert_allclose(fitted.loo().pointwise, exact, atol=0.1)


# ----------------------------------------------------------------------------------- new rows


def test_a_new_row_has_its_error_the_median_one_or_that_in_its_column():
    X, y, errors = measured()
    table = pd.DataFrame({"x": X[:, 0], "sd": errors})
    fitted = model("known").fit(table, y, y_err="sd")
    assert fitted.n_features_in_ == 1
    _, sd = fitted.predict(table[["x"]][:3], return_std=True)
    assert np.ptp(sd) < 0.3 * np.ptp(errors[:3])
    np.testing.assert_allclose(sd, np.median(errors), rtol=0.2)
    X = table[["x"]]
    _, own = fitted.predict(table[:3], return_std=True)
    given = fitted.predict(X[:3], return_std=True, y_err=errors[:3])[1]
    np.testing.assert_allclose(own, given, rtol=1e-12)
    assert np.all(own > errors[:3])
    narrow, wide = (fitted.predict_interval(X[:1], y_err=size) for size in (0.1, 10.0))
    assert wide[1] - wide[0] == pytest.approx(2 * 10 * stats.norm.ppf(0.95), rel=0.02)
    assert narrow[1] - narrow[0] < 1.0
    drawn = fitted.sample_posterior_predictive(X[:1], y_err=10.0)
    assert np.std(drawn) == pytest.approx(10.0, rel=0.1)
    assert fitted.interval_holds(X[:1], [30.0], y_err=[30.0])[0] == 1
    assert fitted.interval_holds(X[:1], [30.0], y_err=[1.0])[0] == 0
    assert fitted.score(table, y) == pytest.approx(fitted.score(X, y, y_err=errors), rel=1e-12)


def test_searches_and_folds_slice_the_errors():
    X, y, errors = measured(n=30)
    table = pd.DataFrame({"x": X[:, 0], "sd": errors})
    folds = KFold(3)
    found = cross_val_score(model(n_draws=200), table, y, cv=folds, params={"y_err": "sd"})
    train, test = next(folds.split(X))
    one = model(n_draws=200).fit(X[train], y[train], y_err=errors[train])
    assert found[0] == pytest.approx(one.score(X[test], y[test], y_err=errors[test]), rel=1e-12)
    search = GridSearchCV(model(n_draws=200), {"noise": ["known", "scaled"]}, cv=2)
    assert search.fit(X, y, y_err=errors).best_estimator_.data_.y_err.tolist() == errors.tolist()


def test_a_choice_of_beta_takes_errors():
    case = make_log_sin(random_state=0)
    errors = np.full(len(case.y), 0.5)
    base = hs.PowerScaledSurrogate(
        case.simulation, hs.PolynomialChaos(degree=3), noise="known", n_draws=100, random_state=0
    )
    choice = hs.choose_beta(base, case.X, case.y, [0.3, 0.7], cv=2, y_err=errors)
    assert choice.estimator.data_.y_err.tolist() == errors.tolist()


# -------------------------------------------------------------------------- every estimator


def test_every_estimator_takes_errors():
    case = make_log_sin(random_state=0)
    random = np.random.default_rng(0)
    errors = np.exp(random.uniform(-3, 0, len(case.y)))
    y = case.y + errors * random.standard_normal(len(errors))
    cubic = hs.PolynomialChaos(degree=3)
    settings = {"surrogate": cubic, "n_draws": 200, "random_state": 0}
    models = [
        hs.PowerScaledSurrogate(case.simulation, **settings),
        hs.PredictiveWeightedSurrogate(case.simulation, **settings),
        hs.KennedyOHaganSurrogate(case.simulation, **settings),
        hs.MultiSourceSurrogate([hs.Source(case.simulation, 0.5)], **settings),
        hs.AveragedSurrogate([hs.PowerScaledSurrogate(case.simulation, **settings)], [1.0]),
    ]
    for one in models:
        fitted = one.fit(case.X, y, y_err=errors)
        _, sd = fitted.predict(case.X[:2], return_std=True, y_err=[0.01, 50.0])
        assert sd[0] < 5 < sd[1], one
        assert "jitter" in fitted.summary().index
        assert np.isfinite(fitted.score(case.X, y, y_err=errors))


def test_a_precise_further_set_outweighs_an_imprecise_first_one():
    X, y, errors = measured()
    precise = hs.Source((X, y + 5), 1.0, y_err=errors / 100)
    joined = hs.MultiSourceSurrogate(
        [precise], surrogate=hs.PolynomialChaos(degree=1), noise="known", random_state=0
    ).fit(X, y, y_err=errors)
    assert joined.predict(X) == pytest.approx(6 + 2 * X[:, 0], abs=0.5)
    with pytest.raises(ValueError, match="all measured sets have errors or none"):
        joined.set_params(sources=[hs.Source((X, y), 1.0)]).fit(X, y, y_err=errors)


def test_several_outputs_have_an_error_each():
    def both(x, a, b):
        return {"level": a + b * x, "flow": 100 * (a - b * x)}

    simulator = hs.Simulator(
        both, inputs={"x": (-1, 1)}, parameters=SIMULATOR.parameters, output=("level", "flow")
    )
    X, level, errors = measured()
    random = np.random.default_rng(1)
    sd = np.column_stack([errors, 100 * errors[::-1]])
    flow = 100 * (1 - 2 * X[:, 0]) + sd[:, 1] * random.standard_normal(len(X))
    Y = np.column_stack([level, flow])
    Y[3, 1] = np.nan
    sd[3, 1] = np.nan
    fitted = hs.PowerScaledSurrogate(
        simulator, hs.ExactSurrogate(), noise="known", n_draws=4000, random_state=0
    ).fit(X, Y, y_err=sd)
    ones = np.ones(len(X))
    design = np.vstack([np.column_stack([ones, X]), 100 * np.column_stack([ones, -X])])
    values, scatter = Y.T.ravel(), sd.T.ravel()
    there = np.isfinite(values)
    design, values, scatter = design[there], values[there], scatter[there]
    precision = design.T @ (design / scatter[:, None] ** 2) + np.eye(2) / PRIOR_SD**2
    mean = np.linalg.solve(precision, design.T @ (values / scatter**2))
    wanted = np.sqrt(np.diag(np.linalg.inv(precision)))
    draws = fitted.posterior_.values
    assert np.all(np.abs(draws.mean(axis=0) - mean) < 5 * wanted / np.sqrt(4000))
    np.testing.assert_allclose(draws.std(axis=0), wanted, rtol=0.06)
    _, sds = fitted.predict(X[:1], return_std=True, y_err=[[1.0, 300.0]])
    np.testing.assert_allclose(sds, [[1.0, 300.0]], rtol=0.05)
    jitters = fitted.set_params(noise="added").fit(X, Y, y_err=sd).summary()
    assert {"jitter of level", "jitter of flow"} <= {*jitters.index}


# ----------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({2: 0.0}, "first is 0 in row 3: a measurement without any error"),
        ({4: -0.1}, "first is -0.1 in row 5: errors are standard deviations"),
        ({0: np.nan}, "first is nan in row 1: give a row without a known error"),
        ({1: np.inf}, "first is inf in row 2"),
    ],
)
def test_errors_that_are_none_are_refused(change, message):
    X, y, errors = measured()
    for row, value in change.items():
        errors[row] = value
    with pytest.raises(ValueError, match=message):
        model().fit(X, y, y_err=errors)


def test_errors_of_another_shape_or_name_are_refused():
    X, y, errors = measured()
    with pytest.raises(ValueError, match=r"shape of y, \(25,\).*got \(24,\)"):
        model().fit(X, y, y_err=errors[1:])
    table = pd.DataFrame({"x": X[:, 0], "sigma": errors})
    with pytest.raises(ValueError, match=r"no column of X.*Did you mean 'sigma'"):
        model().fit(table, y, y_err="sigm")
    with pytest.raises(ValueError, match="y_err='sd' is no column of X, which has no names"):
        model().fit(X, y, y_err="sd")


def test_errors_are_for_a_likelihood_with_a_noise_scale_and_a_fit_with_errors():
    X, y, errors = measured()
    with pytest.raises(ValueError, match="Poisson likelihood has no noise scale"):
        model(likelihood="poisson").fit(X, np.round(np.exp(y)), y_err=errors)
    with pytest.raises(ValueError, match="noise must be one of"):
        model("aded").fit(X, y, y_err=errors)
    with pytest.raises(ValueError, match="noise_prior is for"):
        model("known", noise_prior=stats.halfnorm()).fit(X, y, y_err=errors)
    plain = model(n_draws=100).fit(X, y)
    with pytest.raises(ValueError, match="whose fit had y_err"):
        plain.predict(X, y_err=errors)


def test_rows_without_a_measurement_take_their_error_along():
    X, y, errors = measured()
    y[3], errors[3] = np.nan, np.nan
    with pytest.warns(hs.MissingMeasurementWarning):
        fitted = model("known", n_draws=100).fit(X, y, y_err=errors)
    assert fitted.data_.y_err.tolist() == np.delete(errors, 3).tolist()


# ------------------------------------------------------------------------------------- coverage


def covered(noise, seeds, jitter=0.0, factor=1.0):
    """Return shares of parameters and of new rows in 90 % intervals, over data sets."""
    inside, new_rows = [], []
    for seed in seeds:
        random = np.random.default_rng(seed)
        a, b = random.normal(0, PRIOR_SD, 2)
        X = random.uniform(-1, 1, (70, 1))
        errors = 0.3 * np.exp(random.uniform(np.log(0.3), np.log(3), 70))
        scatter = np.hypot(factor * errors, jitter)
        y = a + b * X[:, 0] + scatter * random.standard_normal(70)
        fitted = model(noise, n_draws=400).fit(X[:30], y[:30], y_err=errors[:30])
        table = fitted.summary()
        known = {"a": a, "b": b, "jitter": jitter, "error_factor": factor}
        for name in {*known} & {*table.index}:
            inside.append(table.loc[name, "q5"] <= known[name] <= table.loc[name, "q95"])
        new_rows.append(fitted.interval_holds(X[30:], y[30:], y_err=errors[30:])[0].mean())
    return np.mean(inside), np.mean(new_rows)


@pytest.mark.parametrize(
    ("noise", "jitter", "factor"), [("scaled", 0.0, 1.7), ("added", 0.25, 1.0)]
)
def test_intervals_cover(noise, jitter, factor):
    parameters, rows = covered(noise, range(25), jitter, factor)
    # 75 parameters, whose share has a standard error of 3.5 %; 1000 rows of 25 fits
    assert parameters > 0.9 - 3.5 * 0.035
    assert 0.85 < rows < 0.95


@pytest.mark.slow
@pytest.mark.parametrize(
    ("noise", "jitter", "factor"), [("known", 0, 1), ("scaled", 0, 1.7), ("added", 0.25, 1)]
)
def test_intervals_cover_over_200_sets(noise, jitter, factor):
    parameters, rows = covered(noise, range(1000, 1200), jitter, factor)
    assert 0.86 < parameters < 0.94
    assert 0.86 < rows < 0.94
