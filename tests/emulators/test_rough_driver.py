"""A reservoir driven by daily rain, known from daily runs: leaks are seen, and no run is wasted."""

import warnings
from functools import cache

import numpy as np
import pytest
from few_kinds import all_but
from scipy.stats import qmc, uniform

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.checks.simulation import EmulatorCheck

PRIORS = {"k": uniform(0.03, 0.17), "loss": uniform(0.1, 0.5), "s0": uniform(20, 100)}
NOISE, FROM = 0.08, 70
DAYS = np.arange(120.0)
# mostly dry, and a storm on day 33
RAIN = np.where(DAYS == 33, 54.0, np.random.default_rng(0).gamma(0.12, 12.0, len(DAYS)))


def reservoir(k, loss, s0, leak=0.0):
    """Return storage and outflow (n_runs, n_days): s += rain (1 - loss); q = k s; s -= q."""
    storage, out = np.array(s0, dtype=float), []
    for day, rain in zip(DAYS, RAIN, strict=True):
        storage = storage + rain * (1 - loss)
        flow = k * storage
        out.append((storage, flow))
        storage = storage - flow
        if day >= FROM:
            storage = storage - leak * storage
    return np.moveaxis(np.array(out), 2, 0)[:, :, ::-1]


def design(n, seed):
    low, high = zip(*(prior.support() for prior in PRIORS.values()), strict=True)
    return qmc.scale(qmc.LatinHypercube(3, seed=seed).random(n), low, high)


@cache
def runs(seed, every=1):
    points = design(60, seed)
    flow = reservoir(*points.T)[:, ::every, 0]
    along = {"day": DAYS[::every]}
    return hs.SimulationData.from_curves(
        points, flow, along=along, parameters=PRIORS, output="flow", inputs={"day": (0, 119)}
    )


def measured(leak, seed):
    """Return 51 days and flows of k = 0.08, loss = 0.3, s0 = 70."""
    rng = np.random.default_rng(1000 + seed)
    days = np.sort(rng.choice(np.arange(2, 117), 51, replace=False))
    true = reservoir(*(np.array([value]) for value in (0.08, 0.3, 70.0)), leak)[0, days, 0]
    return DAYS[days][:, None], true + NOISE * rng.normal(size=51)


def asked(simulation, n_replicates=39, exclude=()):
    model = hs.PowerScaledSurrogate(simulation, surrogate=hs.Kriging(), n_draws=200, random_state=0)
    settings = {"exclude": exclude, "cv": None, "n_replicates": n_replicates}
    return hs.DiscrepancyDiagnosis(model, **settings, random_state=0)


def test_a_leak_is_seen_through_the_runs():
    diagnosis = asked(runs(0), 19, all_but("step", "ramp", "trend")).fit(*measured(0.12, 0))
    assert diagnosis.p_value_ <= 0.05
    check = diagnosis.emulator_check_
    # 0.004 of 0.08: what the runs leave open is far below the noise, and all of it of the runs
    assert check.left_open < 0.15
    assert (check.between, check.along) == (0, "day")


@pytest.mark.slow
@pytest.mark.parametrize("leak", [0.04, 0.12, 0.3])
def test_leaks_of_any_size_are_seen(leak):
    seen = [asked(runs(s)).fit(*measured(leak, s)).p_value_ <= 0.05 for s in range(10)]
    assert sum(seen) >= 8


@pytest.mark.slow
def test_without_a_leak_nothing_is_wrong():
    verdicts = [asked(runs(s)).fit(*measured(0.0, s)).verdict_ for s in range(10)]
    assert verdicts.count("adequate") >= 9


@pytest.mark.slow
def test_places_too_far_apart_are_said_and_no_run_is_spent():
    simulator = hs.Simulator(
        lambda day, k, loss, s0: reservoir(k, loss, s0)[:, np.rint(day).astype(int), 0],
        {"day": (0, 119)},
        PRIORS,
        returns="curve",
    )
    with pytest.warns(hs.DiagnosisWarning) as caught:
        found = hs.refine(asked(runs(0, every=3), 19), *measured(0.0, 0), simulator, budget=40)
    said = " ".join(str(each.message) for each in caught)
    assert "0 of 40 further runs were made, and more would not help" in said
    assert "Give runs with finer places along day" in said
    assert found.refinement_["n_runs"].tolist() == [60]
    check = found.emulator_check_
    assert check.left_open > 1 > 0.2 > check.between_runs
    assert check.between == pytest.approx(check.left_open, rel=0.05)
    assert "finer places along day" in " ".join(str(found.report(full=True)).split())


@pytest.mark.slow
def test_several_outputs_and_a_further_input():
    """Storage and flow of two basins of different area, each run with one of its own."""
    points, area = design(60, 5), np.linspace(1, 2, 60)
    area = np.random.default_rng(5).permutation(area)
    both = reservoir(*points.T) * area[:, None, None]
    names = {"flow": both[..., 0], "storage": both[..., 1]}
    simulation = hs.SimulationData.from_curves(
        np.column_stack([area, points]),
        names,
        along={"day": DAYS},
        parameters=PRIORS,
        inputs={"day": (0, 119), "area": (1, 2)},
        output=["flow", "storage"],
    )
    rng = np.random.default_rng(6)
    days = np.concatenate([np.sort(rng.choice(120, 30, replace=False)) for _ in range(2)])
    basin = np.repeat([1.2, 1.8], 30)
    true = reservoir(*(np.array([value]) for value in (0.08, 0.3, 70.0)))[0, days]
    Y = true * basin[:, None] + [0.08, 1.0] * rng.normal(size=(60, 2))
    X = np.column_stack([days, basin])
    with warnings.catch_warnings():
        warnings.simplefilter("error", hs.DiagnosisWarning)
        diagnosis = asked(simulation, 19).fit(X, Y)
    check = diagnosis.emulator_check_
    assert check.left_open < 0.5
    assert (check.between, check.along) == (0, "day")
    assert diagnosis.verdict_ == "adequate"
    # half a day later rows lie between the places of both outputs
    later = asked(simulation, 19)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        later.fit(X + np.array([0.5, 0]), Y)
    check = later.emulator_check_
    assert check.needs_places
    assert check.along == "day"


def test_what_helps_is_what_is_named():
    of_runs = EmulatorCheck(2.0, 0.0, {}, 0.1, 0.0, "day")
    assert of_runs.remedy.startswith("Give more runs, or the simulation itself")
    assert EmulatorCheck(2.0, 0.0, {}, 0.0, 0.0).remedy == of_runs.remedy
    of_places = EmulatorCheck(2.0, 0.0, {}, 1.9, 0.0, "day")
    assert of_places.between_runs == pytest.approx(np.sqrt(4 - 1.9**2))
    assert of_places.remedy.startswith("Most of it lies between the places of the runs along day")
    assert "Give runs with finer places along day" in of_places.remedy
    (caution,) = of_places.cautions(hs.Kriging())
    assert caution.about == "runs"
    assert "open by 2.0 times the noise" in caution.sentence
    assert "finer places" in caution.sentence
