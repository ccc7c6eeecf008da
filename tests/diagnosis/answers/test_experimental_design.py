"""One more measurement where it tells most."""

import numpy as np
import pytest
from hidden_effects.cases import make_case
from scipy.special import entr
from scipy.stats import norm

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.answers.experimental_design import (
    _mutual,
    information_at,
    next_measurement,
)
from hybridsurrogate.diagnosis.answers.table import form_of
from hybridsurrogate.diagnosis.search.evidence import search
from hybridsurrogate.diagnosis.search.setup import prepare, trained_emulator

HALF = np.array([0.5, 0.5])


def bits(means, variances, weight=HALF, rival=(0, 1)):
    means, variances = (np.array(v, dtype=float)[:, None] for v in (means, variances))
    return float(_mutual(means, variances, np.asarray(weight), np.array(rival))[0])


def test_rivals_that_agree_tell_nothing_and_those_far_apart_everything():
    assert bits([0, 0], [1, 1]) == pytest.approx(0, abs=1e-12)
    assert bits([0, 100], [1, 1]) == pytest.approx(1, abs=1e-9)
    third = np.full(3, 1 / 3)
    assert bits([0, 100, 200], [1, 1, 1], third, (0, 1, 2)) == pytest.approx(np.log2(3))
    # two nodes of one rival are one rival
    assert bits([0, 100, 200], [1, 1, 1], third, (0, 0, 1)) == pytest.approx(
        entr([2 / 3, 1 / 3]).sum() / np.log(2)
    )


@pytest.mark.parametrize(("gap", "sd"), [(1.0, 1.0), (2.0, 0.7), (0.0, 4.0)])
def test_the_information_is_that_of_many_simulated_measurements(gap, sd):
    rng = np.random.default_rng(0)
    p = np.array([0.7, 0.3])
    truth = rng.uniform(size=400_000) < p[1]
    y = np.where(truth, gap + sd * rng.standard_normal(400_000), rng.standard_normal(400_000))
    log = np.log(p) + np.stack([-0.5 * y**2, -0.5 * ((y - gap) / sd) ** 2 - np.log(sd)], axis=1)
    after = np.exp(log - np.logaddexp(*log.T)[:, None])
    expected = (entr(p).sum() - entr(after).sum(axis=1).mean()) / np.log(2)
    assert bits([0, gap], [1, sd**2], p) == pytest.approx(expected, abs=0.005)


def found_in(simulator, X, y, forms=None):
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=20, random_state=0
    )
    prepared = prepare(model.fit(X, y), ())
    over = f"parameter-drift: linear over {simulator.input_names[0]}"
    forms = forms or ("offset", "trend", "gain", over)
    causes = [cause for cause in prepared.causes if form_of(cause) in forms]
    problem, emulator = trained_emulator(prepared.problem, model)
    return search(problem, causes, emulator, with_remainder=False)


def entropy(found):
    return entr(found.probability).sum() / np.log(2)


@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
def test_the_place_tells_more_than_a_random_one():
    saved, promised, elsewhere = [], [], []
    for seed, kind in enumerate(("trend", "gain", "parameter-drift", "offset") * 2):
        case = make_case(kind, 1.5, 40 + seed, simulation=("cooling", "uptake")[seed % 2])
        found = found_in(case.simulator, case.X, case.y)
        told = next_measurement(found, case.simulator.input_ranges)
        # what would be measured is known at the measured rows and at a hundred beyond them
        rows, mu = np.vstack([case.X, case.X_out]), np.r_[case.truth["mu"], case.mu_out]
        rng = np.random.default_rng(seed)
        y = mu + case.truth["noise_sd"] * rng.standard_normal(len(mu))
        ((name, (low, high)),) = case.simulator.input_ranges.items()
        before = entropy(found)

        def reduction(x, case=case, rows=rows, y=y, before=before):
            k = int(np.argmin(np.abs(rows[:, 0] - x)))
            after = found_in(case.simulator, np.vstack([case.X, rows[k]]), np.append(case.y, y[k]))
            return before - entropy(after)

        saved.append(reduction(told.place[name]))
        promised.append(told.information)
        elsewhere.append(reduction(rng.uniform(low, high)))
    assert np.mean(saved) > np.mean(elsewhere)
    # the promise is an average over what may be measured, and holds on average
    error = np.std(np.subtract(saved, promised), ddof=1) / np.sqrt(len(saved))
    assert abs(np.mean(saved) - np.mean(promised)) < 3 * error


def test_a_smooth_curve_foresees_nothing_beyond_the_measured_rows():
    case = make_case("step", 4.0, 3, simulation="cooling")
    model = hs.PowerScaledSurrogate(
        case.simulator, surrogate=hs.ExactSurrogate(), n_draws=20, random_state=0
    )
    prepared = prepare(model.fit(case.X, case.y), ())
    causes = [cause for cause in prepared.causes if cause.kind == "unexplained"]
    problem, emulator = trained_emulator(prepared.problem, model)
    found = search(problem, causes, emulator)
    inside, outside = np.median(case.X, axis=0), case.X_out[-1:]
    assert information_at(found, outside)[0] == pytest.approx(0, abs=1e-9)
    assert information_at(found, inside[None]).shape == (1,)


def test_a_rival_whose_probability_is_no_number_any_more():
    simulator = hs.Simulator(
        lambda t, level: level + 0 * t, inputs={"t": (0, 1)}, parameters={"level": norm(0, 1)}
    )
    t = np.linspace(0, 1, 400)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(400)
    found = found_in(simulator, t[:, None], t + noise, ("offset", "trend"))
    assert np.sort(found.probability)[-2] == 0
    told = next_measurement(found, simulator.input_ranges)
    assert told.information == 0
    assert 0 <= told.place["t"] <= 1
