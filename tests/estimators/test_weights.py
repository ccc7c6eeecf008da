"""Weights between sources, their choice, and leave-one-out scores."""

import numpy as np
import pytest
from agreement import assert_same_numbers
from scipy import stats
from scipy.stats import halfnorm, norm
from shared_files import ReferenceCase, needs_reference
from sklearn.base import clone
from sklearn.model_selection import TimeSeriesSplit

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin
from hybridsurrogate.inference.loo import stacking_weights

CUBIC = hs.PolynomialChaos(degree=3)


@pytest.fixture(scope="module")
def case():
    return make_log_sin(random_state=0)


def power_scaled(case, **parameters):
    return hs.PowerScaledSurrogate(
        case.simulation, **{"surrogate": CUBIC, "random_state": 0, **parameters}
    )


# ------------------------------------------------------------------------------------- sources


def test_two_sources_are_beta(case):
    alone = power_scaled(case, beta=0.2).fit(case.X, case.y)
    sources = [hs.Source(case.simulation, power=0.25)]
    several = hs.MultiSourceSurrogate(sources, surrogate=CUBIC, random_state=0)
    several.fit(case.X, case.y)
    np.testing.assert_allclose(several.predict(case.X_out), alone.predict(case.X_out), rtol=1e-6)


def test_a_set_in_two_parts_is_the_set(case):
    whole = hs.MultiSourceSurrogate(
        [hs.Source(case.simulation, 0.5)], surrogate=CUBIC, random_state=0
    ).fit(case.X, case.y)
    runs = case.simulation
    halves = [
        hs.SimulationData(
            runs.X[part],
            runs.omega[part],
            runs.y[part],
            inputs=runs.input_ranges,
            parameters=runs.parameters,
        )
        for part in (np.s_[:40], np.s_[40:])
    ]
    sources = [hs.Source(half, 0.5) for half in halves]
    sources.append(hs.Source((case.X[20:], case.y[20:]), 1.0))
    parts = hs.MultiSourceSurrogate(sources, surrogate=CUBIC, random_state=0)
    parts.fit(case.X[:20], case.y[:20])
    # the same numbers summed in another order
    np.testing.assert_allclose(parts.predict(case.X_in), whole.predict(case.X_in), rtol=1e-6)


def test_a_source_of_no_power_is_not_there(case):
    with_it = [hs.Source(case.simulation, 1.0), hs.Source((case.X, case.y + 50), 0.0)]
    models = [
        hs.MultiSourceSurrogate(sources, surrogate=CUBIC, random_state=0).fit(case.X, case.y)
        for sources in (with_it, with_it[:1])
    ]
    assert_same_numbers(models[0].predict(case.X_in), models[1].predict(case.X_in))


@pytest.mark.parametrize(
    ("sources", "power", "error", "match"),
    [
        ([3], 1.0, TypeError, "sources must hold Source objects"),
        ([hs.Source(([[1.0]], [1.0]), 2.0)], 1.0, ValueError, "power of a source == 2.0"),
        ([hs.Source(([[1.0]], [1.0]), 0.0)], 0.0, ValueError, "powers of all sources are zero"),
        ([hs.Source(([[1.0, 2.0]], [1.0]))], 1.0, ValueError, r"must have X of shape \(n, 1\)"),
    ],
)
def test_bad_sources(case, sources, power, error, match):
    with pytest.raises(error, match=match):
        hs.MultiSourceSurrogate(sources, power).fit(case.X, case.y)


# --------------------------------------------------------------------------- weights of single rows


@pytest.mark.parametrize(
    ("estimator", "surrogate"),
    [
        (hs.PowerScaledSurrogate, CUBIC),
        (hs.PowerScaledSurrogate, hs.GaussianProcess(degree=5)),
        (hs.PredictiveWeightedSurrogate, CUBIC),
    ],
)
def test_a_row_of_weight_two_is_two_rows(case, estimator, surrogate):
    weights = np.tile([0.0, 1.0, 2.0], 10)
    model = estimator(case.simulation, surrogate=surrogate, n_draws=300, random_state=0)
    weighted = clone(model).fit(case.X, case.y, sample_weight=weights)
    index = np.repeat(np.arange(30), weights.astype(int))
    repeated = clone(model).fit(case.X[index], case.y[index])
    assert_same_numbers(weighted.predict(case.X_out), repeated.predict(case.X_out))


@pytest.mark.parametrize(
    ("weights", "match"),
    [
        (np.zeros(30), "sums to zero"),
        (-np.ones(30), "finite and not negative"),
        (np.ones(29), r"shape \(30,\)"),
    ],
)
def test_bad_weights(case, weights, match):
    with pytest.raises(ValueError, match=match):
        power_scaled(case).fit(case.X, case.y, sample_weight=weights)


def test_beta_of_x(case):
    constant = power_scaled(case, beta=0.3).fit(case.X, case.y)
    same = power_scaled(case, beta=lambda X: np.full(len(X), 0.3)).fit(case.X, case.y)
    np.testing.assert_allclose(same.predict(case.X_in), constant.predict(case.X_in), rtol=1e-6)

    # predictive weighting: measured data up to 100, the simulation beyond
    mixture = hs.PredictiveWeightedSurrogate(case.simulation, surrogate=CUBIC, random_state=0)
    mixture.set_params(beta=lambda X: (X[:, 0] > 100).astype(float)).fit(case.X, case.y)
    ends = [clone(mixture).set_params(beta=beta).fit(case.X, case.y) for beta in (0.0, 1.0)]
    np.testing.assert_allclose(mixture.predict(case.X_in), ends[0].predict(case.X_in))
    np.testing.assert_allclose(mixture.predict(case.X_out), ends[1].predict(case.X_out))
    both = np.concatenate([case.X_in, case.X_out])
    draws = mixture.sample_posterior_predictive(both, n_draws=300, random_state=0)
    assert draws.shape == (300, len(both))
    assert mixture.to_arviz() is not None

    with pytest.raises(ValueError, match=r"beta\(X\) must return shape \(100,\)"):
        power_scaled(case, beta=lambda X: 0.5).fit(case.X, case.y)
    with pytest.raises(ValueError, match="between 0 and 1 for every row"):
        power_scaled(case, beta=lambda X: X[:, 0]).fit(case.X, case.y)


# ------------------------------------------------------------------------------ leave one out


@pytest.mark.parametrize("alpha", [0.3, 1.0])
def test_leave_one_out_of_a_conjugate_posterior(alpha):
    """A line in x with known noise, runs at full power, measured rows at power alpha."""
    rng = np.random.default_rng(0)
    noise = 0.5
    runs_x, x = rng.uniform(-1, 1, 12), np.linspace(-1, 1, 14)
    runs_y, y = 1 + runs_x + rng.normal(0, noise, 12), 1.3 + 0.6 * x + rng.normal(0, noise, 14)
    runs = hs.SimulationData(runs_x, None, runs_y, inputs={"x": (-1, 1)})
    model = hs.PowerScaledSurrogate(
        runs,
        surrogate=hs.PolynomialChaos(1, norm(0, 2)),
        beta=1 / (1 + alpha),
        noise_prior=stats.lognorm(s=1e-4, scale=noise),
        n_draws=20_000,
        random_state=0,
    ).fit(x[:, None], y)

    def features(x):
        return np.column_stack([np.ones(len(x)), np.sqrt(1.5) * x])

    exact = np.empty(14)
    for i in range(14):
        rest = np.arange(14) != i
        precision = np.eye(2) / 4 + features(runs_x).T @ features(runs_x) / noise**2
        precision += alpha * features(x[rest]).T @ features(x[rest]) / noise**2
        right = features(runs_x).T @ runs_y + alpha * features(x[rest]).T @ y[rest]
        mean = np.linalg.solve(precision, right / noise**2)
        row = features(x[i : i + 1])[0]
        sd = np.sqrt(noise**2 + row @ np.linalg.solve(precision, row))
        exact[i] = norm.logpdf(y[i], row @ mean, sd)
    loo = model.loo()
    assert loo.n_refits == 0
    np.testing.assert_allclose(loo.pointwise, exact, atol=0.02)
    assert loo.elpd == pytest.approx(exact.mean(), abs=0.005)
    if alpha != 1.0:
        # the weights of an ordinary posterior would take more away than the row gave
        log_likelihood = norm.logpdf(y, model.first_step_.eta(x[:, None])[0], noise)
        naive = -(np.logaddexp.reduce(-log_likelihood) - np.log(len(log_likelihood)))
        assert np.abs(naive - exact).max() > 0.05


@pytest.mark.slow
def test_leave_one_out_is_a_fit_without_the_row(case):
    model = power_scaled(case, beta=0.5, n_draws=4000).fit(case.X, case.y)
    loo = model.loo()
    # both ends and three rows between, each left out for real
    rows = [0, 8, 15, 22, 29]
    for i in rows:
        rest = np.arange(30) != i
        fitted = clone(model).fit(case.X[rest], case.y[rest])
        exact = fitted.log_predictive_density(case.X[[i]], case.y[[i]])[0]
        assert loo.pointwise[i] == pytest.approx(exact, abs=0.15)
    assert loo.elpd < model.score(case.X, case.y)
    assert loo.standard_error > 0


def test_leave_one_out_speaks_of_the_rows_in_fit_alone(case):
    # a further measured set sorts in between; a row without weight is predicted by the others
    further = hs.Source((case.X[::2] + 0.5, case.y[::2]), 0.5)
    sources = [hs.Source(case.simulation), further]
    model = hs.MultiSourceSurrogate(sources, surrogate=CUBIC, n_draws=3000, random_state=0)
    model.fit(case.X[1::2], case.y[1::2])
    loo = model.loo()
    assert loo.pointwise.shape == (15,)
    assert loo.elpd == pytest.approx(loo.pointwise.mean())
    for i in (3, 9):
        rest = np.arange(15) != i
        X, y = case.X[1::2], case.y[1::2]
        fitted = clone(model).fit(X[rest], y[rest])
        exact = fitted.log_predictive_density(X[[i]], y[[i]])[0]
        assert loo.pointwise[i] == pytest.approx(exact, abs=0.1)

    silent = hs.MultiSourceSurrogate([*sources], power=0.0, surrogate=CUBIC, random_state=0)
    silent.fit(case.X[1::2], case.y[1::2])
    assert silent.loo().elpd == pytest.approx(silent.score(case.X[1::2], case.y[1::2]))


# ------------------------------------------------------------------------------------ stacking


@needs_reference
def test_stacking_finds_the_reference_optima():
    data = ReferenceCase("case1")
    model = hs.PredictiveWeightedSurrogate(
        data.simulation,
        surrogate=data.surrogate,
        noise_prior=halfnorm(scale=0.5),
        n_draws=4000,
        random_state=0,
    ).fit(data.X, data.y)
    densities = {}
    for table in ("oos", "ood"):
        X, y = data.tables[table][["x"]].to_numpy(), data.tables[table]["y"].to_numpy()
        densities[table] = [
            model.set_params(beta=beta).fit(data.X, data.y).log_predictive_density(X, y)
            for beta in (1.0, 0.0)
        ]
    both = [np.concatenate(pair) for pair in zip(*densities.values(), strict=True)]

    def optimum(pair):
        return stacking_weights(np.column_stack(pair))[0]

    assert optimum(densities["oos"]) == pytest.approx(0.001, abs=0.01)
    assert optimum(densities["ood"]) == pytest.approx(0.999, abs=0.01)
    assert optimum(both) == pytest.approx(0.29, abs=0.03)


def test_stacking_chooses_beta(case):
    model = hs.PredictiveWeightedSurrogate(
        case.simulation, surrogate=CUBIC, beta="stacking", random_state=0
    ).fit(case.X, case.y)
    assert 0 <= model.beta_ <= 1
    # what it maximised: no other weight has a better leave-one-out score
    best = model.loo().elpd
    for beta in (0.0, 0.5, 1.0):
        other = clone(model).set_params(beta=beta).fit(case.X, case.y)
        assert other.loo().elpd < best + 0.02
    with pytest.raises(ValueError, match='callable or "stacking"'):
        clone(model).set_params(beta="best").fit(case.X, case.y)


# ------------------------------------------------------------------------------- along the path


@pytest.mark.slow
def test_path_agrees_with_fits(case):
    betas = np.linspace(0, 1, 21)
    model = power_scaled(case, surrogate=hs.PolynomialChaos(degree=5))
    path = hs.beta_path(model, case.X, case.y, betas)
    assert path.n_refits <= 6
    assert str(path) == f"21 betas from {path.n_refits} fits"
    ours = path.score(case.X_in, case.y_in)
    fits = np.array(
        [
            [
                clone(model).set_params(beta=beta, random_state=seed).fit(case.X, case.y)
                .score(case.X_in, case.y_in)
                for beta in betas
            ]
            for seed in (1, 2, 3)
        ]
    )  # fmt: skip
    error = np.maximum(fits.std(axis=0, ddof=1), 0.002)
    assert (np.abs(ours - fits.mean(axis=0)) < 6 * error).all()


def test_path_warns_of_the_data_once(case):
    narrow = hs.SimulationData(
        case.simulation.X,
        case.simulation.omega,
        case.simulation.y,
        inputs=["x"],
        parameters=case.simulation.parameters,
    )
    model = hs.PowerScaledSurrogate(narrow, surrogate=CUBIC, random_state=0)
    with pytest.warns(hs.ExtrapolationWarning) as caught:
        hs.beta_path(model, case.X, case.y, [0.3, 0.5, 0.7])
    assert len(caught) == 1


def test_path_of_a_mixture_is_one_fit(case):
    model = hs.PredictiveWeightedSurrogate(case.simulation, surrogate=CUBIC, random_state=0)
    path = hs.beta_path(model, case.X, case.y, [0.0, 0.4, 1.0])
    assert path.n_refits == 1
    direct = clone(model).set_params(beta=0.4).fit(case.X, case.y)
    assert_same_numbers(path.score(case.X_in, case.y_in)[1], direct.score(case.X_in, case.y_in))


def test_bad_paths(case):
    with pytest.raises(ValueError, match="numbers between 0 and 1"):
        hs.beta_path(power_scaled(case), case.X, case.y, [0.5, 1.5])
    with pytest.raises(TypeError, match="needs a PowerScaledSurrogate or a Predictive"):
        hs.beta_path(hs.KennedyOHaganSurrogate(case.simulation), case.X, case.y, [0.5])


@pytest.mark.parametrize("cv", [3, TimeSeriesSplit(3), "leave-future-out"], ids=str)
def test_choice_of_beta(case, cv):
    model = hs.PredictiveWeightedSurrogate(
        case.simulation, surrogate=CUBIC, n_draws=300, random_state=0
    )
    choice = hs.choose_beta(model, case.X, case.y, betas=[0.0, 0.5, 1.0], cv=cv)
    table = choice.table.set_index("beta")
    # the same density summed otherwise: of equal weights either may be the best
    assert table.loc[choice.beta, "elpd"] >= table["elpd"].max() - 1e-9
    assert choice.estimator.beta == choice.beta
    assert table.loc[choice.beta, "difference"] == 0
    with pytest.raises(ValueError, match="leave-future-out"):
        hs.choose_beta(model, case.X, case.y, cv="future")


# ------------------------------------------------------------------------- Kennedy and O'Hagan


@pytest.mark.slow
@needs_reference
def test_kennedy_ohagan_against_stan():
    data = ReferenceCase("case1")
    model = hs.KennedyOHaganSurrogate(
        data.simulation,
        surrogate=hs.GaussianProcess(amplitude_prior=halfnorm(scale=1)),
        noise_prior=halfnorm(scale=0.5),
        amplitude_prior=halfnorm(scale=1),
        random_state=0,
    ).fit(data.X, data.y)
    draws = model.posterior_.named()
    # Stan: omega 0.917 (0.050), sigma 0.210 (0.034); ELPD 0.07, -1.11, both -0.52
    assert draws["omega"].mean() == pytest.approx(0.917, abs=0.25 * 0.050)
    assert draws["omega"].std() == pytest.approx(0.050, rel=0.15)
    assert draws["sigma"].mean() == pytest.approx(0.210, abs=0.034)
    elpd = {
        table: model.score(data.tables[table][["x"]].to_numpy(), data.tables[table]["y"])
        for table in ("oos", "ood")
    }
    assert elpd["oos"] == pytest.approx(0.07, abs=0.05)
    assert elpd["ood"] == pytest.approx(-1.11, abs=0.15)
    assert np.mean(list(elpd.values())) == pytest.approx(-0.52, abs=0.08)


def test_rows_of_no_weight_at_the_start_leave_draws_to_trust():
    """Measured rows far noisier than the runs: step 1 starts at a noise of the runs.

    There were 1.7 effective draws of 3000 and k-hat was 1.7, after ten CPU seconds.
    """
    runs = hs.Simulator(
        lambda t, g: g * t, {"t": (0, 4)}, {"g": hs.truncated_normal(2, 1, 0, 5)}
    ).run(64, random_state=0)
    t = np.linspace(0, 4, 40)
    y = 2 * t + np.random.default_rng(0).normal(0, 0.3, 40)
    weights = np.where(t < 2, 0.0, 1.0)
    model = hs.KennedyOHaganSurrogate(runs, random_state=0)
    found = model.fit(t[:, None], y, sample_weight=weights).diagnostics_
    assert found.second_khat < 0.7
    assert found.second_effective_draws > 100
    # the truth at rows that count, within a third of the noise
    counted = t[weights > 0]
    error = model.predict(counted[:, None]) - 2 * counted
    assert np.sqrt(np.mean(error**2)) < 0.1
