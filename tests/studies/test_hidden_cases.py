"""The test bed itself: what it calls an effect of size s is one, and by hand is a fair rival."""

from __future__ import annotations

import numpy as np
import pytest
from hidden_effects.by_hand import diagnose_by_hand
from hidden_effects.cases import (
    FORMS,
    KINDS,
    LATER_FORMS,
    SIMULATIONS,
    InfeasibleError,
    left_over,
    make_case,
    rms,
    same_curve,
)
from hidden_effects.fits import fit_kind
from hidden_effects.forms import forms
from hidden_effects.problem import predict
from hidden_effects.rates import by_hand_rates
from hidden_effects.several import PAIR_NAMES, TRIPLE_NAMES, make_several

from hybridsurrogate import effects

EFFECTS = KINDS[1:]
FIRSTS = {"step": 13.86451818003362, "none": 11.39040988361373, "gain": 1.1415688647607047}


def base(case):
    """Return the simulation at the true parameters, constants as assumed."""
    omega = np.tile(list(case.truth["parameters"].values()), (len(case.X), 1))
    return case.simulator(case.X[:, :-1], omega)


@pytest.mark.parametrize("kind", FORMS)
def test_same_seed_same_data(kind):
    one, two, other = (make_case(kind, 2.0, seed) for seed in (3, 3, 4))
    for word in ("X", "y", "X_out", "mu_out"):
        np.testing.assert_array_equal(getattr(one, word), getattr(two, word))
    assert one.simulator is two.simulator
    assert not np.array_equal(one.y, other.y)


@pytest.mark.parametrize("kind", EFFECTS)
@pytest.mark.parametrize("size", [1.0, 4.0])
def test_size_is_what_the_parameters_leave(kind, size):
    for seed in range(2):
        case = make_case(kind, size, seed)
        left = left_over(case.simulator, case.X, case.truth["mu"])
        assert rms(left) == pytest.approx(size * case.truth["noise_sd"], rel=1e-6)
        # no parameters anywhere in their priors come closer, so nothing more can be absorbed
        rng = np.random.default_rng(seed)
        priors = case.simulator.parameters.values()
        for _ in range(50):
            omega = np.tile([prior.ppf(rng.uniform()) for prior in priors], (len(case.X), 1))
            tried = case.truth["mu"] - case.simulator(case.X[:, :-1], omega)
            assert rms(tried) >= rms(left) * (1 - 1e-6)
        assert rms(left) >= 0.1 * rms(case.truth["mu"] - base(case))


@pytest.mark.parametrize("kind", KINDS)
def test_noise_and_ranges(kind):
    case = make_case(kind, 2.0, 5)
    n_inputs = len(case.simulator.input_names)
    assert case.X.shape == (40, n_inputs + 1)
    assert case.X_out.shape == (100, n_inputs + 1)
    assert case.mu_out.shape == (100,)
    low, high = case.simulator.input_ranges[case.simulator.input_names[0]]
    assert 0.55 < (case.X[:, 0].max() - low) / (high - low) < 0.71
    assert case.X_out[:, 0].min() > case.X[:, 0].max()
    share = case.truth["noise_sd"] / np.ptp(base(case))
    assert 0.003 <= share <= 0.3
    noise = (case.y - case.truth["mu"]) / case.truth["noise_sd"]
    assert 0.6 < noise.std() < 1.5


def test_none_has_no_effect():
    for seed in range(5):
        case = make_case("none", 0.0, seed)
        np.testing.assert_array_equal(case.truth["mu"], base(case))
        assert not case.truth["left"].any()
        omega = np.tile(list(case.truth["parameters"].values()), (len(case.X_out), 1))
        np.testing.assert_array_equal(case.mu_out, case.simulator(case.X_out[:, :-1], omega))


@pytest.mark.parametrize("kind", EFFECTS)
def test_every_kind_shows_in_several_simulations(kind):
    feasible = 0
    for name in SIMULATIONS:
        try:
            case = make_case(kind, 2.0, 0, simulation=name)
        except InfeasibleError:
            continue
        assert case.simulator.name == name
        feasible += 1
    assert feasible >= 4


@pytest.mark.parametrize("kind", EFFECTS)
def test_the_right_explanation_can_draw_the_truth(kind):
    """Noise-free, here and out of range: the two sets of curves are written apart."""
    for seed in range(2):
        case = make_case(kind, 4.0, seed)
        fit = fit_kind(case.simulator, case.X, case.truth["mu"], kind, np.random.default_rng(0))[0]
        assert np.sqrt(fit.rss / len(case.X)) < 0.01 * rms(case.truth["left"])
        out = predict(case.simulator, fit, case.X_out)
        plain = fit_kind(case.simulator, case.X, case.truth["mu"], "none", np.random.default_rng(0))
        worse = predict(case.simulator, plain[0], case.X_out)
        # the median: where between two rows a step lies is not in the data, and rows out of range
        # may fall there, along the second input
        assert np.median(np.abs(out - case.mu_out)) < 0.05 * rms(worse - case.mu_out) + 1e-9


def test_the_extra_column_matters_only_for_a_missing_input():
    case = make_case("missing-input", 2.0, 1)
    effect = case.truth["mu"] - base(case)
    np.testing.assert_allclose(effect, case.truth["slope"] * case.X[:, -1], atol=1e-9)
    case = make_case("trend", 2.0, 1)
    assert abs(np.corrcoef(case.X[:, 0], case.X[:, -1])[0, 1]) < 0.5


def test_same_curve():
    case = next(
        case
        for case in (make_case("wrong-constant", 2.0, seed) for seed in range(50))
        if case.simulator.name == "slow_growth"
    )
    assert same_curve(case, "wrong-constant", "wrong-constant")
    assert same_curve(case, "wrong-constant", "trend")  # a constant that multiplies x
    assert not same_curve(case, "wrong-constant", "missing-input")
    offset = make_case("offset", 2.0, 0)
    assert not same_curve(offset, "offset", "trend")
    assert not same_curve(offset, "offset", "none")
    with pytest.raises(ValueError, match="holds 'offset'"):
        same_curve(offset, "step", "offset")


@pytest.mark.parametrize("kind", ["periodic", "step"])
def test_by_hand_finds_what_is_plain_to_see(kind):
    for seed in range(2):
        case = make_case(kind, 8.0, seed)
        found = diagnose_by_hand(case.simulator, case.X, case.y, np.random.default_rng(seed))
        assert found["kind"] == kind
        assert found["target"] == case.truth["target"]
        assert rms(found["predict"](case.X_out) - case.mu_out) < 0.5 * rms(
            found["predict_none"](case.X_out) - case.mu_out
        )


def test_by_hand_tries_every_kind_at_every_target():
    case = make_case("none", 0.0, 0, simulation="conversion")
    targets = [(form.kind, form.target) for form in forms(case.simulator, case.X)]
    assert {kind for kind, _ in targets} == set(EFFECTS)
    for kind in ("trend", "periodic", "step", "bump"):
        assert {target for name, target in targets if name == kind} == {"hours", "temperature"}
    assert targets.count(("parameter-drift", "rate")) == 2  # along either input


@pytest.mark.slow
def test_rates_have_a_row_for_each_case():
    rows = by_hand_rates(sizes=(4,), n_seeds=1, n_null=1)
    assert sorted(row["truth"] for row in rows[4]) == sorted(EFFECTS)
    assert [row["truth"] for row in rows["none"]] == ["none"]


# ------------------------------------------------------------------- the rest of the catalogue


def test_earlier_cases_stay_what_they_were():
    """Figures in the docs rest on them."""
    firsts = {kind: float(make_case(kind, 2.0, 5000).y[0]) for kind in ("step", "none", "gain")}
    assert firsts == pytest.approx(FIRSTS, rel=1e-6)


@pytest.mark.parametrize("form", [form for form in LATER_FORMS if not form.startswith("noise")])
def test_size_of_later_kinds(form):
    for seed in range(2):
        case = make_case(form, 2.0, seed, n_rows=30)
        assert case.truth["form"] == form
        assert case.truth["kind"] == form.partition(":")[0]
        assert rms(case.truth["left"]) == pytest.approx(2 * case.truth["noise_sd"])
        assert np.isfinite(case.mu_out).all()


def test_noise_grows_from_end_to_end():
    for size, seed in ((0.5, 0), (4.0, 1), (4.0, 2)):
        case = make_case("noise", size, seed, n_rows=4000)
        np.testing.assert_allclose(case.truth["mu"], base(case))
        ratio = case.truth["ratio"]
        assert max(ratio, 1 / ratio) == pytest.approx(1 + size)
        j = case.simulator.input_names.index(case.truth["target"])
        order = np.argsort(case.X[:, j])
        noise = (case.y - case.truth["mu"])[order] / case.truth["noise_sd"]
        assert rms(noise) == pytest.approx(1, rel=0.05)
        # mean squares over tenths, of a log-linear course: 0.05 and 0.95 of the way
        seen = rms(noise[-400:]) / rms(noise[:400])
        assert seen == pytest.approx(ratio**0.9, rel=0.15)


def context(case):
    simulator = case.simulator
    names = [*simulator.input_names, "extra"]
    return effects.Context(
        dict(zip(names, case.X.T, strict=True)),
        len(names) - 1,
        simulator.parameters,
        simulator.assumed,
        1.0,
    )


ADDED = {
    "trend: quadratic": lambda name: effects.Trend(name, degree=2),
    "ramp": effects.Ramp,
    "decay": effects.Decay,
    "saturation": effects.Saturation,
    "interaction": lambda name: effects.Interaction(*name.split(" * ")),
}


@pytest.mark.parametrize("form", ADDED)
def test_the_catalogue_can_draw_what_is_added(form):
    """The same curve and the same words for its numbers, though both are written apart."""
    for seed in range(3):
        case = make_case(form, 2.0, seed)
        known, truth = context(case), case.truth
        cause = ADDED[form](truth["target"]).prepare(known)
        theta = {name: truth[name] for name in cause.parameters}
        columns = cause.columns(known.X, theta)
        curve = truth["mu"] - base(case)
        weights = np.linalg.lstsq(columns, curve, rcond=None)[0]
        np.testing.assert_allclose(columns @ weights, curve, atol=1e-8 * rms(curve))
        told = cause.estimates(theta, dict(zip(cause.coefficients, weights, strict=True)))
        shared = set(told) & set(truth)
        assert shared >= set(told) - {"level"}
        for name in shared:
            assert float(told[name]) == pytest.approx(float(truth[name]), rel=1e-6)


@pytest.mark.parametrize("form", ["delay", "parameter-drift: step", "parameter-drift: logistic"])
def test_the_catalogue_can_draw_what_is_changed_inside(form):
    for seed in range(3):
        case = make_case(form, 2.0, seed)
        known, truth = context(case), case.truth
        if form == "delay":
            cause = effects.Delay(truth["target"])
        else:
            cause = effects.ParameterDrift(truth["target"], truth["along"], form.partition(": ")[2])
        cause = cause.prepare(known)
        theta = {name: truth[name] for name in cause.parameters}
        omega = {name: np.full(len(case.X), v) for name, v in truth["parameters"].items()}
        constants = {name: a.value for name, a in case.simulator.assumed.items()}
        X, omega = cause.inputs(known.X, omega, theta)
        columns = [omega.get(name, constants.get(name)) for name in (*omega, *constants)]
        inputs = np.column_stack([X[name] for name in case.simulator.input_names])
        drawn = case.simulator(inputs, np.column_stack(np.broadcast_arrays(*columns)))
        off = np.abs(drawn - truth["mu"]) > 1e-6 * rms(truth["left"])
        # the catalogue's step rises over a fifth of the distance of neighbours
        assert off.sum() <= (1 if form.endswith("step") else 0)


@pytest.mark.parametrize("name", [*PAIR_NAMES, *TRIPLE_NAMES])
def test_several(name):
    case, again = (make_several(name, 2.0, 3, n_rows=40) for _ in range(2))
    np.testing.assert_array_equal(case.y, again.y)
    assert "+".join(case.truth["kinds"]) == name
    left = left_over(case.simulator, case.X, case.truth["mu"])
    # each is twice the noise: together between once, where they oppose each other, and all of them
    assert 2 <= rms(left) / case.truth["noise_sd"] <= 2.1 * len(case.truth["kinds"])


@pytest.mark.parametrize("form", ["noise: mean", "noise: tails", "noise: autocorrelation"])
def test_size_of_unexpected_noise(form):
    for size, seed in ((1.0, 0), (4.0, 1)):
        case = make_case(form, size, seed, n_rows=4000)
        np.testing.assert_allclose(case.truth["mu"], base(case))
        noise = (case.y - case.truth["mu"]) / case.truth["noise_sd"]
        if form == "noise: mean":
            height = np.abs(case.truth["mu"])
            share = (height - height.min()) / np.ptp(height)
            low, high = rms(noise[share < 0.1]), rms(noise[share > 0.9])
            middle = (share[share < 0.1].mean(), share[share > 0.9].mean())
            assert high / low == pytest.approx(
                np.divide(*(1 + size * np.array(middle[::-1]))), 0.15
            )
        elif form == "noise: tails":
            far = np.isin(np.arange(4000), case.truth["rows"])
            assert far.mean() == pytest.approx(0.1)
            assert rms(noise[far]) / rms(noise[~far]) == pytest.approx(1 + 2 * size, rel=0.1)
        else:
            assert rms(noise) == pytest.approx(1, rel=0.1)
            share = np.mean(noise[1:] * noise[:-1]) / np.mean(noise**2)
            kept = np.exp(-np.ptp(case.X[:, 0]) / 3999 / case.truth["length"])
            assert share == pytest.approx(size**2 / (1 + size**2) * kept, abs=0.06)
