"""The verdict: what is at fault, and when nobody can tell."""

import numpy as np
import pytest
from few_kinds import all_but
from scipy.stats import norm, uniform

import hybridsurrogate as hs


def heat(t, k, p):
    return 21.5 + p / k * (1 - np.exp(-k * t))


T = np.linspace(0.5, 60, 60)
PRIORS = {"k": uniform(0.02, 0.1), "p": uniform(1.5, 2.0)}


def noise(seed, n=60):
    return np.random.default_rng(seed).standard_normal(n)


# alternatives of each other's curves
SEVERAL = all_but("narrow-prior", "trend", "step", "bump", "decay", "parameter-drift", "noise")


def diagnosed(y, parameters=PRIORS, n_runs=None, t=T, function=heat, **settings):
    settings = {"exclude": SEVERAL, "n_replicates": 39} | settings
    simulation = hs.Simulator(function, inputs={"t": (0, 60)}, parameters=parameters)
    surrogate = hs.ExactSurrogate()
    if n_runs is not None:
        simulation = simulation.run(n_runs, random_state=0)
        surrogate = hs.PolynomialChaos(degree=2)
    model = hs.PowerScaledSurrogate(simulation, surrogate=surrogate, n_draws=200, random_state=0)
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0, **settings)
    return diagnosis.fit(t[:, None], y)


@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.HybridSurrogateWarning")
@pytest.mark.parametrize("fault", [0.0, pytest.param(2.0, marks=pytest.mark.slow)])
def test_few_runs_cannot_tell(fault):
    """Six runs leave the output open by many times the noise: neither adequate nor a name."""
    y = heat(T, 0.05, 2.4) + 0.4 * noise(0) + fault * (T > 30)
    # whatever the kinds are
    diagnosis = diagnosed(y, n_runs=6, exclude=all_but("step", "trend", "noise"))
    assert diagnosis.emulator_check_.left_open > 2
    assert diagnosis.verdict_ == "undecided"
    assert diagnosis.undecided_by_ == "runs"
    assert diagnosis.concerns_ is None
    report = diagnosis.report()
    assert report.headline == "The runs cannot show whether the simulation is right."
    assert "next_runs(20)" in str(report)
    assert report.to_dict()["verdict"] == "undecided"


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_prior_that_excludes_the_value(seed):
    """The simulation is right with k = 0.05, the prior begins at 0.08."""
    y = heat(T, 0.05, 2.4) + 0.4 * noise(seed)
    diagnosis = diagnosed(y, {**PRIORS, "k": uniform(0.08, 0.02)})
    assert diagnosis.verdict_ == "named"
    assert diagnosis.concerns_ == "prior"
    assert (diagnosis.best_cause_.kind, diagnosis.best_cause_.target) == ("narrow-prior", "k")
    _, low, high = diagnosis.best_cause_.estimates["value"]
    assert low < 0.05 < high
    assert diagnosis.report().headline == (
        "The prior of k excludes the value that the data ask for."
    )
    # the extended simulation is the same one, with a wider prior of k
    extended = diagnosis.extended_simulator_
    assert set(extended.parameter_names) == {"k", "p"}
    assert extended.parameters["k"].cdf(0.05) > 0.1


@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.HybridSurrogateWarning")
def test_a_prior_that_excludes_the_value_of_an_emulator():
    """Runs end where the prior ends: whether a value beyond would do cannot be seen."""
    y = heat(T, 0.05, 2.4) + 0.4 * noise(0)
    few = all_but("narrow-prior", "trend", "bump", "parameter-drift")
    diagnosis = diagnosed(y, {**PRIORS, "k": uniform(0.08, 0.02)}, n_runs=100, exclude=few)
    assert diagnosis.verdict_ == "undecided"
    assert diagnosis.undecided_by_ == "prior"
    assert "k" in [one.name for one in diagnosis.at_prior_end_]
    assert "The prior of a parameter is too narrow" in diagnosis.report().headline
    assert "Widen the prior" in str(diagnosis.report())


def test_a_prior_wide_enough_is_no_cause():
    diagnosis = diagnosed(heat(T, 0.05, 2.4) + 0.4 * noise(0))
    assert diagnosis.verdict_ == "adequate"
    assert "narrow-prior" not in set(diagnosis.causes_["kind"][diagnosis.causes_["note"] == ""])


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_noise_that_grows_is_no_fault_of_the_simulation(seed):
    clean = heat(T, 0.05, 2.4)
    diagnosis = diagnosed(clean + 0.06 * (clean - 21.5) * noise(seed))
    assert diagnosis.p_value_ <= 0.05
    assert diagnosis.concerns_ == "noise"
    assert "The mean of the simulation stands" in str(diagnosis.report())


@pytest.mark.slow
def test_the_smallest_fault_that_would_have_shown():
    """Half of it is hardly ever detected, and twice of it is."""
    clean = heat(T, 0.05, 2.4)
    size = diagnosed(clean + 0.4 * noise(1)).smallest_detectable_
    assert 0.1 < size < 1.2
    step = np.sqrt(2) * (np.median(T) < T)  # of unit root mean square
    seeds = range(10, 13)
    small = [diagnosed(clean + 0.4 * noise(s) + 0.4 * size * step).p_value_ for s in seeds]
    large = [diagnosed(clean + 0.4 * noise(s) + 2 * size * step).p_value_ for s in seeds]
    assert sum(p <= 0.05 for p in large) == len(seeds)
    assert sum(p <= 0.05 for p in small) < len(seeds)


def test_kinds_of_one_curve_are_one_explanation():
    """With a free level a step, and a drift of the level by a step, draw the same curve."""
    y = 1 + 1.2 * (T > 30) + 0.4 * noise(3)
    diagnosis = diagnosed(y, {"level": norm(0, 5)}, function=lambda t, level: level + 0 * t)
    found = diagnosis.best_cause_
    assert diagnosis.verdict_ == "named"
    assert {found.kind, *found.same_curve} >= {"step", "parameter-drift"}
    table = diagnosis.causes_
    together = table["kind"].isin([found.kind, *found.same_curve])
    np.testing.assert_allclose(found.probability, table["probability"][together].sum(), rtol=1e-6)
    assert "would draw the same curve" in " ".join(diagnosis.report().lead)


@pytest.mark.parametrize("before", [False, True])
def test_the_amplitude_of_a_step_is_the_change_at_its_place(before):
    step = hs.Step("t", before=before)
    rows = {"t": np.array([1.0, 4.0])}
    low, high = step.columns(rows, {"location": 2.5}).ravel()
    assert high - low == 1.0
