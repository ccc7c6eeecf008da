"""Data as a beginner may give them: the mistake is pointed out, and no mechanism is made of it."""

import warnings

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy import stats

import hybridsurrogate as hs

N, NOISE = 50, 0.1
# of a study of six kinds with ten seeds each: 3 of 60 may be named, 50 of 60 must be pointed out
MOST_NAMED, LEAST_POINTED_OUT = 3 / 60, 50 / 60


# what could be made of a mistake; the study compares all kinds
FEW = all_but("gross-error", "step", "trend", "gain", "missing-input", "narrow-prior", "noise")


def flow(pressure, viscosity, gain):
    return gain * pressure * np.exp(-viscosity / 3)


def simulator(pressures=(0, 10), viscosities=(0, 10)):
    return hs.Simulator(
        flow,
        inputs={"pressure": pressures, "viscosity": viscosities},
        parameters={"gain": stats.uniform(0.5, 1.5)},
        output="flow",
    )


def measured(rng):
    """Return rows and outputs without a mistake."""
    X = pd.DataFrame({"pressure": rng.uniform(0, 10, N), "viscosity": rng.uniform(0, 10, N)})
    return X, flow(X.pressure, X.viscosity, 1.3).to_numpy() + NOISE * rng.standard_normal(N)


def one_wild_row(seed, rng):
    X, y = measured(rng)
    # the last row may be it, where a step would be seen in one row
    row = N - 1 if seed == 1 else int(rng.integers(N))
    y[row] = (9999.0, -999.0, y[row] + 12 * NOISE, 10 * y[row] + 5)[seed % 4]
    return simulator(), X, y, rf"[Rr]ow {row + 1} \("


def swapped_columns(seed, rng):
    X, y = measured(rng)
    swapped = X.rename(columns={"pressure": "viscosity", "viscosity": "pressure"})
    if seed % 2:
        return simulator(), swapped, y, "'pressure' and 'viscosity' exchanged"
    # other ranges: most rows lie outside
    swapped["viscosity"] = 100 + swapped.viscosity
    far = hs.Simulator(
        lambda pressure, viscosity, gain: flow(pressure - 100, viscosity, gain),
        *({"pressure": (100, 110), "viscosity": (0, 10)}, simulator().parameters),
    )
    return far, swapped, y, "'pressure' and 'viscosity' exchanged"


def wrong_unit(seed, rng):
    X, y = measured(rng)
    factor = (60, 1 / 1000, 1000, 1 / 60, 3600)[seed % 5]
    # a factor on the pressure is one on the gain, and no fit can see it
    X["viscosity"] *= factor
    way, size = ("divided", factor) if factor > 1 else ("multiplied", 1 / factor)
    return simulator(), X, y, f"{way} by {size:.6g}"


def output_among_inputs(seed, rng):
    X, y = measured(rng)
    copy = (y, 32 + 1.8 * y, y / 1000, -y)[seed % 4]
    return simulator(), X.assign(flow_again=copy), y, "'flow_again' is the output itself"


def narrow_prior(seed, rng):
    X, y = measured(rng)
    low, high = ((1.5, 2.5), (0.4, 1.1), (1.36, 1.5), (0.9, 1.24), (2.0, 3.0))[seed % 5]
    simulation = hs.Simulator(
        flow,
        simulator().input_ranges,
        {"gain": stats.uniform(low, high - low)},
        output="flow",
    )
    return simulation, X, y, r"gain = 1\.3.* \(outside its prior\)|gain = 1\.29.* \(outside"


def too_few_runs(seed, rng):
    X, y = measured(rng)
    # every second data set holds a fault of twice the noise, which nobody could see
    y += 2 * NOISE * (seed % 2) * (X.pressure > 5)
    return simulator().run(5 + seed % 3, random_state=seed), X, y, "undecided by runs"


MISTAKES = {
    "narrow prior": narrow_prior,
    "too few runs": too_few_runs,
    "one wild row": one_wild_row,
    "swapped columns": swapped_columns,
    "wrong unit": wrong_unit,
    "output among inputs": output_among_inputs,
}


def diagnosed(simulation, X, y, exclude=FEW):
    """Return a diagnosis, and all that it said or raised instead."""
    is_run = isinstance(simulation, hs.SimulationData)
    surrogate = hs.PolynomialChaos(degree=2) if is_run else hs.ExactSurrogate()
    model = hs.PowerScaledSurrogate(simulation, surrogate=surrogate, n_draws=200, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        try:
            settings = {"exclude": exclude, "cv": None, "n_replicates": 39, "random_state": 0}
            found = hs.DiscrepancyDiagnosis(model, **settings).fit(X, y)
        except ValueError as error:
            return None, str(error)
    said = [one.sentence for one in found.cautions_]
    verdict = f"{found.verdict_} by {found.undecided_by_}"
    return found, " ".join([*said, found.best_cause_.formula, verdict])


def outcome(mistake, seed, exclude=FEW):
    """Return whether a mechanism of the simulation is named, and what is said with the words."""
    simulation, X, y, words = MISTAKES[mistake](seed, np.random.default_rng(seed))
    found, said = diagnosed(simulation, X, y, exclude)
    named = False
    if found is not None and found.verdict_ == "named":
        named = found.result_.steps[0].chosen.cause.concerns == "simulation"
    return named, said, words


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_pointed_out(mistake):
    named, said, words = outcome(mistake, 1)
    assert not named
    assert pd.Series([said]).str.contains(words).all(), said


@pytest.mark.slow
def test_how_often_mistakes_are_pointed_out():
    found = [outcome(mistake, seed, ()) for mistake in MISTAKES for seed in range(10)]
    said = [bool(pd.Series([text]).str.contains(words)[0]) for _, text, words in found]
    assert np.mean([named for named, _, _ in found]) <= MOST_NAMED
    assert np.mean(said) >= LEAST_POINTED_OUT


def test_the_rest_is_right_apart_from_a_wild_row():
    X, y = measured(np.random.default_rng(3))
    y[10] = 9999.0
    found, said = diagnosed(simulator(), X, y)
    assert (found.verdict_, found.best_cause_.kind) == ("named", "gross-error")
    assert "9999, where the simulation predicts" in said
    estimates = found.best_cause_.estimates
    assert (estimates["row"][0], estimates["measured"][0]) == (11, 9999)
    truth = flow(X.pressure, X.viscosity, 1.3).to_numpy()
    assert estimates["predicted"][0] == pytest.approx(truth[10], abs=2 * NOISE)
    # the row is left out: the others tell the gain to a hundredth
    gain = found.extended_estimator_.posterior_.named()["gain"]
    assert abs(gain.mean() - 1.3) < 4 * gain.std()
    assert gain.std() < 0.02
    assert np.max(np.abs(found.extended_estimator_.predict(X) - truth)) < NOISE
    assert found.extended_simulator_ is None
    assert "Row 11" in str(found.report(full=True))


@pytest.mark.slow
def test_two_wild_rows_are_a_pair_and_many_are_tails():
    X, y = measured(np.random.default_rng(4))
    some = y.copy()
    some[[7, 30]] = 99.0, -99.0
    found, said = diagnosed(simulator(), X, some, ())
    assert found.best_cause_.kind == "gross-error"
    assert "Row 8 (" in said
    assert "Row 31 (" in said
    many = y.copy()
    many[::7] += np.array([2.0, -1.5, 1.8, -2.2, 1.2, -1.1, 2.4, -2.0])
    found, _ = diagnosed(simulator(), X, many, ())
    assert (found.best_cause_.kind, found.causes_.form[0]) == ("noise", "noise: tails")


@pytest.mark.slow
def test_a_step_in_two_rows_rests_on_them():
    X, y = measured(np.random.default_rng(5))
    X = X.sort_values("pressure", ignore_index=True)
    y = flow(X.pressure, X.viscosity, 1.3).to_numpy() + NOISE * np.random.default_rng(6).normal(
        size=N
    )
    y[-2:] += 50.0
    found, said = diagnosed(simulator(), X, y, ())
    assert found.verdict_ != "named" or found.best_cause_.kind == "gross-error"
    assert f"row {N - 1} (" in said.lower()
    assert f"row {N} (" in said.lower()


def test_rows_at_one_place():
    X, y = measured(np.random.default_rng(0))
    _, said = diagnosed(simulator(), X.assign(pressure=2.0, viscosity=3.0), y)
    assert "same inputs, pressure = 2, viscosity = 3" in said
    assert "give the inputs at which each row was measured" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda y: 1000 * y, r"times what is simulated \(as milli and one"),
        (lambda y: y + 273.15, "kelvins, and the simulation degrees Celsius"),
    ],
)
def test_an_output_in_another_unit(change, words):
    X, y = measured(np.random.default_rng(1))
    found, said = diagnosed(simulator(), X, change(y), ())
    assert pd.Series([said]).str.contains(words).all(), said
    assert found.cautions_[0].about == "columns"


@pytest.mark.parametrize(("low", "high", "words"), [(3, 18, "1/60"), (0.0008, 0.005, "60")])
def test_a_prior_in_another_unit(low, high, words):
    """A rate of 0.15 a minute, with a prior in 1/h and in 1/s."""
    minutes = np.linspace(0, 20, 40)
    rng = np.random.default_rng(0)
    y = 20 + 63 * np.exp(-0.15 * minutes) + 0.4 * rng.standard_normal(40)
    cooling = hs.Simulator(
        lambda minutes, start, rate: 20 + start * np.exp(-rate * minutes),
        inputs={"minutes": (0, 20)},
        parameters={
            "start": hs.truncated_normal(60, 10, 40, 80),
            "rate": stats.uniform(low, high - low),
        },
    )
    found, said = diagnosed(cooling, minutes[:, None], y)
    assert f"the prior of 'rate' multiplied by {words} (as" in said
    assert found.verdict_ != "named"


@pytest.mark.parametrize("step", [0.0, pytest.param(4.0, marks=pytest.mark.slow)])
def test_measurements_without_noise(step):
    """A simulation of one's own, given as measurements: tails of rounding were named."""
    X, _ = measured(np.random.default_rng(2))
    y = flow(X.pressure, X.viscosity, 1.3).to_numpy() + step * (X.pressure > 5)
    found, said = diagnosed(simulator(), X, y)
    assert "the data are exact" in said
    assert [one.about for one in found.cautions_] == ["noise"]
    if not step:
        assert found.verdict_ == "adequate"
        return
    assert (found.verdict_, found.best_cause_.kind) == ("named", "step")
    assert found.best_cause_.estimates["amplitude"][0] == pytest.approx(step, rel=1e-3)


def test_a_rate_that_depends_on_temperature():
    """Four temperatures were taken for experiments, each with a curve of its own."""
    simulation = hs.Simulator(
        lambda t, rate: 10 * np.exp(-rate * t), {"t": (0, 10)}, {"rate": stats.uniform(0.02, 0.6)}
    )
    rng = np.random.default_rng(0)

    def rows(*temperatures):
        t = np.tile(np.linspace(0.5, 10, 15), len(temperatures))
        kelvin = 273.15 + np.repeat(temperatures, 15)
        # Arrhenius: twice the rate from 20 to 80 degrees
        y = 10 * np.exp(-0.2 * np.exp(-1200 * (1 / kelvin - 1 / 323.15)) * t)
        X = pd.DataFrame({"t": t, "temperature": kelvin - 273.15})
        return X, y + 0.2 * rng.standard_normal(len(t))

    found, _ = diagnosed(simulation, *rows(20.0, 37.5, 60.0, 80.5), ())
    assert (found.best_cause_.kind, found.best_cause_.target) == ("parameter-drift", "rate")
    assert "temperature" in found.best_cause_.formula
    new = rows(50.0)
    assert found.extended_estimator_.score(*new) > found.estimator_.score(*new)


@pytest.mark.parametrize("seed", [8, 9])
def test_a_test_and_an_evidence_that_disagree_are_told(seed):
    """A density that is 12 % off, and a coefficient whose narrow prior draws the same curve."""

    def flow_rate(dp, cd, rho):
        return 1.44 * cd * np.sqrt(2000 * dp / rho)

    rng = np.random.default_rng(seed)
    dp = rng.uniform(1, 30, 60)
    y = flow_rate(dp, 0.608, 1120.0) + 0.05 * rng.standard_normal(60)
    orifice = hs.Simulator(
        flow_rate,
        inputs={"dp": (0.1, 40)},
        parameters={"cd": hs.truncated_normal(0.61, 0.01, 0.5, 0.7)},
        assumed={"rho": hs.Assumed(1000, hs.truncated_normal(1000, 80, 500, 2000))},
    )
    model = hs.PowerScaledSurrogate(
        orifice, surrogate=hs.ExactSurrogate(), n_draws=200, random_state=0
    )
    # far below the p-value
    settings = {"cv": None, "n_replicates": 99, "false_alarm_rate": 0.01, "random_state": 0}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        found = hs.DiscrepancyDiagnosis(model, **settings).fit(dp[:, None], y)
    assert found.verdict_ == "adequate"
    said = [one.sentence for one in found.cautions_ if one.about == "rows"]
    assert any("probability" in text and "measure more" in text for text in said), said
