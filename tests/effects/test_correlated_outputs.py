"""Errors of several outputs that are correlated within a measurement, known and estimated."""

import numpy as np
import pytest
from few_kinds import all_but
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal, norm, uniform

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.null_test import replicates

N, OUTPUTS = 30, ("height", "flow", "heat")
T = np.linspace(0, 10, N)
PRIORS = {"level": norm(0, 2), "slope": norm(0, 1)}
SD = np.array([0.3, 3.0, 0.1])
CORRELATION = np.array([[1.0, 0.8, -0.3], [0.8, 1.0, 0.1], [-0.3, 0.1, 1.0]])


def curves(t, level, slope):
    return level + slope * t, 10 * (level - slope * t), level + 0.2 * slope * t


def simulator_of(k=2):
    return hs.Simulator(
        lambda t, level, slope: curves(t, level, slope)[:k],
        {"t": (0, 10)},
        PRIORS,
        output=OUTPUTS[:k],
    )


def model_of(k=2, **settings):
    settings = {"surrogate": hs.ExactSurrogate(), "random_state": 0, **settings}
    return hs.PowerScaledSurrogate(simulator_of(k), **settings)


def covariances(k=2):
    """Return those of all rows, which scatter more from t = 5 on."""
    sd = SD[:k] * np.where(T > 5, 1.5, 1.0)[:, None]
    return CORRELATION[:k, :k] * sd[:, :, None] * sd[:, None]


def measured(seed, k=2, t=T, known=None):
    """Return what was measured, with gaps."""
    random = np.random.default_rng(seed)
    each = covariances(k) if known is None else known
    errors = np.stack([random.multivariate_normal(np.zeros(k), one) for one in each])
    y = np.column_stack(curves(t, 1.0, 0.5)[:k]) + errors
    y[3, 0] = y[7, 1] = np.nan
    return y


def exactly(y, k=2, each=None):
    """Return values, design, noise and prior predictive covariance of all that was measured."""
    design = np.stack(
        [
            np.column_stack([np.broadcast_to(a, N) for a in curves(T, *unit)[:k]])
            for unit in np.eye(2)
        ],
        axis=2,
    ).reshape(-1, 2)
    noise = block_diag(*(covariances(k) if each is None else each))
    there = np.isfinite(y.ravel())
    noise, design = noise[np.ix_(there, there)], design[there]
    return y.ravel()[there], design, noise, noise + design @ np.diag([4.0, 1.0]) @ design.T


@pytest.mark.parametrize("k", [2, 3])
def test_known_covariances_are_those_of_generalised_least_squares(k):
    y = measured(0, k)
    model = model_of(k, noise="known", n_draws=4000).fit(T[:, None], y, y_err=covariances(k))
    values, design, noise, whole = exactly(y, k)
    precision = design.T @ np.linalg.solve(noise, design) + np.diag([0.25, 1.0])
    mean = np.linalg.solve(precision, design.T @ np.linalg.solve(noise, values))
    sd = np.sqrt(np.diag(np.linalg.inv(precision)))
    table = model.summary().loc[["level", "slope"], ["mean", "sd"]].to_numpy(dtype=float)
    # 4000 draws, of which some count for less: four standard errors
    np.testing.assert_array_less(np.abs(table[:, 0] - mean), 4 * sd / np.sqrt(1000))
    np.testing.assert_allclose(table[:, 1], sd, rtol=0.07)
    units = np.sum(np.isfinite(y) * np.log(model.data_.stacking.scale))
    exact = multivariate_normal(cov=whole).logpdf(values)
    assert model.diagnostics_.log_evidence - units == pytest.approx(exact, abs=0.05)
    # left out one by one, given what else was measured: of the inverse of the covariance
    inverse = np.linalg.inv(whole)
    off, spread = inverse @ values / np.diag(inverse), np.diag(inverse) ** -0.5
    np.testing.assert_allclose(model.loo().pointwise, norm.logpdf(off, 0, spread), atol=0.1)


def test_the_densities_of_a_row_add_up_to_that_of_the_row(monkeypatch):
    y = measured(1)
    model = model_of(noise="known", n_draws=4000).fit(T[:, None], y, y_err=covariances())
    values, design, noise, _ = exactly(y)
    precision = design.T @ np.linalg.solve(noise, design) + np.diag([0.25, 1.0])
    covariance = np.linalg.inv(precision)
    mean = covariance @ design.T @ np.linalg.solve(noise, values)
    new = measured(2)
    there = model.log_predictive_density(T[:, None], new, y_err=covariances())
    for i, row in enumerate(new):
        own = np.column_stack([np.stack(curves(T[i], *unit)[:2]) for unit in np.eye(2)])
        some = np.isfinite(row)
        of_row = own[some] @ covariance @ own[some].T + covariances()[i][np.ix_(some, some)]
        exact = multivariate_normal(own[some] @ mean, of_row).logpdf(row[some])
        assert np.nansum(there[i]) == pytest.approx(exact, abs=0.05)
    # however few rows fit into memory at a time
    monkeypatch.setattr("hybridsurrogate.prediction.mixture.LARGE_BLOCK", 3 * 4000)
    pieces = model.log_predictive_density(T[:, None], new, y_err=covariances())
    np.testing.assert_allclose(pieces, there)
    # one covariance for few rows is one covariance, too
    two = model.log_predictive_density(T[:2, None], new[:2], y_err=covariances()[0])
    np.testing.assert_allclose(two, there[:2])
    # draws are correlated within a row alone
    drawn = model.sample_posterior_predictive(T[:2, None], 20000, random_state=0)
    found = np.corrcoef(drawn.reshape(-1, 4).T)
    assert found[0, 1] == pytest.approx(0.8, abs=0.03)
    assert found[2, 3] == pytest.approx(0.8, abs=0.03)
    assert abs(found[0, 3]) < 0.1
    # a value of which a limit is known is given to no other
    low = np.array([np.nan, y[0, 1] + 1.0])
    limited = model.log_predictive_density(T[:1, None], y[:1], covariances()[0], below=low)
    alone = y[:1] * [1.0, np.nan]
    alone = model.log_predictive_density(T[:1, None], alone, y_err=covariances()[0])
    assert limited[0, 0] == pytest.approx(alone[0, 0])


def each_draw(model):
    """Return the log likelihood of each draw as the fit has it, in units of y, and the draws."""
    rows, posterior = model.data_.single, model.posterior_
    eta, noise = posterior.eta(rows.X)
    density = norm.logpdf(rows.y, eta, noise) - model.data_.stacking.log_scale(rows.X)
    return density.sum(axis=1), posterior


@pytest.mark.parametrize("kind", ["added", "scaled", "estimated", "errors", "three"])
def test_each_draw_has_the_likelihood_of_its_covariance(kind):
    k = 3 if kind == "three" else 2
    y, effects = measured(3, k), [hs.OutputCorrelation()]
    noise, y_err, effects = {
        "added": ("added", covariances() / 4, ()),
        "scaled": ("scaled", covariances() / 4, ()),
        "estimated": ("added", None, effects),
        "errors": ("known", np.tile(SD[:2], (N, 1)), effects),
        "three": ("added", None, effects),
    }[kind]
    model = model_of(k, noise=noise, effects=effects, n_draws=50).fit(T[:, None], y, y_err=y_err)
    density, posterior = each_draw(model)
    values, design, _, _ = exactly(y, k)
    scale, names = model.data_.stacking.scale, OUTPUTS[:k]
    named, errors = posterior.named(), model.data_.errors
    for s in range(5):
        each, sd = covariances() / 4, posterior.sigma[s] * scale
        if errors is not None:
            # where sigma is known, samplers still move by a thousandth
            sd = np.full(k, posterior.sigma[s] / errors.unit)
        if kind in ("scaled", "estimated", "three"):
            sd = sd * [1.0, *(named[f"noise of {name}"][s] for name in names[1:])]
        if kind == "added":
            each = each + np.diag(([named[f"jitter of {name}"][s] for name in names] * scale) ** 2)
        if kind in ("estimated", "errors", "three"):
            found, each = posterior.estimates(0), np.eye(k)
            for i, j in [(0, 1), (0, 2), (1, 2)][: 1 if k == 2 else 3]:
                word = "correlation" if k == 2 else f"correlation of {names[i]} and {names[j]}"
                each[i, j] = each[j, i] = found[word][s]
            if kind == "errors":
                each = each * np.outer(SD[:2], SD[:2])
        each = np.broadcast_to(each * np.outer(sd, sd), (N, k, k))
        _, _, covariance, _ = exactly(y, k, each)
        mean = design @ posterior.values[s, :2]
        exact = multivariate_normal(mean, covariance).logpdf(values)
        assert density[s] == pytest.approx(exact, abs=1e-6 * abs(exact))


def test_a_prior_at_the_truth_is_a_known_covariance():
    y, sd = measured(4, known=np.tile(covariances()[0], (N, 1, 1))), SD[:2]
    close = hs.OutputCorrelation(uniform(0.7999, 0.0002))
    models = [
        model_of(noise="known", n_draws=2000).fit(T[:, None], y, y_err=covariances()[0]),
        model_of(noise="known", effects=[close], n_draws=2000).fit(
            T[:, None], y, y_err=np.tile(sd, (N, 1))
        ),
    ]
    names = ["level", "slope"]
    one, other = (model.summary().loc[names, ["mean", "sd"]].astype(float) for model in models)
    np.testing.assert_array_less(np.abs(one["mean"] - other["mean"]), 0.15 * one["sd"])
    np.testing.assert_allclose(one["sd"], other["sd"], rtol=0.1)
    assert models[1].summary().loc["correlation", "mean"] == pytest.approx(0.8, abs=1e-3)


@pytest.mark.parametrize(
    "beta", [0.3, *(pytest.param(beta, marks=pytest.mark.slow) for beta in (0.6, 0.9))]
)
def test_the_order_of_the_outputs_changes_no_fit_of_two_steps(beta):
    """Each value is given those before it in its row: other ones, and the same posterior."""
    y, found = measured(5), []
    for order in ([0, 1], [1, 0]):
        simulator = hs.Simulator(
            lambda t, level, slope, order=order: tuple(curves(t, level, slope)[k] for k in order),
            {"t": (0, 10)},
            PRIORS,
            output=tuple(OUTPUTS[k] for k in order),
        )
        model = hs.PowerScaledSurrogate(
            simulator.run(60, random_state=0),
            hs.PolynomialChaos(2),
            beta=beta,
            noise="known",
            random_state=0,
        )
        model.fit(T[:, None], y[:, order], y_err=covariances()[:, order][:, :, order])
        found.append(model)
    one, other = (m.summary().loc[["level", "slope"], ["mean", "sd"]].astype(float) for m in found)
    np.testing.assert_array_less(np.abs(one["mean"] - other["mean"]), 0.15 * one["sd"])
    np.testing.assert_allclose(one["sd"], other["sd"], rtol=0.12)
    if beta > 0.3:
        assert found[0].loo().elpd == pytest.approx(found[1].loo().elpd, abs=0.03)


@pytest.mark.parametrize("kind", ["known", "estimated"])
def test_replicates_are_correlated_as_far_as_that_is_known(kind):
    n, random = 16, np.random.default_rng(0)
    y = random.multivariate_normal([0, 0], CORRELATION[:2, :2] * np.outer(SD[:2], SD[:2]), n)
    simulator = hs.Simulator(
        lambda t, level: np.stack([level + 0 * t, 10 * level + 0 * t], axis=-1),
        {"t": (0, 1)},
        {"level": norm(0, 1e-6)},
        output=OUTPUTS[:2],
    )
    known = kind == "known"
    model = hs.PowerScaledSurrogate(
        simulator,
        hs.ExactSurrogate(),
        noise="known" if known else "added",
        effects=[] if known else [hs.OutputCorrelation()],
        random_state=0,
    )
    search = hs.DiscrepancyDiagnosis(
        model, exclude=all_but("offset"), cv=None, n_replicates=20, random_state=0
    )
    y_err = CORRELATION[:2, :2] * np.outer(SD[:2], SD[:2]) if known else None
    search = search.fit(np.linspace(0, 1, n)[:, None], y, y_err=y_err).search_
    problem, null = search.problem, search.candidates[0].fit.model
    given = null.conditional(problem.X, null.values(np.zeros((1, null.n_unknowns))))
    drawn = replicates(search, 4000, np.random.RandomState(0))
    # rows are given others of their measurement: back to what would be measured
    off = (drawn - problem.y)[:, given.members]
    again = problem.y[given.members] + (np.linalg.inv(given.weight) @ off[..., None])[..., 0]
    a, b = again[..., 0], again[..., 1]
    found = np.sum(a * b, axis=1) / np.sqrt(np.sum(a**2, axis=1) * np.sum(b**2, axis=1))
    angle = np.arctanh(found)
    # Fisher's variance for sixteen rows around no fitted mean, and that of what was estimated
    exact = 1 / (n - 2) + (0 if known else 1 / (n - 0.5))
    assert np.var(angle) == pytest.approx(exact, rel=0.15)
    # what the second has of the first, and noise of its own
    noise = null.simulated(problem.X, null.values(np.zeros((1, null.n_unknowns))))[2]
    first, second = noise[0, given.members[0]]
    shared = -given.weight[0, 0, 1, 0] * first
    assumed = shared / np.hypot(shared, second)
    assert np.tanh(np.mean(angle)) == pytest.approx(assumed, abs=0.02)
    assert assumed == pytest.approx(0.8, abs=1e-9 if known else 0.15)


# ----------------------------------------------------------------------------------- bad input


def changed(**entries):
    out = covariances()
    for place, value in entries.items():
        out[4, *map(int, place[1:])] = value
    return out


@pytest.mark.parametrize(
    ("y_err", "settings", "message"),
    [
        (changed(_01=0.1), {}, "row 5: covariance is not symmetric"),
        (changed(_00=np.nan), {}, "row 5: covariance has 1 values that are NaN"),
        (-covariances()[0], {}, "not positive definite"),
        (np.outer(SD[:2], SD[:2]), {}, "Add the variance of what each output has alone"),
        (np.ones((N, 3, 3)), {}, r"no covariance of the 2 outputs height, flow in 30 rows"),
        (covariances()[:5], {}, r"give shape \(2, 2\) for all rows, or \(30, 2, 2\)"),
        (covariances(), {"likelihood": "student-t"}, "give standard deviations"),
        (covariances(), {"effects": [hs.OutputCorrelation()]}, "leave out OutputCorrelation"),
        (covariances(), {"effects": [hs.Outliers()]}, "outliers are not"),
        (None, {"effects": [hs.OutputCorrelation()], "likelihood": "student-t"}, "needs a likelih"),
    ],
)
def test_what_is_no_covariance_is_refused(y_err, settings, message):
    with pytest.raises(ValueError, match=message):
        model_of(noise="added", **settings).fit(T[:, None], measured(0), y_err=y_err)


def test_a_single_output_has_no_correlation_and_a_further_set_none_that_is_known():
    one = hs.Simulator(lambda t, level: level + 0 * t, {"t": (0, 10)}, {"level": norm(0, 2)})
    model = hs.PowerScaledSurrogate(one, hs.ExactSurrogate(), effects=[hs.OutputCorrelation()])
    with pytest.raises(ValueError, match="of several outputs, and there is one"):
        model.fit(T[8:, None], measured(0)[8:, 1])
    y, known = measured(0), covariances()
    more = hs.Source((T[:, None], y), y_err=np.tile(SD[:2], (N, 1)))
    runs = simulator_of().run(40, random_state=0)
    model = hs.MultiSourceSurrogate([hs.Source(runs), more], surrogate=hs.PolynomialChaos(2))
    with pytest.raises(ValueError, match="those of one measured set"):
        model.fit(T[:, None], y, y_err=known)


# ------------------------------------------------------------------------------- rates over sets


def drawn(seed, n=30):
    """Return a set whose truth is from the priors: rows, outputs, their covariance, the truth."""
    random = np.random.default_rng([seed, 54])
    t, truth = np.sort(random.uniform(0, 10, n)), (random.normal(0, 2), random.normal())
    covariance = CORRELATION[:2, :2] * np.outer(SD[:2], SD[:2])
    y = np.column_stack(curves(t, *truth)[:2])
    return t, y + random.multivariate_normal(np.zeros(2), covariance, n), covariance, truth


@pytest.mark.slow
def test_intervals_cover_over_100_sets():
    """Of 90 % intervals; taken for independent, one is too narrow and the other too wide."""
    inside = {"known": [], "estimated": [], "independent": []}
    for seed in range(100):
        t, y, covariance, truth = drawn(seed)
        for kind, found in inside.items():
            effects = [hs.OutputCorrelation()] if kind == "estimated" else []
            model = model_of(noise="known" if kind == "known" else "added", effects=effects)
            table = model.fit(
                t[:, None], y, y_err=covariance if kind == "known" else None
            ).summary()
            names = {"level": truth[0], "slope": truth[1], "correlation": 0.8}
            found.append(
                [table.q5[k] < v < table.q95[k] for k, v in names.items() if k in table.q5]
            )
    # binomial, 100 sets of 90 %: 0.03 is one standard error
    for kind in ("known", "estimated"):
        assert np.all(np.abs(np.mean(inside[kind], axis=0) - 0.9) < 0.08)
    level, slope = np.mean(inside["independent"], axis=0)
    assert level < 0.85
    assert slope > 0.97


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["known", "estimated"])
def test_a_diagnosis_knows_what_outputs_share(kind):
    t, y, covariance, _ = drawn(1)
    y_err = covariance if kind == "known" else None
    effects = [] if kind == "known" else [hs.OutputCorrelation()]
    model = model_of(noise="known" if kind == "known" else "added", effects=effects)
    few = all_but("step", "trend", "periodic", "missing-input", "noise")
    settings = {"cv": 3, "n_replicates": 50, "exclude": few, "random_state": 0}
    found = hs.DiscrepancyDiagnosis(model, **settings).fit(t[:, None], y, y_err=y_err)
    assert found.p_value_ > 0.05
    y[:, 1] += 2 * SD[1] * (t > 5)
    found = hs.DiscrepancyDiagnosis(model, **settings).fit(t[:, None], y, y_err=y_err)
    assert (found.best_cause_.kind, found.best_cause_.target) == ("step", "flow: t")
    assert found.p_value_ < 0.05
    # folds have the covariances of their rows, and so have new ones
    assert found.gain_.elpd_difference > 0
    found.report(full=True).to_html()
    runs = simulator_of().run(60, random_state=0)
    model = hs.PowerScaledSurrogate(runs, hs.PolynomialChaos(2), noise="known")
    chosen = hs.choose_beta(model, t[:, None], y, [0.2, 0.5], 3, y_err=covariance)
    assert np.isfinite(chosen.table["elpd"]).all()
    found.update([[3.0], [4.0]], y[:2], y_err=y_err)
    assert np.isfinite(found.score(t[:, None], y, y_err=y_err))


def test_it_is_no_cause_to_be_searched_for():
    y = measured(0)
    few = all_but("step")
    diagnosis = hs.DiscrepancyDiagnosis(
        model_of(), causes=[hs.OutputCorrelation()], exclude=few, cv=None, random_state=0
    )
    with pytest.warns(hs.DiagnosisWarning, match="give it to the estimator"):
        diagnosis.fit(T[:, None], y)
