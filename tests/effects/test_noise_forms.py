"""Noise that follows the output, has heavy tails or is autocorrelated: formulas, fits, pictures."""

import numpy as np
import pytest
from lines import FORMS, LINE, problem_of
from matplotlib.axes import Axes
from problems import make_problem
from scipy import integrate, stats

import hybridsurrogate as hs
from hybridsurrogate.catalogue import catalogue
from hybridsurrogate.diagnosis.answers.finding import form_of
from hybridsurrogate.effects.context import Axis, OutputScale
from hybridsurrogate.effects.picture import plot_cause
from hybridsurrogate.likelihoods import Contaminated, Normal
from hybridsurrogate.likelihoods.student_t import log_shape, precision_at


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


def test_noise_changes_no_more_far_beyond_the_rows():
    cause = hs.Noise("t", axis=Axis.of([0.0, 2.0, 10.0]))
    factor = cause.noise({"t": np.array([-2.5, -90.0, 12.5, 13.0, 1e6])}, {"slope": np.log(2)})
    np.testing.assert_allclose(factor[[1, 3, 4]], factor[[0, 2, 2]])
    # it doubles over half a span, and the places are one span and a half apart
    assert factor[2] / factor[0] == pytest.approx(2**3)


def test_noise_that_follows_the_output_by_hand():
    context = problem_of(np.arange(3.0)[:, None], np.array([2.0, 4.0, 6.0]))[1]
    cause = hs.NoiseOfMean().prepare(context)
    size = np.sqrt(56 / 3)
    assert cause.measured.size == pytest.approx(size)
    factor = cause.noise({hs.SIMULATED: np.array([0.0, -size])}, {"exponent": np.array(0.5)})
    np.testing.assert_allclose(factor, [np.sqrt(0.05), (1 + 1 / 400) ** 0.25])
    # an output that moves by a small share of its size: the exponent may be as much larger
    assert cause.exponent.std() == pytest.approx(max(1, size / (2 * np.std([2, 4, 6]))))
    told = cause.estimates({"exponent": np.array([1.0])}, {})
    low, high = 4 - np.std([2, 4, 6]), 4 + np.std([2, 4, 6])
    assert told["ratio"][0] == pytest.approx(high / low, rel=0.02)


def test_noise_that_follows_a_logarithmic_output():
    cause = hs.NoiseOfMean(measured=OutputScale(2.0, spread=1.0, is_log=True)).prepare(None)
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


def test_density_of_outliers_far_away():
    z, share = np.array([[1e3, 2e3, 1e5]]), np.array([0.01, 0.3])
    values = log_shape(z, share[:, None])
    assert np.isfinite(values).all()
    assert (np.diff(values, axis=1) < 0).all()


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


@pytest.mark.slow
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
    with pytest.raises(ValueError, match="not a Student-t one"):
        fitted(hs.Outliers(), t[:, None], 1 + 2 * t, likelihood="student-t")


@pytest.mark.slow
def test_new_rows_are_predicted_from_their_neighbours():
    rng = np.random.default_rng(3)
    t = np.linspace(0, 10, 60)
    path = 2 * ornstein_uhlenbeck(t, 0.5, rng)
    # of fewer draws the error of the mean is as large as what is left to the bound
    rows = t[1::2][:, None], (1 + 2 * t + path)[1::2]
    model = fitted(hs.Autocorrelation("t"), *rows, n_draws=4000)
    between, sd = model.predict(t[2:-2:2][:, None], return_std=True)
    error = between - (1 + 2 * t + path)[2:-2:2]
    assert np.sqrt(np.mean(error**2)) < 0.75 * np.std(path)
    assert np.mean(np.abs(error) < 1.645 * sd) > 0.7
    # beyond the rows it is forgotten, and all of it is open
    _, far = model.predict(np.array([[16.0]]), return_std=True)
    assert far[0] > 1.15 * np.mean(sd)


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
