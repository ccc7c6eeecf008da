"""Causes inside the dynamics: fitted, named, and put into the simulation."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest
from epidemic import hidden_fall, make_epidemic
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.setup import prepare
from hybridsurrogate.diagnosis.validation.refit import extended_simulator
from hybridsurrogate.ode.dynamics import DelayedState, MissingTerm, TimeVaryingParameter


@pytest.mark.slow
def test_estimator_finds_a_hidden_fall_of_the_contact_rate():
    model = hs.PowerScaledSurrogate(
        make_epidemic(max_step=0.5),
        surrogate=hs.ExactSurrogate(),
        effects=(hs.DynamicDrift("contact_rate", "logistic"),),
        likelihood="lognormal",
        n_draws=500,
        random_state=0,
    )
    inside = []
    for seed in range(8):
        t, y = hidden_fall(seed)
        draws = model.fit(t, y).posterior_.estimates(0)
        for name, truth in {"amount": -0.65, "location": 22.0, "width": 3.0}.items():
            low, high = np.quantile(draws[name], [0.025, 0.975])
            inside.append(low < truth < high)
        assert np.median(np.abs(model.predict(t) / y - 1)) < 0.06
    # of 24 intervals at 95 %: fewer than 20 would happen once in 150 times
    assert np.sum(inside) >= 20


@pytest.fixture(scope="module")
def diagnosed():
    t, y = hidden_fall()
    model = hs.PowerScaledSurrogate(
        make_epidemic(max_step=0.5),
        surrogate=hs.ExactSurrogate(),
        likelihood="lognormal",
        n_draws=400,
        random_state=0,
    )
    return hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(t, y)


@pytest.mark.slow
def test_diagnosis_names_the_hidden_fall(diagnosed):
    assert diagnosed.verdict_ == "named"
    found = diagnosed.best_cause_
    assert (found.kind, found.target) == ("parameter-drift", "contact_rate")
    assert "contact_rate falling by" in found.formula
    assert "logistic" in found.formula
    assert abs(found.estimates["location"][0] - 22) < 3
    assert {"missing-term", "wrong-constant"} <= set(diagnosed.causes_["kind"])


@pytest.mark.slow
def test_extended_simulator_is_an_ode_with_the_cause_in_it(diagnosed):
    simulator = diagnosed.extended_simulator_
    assert isinstance(simulator, hs.OdeSimulator)
    names = [f"contact_rate_logistic_{name}" for name in ("amount", "location", "width")]
    assert list(simulator.parameters) == ["contact_rate", *names]
    assert simulator.modifiers == {}
    # within the measured range: beyond it the estimator is less sure than its formula
    rows = diagnosed.estimator_.measured_[0]
    t = np.linspace(rows.min(), rows.max(), 9)[:, None]
    posterior = diagnosed.extended_estimator_.posterior_
    eta, _ = posterior.eta(t)
    omega = np.repeat(posterior.values[:, :4], len(t), axis=0)
    values = simulator(np.tile(t, (len(eta), 1)), omega).reshape(eta.shape)
    np.testing.assert_allclose(np.log(values), eta, atol=1e-9)
    assert np.isfinite(simulator.run(32, random_state=0).y).all()
    # and it can be modified once more under names that are free
    second_fall = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        effects=(hs.DynamicTerm("i", "proportional"),),
        likelihood="lognormal",
        n_draws=100,
        random_state=0,
    )
    assert "rate" in second_fall.fit(*hidden_fall()).posterior_.estimates(0)


def test_extension_changes_the_dynamics_before_the_output():
    t, y = hidden_fall()
    fall = hs.DynamicDrift("contact_rate", "step")
    model = hs.PowerScaledSurrogate(
        make_epidemic(max_step=1.0),
        surrogate=hs.ExactSurrogate(),
        effects=(hs.Gain(), fall),
        likelihood="lognormal",
        n_draws=50,
        random_state=0,
    ).fit(t, y)
    posterior = model.posterior_
    problem = prepare(model, ()).problem
    extended = extended_simulator(model.simulation.simulator, posterior.model.effects, problem)
    assert list(extended.parameters) == [
        "contact_rate",
        "contact_rate_step_amount",
        "contact_rate_step_location",
        "log_gain",
    ]
    # on a logarithmic scale a gain is a column
    values = [*posterior.values[0], *posterior.effect_coefficients[0]]
    np.testing.assert_allclose(
        np.log(extended(t, np.tile(values, (len(t), 1)))), posterior.eta(t)[0][0], atol=1e-9
    )


def test_an_initial_state_does_not_drift_in_time():
    def decay(time, state, rate):
        return -rate * state

    simulator = hs.OdeSimulator(
        decay,
        initial_state=lambda start, rate, both: [start + rate + both],
        observe=lambda state, scale, both: scale * state[0] + both,
        inputs={"t": (0, 4)},
        parameters=dict.fromkeys(("start", "rate", "scale", "both"), stats.uniform(0.5, 1)),
        states="n",
    )
    assert simulator.starts == ("start",)
    changed = simulator.modified(
        [TimeVaryingParameter("rate", "step")], {"rate_step_amount": stats.norm(0, 1)}
    )
    assert changed.starts == ("start",)
    X = pd.DataFrame({"t": np.linspace(0.2, 4, 20), "day": np.tile([0.0, 1.0], 10)})
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=50, random_state=0
    )
    prepared = prepare(model.fit(X, np.exp(-X["t"])), ())
    drifts = [cause for cause in prepared.causes if isinstance(cause, hs.ParameterDrift)]
    # on another day it may be another start, and two days are enough to tell
    assert {cause.column for cause in drifts if cause.parameter == "start"} == {"day"}
    assert {cause.column for cause in drifts if cause.parameter == "scale"} == {"t", "day"}
    assert ("start", "over t: it sets the initial state and nothing else") in {
        (skipped.target, skipped.reason) for skipped in prepared.skipped
    }


@pytest.mark.slow
def test_catalogue_says_why_the_dynamics_are_not_weighed():
    t, y = hidden_fall(n=12)
    model = hs.PowerScaledSurrogate(
        make_epidemic(max_step=0.5).run(64, random_state=0),
        likelihood="lognormal",
        n_draws=100,
        random_state=0,
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, n_replicates=20, random_state=0)
    # few runs, and a polynomial that cannot follow them
    with pytest.warns(hs.HybridSurrogateWarning) as told:
        diagnosis.fit(t, y)
    assert any("the runs leave the simulation open" in str(warning.message) for warning in told)
    notes = diagnosis.causes_.set_index("kind")["note"]
    assert "needs an OdeSimulator" in notes["missing-term"]


@pytest.mark.slow
def test_one_curve_by_two_terms_is_told_as_such():
    """A fall at constant acceleration: a loss of speed and one of the path are the same curve."""
    drag, t = 0.25, np.linspace(0.05, 2, 25)
    path = 9.81 / drag * t - 9.81 / drag**2 * (1 - np.exp(-drag * t))
    simulator = hs.OdeSimulator(
        lambda t, state, g: np.stack([state[1], g + 0 * state[1]]),
        initial_state=[0.0, 0.0],
        observe=lambda state: state[0],
        inputs={"t": (0, 3)},
        states=("fallen", "speed"),
        parameters={"g": hs.truncated_normal(9.81, 0.05, 9.5, 10.1)},
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
    with pytest.warns(hs.ConfoundingWarning):
        diagnosis.fit(t[:, None], path + 0.05 * np.random.default_rng(6).standard_normal(25))
    assert diagnosis.best_cause_.kind == "missing-term"
    assert diagnosis.best_cause_.probability > 0.9
    text = " ".join(str(diagnosis.report(full=True)).split())
    table = diagnosis.causes_.query("form == 'missing-term: proportional'")
    first, second = table["probability"].iloc[:2]
    assert first == pytest.approx(second, rel=1e-3)
    assert re.search("has (3|4). % of the probability, its kind in all its forms 9", text)
    # of two that are equal either may come first; a power says the same with a number more
    one = r"missing-term of (speed|fallen) \(proportional\)"
    told = "The data do not separate these forms of the same kind"
    assert re.search(rf"{told}: {one}, {one} and missing-term of \w+ \(power\)\.", text)
    assert re.search(rf"Check {one}, {one} and missing-term of \w+ \(power\) where", text)


@pytest.mark.slow
def test_growth_that_slows_down_by_itself_is_crowding():
    """Verhulst's logistic growth, simulated without its limit: ten times too large at the end."""
    random = np.random.default_rng(71)
    t, rate, most = np.sort(random.uniform(0.2, 12, 40)), 0.5, random.uniform(12, 40)
    size = most / (1 + (most - 1) * np.exp(-rate * t))
    simulator = hs.OdeSimulator(
        lambda t, state, rate: rate * state,
        initial_state=[1.0],
        observe=lambda state: state[0],
        inputs={"t": (0, 12)},
        states=("size",),
        parameters={"rate": hs.truncated_normal(0.5, 0.1, 0.1, 1)},
    )
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    curves = ("periodic", "bump", "episode", "step", "ramp", "decay", "saturation", "noise")
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, exclude=curves, random_state=0)
    diagnosis.fit(t[:, None], size + 0.02 * most * random.normal(size=40))
    assert diagnosis.verdict_ == "named"
    best = diagnosis.best_cause_
    assert (best.kind, best.target) == ("missing-term", "size")
    _, low, high = best.estimates["exponent"]
    assert low < 2 < high


def _growth(**settings):
    return hs.OdeSimulator(
        lambda t, state, rate: rate * state * (1 - state),
        initial_state=[0.1],
        observe=lambda state: state[0],
        inputs={"t": (0, 20)},
        parameters={"rate": hs.truncated_normal(0.6, 0.2, 0, 2)},
        states="n",
        **settings,
    )


def _tank():
    return hs.OdeSimulator(
        lambda t, state, rate: 2 - rate * state,
        initial_state=[8.0],
        observe=lambda state: state[0],
        inputs={"t": (0, 20)},
        parameters={"rate": hs.truncated_normal(0.5, 0.1, 0, 1)},
        states="level",
    )


def _reservoir():
    """A basin that a tide fills; it may flow over."""
    return hs.OdeSimulator(
        lambda t, state, rate, tide: 3 + tide * np.sin(t) - rate * state,
        initial_state=[4.0],
        observe=lambda state: state[0],
        inputs={"t": (0, 20)},
        parameters={
            "rate": hs.truncated_normal(0.5, 0.1, 0.1, 1),
            "tide": hs.truncated_normal(3, 0.4, 1, 5),
        },
        states="level",
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("simulator", "change", "numbers", "noise", "form", "estimates"),
    [
        (
            _growth(),
            DelayedState("n"),
            [0.7, 1.2],
            0.03,
            "delay: inside the dynamics",
            {"lag": 1.2},
        ),
        (
            *(_tank(), MissingTerm("level", "seasonal"), [0.5, 0.3, 0.2, 6.0], 0.08),
            *("missing-term: seasonal", {"period": 6.0, "amplitude": np.hypot(0.3, 0.2)}),
        ),
        (
            *(_reservoir(), MissingTerm("level", "threshold"), [0.5, 3.0, -1.0, 7.0], 0.15),
            *("missing-term: threshold", {"rate": -1.0, "level": 7.0}),
        ),
    ],
)
def test_diagnosis_finds_what_the_right_hand_side_lacks(
    simulator, change, numbers, noise, form, estimates
):
    kind = form.partition(":")[0]
    t = np.linspace(0.5, 20, 40)
    truth = simulator.modified([change])(t, np.tile(numbers, (40, 1)))
    listed, inside = 0, []
    for seed in (20, 21):
        y = truth + noise * np.random.default_rng(seed).standard_normal(40)
        model = hs.PowerScaledSurrogate(
            simulator, surrogate=hs.ExactSurrogate(), n_draws=400, random_state=seed
        )
        diagnosed = hs.DiscrepancyDiagnosis(model, cv=None, random_state=seed).fit(t[:, None], y)
        listed += kind in diagnosed.indistinguishable_
        assert form in set(diagnosed.causes_["form"])
        found = diagnosed.best_cause_
        if found.kind == kind:
            inside += [
                found.estimates[k][1] < v < found.estimates[k][2] for k, v in estimates.items()
            ]
            assert isinstance(diagnosed.extended_simulator_, hs.OdeSimulator)
            assert change.state in found.formula
    # sets and intervals hold the truth in 90 %
    assert listed >= 1
    assert np.mean(inside) >= 0.5


@pytest.mark.slow
def test_a_delay_inside_the_dynamics_is_skipped_where_the_solver_forgets():
    t = np.linspace(0.5, 20, 12)
    model = hs.PowerScaledSurrogate(
        _growth(method="RK45"), surrogate=hs.ExactSurrogate(), n_draws=50, random_state=0
    )
    prepared = prepare(
        model.fit(t[:, None], 1 / (1 + 9 * np.exp(-0.6 * t)) + 0.01 * np.cos(9 * t)), ()
    )
    reasons = {one.reason for one in prepared.skipped if one.target == "n"}
    assert reasons == {"inside the dynamics: needs an OdeSimulator with method='rk4'"}


@pytest.mark.slow
def test_a_term_that_lets_solutions_run_away_is_weighed():
    # of a growth that overshoots; any loss beyond its start drives it to minus infinity
    simulator = _growth(max_step=0.2)
    t = np.linspace(0.5, 20, 40)
    truth = simulator.modified([DelayedState("n")])(t, np.tile([0.7, 1.2], (40, 1)))
    y = truth + 0.015 * np.random.default_rng(0).standard_normal(40)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=200, random_state=0
    )
    causes = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(t[:, None], y).causes_
    weighed = causes[causes["kind"] == "missing-term"]
    # at size zero each is the simulation itself
    assert (weighed["log_evidence"] > -3).all()
    assert weighed["note"].str.contains("fails for").any()
