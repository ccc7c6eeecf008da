"""Values beyond limits and rounded values: probabilities, derivatives, rates over data sets."""

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy import integrate, special, stats

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.validation.gain import pointwise

BASES = ("normal", "lognormal", "student-t", "poisson", "negative-binomial")
COUNTS = ("poisson", "negative-binomial")
SIGMA = np.array([[0.6]])


def eta_of(base, mean=4.0):
    on_log = base in ("lognormal", *COUNTS)
    return np.full((1, 1), np.log(mean) if on_log else mean)


@pytest.mark.parametrize("base", BASES)
def test_all_that_can_be_recorded_has_probability_one(base):
    limited = hs.Censored(base, below=2.0, above=6.0)
    eta = eta_of(base)
    if base in COUNTS:
        total = np.exp(limited.log_density(np.arange(2.0, 7.0), eta, SIGMA)).sum()
    else:
        ends = np.exp(limited.log_density(np.array([2.0, 6.0]), eta, SIGMA)).sum()
        total = ends + integrate.quad(
            lambda y: np.exp(limited.log_density(np.array([y]), eta, SIGMA)).item(), 2.0001, 5.9999
        )[0]  # fmt: skip
    assert total == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("base", ["normal", "lognormal", "student-t"])
def test_rounded_values_have_probability_one(base):
    steps = np.arange(0 if base == "lognormal" else -800, 800) * 0.5
    rounded = hs.Censored(base, step=0.5)
    total = np.exp(rounded.log_density(steps, eta_of(base), SIGMA)).sum()
    assert total == pytest.approx(1.0, abs=1e-6)
    # fine steps are a density
    fine, plain = hs.Censored(base, step=1e-4), hs.Censored(base)
    y = np.array([3.3, 4.0, 5.1])
    density = fine.log_density(y, eta_of(base), SIGMA) - np.log(1e-4)
    np.testing.assert_allclose(density, plain.log_density(y, eta_of(base), SIGMA), atol=1e-6)


@pytest.mark.parametrize("base", BASES)
def test_tails_are_those_of_draws(base):
    limited = hs.Censored(base, below=3.0, above=5.0)
    eta = np.broadcast_to(eta_of(base), (1, 40000))
    drawn = limited.sample(eta, SIGMA, np.random.RandomState(0))
    for side, y in ((-1, 3.0), (1, 5.0)):
        share = np.mean(limited.side(drawn) == side)
        exact = np.exp(limited.log_density(np.array([y]), eta_of(base), SIGMA)).item()
        assert share == pytest.approx(exact, abs=4 * np.sqrt(exact / 40000) + 1e-9)
    # far beyond, where a probability is no number, its logarithm still falls
    far = eta_of(base, 900.0)
    if base != "student-t":
        steps = limited.log_density(np.array([3.0]), np.hstack([far, 1.1 * far]), SIGMA)[0]
        assert np.isfinite(steps).all()
        assert steps[1] < steps[0] < -5


@pytest.mark.parametrize("base", BASES)
def test_derivatives_are_those_of_the_log_density(base):
    limited = hs.Censored(base, below=3.0, above=6.0)
    y, h = np.array([3.0, 4.0, 5.0, 6.0]), 1e-4
    eta = np.broadcast_to(eta_of(base), (1, 4))
    ahead, here, behind = (limited.log_density(y, eta + d, SIGMA) for d in (h, 0.0, -h))
    slope, curvature = limited.derivatives(y, eta, SIGMA)
    if base != "student-t":  # an average over a kernel
        np.testing.assert_allclose(slope, (ahead - behind) / (2 * h), rtol=0.02, atol=1e-3)
        np.testing.assert_allclose(curvature, -(ahead - 2 * here + behind) / h**2, rtol=0.05)
    assert (curvature > 0).all()


def test_information_is_the_mean_square_of_the_score():
    limited = hs.Censored(below=1.0, above=3.0)
    for mean in (-1.0, 0.5, 2.0, 3.5):
        eta = np.full((1, 1), mean)

        def square(y, eta=eta):
            y = np.array([y])
            score = limited.derivatives(y, eta, SIGMA)[0]
            return (score**2 * np.exp(limited.log_density(y, eta, SIGMA))).item()

        exact = integrate.quad(square, 1 + 1e-9, 3 - 1e-9)[0] + square(1.0) + square(3.0)
        assert limited.information(eta, SIGMA).item() == pytest.approx(exact, rel=1e-6)


def test_limits_of_counts_are_whole():
    assert hs.Censored("poisson", below=2.7, above=6.2).side(np.arange(9.0)).tolist() == [
        -1, -1, -1, 0, 0, 0, 0, 1, 1,
    ]  # fmt: skip


# ----------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("likelihood", "message"),
    [
        (hs.Censored(below=3.0, above=2.0), "below < above, got below=3, above=2"),
        (hs.Censored(below=9.0), "None of the 20 measured values lies between the limits 9 and"),
        (hs.Censored(step=-1.0), "step that is positive"),
        (hs.Censored("binomial", below=0.0), "binomial likelihood has no distribution function"),
        (hs.Censored("norml"), "Did you mean 'normal'"),
    ],
)
def test_limits_without_sense_are_refused(likelihood, message):
    X = np.linspace(0, 1, 20)[:, None]
    y = (X[:, 0] > 0.5).astype(float)
    with pytest.raises(ValueError, match=message):
        hs.PowerScaledSurrogate(likelihood=likelihood).fit(X, y)


def test_several_outputs_have_no_limits():
    X = np.linspace(0, 1, 20)[:, None]
    model = hs.PowerScaledSurrogate(likelihood=hs.Censored(below=0.1))
    with pytest.raises(ValueError, match="limits of one output"):
        model.fit(X, np.hstack([X, X]))


# ------------------------------------------------------------------------------- rates over sets


def fits(base, seeds, n_rows=60):
    """Return deviations of posterior means, in posterior sd, and whether 90 % intervals cover.

    Truths are drawn from their priors, so the mean deviation is zero and the coverage 90 %.
    """
    on_log = base in ("lognormal", *COUNTS)
    noise = stats.lognorm(0.3, scale=0.5)
    simulator = hs.Simulator(
        lambda x, a, b: np.exp(a + b * x) if on_log else a + b * x,
        inputs={"x": (-1, 1)},
        parameters={"a": stats.norm(1.5 if on_log else 0, 1), "b": stats.norm(0, 1)},
    )
    plain, off, inside = hs.Censored(base), [], []
    for seed in seeds:
        random = np.random.RandomState(seed)
        a, b = random.normal(1.5 if on_log else 0, 1), random.normal(0, 1)
        sigma = float(noise.rvs(random_state=random))
        x = random.uniform(-1, 1, n_rows)
        y, other = plain.sample(np.tile(a + b * x, (2, 1)), np.full((2, 1), sigma), random)
        # a limit that owes nothing to these rows, 30 % of such rows below it
        limit = float(np.quantile(other, 0.3))
        if np.all(y <= limit):
            continue
        fitted = hs.PowerScaledSurrogate(
            simulator,
            hs.ExactSurrogate(),
            likelihood=hs.Censored(base, below=limit),
            noise_prior=None if base == "poisson" else noise,
            n_draws=400,
            random_state=seed,
        ).fit(x[:, None], np.maximum(y, limit))
        table = fitted.summary()
        for name, truth in {"a": a, "b": b, "sigma": sigma}.items():
            if name in table.index:
                row = table.loc[name]
                off.append((row["mean"] - truth) / row["sd"])
                inside.append(row["q5"] <= truth <= row["q95"])
    return np.array(off), np.array(inside)


@pytest.mark.parametrize("base", ["normal", "poisson"])
def test_rows_below_a_limit_leave_estimates_unbiased(base):
    off, inside = fits(base, range(30))
    assert abs(off.mean()) < 3.5 / np.sqrt(len(off))
    assert inside.mean() > 0.9 - 3.5 * np.sqrt(0.09 / len(inside))


@pytest.mark.slow
@pytest.mark.parametrize("base", BASES)
def test_rows_below_a_limit_over_200_sets(base):
    off, inside = fits(base, range(1000, 1200))
    assert abs(off.mean()) < 3 / np.sqrt(len(off))
    assert 0.86 < inside.mean() < 0.94


def test_the_limit_taken_for_a_value_would_be_biased():
    random = np.random.default_rng(0)
    x = random.uniform(-1, 1, 200)
    y = 2 * x + 0.5 * random.standard_normal(200)
    line = hs.Simulator(
        lambda x, b: b * x, inputs={"x": (-1, 1)}, parameters={"b": stats.norm(0, 5)}
    )
    recorded = np.maximum(y, -0.5)
    slopes = {}
    for likelihood in ("normal", hs.Censored(below=-0.5)):
        model = hs.PowerScaledSurrogate(
            line, hs.ExactSurrogate(), likelihood=likelihood, n_draws=400, random_state=0
        ).fit(x[:, None], recorded)
        slopes[str(likelihood)] = model.summary().loc["b"]
    naive, limited = slopes.values()
    assert abs(limited["mean"] - 2) < 3 * limited["sd"]
    assert naive["mean"] < 2 - 5 * naive["sd"]
    # what is predicted may lie beyond the limit, what is recorded may not
    assert model.predict([[-1.0]])[0] < -1.5
    assert model.sample_posterior_predictive([[-1.0]]).min() == -0.5


def test_known_errors_and_limits_go_together():
    random = np.random.default_rng(0)
    x = random.uniform(-1, 1, 100)
    errors = np.where(random.uniform(size=100) < 0.5, 0.1, 1.0)
    y = 2 * x + errors * random.standard_normal(100)
    line = hs.Simulator(
        lambda x, b: b * x, inputs={"x": (-1, 1)}, parameters={"b": stats.norm(0, 5)}
    )
    fitted = hs.PowerScaledSurrogate(
        line, hs.ExactSurrogate(), likelihood=hs.Censored(below=-0.5), noise="known", random_state=0
    ).fit(x[:, None], np.maximum(y, -0.5), y_err=errors)
    b = np.linspace(1.5, 2.5, 2001)
    mean = b[:, None] * x
    below = stats.norm(mean, errors).logcdf(-0.5)
    density = np.where(y <= -0.5, below, stats.norm(mean, errors).logpdf(y)).sum(axis=1)
    density = np.exp(density - density.max())
    exact = np.sum(b * density) / density.sum()
    sd = np.sqrt(np.sum((b - exact) ** 2 * density) / density.sum())
    row = fitted.summary().loc["b"]
    assert row["mean"] == pytest.approx(exact, abs=5 * sd / np.sqrt(500))
    assert row["sd"] == pytest.approx(sd, rel=0.15)


# ------------------------------------------------------------------------------- limits of rows


def of_rows(seed, n=60, base="normal"):
    """Return a line of which some 30 % of the rows lie below limits of their own, and its truth."""
    random = np.random.RandomState(seed)
    truth = {
        "a": random.normal(0, 1),
        "b": random.normal(0, 1),
        "sigma": stats.lognorm(0.3, scale=0.5).rvs(random_state=random),
    }
    x = random.uniform(-1, 1, n)
    mean = truth["a"] + truth["b"] * x
    y = mean + truth["sigma"] * random.standard_normal(n)
    # three instruments, whose limits owe nothing to these rows
    spread = np.hypot(truth["sigma"], abs(truth["b"]) / np.sqrt(3))
    limit = truth["a"] + spread * random.choice([-1.6, -0.6, 0.0], n)
    y, limited = hs.Censored.of_rows(y, below=limit, base=base)
    simulator = hs.Simulator(
        lambda x, a, b: a + b * x,
        inputs={"x": (-1, 1)},
        parameters={"a": stats.norm(0, 1), "b": stats.norm(0, 1)},
    )
    model = hs.PowerScaledSurrogate(
        simulator,
        hs.ExactSurrogate(),
        likelihood=limited,
        noise_prior=stats.lognorm(0.3, scale=0.5),
        n_draws=400,
        random_state=seed,
    )
    return x[:, None], y, model, truth


def test_rows_have_the_density_of_their_own_limit():
    values, limit = np.array([0.3, 1.0, 1.0, 4.0, np.nan]), [0.5, 0.2, 1.0, np.nan, 1.0]
    y, limited = hs.Censored.of_rows(values, below=limit, above=[9.0, 9.0, 9.0, 3.0, 9.0])
    assert limited.side(y).tolist() == [-1, 0, -1, 1, 0]
    # the second row was measured to be one, and the third is at most one
    assert y[1] == pytest.approx(1.0)
    plain, eta = stats.norm(2.0, SIGMA[0, 0]), np.full((1, 5), 2.0)
    exact = [plain.logcdf(0.5), plain.logpdf(1.0), plain.logcdf(1.0), plain.logsf(3.0)]
    np.testing.assert_allclose(limited.log_density(y, eta, SIGMA)[0, :4], exact)
    # one limit for all is that limit
    both = np.array([0.4, 2.0])
    y, limited = hs.Censored.of_rows(both, below=1.0)
    one = hs.Censored(below=1.0)
    np.testing.assert_allclose(
        limited.log_density(y, eta[:, :2], SIGMA), one.log_density(both, eta[:, :2], SIGMA)
    )


def test_subsets_in_another_order_keep_their_limits():
    X, y, model, _ = of_rows(0)
    order = np.random.default_rng(0).permutation(len(y))[:45]
    rest = np.setdiff1d(np.arange(len(y)), order)
    fitted = model.fit(X[order], y[order])
    density = fitted.log_predictive_density(X[rest], y[rest])
    draws = fitted.posterior_
    eta, sigma = draws.eta(X[rest])
    side = model.likelihood.side(y[rest])
    assert 0 < np.mean(side) + 1 < 1
    each = np.where(
        side < 0, stats.norm(eta, sigma).logcdf(y[rest]), stats.norm(eta, sigma).logpdf(y[rest])
    )
    np.testing.assert_allclose(density, special.logsumexp(each, axis=0) - np.log(len(eta)))


@pytest.mark.slow
def test_rows_below_their_own_limits_over_200_sets():
    """Some 30 % of the rows; the same taken for values are biased."""
    off, inside, naive, share = [], [], [], []
    for seed in range(2000, 2200):
        X, y, model, truth = of_rows(seed)
        share.append(np.mean(model.likelihood.side(y) < 0))
        table = model.fit(X, y).summary()
        rows = table.loc[list(truth)].astype({"mean": float, "sd": float})
        true = np.array([*truth.values()])
        off.append((rows["mean"] - true) / rows["sd"])
        inside.append((rows["q5"] < true) & (true < rows["q95"]))
        if seed < 2040:
            table = model.set_params(likelihood="normal").fit(X, y).summary()
            row = table.loc["sigma"]
            naive.append((row["mean"] - truth["sigma"]) / row["sd"])
    assert 0.25 < np.mean(share) < 0.4
    # slope and noise: means within three standard errors of none, intervals as wide as they are
    assert np.all(np.abs(np.mean(off, axis=0)) < 3 / np.sqrt(200))
    assert np.all(np.abs(np.mean(inside, axis=0) - 0.9) < 0.055)
    assert np.mean(naive) < -0.5


@pytest.mark.slow
def test_a_diagnosis_with_limits_of_rows():
    X, y, model, _ = of_rows(4, n=80)
    settings = {"cv": None, "n_replicates": 50, "random_state": 0}
    few = all_but("step", "trend", "periodic", "noise")
    found = hs.DiscrepancyDiagnosis(model, exclude=few, **settings).fit(X, y)
    assert found.verdict_ == "adequate"
    jump = 2.0 * (X[:, 0] > 0.2)
    limit = np.where(model.likelihood.side(y) < 0, y, np.nan)
    y, limited = hs.Censored.of_rows(y + jump, below=limit + jump)
    found = hs.DiscrepancyDiagnosis(
        model.set_params(likelihood=limited), exclude=few, **settings
    ).fit(X, y)
    assert found.best_cause_.kind == "step"
    found.report().to_html()


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"below": [9.0, 9.0, 9.0]}, "None of the 3 values lies between its limits"),
        ({"below": [0.0, 0.0]}, "one limit for each of the 3 rows, got .2,."),
        ({"below": [0.0, np.inf, 0.0]}, "finite limits"),
        ({"below": [0.0, 2.0, 0.0], "above": 2.0}, "row 2 has 2 and 2"),
    ],
)
def test_limits_of_rows_without_sense_are_refused(limits, message):
    with pytest.raises(ValueError, match=message):
        hs.Censored.of_rows([1.0, 2.0, 3.0], **limits)


# ------------------------------------------------------------------------- limits of new rows


def new_rows(seed, n=40):
    """Return a fit, and new rows with limits that no row of the fit had, recorded at these."""
    X, y, model, truth = of_rows(seed)
    return model.fit(X, y), *recorded_anew(truth, seed, n)


def recorded_anew(truth, seed, n=40):
    random = np.random.RandomState(seed + 7)
    x = random.uniform(-1, 1, n)
    value = truth["a"] + truth["b"] * x + truth["sigma"] * random.standard_normal(n)
    low = truth["a"] + random.uniform(-1, 0.5, n)
    high = np.where(np.arange(n) % 3, np.nan, low + 1.0)
    low[1] = np.nan
    recorded = np.fmin(np.fmax(value, low), high)
    return x[:, None], recorded, low, high


def exact_density(fitted, X, y, low, high):
    eta, sigma = fitted.posterior_.eta(X)
    noise = stats.norm(eta, sigma)
    each = np.where(y <= low, noise.logcdf(y), np.where(y >= high, noise.logsf(y), noise.logpdf(y)))
    return special.logsumexp(each, axis=0) - np.log(len(eta))


def test_new_rows_at_limits_of_their_own_have_the_probability_of_the_tail():
    fitted, X, y, low, high = new_rows(0)
    exact = exact_density(fitted, X, y, low, high)
    assert np.any(y == low)
    assert np.any(y == high)
    limits = {"below": low, "above": high}
    density = fitted.log_predictive_density(X, y, **limits)
    np.testing.assert_allclose(density, exact)
    assert fitted.score(X, y, **limits) == pytest.approx(exact.mean())
    # a limit that is taken for a value has a density
    at = (y == low) | (y == high)
    plain = fitted.log_predictive_density(X, y)
    assert np.all(np.abs(plain - exact)[at] > 1e-3)
    # rows without a measurement, and one row alone
    y[3] = np.nan
    density = fitted.log_predictive_density(X, y, **limits)
    assert np.isnan(density[3])
    np.testing.assert_allclose(np.delete(density, 3), np.delete(exact, 3))
    k = int(np.flatnonzero(y == low)[0])
    one = fitted.score(X[[k]], y[[k]], below=low[k])
    assert one == pytest.approx(exact[k])


def test_a_fit_without_limits_may_be_scored_on_rows_with_some():
    fitted, X, y, low, high = new_rows(1)
    inside = (y > low) & ~(y >= high)
    again = fitted.set_params(likelihood="normal").fit(X[inside], y[inside])
    density = again.log_predictive_density(X, y, below=low, above=high)
    np.testing.assert_allclose(density, exact_density(again, X, y, low, high))
    # one limit of the fit stays where another is given
    limited = again.set_params(likelihood=hs.Censored(below=-0.2)).fit(X[inside], y[inside])
    y = np.maximum(y, -0.2)
    density = limited.log_predictive_density(X, y, above=high)
    exact = exact_density(limited, X, y, np.full(len(y), -0.2), high)
    np.testing.assert_allclose(density, exact)


def test_draws_and_intervals_of_new_rows_are_of_what_is_recorded():
    fitted, X, y, low, high = new_rows(2)
    limits = {"below": low, "above": high}
    draws = fitted.sample_posterior_predictive(X, n_draws=4000, random_state=0, **limits)
    assert np.all(draws >= np.nan_to_num(low, nan=-np.inf))
    assert np.all(draws <= np.nan_to_num(high, nan=np.inf))
    for limit, side in ((low, "below"), (high, "above")):
        there = np.flatnonzero(np.isfinite(limit))
        share = np.mean(draws[:, there] == limit[there], axis=0)
        log_tail = fitted.log_predictive_density(X[there], limit[there], **{side: limit[there]})
        # draws are of draws of the posterior: 400 are known to a standard error of 0.025
        np.testing.assert_allclose(share, np.exp(log_tail), atol=0.1)
    lower, upper = fitted.predict_interval(X, 0.9, **limits)
    free = fitted.predict_interval(X, 0.9)
    np.testing.assert_allclose(lower, np.fmin(np.fmax(free[0], low), high))
    np.testing.assert_allclose(upper, np.fmin(np.fmax(free[1], low), high))
    (inside,) = fitted.interval_holds(X, y, [0.9], **limits)
    np.testing.assert_array_equal(inside, (lower <= y) & (y <= upper))
    # a limit of the fit gives way to those of the rows
    limited = fitted.set_params(likelihood=hs.Censored(below=float(np.nanmax(low)))).fit(X, y)
    draws = limited.sample_posterior_predictive(X, n_draws=1000, random_state=0, below=low)
    assert draws.min() < np.nanmax(low) - 0.1
    free, own = limited.predict_interval(X, 0.9, below=low)[0], np.nan_to_num(low, nan=-np.inf)
    assert np.any((free < np.nanmax(low) - 0.1) & (free >= own))


def test_intervals_of_recorded_rows_cover():
    """A row at its limit is covered where its interval reaches the limit."""
    marked, new = [], []
    for seed in range(20):
        X, y, model, truth = of_rows(100 + seed, n=100)
        fitted = model.fit(X[:60], y[:60])
        marked += fitted.interval_holds(X[60:], y[60:], [0.9])
        X, y, low, high = recorded_anew(truth, 100 + seed)
        new += fitted.interval_holds(X, y, [0.9], below=low, above=high)
    # 20 sets of 40 rows that share a fit; a limit inside an interval covers more than 90 %
    assert 0.87 < np.mean(marked) < 0.97
    assert 0.87 < np.mean(new) < 0.97


def test_errors_of_rows_at_a_limit_count_on_one_side():
    """A prediction beyond the limit is no error."""
    X, y, model, _ = of_rows(3, n=100)
    fitted = model.fit(X[:60], y[:60])
    side, error = model.likelihood.side(y[60:]), y[60:] - fitted.predict(X[60:])
    scores = pointwise(fitted, X[60:], y[60:])
    np.testing.assert_allclose(scores.error[side == 0], error[side == 0])
    np.testing.assert_allclose(scores.error[side < 0], np.minimum(error[side < 0], 0.0))


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"below": [0.0, 1.0]}, "one limit for each of the 40 rows, got .2,."),
        ({"below": np.inf}, "finite limits"),
        ({"below": 0.5, "above": 0.5}, "row 1 has 0.5 and 0.5"),
    ],
)
def test_limits_of_new_rows_without_sense_are_refused(limits, message):
    fitted, X, y, *_ = new_rows(0)
    for call in (fitted.score, fitted.log_predictive_density):
        with pytest.raises(ValueError, match=message):
            call(X, y, **limits)
    for call in (fitted.predict_interval, fitted.sample_posterior_predictive):
        with pytest.raises(ValueError, match=message):
            call(X, **limits)


def two_outputs(seed, base="normal", n=60, **settings):
    """Return a fit of two outputs of different size, new rows, their values and limits."""
    random = np.random.RandomState(seed)
    on_log = base in ("lognormal", *COUNTS)
    truth = random.normal(1.5 if on_log else 0, 0.5), random.normal(0, 0.5)
    simulator = hs.Simulator(
        lambda x, a, b: (
            (np.exp(a + b * x), 9 * np.exp(a - b * x)) if on_log else (a + b * x, 90 * (a - b * x))
        ),
        inputs={"x": (-1, 1)},
        parameters={"a": stats.norm(1.5 if on_log else 0, 0.5), "b": stats.norm(0, 0.5)},
        output=("small", "large"),
    )
    size = np.array([1.0, 9.0 if on_log else 90.0])
    sigma = 0.5 if base in ("lognormal", *COUNTS) else 0.5 * size

    def drawn(n):
        x = random.uniform(-1, 1, (n, 1))
        mean = truth[0] + truth[1] * x * [1, -1]
        eta = mean + np.log(size) if on_log else mean * size
        return x, hs.Censored(base).sample(eta, np.broadcast_to(sigma, eta.shape), random)

    X, y = drawn(n)
    model = hs.PowerScaledSurrogate(
        simulator, hs.ExactSurrogate(), likelihood=base, n_draws=400, random_state=seed, **settings
    ).fit(X, y)
    new, value = drawn(40)
    # limits that owe nothing to these rows, 30 % of such rows below them, and some without
    low = np.quantile(drawn(400)[1], 0.3, axis=0) * np.ones((40, 1))
    if base in COUNTS:
        low = np.floor(low)
    low[::7, 1] = np.nan
    return model, new, value, low


def tail_of(base, eta, sigma):
    """Return the distribution function and log density of SciPy, with our second parameter."""
    if base == "poisson":
        return stats.poisson(np.exp(eta))
    if base == "negative-binomial":
        return stats.nbinom(sigma**-2, 1 / (1 + sigma**2 * np.exp(eta)))
    if base == "lognormal":
        return stats.lognorm(sigma, scale=np.exp(eta))
    return stats.t(4, eta, sigma) if base == "student-t" else stats.norm(eta, sigma)


@pytest.mark.parametrize("base", BASES)
def test_new_values_of_two_outputs_at_their_limits_have_the_probability_of_the_tail(base):
    fitted, X, value, low = two_outputs(0, base)
    y = np.fmax(value, low)
    y[3, 0] = np.nan
    scale = fitted.data_.stacking.scale
    eta, sigma = (
        fitted.data_.stacking.back(one) for one in fitted.posterior_.eta(fitted.checked_rows(X))
    )
    if base in ("lognormal", *COUNTS):
        sigma = sigma / scale
    scipy = tail_of(base, eta, sigma)
    plain = scipy.logpmf if base in COUNTS else scipy.logpdf
    each = np.where(y <= low, scipy.logcdf(low), plain(y))
    exact = special.logsumexp(each, axis=0) - np.log(len(eta))
    assert 0.15 < np.mean(y <= low) < 0.45
    density = fitted.log_predictive_density(X, y, below=low)
    np.testing.assert_allclose(density, exact, rtol=1e-6)
    assert fitted.score(X, y, below=low) == pytest.approx(np.nanmean(exact))
    # by name, in any order; one limit of each output, that of the second being none
    table = pd.DataFrame(low[:, ::-1], columns=["large", "small"])
    assert fitted.score(X, y, below=table) == pytest.approx(np.nanmean(exact))
    one = fitted.log_predictive_density(X, y, below=[low[0, 0], -np.inf])
    np.testing.assert_allclose(one[:, 0], exact[:, 0])
    # draws and intervals are of what is recorded
    draws = fitted.sample_posterior_predictive(X, 2000, random_state=0, below=low)
    assert np.all(draws >= np.nan_to_num(low, nan=-np.inf))
    share = np.mean(draws <= low, axis=0)[np.isfinite(low)]
    tail = np.exp(special.logsumexp(scipy.logcdf(low), axis=0) - np.log(len(eta)))
    # draws are of draws of the posterior: 400 are known to a standard error of 0.025
    np.testing.assert_allclose(share, tail[np.isfinite(low)], atol=0.1)
    lower, upper = fitted.predict_interval(X, 0.9, below=low)
    free = fitted.predict_interval(X, 0.9)
    np.testing.assert_allclose(lower, np.fmax(free[0], low))
    np.testing.assert_allclose(upper, np.fmax(free[1], low))
    (inside,) = fitted.interval_holds(X, y, [0.9], below=low)
    there = np.isfinite(y)
    same = (inside == ((lower <= y) & (y <= upper)))[there]
    # without a closed form they are quantiles of draws: a value next to an end is on either side
    assert np.mean(same) >= (1.0 if base in ("normal", "lognormal") else 0.97)
    assert np.isnan(inside[3, 0])


@pytest.mark.parametrize("base", ["normal", "lognormal"])
def test_outliers_have_the_mixture_of_the_tails(base):
    """All that can be recorded has probability one, and far tails are those of the widest."""
    random = np.random.default_rng(0)
    x = random.uniform(-1, 1, 60)
    y = 1 + 0.3 * x + 0.1 * random.standard_normal(60) * np.where(np.arange(60) % 9, 1, 10)
    y = np.exp(y) if base == "lognormal" else y
    fitted = hs.PowerScaledSurrogate(
        effects=[hs.Outliers()], likelihood=base, n_draws=200, random_state=0
    ).fit(x[:, None], y)
    low, high = np.quantile(y, [0.2, 0.9])
    limits = {"below": low, "above": high}

    def density(value):
        return np.exp(fitted.log_predictive_density([[0.2]], [value], **limits)).item()

    middle = integrate.quad(density, low + 1e-9, high - 1e-9, limit=200)[0]
    assert density(low) + middle + density(high) == pytest.approx(1.0, abs=1e-4)
    lower, upper = fitted.predict_interval([[0.2]], 0.98, **limits)
    assert low <= lower < upper <= high
    draws = fitted.sample_posterior_predictive([[0.2]], 4000, random_state=0, **limits)
    assert np.mean(draws == low) == pytest.approx(density(low), abs=0.03)
    # many standard deviations away only outliers of the widest kind
    eta, sigma = fitted.posterior_.eta(np.array([[0.2]]))
    share, scale = (
        fitted.posterior_.likelihood.share,
        np.exp(np.linspace(np.log(3), np.log(30), 4001)),
    )
    far = (np.log(low) if base == "lognormal" else low) - 40 * sigma.mean()
    each = (1 - share) * special.ndtr((far - eta) / sigma) + share * integrate.trapezoid(
        special.ndtr((far - eta) / sigma / scale), np.log(scale), axis=1
    )[:, None] / np.log(10)
    far = np.exp(far) if base == "lognormal" else far
    there = fitted.log_predictive_density([[0.2]], [far], below=far)
    assert there.item() == pytest.approx(np.log(each.mean()), abs=1e-4)


def test_counts_that_scatter_more_have_their_tails():
    random = np.random.RandomState(0)
    x = random.uniform(-1, 1, 80)
    y = random.negative_binomial(3, 3 / (3 + np.exp(2 + 0.5 * x))).astype(float)
    fitted = hs.PowerScaledSurrogate(
        effects=[hs.Overdispersion()], likelihood="poisson", n_draws=200, random_state=0
    ).fit(x[:, None], y)
    rows = np.zeros((400, 1))
    values = np.arange(400.0)
    whole = np.exp(fitted.log_predictive_density(rows, values))
    at = fitted.log_predictive_density(rows[:1], values[4:5], below=4.0)
    assert np.exp(at).item() == pytest.approx(whole[:5].sum())
    at = fitted.log_predictive_density(rows[:1], values[9:10], above=9.0)
    assert np.exp(at).item() == pytest.approx(1 - whole[:9].sum())


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"below": 0.2}, "each of the outputs small, large, or for each value, .40, 2., got .."),
        ({"below": np.zeros(40)}, "each of the outputs small, large"),
        ({"above": [np.nan, -np.inf]}, "finite limits"),
        ({"below": [0.0, 1.0], "above": [1.0, 1.0]}, "row 1 has 1 and 1"),
        ({"below": pd.DataFrame({"smal": [0.0] * 40, "large": 0.0})}, "lacks the outputs .'small'"),
    ],
)
def test_limits_of_several_outputs_without_sense_are_refused(limits, message):
    fitted, X, y, _ = two_outputs(0)
    with pytest.raises(ValueError, match=message):
        fitted.score(X, y, **limits)
    with pytest.raises(ValueError, match=message):
        fitted.predict_interval(X, **limits)


def with_outliers(seed):
    """Return a fit of a line whose rows are outliers at times, new rows, values and limits."""
    random = np.random.RandomState(seed)
    a, b = random.normal(size=2)

    def drawn(n):
        x = random.uniform(-1, 1, (n, 1))
        wide = np.where(random.uniform(size=(n, 1)) < 0.1, 3 * 10 ** random.uniform(size=(n, 1)), 1)
        return x, (a + b * x + 0.3 * wide * random.standard_normal((n, 1)))[:, 0]

    X, y = drawn(60)
    simulator = hs.Simulator(
        lambda x, a, b: a + b * x, {"x": (-1, 1)}, {"a": stats.norm(0, 1), "b": stats.norm(0, 1)}
    )
    model = hs.PowerScaledSurrogate(
        simulator, hs.ExactSurrogate(), effects=[hs.Outliers()], n_draws=400, random_state=seed
    )
    X_new, value = drawn(40)
    low = np.full(40, np.quantile(drawn(400)[1], 0.3))
    return model.fit(X, y), X_new, value, low


@pytest.mark.slow
@pytest.mark.parametrize("made", [two_outputs, with_outliers])
def test_limits_of_new_rows_over_100_sets(made):
    """Whether a value is recorded as below is predicted better than by its share, 30 %."""
    gain, off, inside, plain = [], [], [], []
    for seed in range(100):
        fitted, X, value, low = made(seed)
        y, given = np.fmax(value, low), np.isfinite(low)
        density, below = fitted.log_predictive_density(X, y, below=low), y <= low
        # values above their limits count as before
        before = fitted.log_predictive_density(X, y)
        np.testing.assert_allclose(density[~below], before[~below])
        tail = fitted.log_predictive_density(X, np.where(given, low, 0.0), below=low)[given]
        share = np.where(below[given], 0.3, 0.7)
        each = np.where(below[given], tail, np.log1p(-np.exp(np.minimum(tail, -1e-12))))
        gain.append(np.mean(each - np.log(share)))
        off.append(np.mean(np.exp(tail) - below[given]))
        plain.append(np.mean(fitted.interval_holds(X, value, [0.9])[0]))
        # below a limit that an interval reaches nothing is missed
        ends = fitted.predict_interval(X, 0.9)
        nominal = 0.9 + 0.05 * sum(np.where(given, end < low, False) for end in ends)
        inside.append(np.mean(fitted.interval_holds(X, y, [0.9], below=low)[0] - nominal))
    assert np.mean(gain) > 3 * np.std(gain) / 10
    assert abs(np.mean(off)) < 3 * np.std(off) / 10
    assert 0.86 < np.mean(plain) < 0.94
    assert abs(np.mean(inside)) < 0.03


def test_an_array_of_limits_says_where_it_goes():
    X = np.linspace(0, 1, 20)[:, None]
    for limits in (X[:, 0], [0.1, 0.2]):
        model = hs.PowerScaledSurrogate(likelihood=hs.Censored(below=limits))
        with pytest.raises(ValueError, match="Limits of rows"):
            model.fit(X, X[:, 0])
