"""One more measurement where it tells most."""

import numpy as np
import pytest
from hidden_effects.cases import make_case
from scipy.special import entr
from scipy.stats import loguniform, norm
from searching import compared

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.answers.averaging import (
    Predictions,
    components_of,
    predictions_at,
)
from hybridsurrogate.diagnosis.answers.experimental_design import (
    _conditioned,
    _mutual,
    batch,
    information_at,
    next_measurement,
)
from hybridsurrogate.diagnosis.answers.finding import form_of
from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.search import predict_jointly, search
from hybridsurrogate.diagnosis.search.setup import prepare, trained_emulator

HALF = np.array([0.5, 0.5])


def bits(means, variances, weight=HALF, alternative=(0, 1)):
    means, variances = (np.array(v, dtype=float)[:, None] for v in (means, variances))
    return float(_mutual(means, variances, np.asarray(weight), np.array(alternative))[0])


def test_rivals_that_agree_tell_nothing_and_those_far_apart_everything():
    assert bits([0, 0], [1, 1]) == pytest.approx(0, abs=1e-12)
    assert bits([0, 100], [1, 1]) == pytest.approx(1, abs=1e-9)
    third = np.full(3, 1 / 3)
    assert bits([0, 100, 200], [1, 1, 1], third, (0, 1, 2)) == pytest.approx(np.log2(3))
    # an alternative that is all but refuted leaves nothing to ask
    assert bits([0, 100], [1, 1], [1 - 1e-315, 1e-315]) == pytest.approx(0, abs=1e-12)
    # two nodes of one alternative are one alternative
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
    return search(SearchContext.of(problem, emulator), causes)


def entropy(found):
    return entr(found.probability).sum() / np.log(2)


@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
def test_the_place_tells_more_than_a_random_one():
    saved, promised, elsewhere = [], [], []
    for seed, kind in enumerate(("trend", "gain", "parameter-drift", "offset") * 2):
        case = make_case(kind, 1.5, 40 + seed, simulation=("cooling", "uptake")[seed % 2])
        found = found_in(case.simulator, case.X, case.y)
        # within the measured range: beyond it a alternative may lack more than the search supposes
        ((name, _),) = case.simulator.input_ranges.items()
        low, high = float(case.X[:, 0].min()), float(case.X[:, 0].max())
        told = next_measurement(found, {name: (low, high)})
        # what would be measured is known at the measured rows
        rows, mu = case.X, case.truth["mu"]
        rng = np.random.default_rng(seed)
        y = mu + case.truth["noise_sd"] * rng.standard_normal(len(mu))
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
    found = compared(problem, causes, emulator)
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


@pytest.fixture(scope="module")
def step():
    """A line that jumps, which other causes come near."""
    simulator = hs.Simulator(
        lambda t, level: level + 2 * t,
        inputs={"t": (0, 3.0)},
        parameters={"level": norm(0, 1)},
    )
    rng = np.random.default_rng(0)
    t = np.linspace(0, 1, 30)
    y = 0.3 + 2 * t + 0.6 * (t > 0.5) + 0.2 * rng.standard_normal(30)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    )
    return hs.DiscrepancyDiagnosis(model, cv=None, n_replicates=39, random_state=0).fit(
        t[:, None], y
    )


def test_a_batch_begins_where_one_measurement_would_be(step):
    told = step.next_measurements(4)
    assert list(told) == ["t", "information", "cost"]
    assert len(told) == 4
    # 500 simulated batches against quadrature
    assert told["information"][0] == pytest.approx(step.next_information_, abs=0.05)
    assert np.all(told["information"] >= 0)
    # nothing is told twice: no more than there is to tell
    uncertain = entr(step.result_.asked.probability).sum() / np.log(2)
    assert told["information"].sum() <= uncertain + 0.02


def test_a_dear_place_gives_way_to_one_nearly_as_good(step):
    free = step.next_measurements(1)
    dear = float(free["t"][0])
    priced = step.next_measurements(3, cost=lambda table: 1 + 99 * (abs(table["t"] - dear) < 0.2))
    assert np.all(np.abs(priced["t"] - dear) >= 0.2)
    assert (priced["cost"] == 1).all()
    # a currency is no matter
    same = step.next_measurements(3, cost=lambda table: np.full(len(table), 7.0))
    assert same["t"].tolist() == step.next_measurements(3)["t"].tolist()


def test_places_of_ones_own_and_costs_that_are_none(step):
    told = step.next_measurements(2, places=[[0.2], [0.52], [0.9]], cost=[1, 2, 1])
    assert set(told["t"]) <= {0.2, 0.52, 0.9}
    with pytest.raises(ValueError, match="one number for each of the 3 places"):
        step.next_measurements(2, places=[[0.2], [0.52], [0.9]], cost=[1, 2])
    with pytest.raises(ValueError, match="positive and finite"):
        step.next_measurements(2, places=[[0.2], [0.52]], cost=[0, 2])
    with pytest.raises(ValueError, match="n == 0"):
        step.next_measurements(0)


def test_conditioning_is_that_of_a_normal():
    rng = np.random.default_rng(0)
    L, variance = rng.standard_normal((2, 5, 3)), rng.uniform(0.1, 1, (2, 5))
    mean = rng.standard_normal((2, 5))
    known = Predictions(mean, L, variance, HALF, np.arange(2))
    y = np.array([0.7, -1.2])
    after, moved = _conditioned(
        known, np.repeat(mean[None], 2, axis=0), y, 1, np.zeros(2, dtype=bool)
    )
    for c in range(2):
        full = L[c] @ L[c].T
        gain = full[:, 1] / (full[1, 1] + variance[c, 1])
        expected = full - np.outer(gain, full[1])
        np.testing.assert_allclose(after.loadings[c] @ after.loadings[c].T, expected, atol=1e-12)
        for k in range(2):
            np.testing.assert_allclose(moved[k, c], mean[c] + gain * (y[k] - mean[c, 1]))


@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
def test_a_batch_tells_what_it_promises():
    saved, promised = [], []
    for seed, kind in enumerate(("trend", "gain", "parameter-drift", "offset") * 2):
        case = make_case(kind, 1.5, 70 + seed, simulation=("cooling", "uptake")[seed % 2])
        found = found_in(case.simulator, case.X, case.y)
        told = batch(found, case.X, 3, np.ones(len(case.X)))
        rng = np.random.default_rng(seed)
        at = [k for k, _ in told]
        y = case.truth["mu"][at] + case.truth["noise_sd"] * rng.standard_normal(3)
        after = found_in(case.simulator, np.vstack([case.X, case.X[at]]), np.append(case.y, y))
        saved.append(entropy(found) - entropy(after))
        promised.append(sum(bits for _, bits in told))
    error = np.std(np.subtract(saved, promised), ddof=1) / np.sqrt(len(saved))
    assert abs(np.mean(saved) - np.mean(promised)) < 3 * error


def test_what_is_foreseen_jointly_is_what_each_row_foresees_where_a_matrix_is_nearly_singular():
    case = make_case("trend", 4.0, 3, simulation="cooling")
    found = found_in(case.simulator, case.X, case.y, ("trend",))
    (w,) = (w for w in found.candidates if w.cause is not None)
    # as precise as data can be: the covariance of the coefficients has lost its digits
    w = w._replace(fit=w.fit._replace(sigma=1e-9 * w.fit.sigma))
    mean, loadings, variance = predict_jointly(found, w, case.X_out)
    alone = [predict_jointly(found, w, row[None]) for row in case.X_out[:3]]
    assert np.isfinite(loadings).all()
    assert (variance > 0).all()
    for k, (one, its, _) in enumerate(alone):
        assert one[0] == pytest.approx(mean[k])
        assert np.sum(its**2) == pytest.approx(np.sum(loadings[k] ** 2), rel=1e-3, abs=1e-12)


def test_beyond_the_measured_range_a_rival_may_lack_more():
    case = make_case("trend", 4.0, 3, simulation="cooling")
    found = found_in(case.simulator, case.X, case.y, ("trend",))
    components = components_of(found)
    low, high = float(case.X[:, 0].min()), float(case.X[:, 0].max())
    far = np.array([[high + (high - low), *case.X[0, 1:]]])
    known = predictions_at(found, components, far)
    (trend,) = (c for c in components if c.candidate.cause is not None)
    own = known.alternative == trend.alternative
    plain = np.sum(predict_jointly(found, trend.candidate, far)[1] ** 2)
    lacking = np.sum(known.loadings[own, 0] ** 2, axis=1) - plain
    # Remainder: log-uniform from a hundredth of the change to twice, at a distance of one range
    drawn = trend.size[0] * loguniform(0.01, 2).rvs(100_000, random_state=0)
    weight = known.weight[own] / known.weight[own].sum()
    # by three nodes
    assert weight @ lacking == pytest.approx(np.mean(drawn**2), rel=0.1)
