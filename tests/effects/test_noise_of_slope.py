"""Inputs that are not where they are said to be, parameters that are others in every row."""

import numpy as np
import pytest
from matplotlib.axes import Axes
from problems import make_problem
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.catalogue import catalogue
from hybridsurrogate.effects.picture import plot_cause
from hybridsurrogate.effects.registry import kinds
from hybridsurrogate.likelihoods import Normal
from hybridsurrogate.model.context import make_context, with_slopes


def swing(t, height, decay):
    return 5 + height * np.exp(-decay * t) * np.cos(t)


def swing_over_t(t, height, decay):
    return -height * np.exp(-decay * t) * (decay * np.cos(t) + np.sin(t))


SWING = hs.Simulator(
    swing,
    inputs={"t": (0, 10)},
    parameters={
        "height": hs.truncated_normal(5, 1, 1, 10),
        "decay": hs.truncated_normal(0.2, 0.05, 0.05, 0.5),
    },
)
T = np.linspace(0.1, 8, 40)
SD = 0.1
OTHERS = sorted({*kinds()} - {"input-error", "random-parameter"})


def measured(what, spread, seed, t=T):
    """Return measurements of a swing whose times, or decays, are off by that much."""
    rng = np.random.default_rng(seed)
    off = spread * rng.standard_normal(len(t))
    clean = {
        "t": lambda: swing(t + off, 5.2, 0.2),
        "decay": lambda: swing(t, 5.2, 0.2 + off),
        "nothing": lambda: swing(t, 5.2, 0.2),
    }[what]()
    return clean + SD * rng.standard_normal(len(t))


def problem_of(*effects, simulation=SWING, surrogate=None, t=T):
    y = measured("nothing", 0.0, 0, t)
    surrogate = surrogate or hs.ExactSurrogate()
    return make_problem(
        simulation, surrogate, Normal(), None, effects, ("t",), np.asarray(t)[:, None], y
    )


def fitted(cause, y, simulation=SWING, **options):
    model = hs.PowerScaledSurrogate(
        simulation,
        effects=(cause,),
        random_state=0,
        **{"surrogate": hs.ExactSurrogate(), "n_draws": 200} | options,
    )
    return model.fit(T[:, None], y)


def diagnosed(y, t=T, **options):
    model = hs.PowerScaledSurrogate(SWING, hs.ExactSurrogate(), n_draws=300, random_state=0)
    settings = {"cv": None, "n_replicates": 39, "random_state": 0} | options
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings)
    return diagnosis.fit(t[:, None], y)


# ------------------------------------------------------------------------------------ formulas


@pytest.mark.parametrize("name", ["t", "decay"])
def test_noise_follows_the_slope_of_the_simulation(name):
    cause = (hs.InputError if name == "t" else hs.RandomParameter)(name)
    model = problem_of(cause).model
    values = np.array([[5.2, 0.2, 0.5], [4.0, 0.3, 3.0]])
    noise = model.simulated(T[:, None], values)[2]
    for (height, decay, ratio), row in zip(values, noise, strict=True):
        over = {
            "t": swing_over_t(T, height, decay),
            "decay": -T * (swing(T, height, decay) - 5),
        }[name]
        usual = model.effects[0].usual
        np.testing.assert_allclose(row, np.sqrt(1 + (ratio * over / usual) ** 2), rtol=2e-3)


def test_a_usual_slope_is_that_at_the_medians_of_the_priors():
    usual = problem_of(hs.InputError("t")).model.effects[0].usual
    height, decay = (prior.median() for prior in SWING.parameters.values())
    expected = np.sqrt(np.mean(swing_over_t(T, height, decay) ** 2))
    assert usual == pytest.approx(expected, rel=1e-3)


def test_an_earlier_cause_changes_the_slope():
    causes = hs.Gain(), hs.InputError("t", usual=1.0, step=1.0)
    model = problem_of(*causes).model
    values = np.array([[5.2, 0.2, 2.0, 1.0]])
    noise = model.simulated(T[:, None], values)[2][0]
    np.testing.assert_allclose(noise, np.sqrt(1 + (2 * swing_over_t(T, 5.2, 0.2)) ** 2), rtol=2e-3)


def test_an_emulator_has_slopes_too():
    runs = SWING.run(200, random_state=0)
    for surrogate in (hs.PolynomialChaos(degree=10), hs.Kriging()):
        model = problem_of(hs.InputError("t"), simulation=runs, surrogate=surrogate).model
        unknown = np.zeros((1, len(model.all_priors)))
        values = model.values(unknown)
        values[0, :3] = 5.0, 0.2, 2.0
        noise = model.simulated(T[2:, None], values)[2][0]
        over = swing_over_t(T[2:], 5.0, 0.2) / model.effects[0].usual
        np.testing.assert_allclose(noise, np.sqrt(1 + (2 * over) ** 2), rtol=0.15)


# ---------------------------------------------------------------------------- what is weighed


def test_each_input_parameter_and_constant_is_weighed():
    def offset(t, height, decay, floor):
        return swing(t, height, decay) + floor

    simulator = hs.Simulator(
        offset,
        inputs={"t": (0, 10)},
        parameters=SWING.parameters,
        assumed={"floor": hs.Assumed(0.0, hs.truncated_normal(0, 1, -3, 3))},
    )
    model = hs.PowerScaledSurrogate(simulator, hs.ExactSurrogate(), n_draws=100, random_state=0)
    settings = {"exclude": OTHERS, "cv": None, "n_replicates": 20}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings, random_state=0)
    table = diagnosis.fit(T[:, None], measured("nothing", 0.0, 1)).causes_
    of = table.set_index(["kind", "target"])
    weighed = of["log_evidence"].notna()
    for kind, target in (
        ("input-error", "t"),
        ("random-parameter", "height"),
        ("random-parameter", "decay"),
    ):
        assert weighed[kind, target]
    # a constant that is added counts as much everywhere
    assert not weighed["random-parameter", "floor"]
    assert "everywhere" in of.loc[("random-parameter", "floor"), "note"]


def test_not_with_several_outputs():
    def two(t, height):
        return np.column_stack([height * np.cos(t), height * np.sin(t)])

    simulator = hs.Simulator(
        two,
        inputs={"t": (0, 10)},
        parameters={"height": hs.truncated_normal(5, 1, 1, 10)},
        output=("x", "y"),
    )
    rng = np.random.default_rng(0)
    y = two(T, 5.0) + 0.1 * rng.standard_normal((len(T), 2))
    plain = hs.PowerScaledSurrogate(simulator, hs.ExactSurrogate(), n_draws=100, random_state=0)
    settings = {"exclude": OTHERS, "cv": None, "n_replicates": 20}
    diagnosis = hs.DiscrepancyDiagnosis(plain, **settings, random_state=0)
    table = diagnosis.fit(T[:, None], y).causes_
    table = table[table["kind"].isin(["input-error", "random-parameter"])]
    assert table["log_evidence"].isna().all()
    assert table["note"].str.contains("one output").all()
    with pytest.raises(ValueError, match="one output"):
        plain.set_params(effects=(hs.InputError("t"),)).fit(T[:, None], y)


def test_a_name_that_is_not_there_is_told():
    with pytest.raises(ValueError, match=r"no input or parameter 'tt'; there are \['t'"):
        fitted(hs.InputError("tt"), measured("nothing", 0.0, 0))


# -------------------------------------------------------------------------------------- blind


@pytest.mark.parametrize(
    ("what", "spread", "kind"), [("t", 0.2, "input-error"), ("decay", 0.1, "random-parameter")]
)
def test_what_is_hidden_is_found(what, spread, kind):
    diagnosis = diagnosed(measured(what, spread, 4))
    best = diagnosis.best_cause_
    assert (best.kind, best.target) == (kind, what)
    assert diagnosis.verdict_ in ("named", "nearest", "ambiguous")
    report = str(diagnosis.report(full=True))
    assert what in report
    assert "spread" in report


@pytest.mark.slow
def test_how_far_inputs_are_off_is_covered():
    n_seeds, hits = 12, 0
    for seed in range(n_seeds):
        model = fitted(hs.InputError("t"), measured("t", 0.15, seed), sampler="importance")
        low, high = np.quantile(model.posterior_.estimates(0)["spread"], [0.05, 0.95])
        hits += low < 0.15 < high
    # fewer happens once in a thousand
    assert hits >= stats.binom(n_seeds, 0.9).ppf(0.001)


def test_predictions_know_where_the_simulation_is_steep():
    model = fitted(hs.InputError("t"), measured("t", 0.2, 0, T))
    flat, steep = np.pi, np.pi / 2
    _, sd = model.predict(np.array([[flat], [steep]]), return_std=True)
    slopes = swing_over_t(np.array([flat, steep]), 5.2, 0.2)
    np.testing.assert_allclose(sd, np.hypot(SD, 0.2 * slopes), rtol=0.5)
    assert sd[1] > 2 * sd[0]


def test_pictures_formulas_and_names():
    context = told()
    causes = [c for c in catalogue(context)[0] if c.kind in ("input-error", "random-parameter")]
    assert [cause.name for cause in causes] == [
        "input-error(t)",
        "random-parameter(height)",
        "random-parameter(decay)",
    ]
    for cause in causes:
        assert isinstance(plot_cause(cause, context), Axes)
        assert "0.25" in cause.formula({"spread": 0.25, "ratio": 2.0})
        assert "0.25" in cause.latex({"spread": 0.25, "ratio": 2.0})


def told():
    """Return what causes know of the swing, as a diagnosis would tell it."""
    problem = problem_of()
    context = make_context(SWING, ("t",), 1, T[:, None], 1.0, Normal(), problem.model.basis, 5.0)
    return with_slopes(context, problem.model, T[:, None], np.empty(0), np.array([[5.0, 0.2]]))


def test_labels_are_not_off():
    """Sensors 1 to 3 along an input are names, and none of them is 1.2."""
    sensors = hs.Simulator(
        lambda sensor, height: height * sensor**2,
        inputs={"sensor": (1, 3)},
        parameters={"height": hs.truncated_normal(1, 0.3, 0.1, 3)},
    )
    sensor = np.tile([1.0, 2.0, 3.0], 14)[:, None]
    problem = make_problem(
        sensors, hs.ExactSurrogate(), Normal(), None, (), ("sensor",), sensor, sensor[:, 0]
    )
    context = make_context(sensors, ("sensor",), 1, sensor, 1.0, Normal(), problem.model.basis, 5.0)
    context = with_slopes(context, problem.model, sensor, np.empty(0), np.array([[1.0]]))
    reasons = {one.kind: one.reason for one in catalogue(context)[1]}
    assert "may be labels" in reasons["input-error"]
