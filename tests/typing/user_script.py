"""A user's script that takes every public name: ``mypy --strict`` accepts it, and it runs.

What takes seconds stands in functions that only the type checker reads.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

import hybridsurrogate as hs
from hybridsurrogate import (
    datasets,
    effects,
    estimators,
    likelihoods,
    plotting,
    scoring,
    surrogates,
)

Array = NDArray[np.floating]
version: str = hs.__version__


def temperature(minutes: Array, start: Array, rate: Array, ambient: Array) -> Array:
    """Return the temperature of something that cools."""
    return np.asarray(ambient + start * np.exp(-rate * minutes))


def cooling(t: Array, state: Array, rate: Array, ambient: Array) -> Array:
    """Return the slope of a temperature."""
    return np.asarray(-rate * (state - ambient))


RATE = hs.truncated_normal(0.15, 0.05, 0.05, 0.3)
START = hs.truncated_normal(60, 10, 40, 80)
AMBIENT = hs.Assumed(20.0, hs.truncated_normal(20, 4, 10, 30))

# -- simulations ------------------------------------------------------------------------------
simulator = hs.Simulator(
    temperature,
    inputs={"minutes": (0, 20)},
    parameters={"start": START, "rate": RATE},
    assumed={"ambient": AMBIENT},
    output="temperature",
)
runs: hs.SimulationData = simulator.run(40, random_state=0, progress=False)
made_elsewhere = hs.SimulationData(
    runs.X, runs.omega, runs.y, ["minutes"], {"start": START, "rate": RATE}, {"ambient": AMBIENT}
)
ode = hs.OdeSimulator(
    cooling,
    initial_state=[80.0],
    observe=lambda states: states[0],
    inputs={"minutes": (0, 20)},
    parameters={"rate": RATE},
    assumed={"ambient": AMBIENT},
    states=["temperature"],
)
program = hs.CommandSimulator(
    [sys.executable, "cool.py", "{minutes}", "{rate}"],
    inputs={"minutes": (0, 20)},
    parameters={"rate": RATE},
)


def from_file(path: Path) -> hs.SimulationData:
    """Return runs that were made elsewhere."""
    return hs.read_simulation(path, ["minutes"], {"rate": RATE}, output="temperature")


# -- causes -----------------------------------------------------------------------------------
class Pulse(hs.Cause):
    """A user-defined cause."""

    kind = "pulse"
    coefficients = ("amplitude",)

    def columns(self, X: Mapping[str, Array], theta: Mapping[str, Array]) -> Array:
        """Return what is added."""
        return np.exp(-np.asarray(X["minutes"]))[:, None]


causes: list[hs.Cause] = [
    Pulse(),
    hs.Autocorrelation("minutes"),
    hs.BuildUp("minutes"),
    hs.Bump("minutes"),
    hs.CurveByExperiment("minutes", by="batch"),
    hs.Decay("minutes"),
    hs.Delay("minutes"),
    hs.DynamicDelay("temperature"),
    hs.DynamicDrift("rate"),
    hs.DynamicStore("temperature"),
    hs.DynamicTerm("temperature", "constant"),
    hs.Episode("minutes"),
    hs.Friction("speed"),
    hs.Gain(),
    hs.GaussianProcessDiscrepancy({"minutes": (0.0, 20.0)}),
    hs.GrossError(n_rows=2),
    hs.InOutput(hs.Offset(), "temperature"),
    hs.InputError("minutes"),
    hs.Interaction("minutes", "speed"),
    hs.Limit(below=True),
    hs.Loss("minutes"),
    hs.MissingInput("speed", shape="quadratic"),
    hs.NarrowPrior("rate"),
    hs.Noise("minutes"),
    hs.NoiseAtLevel("batch", level=2.0),
    hs.NoiseOfMean(),
    hs.Offset("batch", level=1.0),
    hs.Outliers(),
    hs.OutputCorrelation(),
    hs.Overdispersion(),
    hs.SharedErrors("batch", spread=0.5),
    hs.ParameterByExperiment("rate", "batch"),
    hs.ParameterDrift("rate", "minutes", shape="logistic"),
    hs.ParameterProcess("rate", "minutes"),
    hs.Periodic("minutes", harmonics=2),
    hs.Ramp("minutes"),
    hs.RecurringJumps("minutes"),
    hs.RandomParameter("rate"),
    hs.Remainder(1.0),
    hs.Saturation("minutes"),
    hs.SecondStore("minutes"),
    hs.SensorResponse(),
    hs.Step("minutes", before=True),
    hs.TermByExperiment("temperature", "batch"),
    hs.Trend("minutes", degree=2),
    hs.TrendSinceStart("minutes"),
    hs.WrongConstant("ambient"),
]
columns: tuple[str, str] = (hs.SIMULATED, hs.SLOPE)
kinds: set[str] = {cause.kind for cause in causes}


def spans(context: effects.Context) -> Array:
    """Return what a user-defined cause may ask of the data."""
    return context.column("minutes")


# -- likelihoods and surrogates ---------------------------------------------------------------
def laplace(y: Array, eta: Array, sigma: Array) -> Array:
    """Return a log density."""
    return np.asarray(-np.abs(y - eta) / sigma - np.log(2 * sigma))


of_data: list[likelihoods.Likelihood] = [
    hs.Binomial(trials=10),
    hs.Censored("lognormal", below=0.1, above=9.0, step=0.01),
    hs.Censored.of_rows([0.2, 0.4], below=[0.2, 0.1])[1],
    hs.CustomLikelihood(laplace),
    hs.LogNormal(),
    hs.NegativeBinomial(),
    hs.BetaBinomial(trials=10),
    hs.Normal(),
    hs.Poisson(),
    hs.StudentT(df=5.0),
    likelihoods.Contaminated(hs.Normal(), np.array([0.1])),
    likelihoods.as_likelihood("lognormal"),
    *likelihoods.LIKELIHOODS.values(),
]
transformed: list[likelihoods.TransformedNormal] = [hs.Normal(), hs.LogNormal()]


class LineBasis(surrogates.Basis):
    """A straight line over the first input, without parameters."""

    def known(self, X: Array, omega: Array, hyper: Array | None = None) -> Array:
        """Return what needs no coefficient."""
        return np.zeros(len(X))

    def features(self, X: Array, omega: Array) -> Array:
        """Return what coefficients multiply."""
        return np.column_stack([np.ones(len(X)), X[:, 0]])

    def factors(self, X: Array, omega: Array) -> surrogates.Factors | None:
        """Return no product of parts."""
        return None


class Line(surrogates.Surrogate):
    """A user-defined surrogate."""

    def build(self, domain: surrogates.Domain) -> surrogates.Basis:
        """Return the basis for a domain."""
        return LineBasis(np.zeros(2), np.full(2, domain.scale))


of_runs: list[surrogates.Surrogate] = [
    hs.ExactSurrogate(),
    hs.FeatureSurrogate(),
    hs.GaussianProcess(degree=1),
    hs.Kriging(),
    hs.NetworkSurrogate(hidden_layer_sizes=(8,)),
    hs.ParametricSurrogate(),
    hs.PolynomialChaos(degree=2),
    Line(),
    *surrogates.SURROGATES.values(),
]

# -- estimators -------------------------------------------------------------------------------
model = hs.PowerScaledSurrogate(
    runs,
    surrogate=hs.PolynomialChaos(degree=2),
    likelihood="normal",
    sampler=hs.EnsembleSampler(max_steps=200, progress=False),
    effects=[hs.Trend("minutes")],
    random_state=0,
)
two_step = hs.PredictiveWeightedSurrogate(runs, beta="stacking", random_state=0)
calibration = hs.KennedyOHaganSurrogate(runs, random_state=0)
many = hs.MultiSourceSurrogate([hs.Source(runs, power=0.5)], random_state=0)
average = hs.AveragedSurrogate()
emulator: hs.Emulator = hs.Emulator(kind="polynomial").fit(runs)
print(emulator.predict(runs.to_frame()), plotting.plot_emulator(emulator), emulator.q2_)


def fitted(X: Array, y: Array) -> Array:
    """Return held-out scores and predictions of fitted models."""
    fit: hs.PowerScaledSurrogate = model.fit(X, y)
    two_step.fit(X, y).score(X, y)
    calibration.fit(X, y).loo()
    many.fit(X, y).summary()
    lower, upper = fit.predict_interval(X, level=0.9)
    loo: estimators.Loo = fit.loo()
    path: estimators.BetaPath = hs.beta_path(fit, X, y, [0.1, 0.5])
    choice: estimators.BetaChoice = hs.choose_beta(fit, X, y)
    indices = hs.sobol_indices(fit, X)
    sobol: Axes = plotting.plot_sobol(indices)
    print(loo.elpd, path.betas, choice.beta, sobol.get_title(), fit.to_arviz())
    mixed: hs.AveragedSurrogate = average.fit(X, y)
    print(mixed.predict(X), fit.log_predictive_density(X, y), fit.sample_predictive_mean(X))
    return upper - lower


# -- diagnosis --------------------------------------------------------------------------------
def diagnosed(X: Array, y: Array) -> hs.DiscrepancyDiagnosis:
    """Return what the simulation gets wrong."""
    diagnosis = hs.DiscrepancyDiagnosis(model, causes=causes[:1], max_causes=2, progress=True)
    diagnosis = hs.refine(diagnosis.fit(X, y), X, y, simulator, budget=10)
    best: hs.CauseFinding = diagnosis.best_cause_
    for name, (mean, low, high) in best.estimates.items():
        print(f"{best.kind} {name}: {mean} ({low} to {high}), {best.probability:.0%}")
    print(diagnosis.verdict_, diagnosis.p_value_, diagnosis.gain_on(X, y).elpd_difference)
    print(diagnosis.next_runs(3), diagnosis.next_measurements(2), diagnosis.beta_scan())
    diagnosis.report(units={"minutes": "min"}).save("report.html")
    top, below = diagnosis.plot()
    source: str | None = diagnosis.to_python()
    hs.save(diagnosis.cross_validate(cv=3), "diagnosis.hs")
    again: hs.DiscrepancyDiagnosis = hs.load("diagnosis.hs")
    print(top, below, source, again.verdict_)
    plotting.plot_monitor(diagnosis.update(X, y).table, 0.05)
    plan: hs.Detectability = hs.detectability(model, X, causes=["step"], noise=0.1)
    plotting.plot_power(plan.table)
    print(plan.confusion(), plan.smallest(), plan.report())
    both: hs.SimulationComparison = hs.compare_simulations([model, model], X, y, diagnose=False)
    plotting.plot_comparison(both.table)
    print(both.chosen, both.report())
    return diagnosis


def data_sets() -> list[object]:
    """Return the data that the package knows."""
    return [
        datasets.fetch_covid19_italy(),
        datasets.load_mauna_loa_co2(),
        datasets.load_nile(),
        datasets.load_nist_chwirut1(),
        datasets.load_nist_enso(),
        datasets.make_log_sin(random_state=0),
        datasets.make_sir(random_state=0),
    ]


# -- warnings ---------------------------------------------------------------------------------
kinds_of_warning: list[type[hs.HybridSurrogateWarning]] = [
    hs.ConfoundingWarning,
    hs.DiagnosisWarning,
    hs.ExtrapolationWarning,
    hs.FailedRunsWarning,
    hs.MissingMeasurementWarning,
    hs.PriorWarning,
    hs.RowByRowWarning,
    hs.SamplingWarning,
    hs.EmulationWarning,
    hs.SolverWarning,
]
with warnings.catch_warnings():
    warnings.simplefilter("ignore", hs.SamplingWarning)

# -- scores -----------------------------------------------------------------------------------
draws = np.random.default_rng(0).standard_normal((200, 10))
measured = draws[0]
low, high = np.quantile(draws, (0.05, 0.95), axis=0)
share: float = scoring.coverage(measured, low, high)
ranks: Array = scoring.pit(draws, measured, random_state=0)
per_row: Array = scoring.crps(draws, measured)
mean_elpd, its_error = scoring.elpd(-per_row)
difference: scoring.PairedDifference = scoring.paired_difference(per_row, per_row)
wide: float = scoring.interval_width(low, high)
penalised: Array = scoring.interval_score(measured, low, high, level=0.9)
error: float = scoring.rmse(draws, measured)
scorers = [
    scoring.elpd_scorer,
    scoring.interval_score_scorer,
    scoring.neg_crps_scorer,
    scoring.neg_rmse_scorer,
    *scoring.SCORERS.values(),
]

# -- pictures ---------------------------------------------------------------------------------
x = np.linspace(0.0, 1.0, 10)
scene = plotting.Scene(measured=(x, measured), truth=(x, 0 * x), train=(0.0, 1.0))
told = plotting.Prediction(measured, low, high, low, high)
omega = np.linspace(0.0, 1.0, 200)
by_beta: dict[str, list[Array]] = {"power scaling": [draws, draws]}
colours = [plotting.BEFORE, plotting.AFTER, plotting.DATA, plotting.HELD_OUT, plotting.QUIET]
looks = [*plotting.ALTERNATIVES, plotting.OMEGA_COLOURS.name]


def on_axes() -> Axes:
    """Return Axes without a window."""
    return Figure().subplots()


pictures: list[Axes] = [
    *plotting.new_axes(1, 2),
    plotting.plot_causes(on_axes(), ["trend", "step"], [0.9, 0.1], 0),
    plotting.plot_coverage(on_axes(), ["before", "after"], np.array([0.8, 0.9]), [10, 10], 0.9),
    plotting.plot_densities_over_beta([0.1, 0.9], [omega, omega + 1]),
    plotting.plot_discrepancy(on_axes(), x, measured, low, high),
    plotting.plot_information(on_axes(), x, np.abs(measured), 0.5),
    plotting.plot_mean_draws(x, draws, omega, scene=scene),
    plotting.plot_measured(on_axes(), x, measured),
    *plotting.plot_overview(x, measured, plotting.Predicted(x, told, measured)),
    plotting.plot_prediction(on_axes(), x, told, plotting.AFTER, "after"),
    plotting.plot_predictive_bands(x, draws, scene=scene),
    plotting.plot_quantiles(on_axes(), measured, plotting.BEFORE, "o", "before"),
    plotting.plot_residuals(on_axes(), x, measured, plotting.BEFORE, "before"),
    plotting.plot_alternatives(on_axes(), x, [measured, low], ["trend", "step"], 0.5),
    plotting.plot_scene(scene),
    plotting.plot_scores(on_axes(), ["fold 1"], per_row[:1], per_row[:1], per_row[:1]),
    plotting.plot_setup(scene, x, measured, x),
]
plotting.share_range(pictures[:2], measured)
plotting.tidy(pictures[0], "minutes", "temperature", legend=False)
grids = [
    plotting.plot_bands_over_beta(x, by_beta, (0.1, 0.9), scene=scene),
    plotting.plot_mean_draws_over_beta(x, by_beta, {"power scaling": [omega] * 2}, (0.1, 0.9)),
]


def of_tables(diagnosis: hs.DiscrepancyDiagnosis) -> list[Axes]:
    """Return pictures of tables that a diagnosis returns."""
    course = plotting.plot_parameter_course(diagnosis.parameter_course())
    scan = diagnosis.beta_scan()
    if scan is None:
        return [course]
    return [course, plotting.plot_beta_scan(scan), *plotting.plot_scores_over_beta(scan).ravel()]
