"""Speed: `pytest tests/benchmarks --benchmark-only`; figures are compared within one run."""

import numpy as np
import pytest
from scipy.stats import halfnorm, norm, uniform
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin
from hybridsurrogate.estimators.beta_path import fitted_near
from hybridsurrogate.estimators.power_scaled import prepared
from hybridsurrogate.surrogates.emulation import covariance
from hybridsurrogate.surrogates.emulation.curve_emulator import emulate_curves

BETAS = np.linspace(0, 1, 21)


@pytest.fixture(scope="module")
def case():
    return make_log_sin(random_state=0)


@pytest.fixture(scope="module")
def model(case):
    return hs.PowerScaledSurrogate(
        case.simulation,
        surrogate=hs.PolynomialChaos(degree=5, coefficient_prior=norm(0, 5)),
        noise_prior=halfnorm(scale=0.5),
        n_draws=1000,
        random_state=0,
    )


def test_one_fit(benchmark, case, model):
    benchmark.pedantic(lambda: model.set_params(beta=0.5).fit(case.X, case.y), rounds=5)


@pytest.mark.benchmark(group="21 betas")
def test_scan_of_21_betas(benchmark, case, model):
    def scan():
        for beta in BETAS:
            model.set_params(beta=float(beta)).fit(case.X, case.y)

    benchmark.pedantic(scan, rounds=3, warmup_rounds=1)


@pytest.mark.benchmark(group="21 betas")
def test_path_of_21_betas(benchmark, case, model):
    """No slower than the fits it saves: compare it with the scan of the same group."""
    benchmark.pedantic(
        lambda: hs.beta_path(model, case.X, case.y, BETAS), rounds=3, warmup_rounds=1
    )


@pytest.mark.benchmark(group="likelihoods, polynomial of degree 4")
@pytest.mark.parametrize("likelihood", ["normal", "student-t"])
def test_one_fit_under_a_likelihood(benchmark, case, likelihood):
    model = hs.PowerScaledSurrogate(
        case.simulation,
        surrogate=hs.PolynomialChaos(degree=4),
        likelihood=likelihood,
        beta=0.5,
        random_state=0,
    )
    benchmark.pedantic(lambda: model.fit(case.X, case.y), rounds=2)


@pytest.mark.benchmark(group="surrogates")
@pytest.mark.parametrize("surrogate", [hs.PolynomialChaos(degree=5), hs.GaussianProcess()], ids=str)
def test_one_fit_of_a_surrogate(benchmark, case, surrogate):
    model = hs.PowerScaledSurrogate(case.simulation, surrogate=surrogate, beta=0.5, random_state=0)
    benchmark.pedantic(lambda: model.fit(case.X, case.y), rounds=3)


@pytest.mark.benchmark(group="a fold of 1000 rows")
@pytest.mark.parametrize("how", ["anew", "from the proposals of the whole"])
def test_one_fit_of_a_fold(benchmark, how):
    case = make_log_sin(n_measured=1000, random_state=0)
    model = hs.PowerScaledSurrogate(
        case.simulator,
        surrogate=hs.ExactSurrogate(),
        effects=[hs.Periodic("x")],
        n_draws=400,
        random_state=0,
    )
    rows = np.flatnonzero(np.arange(1000) % 5)
    whole = clone(model).fit(case.X, case.y)
    fits = {
        "anew": lambda: clone(model).fit(case.X[rows], case.y[rows]),
        "from the proposals of the whole": lambda: fitted_near(
            prepared(model, case.X[rows], case.y[rows]), whole
        ),
    }
    assert benchmark.pedantic(fits[how], rounds=5, warmup_rounds=1) is not None


@pytest.mark.filterwarnings("ignore::hybridsurrogate.SamplingWarning")
def test_grid_search_over_21_betas_in_5_folds(benchmark, case, model):
    search = GridSearchCV(model, {"beta": BETAS}, cv=5)
    benchmark.pedantic(lambda: search.fit(case.X, case.y), rounds=1)


@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
def test_one_diagnosis_of_40_rows(benchmark):
    case = make_log_sin(n_measured=40, random_state=0)
    exact = hs.PowerScaledSurrogate(
        case.simulator, surrogate=hs.ExactSurrogate(), n_draws=1000, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(exact, n_replicates=200, random_state=0)
    benchmark.pedantic(lambda: diagnosis.fit(case.X, case.y), rounds=3)


def test_one_search_of_40_rows_without_folds(benchmark):
    case = make_log_sin(n_measured=40, random_state=0)
    exact = hs.PowerScaledSurrogate(
        case.simulator, surrogate=hs.ExactSurrogate(), n_draws=1000, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(exact, cv=None, random_state=0)
    benchmark.pedantic(lambda: diagnosis.fit(case.X, case.y), rounds=3)


@pytest.mark.benchmark(group="rows of a search with an emulator")
@pytest.mark.parametrize("n", [40, 1000])
def test_one_search_with_an_emulator(benchmark, case, n):
    rows = make_log_sin(n_measured=n, random_state=0)
    emulated = hs.PowerScaledSurrogate(
        case.simulation, surrogate=hs.PolynomialChaos(degree=5), n_draws=1000, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(emulated, cv=None, random_state=0)
    benchmark.pedantic(lambda: diagnosis.fit(rows.X, rows.y), rounds=1)


@pytest.mark.benchmark(group="runs that are curves")
@pytest.mark.parametrize(("n_runs", "n_times"), [(80, 300), (400, 300), (400, 1000)])
def test_an_emulator_of_curves(benchmark, n_runs, n_times):
    simulator = hs.Simulator(
        lambda t, a, k, w: a * np.exp(-k * t) * np.cos(w * t) + 0.3 * a,
        {"t": (0, 20)},
        {"a": uniform(1, 2), "k": uniform(0.05, 0.25), "w": uniform(0.5, 1.0)},
    )
    runs = simulator.run(n_runs, along=n_times, random_state=0)
    ranges = [np.array(list(r.values())) for r in (runs.input_ranges, runs.parameter_ranges)]
    benchmark.pedantic(
        lambda: emulate_curves(runs.X, runs.omega, runs.y, *ranges),
        setup=covariance._learned.cache_clear,
        rounds=3,
    )
