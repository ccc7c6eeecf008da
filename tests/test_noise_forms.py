"""Noise that follows the output, has heavy tails or is autocorrelated: formulas, fits, evidence."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hidden_effects.cases import make_case
from matplotlib.axes import Axes
from scipy import integrate, stats
from scipy.special import logsumexp

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.discrepancy import predict_locally
from hybridsurrogate.diagnosis.evidence import search
from hybridsurrogate.diagnosis.freed import freed
from hybridsurrogate.diagnosis.null import _replicates, null_test
from hybridsurrogate.diagnosis.verdict import form_of
from hybridsurrogate.effects.catalogue import catalogue
from hybridsurrogate.effects.picture import plot_cause
from hybridsurrogate.estimators.problem import make_context, make_problem
from hybridsurrogate.inference.layout import layout
from hybridsurrogate.inference.linearised import coefficient_belief, linearise
from hybridsurrogate.inference.noise import NoiseTable
from hybridsurrogate.inference.scan import scan
from hybridsurrogate.inference.shape_table import shape_of
from hybridsurrogate.likelihoods import Contaminated, Normal, as_likelihood
from hybridsurrogate.likelihoods.contaminated import log_shape, precision_at

LINE = hs.Simulator(
    lambda t, level, slope: level + slope * t,
    inputs={"t": (0, 10)},
    parameters={"level": stats.norm(1, 0.5), "slope": stats.norm(2, 0.3)},
)
LEVEL = hs.Simulator(
    lambda t, level: level + t, inputs={"t": (0, 4)}, parameters={"level": stats.norm(1, 0.5)}
)
FORMS = ("noise: mean", "noise: tails", "noise: autocorrelation")


def problem_of(X, y, simulator=LINE, noise_prior=None):
    columns = (*simulator.input_names, "extra")[: X.shape[1]]
    normal = as_likelihood("normal")
    problem = make_problem(simulator, hs.ExactSurrogate(), normal, noise_prior, (), columns, X, y)
    location = float(np.mean(y))
    n_inputs = len(simulator.input_names)
    context = make_context(
        simulator, columns, n_inputs, X, problem.scale, normal, problem.model.basis, location
    )
    return problem, context


def weigh(X, y, simulator=LINE, forms=(*FORMS, "noise", "trend", "step", "bump", "unexplained")):
    problem, context = problem_of(X, y, simulator)
    causes = [cause for cause in catalogue(context)[0] if form_of(cause) in forms]
    found = search(problem, causes, coefficient_belief(problem.model.basis, None))
    first = found.weighed[int(np.argmax(found.probability))]
    return found, "none" if first.cause is None else first.cause.name


def fitted(cause, X, y, simulator=LINE, **options):
    model = hs.PowerScaledSurrogate(
        simulator,
        effects=(cause,),
        random_state=0,
        **{"surrogate": hs.ExactSurrogate(), "n_draws": 100} | options,
    )
    return model.fit(X, y)


def ornstein_uhlenbeck(t, length, rng):
    path = rng.standard_normal(len(t))
    for k in range(1, len(t)):
        kept = np.exp((t[k - 1] - t[k]) / length)
        path[k] = kept * path[k - 1] + np.sqrt(1 - kept**2) * path[k]
    return path


# ------------------------------------------------------------------------- formulas, by hand


def test_noise_that_follows_the_output_by_hand():
    context = problem_of(np.arange(3.0)[:, None], np.array([2.0, 4.0, 6.0]))[1]
    cause = hs.NoiseOfMean().prepare(context)
    size = np.sqrt(56 / 3)
    assert cause.size == pytest.approx(size)
    factor = cause.noise({hs.SIMULATED: np.array([0.0, -size])}, {"exponent": np.array(0.5)})
    np.testing.assert_allclose(factor, [np.sqrt(0.05), (1 + 1 / 400) ** 0.25])
    # an output that moves by a small share of its size: the exponent may be as much larger
    assert cause.exponent.std() == pytest.approx(max(1, size / (2 * np.std([2, 4, 6]))))
    told = cause.estimates({"exponent": np.array([1.0])}, {})
    low, high = 4 - np.std([2, 4, 6]), 4 + np.std([2, 4, 6])
    assert told["ratio"][0] == pytest.approx(high / low, rel=0.02)


def test_noise_that_follows_a_logarithmic_output():
    cause = hs.NoiseOfMean(center=2.0, size=3.0, spread=1.0, log_scale=True).prepare(None)
    factor = cause.noise({hs.SIMULATED: np.array([2.0, 3.0])}, {"exponent": -0.5})
    np.testing.assert_allclose(factor, [1, np.exp(-0.5)])


def outlier_density(z, share):
    """Return the density of a standardised residual by quadrature over the scale of outliers."""

    def part(log_scale):
        return stats.norm(0, np.exp(log_scale)).pdf(z) / np.log(10)

    far = integrate.quad(part, np.log(3), np.log(30), epsabs=1e-14)[0]
    return (1 - share) * stats.norm.pdf(z) + share * far


@pytest.mark.parametrize("z", [0.0, 0.3, 2.0, -5.0, 40.0])
def test_density_of_outliers_is_a_mixture_over_their_scale(z):
    at, share = np.array([[z]]), np.array([[0.07]])
    assert np.exp(log_shape(at, share)).item() == pytest.approx(outlier_density(z, 0.07), rel=1e-4)
    # the mean precision is minus the slope of the log density over z
    step = 1e-5
    slope = (log_shape(at + step, share) - log_shape(at - step, share)) / (2 * step)
    if abs(z) > 0.1:
        np.testing.assert_allclose(precision_at(at, share), -slope / at, rtol=1e-5)


def test_density_of_outliers_far_away_and_from_a_table():
    z, share = np.array([[1e3, 2e3, 1e5]]), np.array([0.01, 0.3])
    values = log_shape(z, share[:, None])
    assert np.isfinite(values).all()
    assert (np.diff(values, axis=1) < 0).all()
    near = np.linspace(-60, 60, 1001)[None]
    for told in ("log_density", "precision", "curvature"):
        exact, table = (getattr(shape_of(share, n), told)(near) for n in (1, 10**6))
        np.testing.assert_allclose(table, exact, atol=2e-3)


def test_a_likelihood_with_outliers_agrees_with_its_draws():
    some = Contaminated(Normal(), np.full((200_000, 1), 0.1))
    draws = some.sample(
        np.zeros((200_000, 1)), np.full((200_000, 1), 2.0), np.random.RandomState(0)
    )
    one = Contaminated(Normal(), np.array([[0.1]]))
    variance = one.variance(np.zeros((1, 1)), np.full((1, 1), 2.0)).item()
    assert np.mean(draws**2) == pytest.approx(variance, rel=0.05)
    beyond = np.mean(np.abs(draws) > 10)
    grid = np.linspace(10, 400, 40_001)
    density = np.exp(one.log_density(grid, np.zeros((1, 1)), np.full((1, 1), 2.0)))[0]
    assert beyond == pytest.approx(2 * integrate.trapezoid(density, grid), rel=0.05)


def test_autocorrelation_has_the_covariance_of_its_process():
    t = np.sort(np.random.default_rng(0).uniform(0, 10, 40))
    cause = hs.Autocorrelation("t").prepare(problem_of(t[:, None], t)[1])
    n = len(t)
    longest = cause.length.support()[1]
    columns = cause.columns({"t": t}, {"length": np.full(n, longest), "amplitude": np.full(n, 2.0)})
    exact = 4 * np.exp(-np.abs(t[:, None] - t) / longest)
    apart = np.abs(t[:, None] - t) > 0.3 * longest
    # what thirty waves leave out is rougher than that and counts as independent noise
    np.testing.assert_allclose((columns @ columns.T)[apart], exact[apart], atol=0.12)
    assert 0.85 < np.mean(np.sum(columns**2, axis=1)) / 4 <= 1
    # far from all rows: as much of it, and nothing in common with either end
    far = cause.columns({"t": np.array([-50.0, 50.0])}, {"length": longest, "amplitude": 2.0})
    np.testing.assert_allclose(np.sum(far**2, axis=1), np.sum(columns**2, axis=1)[0], rtol=1e-6)
    assert np.abs(far @ columns.T).max() < 0.4


# ------------------------------------------------------------------------------- estimators


def recovery(name, n_seeds, n=24):
    """Return how often 90 % intervals hold numbers that were drawn from their priors."""
    t = np.linspace(0, 10, n)
    inside = []
    for seed in range(n_seeds):
        rng = np.random.default_rng(seed)
        mu = rng.normal(1, 0.5) + rng.normal(2, 0.3) * t
        size = np.sqrt(np.mean(mu**2))
        if name == "mean":
            truth = {"exponent": rng.normal()}
            scale = (np.hypot(mu, size / 20) / size) ** truth["exponent"]
            cause, y = hs.NoiseOfMean(), mu + 2 * scale * rng.standard_normal(n)
        elif name == "tails":
            prior = stats.loguniform(0.05, 0.3)
            truth = {"share": prior.ppf(rng.uniform())}
            far = rng.uniform(size=n) < truth["share"]
            scale = np.where(far, 3 * 10 ** rng.uniform(size=n), 1.0)
            cause, y = hs.Outliers(prior), mu + 0.5 * scale * rng.standard_normal(n)
        else:
            priors = {"length": stats.loguniform(0.3, 1), "amplitude": stats.loguniform(0.5, 2)}
            truth = {key: prior.ppf(rng.uniform()) for key, prior in priors.items()}
            path = truth["amplitude"] * ornstein_uhlenbeck(t, truth["length"], rng)
            cause = hs.Autocorrelation("t", **priors)
            y = mu + path + 0.5 * rng.standard_normal(n)
        model = fitted(cause, t[:, None], y, sampler="importance")
        draws = model.posterior_.estimates(0)
        inside.append(
            all(np.prod(np.quantile(draws[key], [0.05, 0.95]) - v) < 0 for key, v in truth.items())
            if len(truth) == 1
            else [np.prod(np.quantile(draws[k], [0.05, 0.95]) - v) < 0 for k, v in truth.items()]
        )
    return np.atleast_2d(np.array(inside).T)


@pytest.mark.parametrize("name", ["mean", "tails", "autocorrelation"])
@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.SamplingWarning")
def test_intervals_cover_numbers_drawn_from_their_priors(name):
    n_seeds = 8
    for hits in recovery(name, n_seeds):
        # fewer happens once in a thousand
        assert hits.sum() >= stats.binom(n_seeds, 0.9).ppf(0.001)


def test_predictions_know_where_noise_is_large():
    rng = np.random.default_rng(0)
    t = np.linspace(0, 10, 80)
    y = 1 + 2 * t + 0.1 * (1 + 2 * t) * rng.standard_normal(80)
    runs = LINE.run(60, random_state=0)
    for simulation, surrogate in (
        (LINE, hs.ExactSurrogate()),
        (runs, hs.PolynomialChaos(degree=2)),
    ):
        model = fitted(hs.NoiseOfMean(), t[:, None], y, simulation, surrogate=surrogate)
        _, sd = model.predict(np.array([[1.0], [9.0]]), return_std=True)
        # 10 % of 3 and of 19
        np.testing.assert_allclose(sd, [0.3, 1.9], rtol=0.4)


def test_noise_follows_an_emulator_at_what_the_runs_say():
    t = np.linspace(0, 10, 8)[:, None]
    runs = LINE.run(40, random_state=0)
    for surrogate in (hs.PolynomialChaos(degree=2), hs.GaussianProcess()):
        model = make_problem(
            runs, surrogate, Normal(), None, (hs.NoiseOfMean(),), ("t",), t, t[:, 0]
        ).model
        known, features, noise = model.simulated(t, np.array([[1.2, 2.1, 1.0]]))
        emulated = known + features @ model.reference
        np.testing.assert_allclose(emulated[0], 1.2 + 2.1 * t[:, 0], atol=0.25)
        assert noise[0, -1] / noise[0, 1] == pytest.approx(22.2 / 4.2, rel=0.05)


def test_predictions_with_outliers():
    rng = np.random.default_rng(0)
    t = np.linspace(0, 10, 60)
    scatter = 0.2 * rng.standard_normal(60)
    scatter[::12] += 8
    plain = hs.PowerScaledSurrogate(LINE, surrogate=hs.ExactSurrogate(), random_state=0)
    plain.fit(t[:, None], 1 + 2 * t + scatter)
    runs = LINE.run(60, random_state=0)
    for simulation, options in (
        (LINE, {}),
        (runs, {"surrogate": hs.PolynomialChaos(degree=1), "beta": 0.5}),
    ):
        model = fitted(hs.Outliers(), t[:, None], 1 + 2 * t + scatter, simulation, **options)
        # the line is where the other rows are, and as sharp
        assert np.abs(model.predict(t[:, None]) - 1 - 2 * t).max() < 0.25
        assert np.abs(plain.predict(t[:, None]) - 1 - 2 * t).max() > 0.4
        assert np.mean(model.posterior_.sigma) == pytest.approx(0.2, rel=0.35)
        new = 1 + 2 * t + 0.2 * rng.standard_normal(60)
        assert model.score(t[:, None], new) > plain.score(t[:, None], new) + 1
        lower, upper = model.predict_interval(t[:5, None])
        assert (upper - lower < 3).all()
        draws = model.sample_posterior_predictive(t[:, None], 400, random_state=1)
        share = np.mean(np.abs(draws - 1 - 2 * t) > 2)
        assert 0.02 < share < 0.2


def test_outliers_need_a_normal_likelihood():
    t = np.linspace(0, 10, 20)
    with pytest.raises(ValueError, match="not beside a Student-t one"):
        fitted(hs.Outliers(), t[:, None], 1 + 2 * t, likelihood="student-t")


def test_new_rows_are_predicted_from_their_neighbours():
    rng = np.random.default_rng(3)
    t = np.linspace(0, 10, 60)
    path = 2 * ornstein_uhlenbeck(t, 0.5, rng)
    model = fitted(hs.Autocorrelation("t"), t[1::2][:, None], (1 + 2 * t + path)[1::2])
    between, sd = model.predict(t[2:-2:2][:, None], return_std=True)
    error = between - (1 + 2 * t + path)[2:-2:2]
    assert np.sqrt(np.mean(error**2)) < 0.75 * np.std(path)
    assert np.mean(np.abs(error) < 1.645 * sd) > 0.7
    # beyond the rows it is forgotten, and all of it is open
    _, far = model.predict(np.array([[16.0]]), return_std=True)
    assert far[0] > 1.15 * np.mean(sd)


# --------------------------------------------------------------------------------- evidence


def test_evidence_of_outliers_equals_brute_force():
    t = np.linspace(0, 4, 40)
    rng = np.random.default_rng(1)
    y = 1.3 + t + 0.3 * rng.standard_normal((3, 40))
    y[1, 4] += 3
    y[2, [1, 7]] += [-2, 5]
    prior = stats.halfnorm(scale=1.5)
    problem, context = problem_of(t[:, None], y[0], LEVEL, prior)
    cause = hs.Outliers().prepare(context)
    model = problem.model.with_effects((cause,))
    plan = layout(model)
    parts = linearise(model, problem.X, coefficient_belief(model.basis, None), plan, plan.neutral)
    table = NoiseTable(prior, problem.scale, len(t))
    # the measured response alone is followed to the end, replicates in a batch nearly so
    batch = scan(parts, y, 0.4, table, np.array([1.0]))
    found = np.concatenate([scan(parts, one[None], 0.4, table, np.array([1.0])) for one in y])
    np.testing.assert_allclose(batch, found, rtol=0, atol=0.3)
    level, log_sigma = np.linspace(0, 2.5, 151), np.linspace(np.log(0.05), np.log(4), 151)
    cell = (level[1] - level[0]) * (log_sigma[1] - log_sigma[0])
    z = (y[:, None, None, :] - level[:, None, None] - t) / np.exp(log_sigma)[:, None]
    weight = stats.norm(1, 0.5).logpdf(level)[:, None] + prior.logpdf(np.exp(log_sigma)) + log_sigma
    brute = np.empty_like(found)
    for k, share in enumerate(plan.grid[:, 0]):
        rows = log_shape(z, share) - log_sigma[:, None]
        brute[:, k] = logsumexp(rows.sum(axis=-1) + weight, axis=(1, 2)) + np.log(cell)
    brute += plan.log_weight
    # nodes at which rows may be read either way have a flat sigma; those that count do not
    np.testing.assert_allclose(found, brute, rtol=0, atol=0.3)
    total, told = logsumexp(brute, axis=1), logsumexp(found, axis=1)
    np.testing.assert_allclose(told, total, rtol=0, atol=0.1)


def test_evidence_of_noise_that_follows_the_output_equals_the_marginal_likelihood():
    t = np.linspace(0, 4, 9)
    y = 1.2 + t + 0.3 * np.random.default_rng(1).standard_normal((2, 9))
    problem, context = problem_of(t[:, None], y[0], LEVEL)
    cause = hs.NoiseOfMean().prepare(context)
    model = problem.model.with_effects((cause,))
    plan, sigma = layout(model), 0.4
    z = np.full(model.n_unknowns, 0.2)
    parts = linearise(model, problem.X, coefficient_belief(model.basis, None), plan, z)

    def fixed_sigma(squares):
        return -0.5 * 9 * np.log(2 * np.pi * sigma**2) - 0.5 * squares / sigma**2

    found = scan(parts, y, sigma, fixed_sigma, np.array([1.0]))
    # the noise is that of the simulation at the point of linearisation
    eta = 1 + 0.2 * 0.5 + t
    size = np.sqrt(np.mean(y[0] ** 2))
    for k, exponent in enumerate(plan.grid[:, 0]):
        factor = np.hypot(eta / size, 0.05) ** exponent
        covariance = 0.25 + np.diag((sigma * factor) ** 2)
        expected = stats.multivariate_normal(1 + t, covariance).logpdf(y) + plan.log_weight[k]
        np.testing.assert_allclose(found[:, k], expected, atol=1e-5)


def test_evidence_of_autocorrelation_equals_the_marginal_likelihood():
    t = np.linspace(0, 10, 16)
    y = 1.2 + 2 * t + np.random.default_rng(1).standard_normal((2, 16))
    problem, context = problem_of(t[:, None], y[0])
    cause = hs.Autocorrelation("t").prepare(context)
    model = problem.model.with_effects((cause,))
    plan, sigma, sizes = layout(model), 0.4, np.array([0.3, 1.0])
    parts = linearise(model, problem.X, coefficient_belief(model.basis, None), plan, plan.neutral)

    def fixed_sigma(squares):
        return -0.5 * 16 * np.log(2 * np.pi * sigma**2) - 0.5 * squares / sigma**2

    found = scan(parts, y, sigma, fixed_sigma, sizes)
    line = 0.5**2 + 0.3**2 * np.outer(t, t) + sigma**2 * np.eye(16)
    for k, length in enumerate(plan.grid[:, 0]):
        columns = cause.columns({"t": t}, {"length": np.full(16, length), "amplitude": np.ones(16)})
        process = columns @ columns.T / np.mean(np.sum(columns**2, axis=1))
        terms = [
            stats.multivariate_normal(1 + 2 * t, line + s**2 * process).logpdf(y) for s in sizes
        ]
        expected = logsumexp(terms, axis=0) - np.log(2) + plan.log_weight[k]
        np.testing.assert_allclose(found[:, k], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("form", "name"),
    [
        ("noise: mean", "noise(output)"),
        ("noise: tails", "noise(outliers)"),
        ("noise: autocorrelation", "noise(day, autocorrelated)"),
    ],
)
def test_blind_cases_are_named(form, name):
    first = []
    for seed in range(3):
        case = make_case(form, 4.0, seed, n_rows=60, simulation="epidemic")
        first.append(weigh(case.X[:, :1], case.y, case.simulator)[1])
    assert first.count(name) >= 2, first


def test_nothing_is_named_where_nothing_is_wrong():
    t = np.linspace(0, 10, 60)
    above = []
    for seed in range(4):
        y = 1 + 2 * t + np.random.default_rng(seed).standard_normal(60)
        found, first = weigh(t[:, None], y, forms=(*FORMS, "trend"))
        assert first == "none"
        above += [w.log_evidence - found.weighed[0].log_evidence for w in found.weighed[1:4]]
    assert np.mean(np.array(above) < 0) >= 0.8
    test = null_test(found, 100, np.random.RandomState(0))
    assert np.mean(test.replicates > 1) < 0.1


def test_a_diagnosis_names_outliers_and_predicts_without_them():
    rng = np.random.default_rng(0)
    frame = pd.DataFrame({"t": np.linspace(0, 10, 50)})
    y = 1 + 2 * frame.t.to_numpy() + 0.3 * rng.standard_normal(50)
    y[::10] += 6
    model = hs.PowerScaledSurrogate(
        LINE, surrogate=hs.ExactSurrogate(), random_state=0, n_draws=100
    )
    found = hs.DiscrepancyDiagnosis(
        model, causes=[hs.Outliers(), hs.NoiseOfMean()], cv=None, max_causes=2, random_state=0
    ).fit(frame, y)
    assert found.best_cause_.kind == "noise"
    _, low, high = found.best_cause_.estimates["share"]
    assert low < 0.1 < high
    assert found.extended_simulator_ is None
    assert "outliers" in found.best_cause_.latex
    _, variance = predict_locally(found.search_, found.search_.weighed[0], np.array([[5.0]]))
    assert variance[0] > 1


def test_replicates_beside_accepted_noise_have_that_noise():
    rng = np.random.default_rng(0)
    t = np.linspace(0, 10, 120)
    sd = 0.1 * (1 + t)  # eleven times as large in the end
    y = 1 + 2 * t + sd * rng.standard_normal(120)
    found, name = weigh(t[:, None], y, forms=("noise", "trend"))
    assert name == "noise(t)"
    first = next(w for w in found.weighed if w.cause and w.cause.name == name)
    problem = replace(found.problem, model=found.problem.model.with_effects((first.cause,)))
    others = [w.cause for w in found.weighed if w.cause and w is not first]
    beside = search(problem, others, found.belief, False, first)
    drawn = _replicates(beside, freed(beside), 400, np.random.RandomState(0))
    spread = drawn.std(axis=0)
    expected = sd[-40:].mean() / sd[:40].mean()
    assert spread[-40:].mean() / spread[:40].mean() == pytest.approx(expected, rel=0.25)


# ---------------------------------------------------------------------------------- pictures


def test_pictures_formulas_and_names():
    t = np.linspace(0, 10, 30)
    _, context = problem_of(t[:, None], 1 + 2 * t)
    causes, skipped = catalogue(context)
    assert "noise" not in {s.kind for s in skipped}
    causes = [cause for cause in causes if form_of(cause) in FORMS]
    assert [cause.name for cause in causes] == [
        "noise(t, autocorrelated)",
        "noise(output)",
        "noise(outliers)",
    ]
    for cause in causes:
        ax = plot_cause(cause, context)
        assert isinstance(ax, Axes)
        heights = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in ax.lines])
        assert np.isfinite(heights).all()
        assert np.ptp(heights) > 0.1
        middle = {name: np.array([prior.median()]) for name, prior in cause.parameters.items()}
        told = {name: float(v[0]) for name, v in cause.estimates(middle, {}).items()}
        assert cause.formula(told).startswith("simulation, ")
        assert cause.latex(told).startswith(r"\text{simulation}")
        assert not cause.changes_output
    few = t[:10]
    _, skipped = catalogue(problem_of(few[:, None], few)[1])
    assert [s.reason for s in skipped if s.kind == "noise"] == [
        "autocorrelation: t has 10 distinct values, 12 are needed"
    ]
