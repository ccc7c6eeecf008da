"""The extended model as Python: what is written, imported, is the extended simulator."""

import importlib
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from epidemic import hidden_fall, make_epidemic, second, sir
from few_kinds import all_but
from problems import make_problem
from scipy import stats
from sklearn.exceptions import NotFittedError
from tide import FRAME, SIMULATOR, context_of

import hybridsurrogate as hs
from hybridsurrogate.catalogue import catalogue
from hybridsurrogate.datasets import load_nile, make_log_sin
from hybridsurrogate.diagnosis.answers.finding import form_of
from hybridsurrogate.diagnosis.source.parts import ExtendedModel, FittedCause
from hybridsurrogate.diagnosis.source.python_code import extended_model, python_source
from hybridsurrogate.effects.base import NOISE_SD
from hybridsurrogate.effects.registry import FORMS, kinds
from hybridsurrogate.likelihoods import Binomial, as_likelihood

ROOT = Path(__file__).parents[3]
SIGMA = 0.3
T = np.linspace(0, 60, 31)
TIMES = pd.DataFrame({"t": T})


def imported(source):
    """Return the names in a module of this source."""
    module = {}
    exec(compile(source, "extended.py", "exec"), module)
    return module


def problem_of(frame, simulator, likelihood="normal"):
    X, columns = frame.to_numpy(dtype=float), tuple(frame.columns)
    y = np.linspace(1.0, 2.0, len(frame))
    one = as_likelihood(likelihood)
    return make_problem(simulator, hs.ExactSurrogate(), one, None, (), columns, X, y)


def one_draw(posterior_model, causes, values, coefficients):
    """Return each cause with its numbers in one draw, (1, n) each."""
    out = []
    for k, cause in enumerate(causes):
        theta = {
            name: values[:, posterior_model.n_parameters + j]
            for j, (owner, name) in enumerate(posterior_model.theta_names)
            if owner == k
        }
        if cause.follows_slope:
            theta[NOISE_SD] = np.array([SIGMA])
        own = {
            name: coefficients[:, j]
            for j, (owner, name) in enumerate(posterior_model.column_names)
            if owner == k
        }
        out.append(FittedCause(cause, theta, own))
    return out


def written(
    causes, frame=FRAME, simulator=SIMULATOR, likelihood="normal", expected=True, **changes
):
    """Return a module of causes at random numbers, and what the fitted model gives there."""
    rng = np.random.default_rng(0)
    problem = problem_of(frame, simulator, likelihood)
    model = problem.model.with_effects(causes)
    values = model.values(0.5 * rng.standard_normal((1, model.n_unknowns)))
    coefficients = rng.standard_normal((1, len(model.column_sd)))
    sizes = simulator.typical_states(frame.to_numpy(dtype=float)).values()
    extended = ExtendedModel(
        name=simulator.name,
        inputs=simulator.input_names,
        outputs=simulator.outputs,
        parameters={name: values[:, j] for j, name in enumerate(model.parameters)},
        assumed={name: constant.value for name, constant in simulator.assumed.items()},
        causes=one_draw(model, causes, values, coefficients),
        likelihood=problem.likelihood,
        sigma={name: np.array([SIGMA]) for name in simulator.outputs},
        simulator=simulator,
        sizes=tuple(sizes),
    )
    source = python_source(replace(extended, **changes))
    if not expected:
        return source, None
    parts = model.parts(problem.X, values)
    eta = parts.known[0]
    if parts.columns.shape[-1] and any(c.changes_output for c in causes):
        eta = eta + parts.columns[0] @ coefficients[0]
    return source, problem.likelihood.inverse(eta)


def run(source, *functions, frame=FRAME, **numbers):
    extended = imported(source)["extended"]
    names = extended.__code__.co_varnames[: extended.__code__.co_argcount]
    rows = {name: frame[name].to_numpy() for name in names if name in frame}
    return extended(*functions, **rows, **numbers)


def cases(context):
    """Return one cause of each form of the catalogue, over another column where there are more."""
    forms = {form_of(one).partition(" over")[0]: one for one in catalogue(context)[0]}
    return [pytest.param(one, id=f"{one.name} {form}") for form, one in forms.items()]


def tolerance(cause, expected):
    # tables of curves are interpolated
    rtol = 1e-3 if cause.code() is not None and cause.code().tables else 1e-6
    return {"rtol": rtol, "atol": 1e-9 * np.abs(expected).max()}


@pytest.mark.parametrize("cause", cases(context_of()))
def test_each_cause_of_the_catalogue(cause):
    source, expected = written([cause])
    found = run(source, SIMULATOR.function)
    np.testing.assert_allclose(found, expected, **tolerance(cause, expected))


@pytest.mark.parametrize("cause", cases(context_of(likelihood="lognormal")))
def test_each_cause_on_a_logarithmic_scale(cause):
    source, expected = written([cause], likelihood="lognormal")
    found = run(source, SIMULATOR.function)
    np.testing.assert_allclose(found, expected, **tolerance(cause, expected))


def test_every_form_is_written():
    """None takes the cause itself, which is for causes of the user's own."""
    for form in FORMS.values():
        assert any("code" in vars(one) for one in form.cause.__mro__[: -len(hs.Cause.__mro__)])


COMBINATIONS = {
    "delay, drift": (hs.Delay("t"), hs.ParameterDrift("height", "t", shape="step")),
    "drift, delay": (hs.ParameterDrift("height", "t", shape="step"), hs.Delay("t")),
    "trend, gain, delay": (hs.Trend("t"), hs.Gain(), hs.Delay("t")),
    "three waves": (hs.Periodic("t"), hs.Periodic("dose"), hs.Periodic("wind")),
    "constant, limit, noise": (hs.WrongConstant("floor"), hs.Limit(), hs.Noise("t")),
    "slopes": (
        hs.MissingInput("wind"),
        hs.MissingInput("batch"),
        hs.ParameterDrift("rate", "wind"),
    ),
}


@pytest.mark.parametrize("effects", COMBINATIONS.values(), ids=COMBINATIONS)
def test_several_causes_at_once(effects):
    causes = [cause.prepare(context_of()) for cause in effects]
    source, expected = written(causes)
    np.testing.assert_allclose(run(source, SIMULATOR.function), expected, rtol=1e-9)


@pytest.mark.parametrize(
    "cause", [hs.Friction("gust"), hs.NarrowPrior("height")], ids=lambda cause: cause.name
)
def test_what_these_data_do_not_bring_forth(cause):
    frame = FRAME.assign(gust=FRAME["wind"] - 2)
    source, expected = written([cause.prepare(context_of(frame))], frame)
    np.testing.assert_allclose(run(source, SIMULATOR.function, frame=frame), expected, rtol=1e-9)


def test_counts_scatter_more():
    cause = hs.effects.Overdispersion().prepare(context_of(likelihood="poisson"))
    source, expected = written([cause], likelihood="poisson")
    np.testing.assert_allclose(run(source, SIMULATOR.function), expected, rtol=1e-9)
    # the variance of a negative binomial
    variance = imported(source)["noise_variance"](mean=np.array([4.0, 10.0]), scatter=0.5)
    np.testing.assert_allclose(variance, [4 + 0.25 * 16, 10 + 0.25 * 100])


def test_successes_scatter_more():
    cause = hs.effects.Overdispersion().prepare(context_of(likelihood=hs.Binomial(20)))
    source, _ = written([cause], likelihood=hs.Binomial(20))
    # the variance of a beta-binomial of sigma 0.5, at a share of a half and of a fifth
    variance = imported(source)["noise_variance"](mean=np.array([10.0, 4.0]), scatter=0.5)
    np.testing.assert_allclose(variance, np.array([5.0, 3.2]) * (1 + 19 * 0.2))


def test_parameters_and_numbers_are_arguments():
    cause = hs.Periodic("t").prepare(context_of())
    source, _ = written([cause])
    numbers = {"height": 2.5, "rate": 0.3, "period": 3.0, "amplitude": 0.7, "peak": 1.0}
    found = run(source, SIMULATOR.function, **numbers)
    t, dose = FRAME["t"].to_numpy(), FRAME["dose"].to_numpy()
    plain = SIMULATOR.function(t, dose, 2.5, 0.3, 10.0)
    np.testing.assert_allclose(found, plain + 0.7 * np.cos(2 * np.pi * (t - 1) / 3), rtol=1e-12)
    # and numbers that differ between rows
    found = run(source, SIMULATOR.function, **numbers | {"rate": np.linspace(0.1, 0.9, len(t))})
    assert found.shape == t.shape


# ------------------------------------------------------------------------------ ways to scatter


@pytest.mark.parametrize(
    "cause",
    [hs.Noise("t"), hs.NoiseAtLevel("batch", 3.0), hs.NoiseOfMean()],
    ids=lambda cause: cause.name,
)
def test_noise_is_a_function(cause):
    cause = cause.prepare(context_of())
    source, _ = written([cause])
    module = imported(source)
    arguments = module["noise_sd"].__code__.co_varnames
    simulated = run(source, SIMULATOR.function)
    known = {name: FRAME[name].to_numpy() for name in FRAME if name in arguments[:2]}
    known |= {"simulated": simulated} if "simulated" in arguments else {}
    found = module["noise_sd"](**known)
    (theta,) = [{k: np.repeat(v, len(FRAME)) for k, v in one.theta.items()} for one in draws(cause)]
    X = {name: FRAME[name].to_numpy() for name in FRAME} | {"simulated output": simulated}
    np.testing.assert_allclose(found, SIGMA * cause.noise(X, theta), rtol=1e-6)
    assert "not in the simulation" in module["__doc__"].replace("\n", " ")


def draws(cause):
    rng = np.random.default_rng(0)
    model = problem_of(FRAME, SIMULATOR).model.with_effects([cause])
    values = model.values(0.5 * rng.standard_normal((1, model.n_unknowns)))
    return one_draw(model, [cause], values, np.empty((1, 0)))


def test_wide_tails_are_drawn():
    source, _ = written([hs.Outliers().prepare(context_of())])
    rng = np.random.default_rng(1)
    found = imported(source)["noise_draws"](rng, 2_000_000, share=0.1, sigma=2.0)
    # nine tenths of variance one, and outliers of 3 to 30 times the sd, log-uniform; the standard
    # error is 0.6 %
    variance = 0.9 + 0.1 * (30**2 - 3**2) / (2 * np.log(10))
    assert np.var(found) == pytest.approx(4 * variance, rel=0.03)


# ---------------------------------------------------------------------------- other likelihoods


def test_log_odds():
    simulator = hs.Simulator(
        lambda t, rate: 20 / (1 + np.exp(-rate * t)),
        {"t": (-3, 3)},
        {"rate": stats.uniform(0.3, 1)},
        output="alive",
    )
    frame = pd.DataFrame({"t": np.linspace(-3, 3, 30)})
    cause = hs.Step("t").prepare(context_of(frame, simulator, Binomial(20)))
    source, expected = written([cause], frame, simulator, Binomial(20))
    np.testing.assert_allclose(run(source, simulator.function, frame=frame), expected, rtol=1e-9)
    assert "log odds" in source


class OwnLink(hs.likelihoods.Normal):
    def link(self, output):
        return output**3


def test_a_link_of_the_users_own_is_refused():
    with pytest.raises(ValueError, match="link that is not written as Python"):
        written([hs.Offset()], likelihood=OwnLink())


# ------------------------------------------------------------------------------------- dynamics


def in_the_dynamics():
    context = context_of(TIMES, make_epidemic(max_step=0.5))
    known = {form_of(c): c for c in catalogue(context)[0] if c.modification is not None}
    causes = known.values()
    shapes = [hs.DynamicDrift("contact_rate", shape) for shape in ("step", "ramp")]
    return [*causes, *(cause.prepare(context) for cause in shapes)]


@pytest.mark.parametrize("cause", in_the_dynamics(), ids=lambda cause: cause.name)
def test_each_change_of_the_dynamics(cause):
    simulator = make_epidemic(max_step=0.1)
    # what is typical is often fatal: small numbers
    source, expected = written([cause], TIMES, simulator)
    found = run(source, sir, second, frame=TIMES)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("likelihood", ["normal", "lognormal"])
def test_causes_in_and_outside_the_dynamics(likelihood):
    simulator = make_epidemic(max_step=0.1)
    context = context_of(TIMES, simulator, likelihood)
    effects = (
        hs.DynamicDrift("contact_rate"),
        hs.DynamicTerm("i", "proportional"),
        hs.WrongConstant("recovery_rate"),
        hs.Gain(),
        hs.Delay("t"),
    )
    causes = [cause.prepare(context) for cause in effects]
    source, expected = written(causes, TIMES, simulator, likelihood)
    found = run(source, sir, second, frame=TIMES)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-7)


# -------------------------------------------------------------------------- hostile and unusual

HOSTILE = 'wind """speed\\n\n(m/s)'


def test_names_that_are_no_identifiers():
    frame = FRAME.rename(columns={"wind": HOSTILE, "batch": "class"}).assign(**{"2nd": FRAME["t"]})
    context = context_of(frame)
    effects = (
        hs.MissingInput(HOSTILE),
        hs.MissingInput("class", shape="categorical"),
        hs.Periodic("2nd"),
    )
    causes = [cause.prepare(context) for cause in effects]
    about = [f"{HOSTILE}: '''a''' \\", 'ends with "']
    units = {HOSTILE: 'm/s """ \n # \\', "level": "m"}
    source, expected = written(causes, frame, about=about, units=units)
    rows = [frame[name].to_numpy() for name in ("t", "dose", HOSTILE, "class", "2nd")]
    found = imported(source)["extended"](SIMULATOR.function, *rows)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_names_of_arguments_that_are_no_identifiers():
    def fall(**given):
        return given["wind speed"] * given["np"] + given["lambda"]

    simulator = hs.Simulator(
        fall,
        {"wind speed": (0, 5), "np": (0, 3)},
        {"lambda": stats.norm(1, 0.1)},
        output="my output",
    )
    frame = pd.DataFrame({"wind speed": np.linspace(0, 5, 30), "np": np.linspace(3, 0, 30) ** 2})
    cause = hs.Trend("np").prepare(context_of(frame, simulator))
    source, expected = written([cause], frame, simulator)
    found = imported(source)["extended"](fall, frame["wind speed"], frame["np"])
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_names_that_python_reads_alike():
    micro, greek = "\u00b5", "\u03bc"
    frame = FRAME.assign(**{micro: FRAME["wind"], greek: FRAME["batch"]})
    effects = (hs.MissingInput(micro), hs.MissingInput(greek))
    causes = [cause.prepare(context_of(frame)) for cause in effects]
    source, expected = written(causes, frame)
    rows = [frame[name].to_numpy() for name in ("t", "dose", micro, greek)]
    found = imported(source)["extended"](SIMULATOR.function, *rows)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_simulation_of_one_run_at_a_time():
    def one(t, rate):
        return rate * t if t > 3 else 0.0

    simulator = hs.Simulator(one, {"t": (0, 9)}, {"rate": stats.norm(1, 0.1)}, vectorized=False)
    frame = pd.DataFrame({"t": np.linspace(0, 9, 20)})
    cause = hs.Delay("t").prepare(context_of(frame, simulator))
    source, expected = written([cause], frame, simulator)
    np.testing.assert_allclose(run(source, one, frame=frame), expected, rtol=1e-9)


def test_a_simulation_that_returns_a_curve():
    def curve(t, start, rate):
        # looks at all places at once, as a solver does
        return start + rate * np.cumsum(np.ones_like(t)) / len(t) + t

    simulator = hs.Simulator(
        curve,
        {"t": (0, 9), "start": (0, 2)},
        {"rate": stats.norm(1, 0.1)},
        returns="curve",
    )
    frame = pd.DataFrame({"t": np.tile(np.linspace(0, 9, 10), 2), "start": np.repeat([0.5, 1], 10)})
    cause = hs.Offset().prepare(context_of(frame, simulator))
    source, expected = written([cause], frame, simulator)
    np.testing.assert_allclose(run(source, curve, frame=frame), expected, rtol=1e-9)


class Drag(hs.Cause):
    kind = "air-drag"
    target = "t"
    parameters = {"strength": stats.halfnorm(scale=0.5)}
    coefficients = ("amplitude",)

    def columns(self, X, theta):
        return (1 - np.exp(-theta["strength"] * X["t"] ** 3))[:, None]


class Late(hs.Cause):
    kind = "late"
    target = "t"
    parameters = {"lag": stats.norm(0, 0.5)}

    def inputs(self, X, omega, theta):
        return {**X, "t": X["t"] - theta["lag"]}, omega

    def gain(self, X, theta):
        return 1 + theta["lag"] ** 2


class Weaker(hs.Cause):
    kind = "weaker"
    parameters = {"level": stats.norm(0.5, 0.1)}

    def response(self, simulated, X, theta):
        return simulated**2 * theta["level"], 2 * simulated * theta["level"]


class SteepTrend(hs.Trend):
    def columns(self, X, theta):
        return 3 * super().columns(X, theta)


@pytest.mark.parametrize(
    "cause", [Drag(), Late(), Weaker(), SteepTrend("t")], ids=lambda cause: type(cause).__name__
)
def test_a_cause_of_the_users_own_is_an_argument(cause):
    cause = cause.prepare(context_of())
    source, expected = written([cause])
    found = run(source, SIMULATOR.function, cause)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert type(cause).__name__ in source


def test_an_earlier_change_of_the_dynamics_is_kept():
    """An extended simulation is diagnosed again: its numbers are parameters by then."""
    context = context_of(TIMES, make_epidemic(max_step=0.1))
    change = hs.DynamicTerm("i", "saturating").prepare(context)
    priors = {change.modification.full(k): v for k, v in change.parameters.items()}
    simulator = make_epidemic(max_step=0.1).modified([change.modification], priors)
    cause = hs.DynamicDrift("contact_rate", "exponential").prepare(context_of(TIMES, simulator))
    source, expected = written([cause], TIMES, simulator)
    found = run(source, sir, second, frame=TIMES)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-7)


def test_nothing_found_is_the_simulation():
    source, expected = written([])
    np.testing.assert_allclose(run(source, SIMULATOR.function), expected, rtol=1e-12)


# ------------------------------------------------------------------------------------ clean code


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder of modules: each form, in the dynamics too, and several causes at once."""
    folder = tmp_path_factory.mktemp("written")
    sets = [list(one.values) for one in cases(context_of())]
    sets += [[cause.prepare(context_of()) for cause in some] for some in COMBINATIONS.values()]
    for k, causes in enumerate(sets):
        source, _ = written(causes, expected=False)
        (folder / f"plain_{k}.py").write_text(source, encoding="utf-8")
    for k, cause in enumerate(in_the_dynamics()):
        source, _ = written([cause], TIMES, make_epidemic(max_step=1.0), expected=False)
        (folder / f"ode_{k}.py").write_text(source, encoding="utf-8")
    return folder


def test_numpy_is_all_that_is_needed(folder):
    """And scipy where an ODE is solved or a surface is interpolated."""
    lines = [line for f in folder.iterdir() for line in f.read_text("utf-8").splitlines()]
    assert {line for line in lines if re.match(r"(from|import) ", line)} == {
        "import numpy as np",
        "from scipy.integrate import solve_ivp",
        "from scipy.interpolate import RectBivariateSpline",
    }


@pytest.mark.parametrize("what", ["check", "format"])
def test_what_is_written_is_clean(folder, what):
    pytest.importorskip("ruff")
    config = ["--config", str(ROOT / "pyproject.toml"), "--no-cache"]
    options = {
        "check": ["--ignore", "D100,INP"],
        "format": ["--check", "--diff", "--line-length", "88"],
    }
    ran = subprocess.run(
        [sys.executable, "-m", "ruff", what, *config, *options[what], str(folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr


# --------------------------------------------------------------------------------------- fits


def of_one_draw(model, X, y):
    """Return a fit of few draws as a diagnosis has it, with one draw left, and that draw's eta."""
    fitted = model.fit(X, y)
    fitted.posterior_ = fitted.posterior_.take(np.array([3]))
    result = SimpleNamespace(
        before=fitted,
        extension=SimpleNamespace(estimator=fitted, found_causes=()),
        conclusion=SimpleNamespace(verdict="named", probability_right=None),
        settings=SimpleNamespace(random_state=0),
    )
    eta, _ = fitted.posterior_.eta(fitted.checked_rows(X))
    return python_source(extended_model(result)), fitted, eta


def surrogate(simulator, **options):
    exact = hs.ExactSurrogate()
    options = {"n_draws": 20, "sampler": "importance", "random_state": 0, **options}
    return hs.PowerScaledSurrogate(simulator, surrogate=exact, **options)


def level_and_flow(t, a, k):
    level = a * np.exp(-k * t)
    return level, 30 * k * level


ASSUMED = {"k": hs.Assumed(0.3, stats.norm(0.3, 0.1))}


def as_dict(t, a, k):
    level, flow = level_and_flow(t, a, k)
    return {"q": flow, "unused": flow, "h": level}


@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.SamplingWarning")
@pytest.mark.parametrize(
    "effects",
    [
        [hs.InOutput(hs.Periodic("t"), "q")],
        [hs.InOutput(hs.Gain(), "h"), hs.InOutput(hs.Trend("t"), "q")],
        [hs.InOutput(hs.SensorResponse(), "q")],
        [hs.InOutput(hs.Limit(), "q"), hs.Delay("t")],
        [hs.ParameterDrift("k", "t", shape="logistic")],
        [hs.InOutput(hs.GaussianProcessDiscrepancy(), "q")],
        [hs.InOutput(hs.Noise("t"), "q")],
        [hs.InOutput(Drag(), "q")],
        [hs.InOutput(Weaker(), "q")],
    ],
    ids=str,
)
@pytest.mark.parametrize("function", [level_and_flow, as_dict])
def test_several_outputs(effects, function):
    priors = {"a": hs.truncated_normal(2, 0.5, 0.5, 4), "k": hs.truncated_normal(0.3, 0.1, 0, 0.8)}
    simulator = hs.Simulator(function, {"t": (0, 10)}, priors, output=("h", "q"))
    t = np.linspace(0, 10, 40)
    Y = np.column_stack(level_and_flow(t, 2.0, 0.25)) + 0.1 * np.cos(9 * t)[:, None]
    source, fitted, eta = of_one_draw(surrogate(simulator, effects=effects), t[:, None], Y)
    own = [one.cause for one in effects if isinstance(one, hs.InOutput)][:1]
    own = [cause for cause in own if "code" not in vars(type(cause))]
    found = imported(source)["extended"](function, *own, t)
    expected = fitted.data_.stacking.back(eta)[0]
    curve = effects[0].kind == "unexplained"
    together = np.column_stack([found["h"], found["q"]])
    np.testing.assert_allclose(together, expected, rtol=1e-6, atol=1e-3 if curve else 1e-9)


@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.SamplingWarning")
@pytest.mark.parametrize("how", ["spread", "own"])
def test_experiments_keep_their_names(how):
    simulator = hs.Simulator(
        lambda t, rate, start: start * np.exp(-rate * t),
        {"t": (0, 5)},
        {"rate": hs.truncated_normal(1, 0.5, 0.1, 3), "start": stats.norm(5, 1)},
    )
    t = np.tile(np.linspace(0, 5, 10), 3)
    frame = pd.DataFrame({"t": t, "batch": np.repeat(["A", "B", "C 3"], 10)})
    y = 5 * np.exp(-t * np.repeat([0.7, 1.0, 1.4], 10)) + 0.05 * np.cos(30 * t)
    model = surrogate(
        simulator,
        effects=[hs.MissingInput("batch", shape="categorical", level=1.0), hs.Trend("t")],
        experiment="batch",
        by_experiment={"rate": how},
    )
    source, _, eta = of_one_draw(model, frame, y)
    extended = imported(source)["extended"]
    found = extended(simulator.function, frame["t"], frame["batch"])
    np.testing.assert_allclose(found, eta[0], rtol=1e-6)
    assert '"C 3": ' in source
    # one that was not measured is as all together
    assert np.isfinite(extended(simulator.function, t, "D")).all()


def restarted(t, state, rate, source):
    return source - rate * state


def total(state, rate):
    return {"level": state[0], "flow": rate * state[0]}


def beginning(start):
    return {"level": start}


@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.SamplingWarning")
def test_dynamics_of_experiments_with_an_input_and_a_start():
    simulator = hs.OdeSimulator(
        restarted,
        beginning,
        total,
        inputs={"t": (0, 5), "source": (0, 2)},
        parameters={"rate": stats.uniform(0.3, 1), "start": stats.uniform(5, 10)},
        states="level",
        output=("level", "flow"),
        max_step=0.05,
    )
    frame = pd.DataFrame(
        {
            "t": np.tile(np.linspace(0, 5, 12), 2),
            "source": np.repeat([0.5, 1.5], 12),
            "run": np.repeat([1.0, 2.0], 12),
        }
    )
    Y = simulator(frame[["t", "source"]], np.tile([0.7, 8.0], (24, 1)))
    effects = [hs.TermByExperiment("level", "run"), hs.InOutput(hs.Offset(), "flow")]
    model = surrogate(simulator, effects=effects)
    source, fitted, eta = of_one_draw(model, frame, Y + 0.1 * np.cos(9 * Y))
    module = imported(source)
    found = module["extended"](restarted, beginning, total, *frame.to_numpy().T)
    expected = fitted.data_.stacking.back(eta)[0]
    np.testing.assert_allclose(np.column_stack(list(found.values())), expected, rtol=1e-4)


@pytest.fixture(scope="module")
def diagnosed():
    case = make_log_sin(random_state=0)
    model = hs.PowerScaledSurrogate(case.simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    settings = {"exclude": all_but("periodic", "trend"), "cv": None, "n_replicates": 39}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings, random_state=0)
    return case, diagnosis.fit(case.X, case.y)


def test_the_module_of_a_diagnosis(diagnosed):
    case, diagnosis = diagnosed
    source = diagnosis.to_python(units={"x": "s", "y": "kg"})
    module = imported(source)
    x = np.asarray(case.X)[:, 0]
    found = module["extended"](case.simulator.function, x)
    leading = diagnosis.extended_estimator_.estimators_[0]
    # what it gives at the means of the numbers is a probable curve of the fitted model
    low, high = np.quantile(leading.sample_predictive_mean(case.X), [0.05, 0.95], axis=0)
    assert np.all((low < found) & (found < high))
    mean, low, high = diagnosis.best_cause_.estimates["amplitude"]
    assert module["AMPLITUDE"] == pytest.approx(mean, rel=1e-4)
    line = next(line for line in source.splitlines() if line.startswith("AMPLITUDE"))
    assert re.search(r"90 %: (\S+) to (\S+) \[kg\]$", line)
    assert re.search(r"\n    amplitude +\S+ \(\S+ to \S+\) \[kg\]\n", module["__doc__"])
    assert low < mean < high
    for part in (
        f"Verdict: {diagnosis.verdict_}",
        f"hybridsurrogate {hs.__version__}",
        "random_state=0",
        "from hybridsurrogate.datasets.log_sin import logarithmic_growth",
    ):
        assert part in source
    # the report shows it: the same whenever and wherever it is written
    assert source == diagnosis.to_python(units={"x": "s", "y": "kg"})
    assert not re.search(r"""[\s"']/\w|20\d\d-\d\d""", source)


def test_the_extended_simulator_is_the_module(diagnosed):
    case, diagnosis = diagnosed
    module = imported(diagnosis.to_python())
    extended = diagnosis.extended_simulator_
    assert extended.parameter_names == ("omega", "period", "sine", "cosine")
    x = np.random.default_rng(0).uniform(1, 100, 50)
    numbers = [0.9, 70.0, 0.3, -0.4]
    expected = extended(x[:, None], np.tile(numbers, (50, 1)))
    (cause,) = (e for e in diagnosis.extended_estimator_.effects if e.is_learned)
    told = cause.estimates(
        {"period": np.array([70.0])}, {"sine": np.array([0.3]), "cosine": np.array([-0.4])}
    )
    own = {name: float(value[0]) for name, value in told.items()}
    found = module["extended"](case.simulator.function, x, omega=0.9, **own)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_file_is_written_whole(diagnosed, tmp_path, monkeypatch):
    _, diagnosis = diagnosed
    path = tmp_path / "extended.py"
    assert diagnosis.to_python(path) is None
    assert path.read_text(encoding="utf-8") == diagnosis.to_python()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "extended", raising=False)
    assert callable(importlib.import_module("extended").extended)
    with pytest.raises(FileNotFoundError, match=r"the folder .* does not exist"):
        diagnosis.to_python(tmp_path / "nowhere" / "extended.py")
    with pytest.raises(IsADirectoryError, match="is a folder"):
        diagnosis.to_python(tmp_path)
    with pytest.raises(ValueError, match=r"there is no 'co2'; there are x, y, omega"):
        diagnosis.to_python(path, units={"co2": "ppm"})
    with pytest.raises(TypeError, match="units must be a dict of names and units as text"):
        diagnosis.to_python(path, units={"x": 3})
    with pytest.raises(TypeError, match="units must be a dict"):
        diagnosis.to_python(path, units="ppm")
    assert path.read_text(encoding="utf-8") == diagnosis.to_python()
    assert [one.name for one in tmp_path.iterdir() if one.suffix == ".py"] == ["extended.py"]


def test_a_diagnosis_that_is_not_fitted():
    with pytest.raises(NotFittedError):
        hs.DiscrepancyDiagnosis().to_python()


def test_a_diagnosis_from_runs_alone():
    """The module takes the function all the same, wherever it is run."""
    case = make_log_sin(random_state=0)
    runs = case.simulator.run(64, random_state=0)
    data = hs.SimulationData(
        runs.X, runs.omega, runs.y, runs.input_ranges, runs.parameters, output="grown"
    )
    effects = [hs.Periodic("x")]
    model = hs.PowerScaledSurrogate(
        data, beta=0.5, effects=effects, n_draws=50, sampler="importance", random_state=0
    )
    source, fitted, _ = of_one_draw(model, case.X, case.y)
    module = imported(source)
    x = np.asarray(case.X)[:, 0]
    assert fitted.simulation.simulator is None
    found = module["extended"](lambda x, omega: np.zeros_like(x), x)
    # without a simulation what is left is the cause
    periods = {name: module[name.upper()] for name in ("period", "amplitude", "peak")}
    wave = periods["amplitude"] * np.cos(2 * np.pi * (x - periods["peak"]) / periods["period"])
    np.testing.assert_allclose(found, wave, rtol=1e-12)
    added = fitted.posterior_.model.added(fitted.checked_rows(case.X), fitted.posterior_.values)
    np.testing.assert_allclose(wave, added[0] @ fitted.posterior_.effect_coefficients[0], rtol=1e-6)


def test_the_dam_on_the_nile():
    """A step in the flow of the Nile, where the simulation is a constant."""
    case = load_nile()
    simulator = case.simulator
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    settings = {"exclude": all_but("step", "trend"), "cv": None, "n_replicates": 39}
    diagnosis = hs.DiscrepancyDiagnosis(model, **settings, random_state=0)
    diagnosis.fit(case.data, case.target)
    module = imported(diagnosis.to_python())
    assert diagnosis.best_cause_.kind == "step"
    found = module["extended"](simulator.function, *case.data.to_numpy().T)
    leading = diagnosis.extended_estimator_.estimators_[0]
    low, high = np.quantile(leading.sample_predictive_mean(case.data), [0.01, 0.99], axis=0)
    # next to the jump some draws are on the other side of it
    assert np.mean((low <= found) & (found <= high)) > 0.95


def test_an_epidemic_whose_contact_rate_falls():
    t, y = hidden_fall()
    model = hs.PowerScaledSurrogate(
        make_epidemic(max_step=1.0),
        surrogate=hs.ExactSurrogate(),
        likelihood="lognormal",
        n_draws=200,
        random_state=0,
    )
    # for time: what is written of the cause is tested, not the search for it
    others = [kind for kind in kinds() if kind not in ("parameter-drift", "offset")]
    diagnosis = hs.DiscrepancyDiagnosis(
        model, exclude=others, cv=None, n_replicates=50, random_state=0
    ).fit(t, y)
    source = diagnosis.to_python()
    assert "contact_rate = contact_rate * parameter_drift(t, " in source
    found = imported(source)["extended"](sir, second, t[:, 0])
    leading = diagnosis.extended_estimator_.estimators_[0]
    low, high = np.quantile(leading.sample_predictive_mean(t), [0.01, 0.99], axis=0)
    assert np.all((low <= found) & (found <= high))


@pytest.mark.filterwarnings("ignore::hybridsurrogate.exceptions.SamplingWarning")
def test_a_function_that_returns_its_output_in_a_dict():
    simulator = hs.Simulator(as_dict, {"t": (0, 10)}, {"a": stats.norm(2, 0.5)}, ASSUMED, "h")
    t = np.linspace(0, 10, 30)
    y = level_and_flow(t, 2.1, 0.3)[0] + 0.05 * np.cos(9 * t)
    source, _, eta = of_one_draw(surrogate(simulator, effects=[hs.Offset()]), t[:, None], y)
    np.testing.assert_allclose(imported(source)["extended"](as_dict, t), eta[0], rtol=1e-9)


def stiff(t, state, rate):
    return np.stack([-1000 * rate * (state[0] - np.cos(t)), rate * (state[0] - state[1])])


def test_unseen_stores_come_after_the_states():
    simulator = hs.OdeSimulator(
        stiff,
        {"fast": 0.0, "slow": 1.0},
        second,
        inputs={"t": (0, 5)},
        parameters={"rate": stats.uniform(0.01, 0.02)},
        states=("fast", "slow"),
    )
    frame = pd.DataFrame({"t": np.linspace(0, 5, 12)})
    context = context_of(frame, simulator)
    causes = [hs.DynamicStore("slow"), hs.DynamicTerm("fast"), hs.DynamicStore("fast", "other")]
    source, expected = written([one.prepare(context) for one in causes], frame, simulator)
    found = run(source, stiff, second, frame=frame)
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def room(t, state, resistance, heat, uptake):
    air, paper = state
    taken = uptake * (air - paper)
    return [heat * np.sin(t) ** 2 + (10 - air) / resistance - taken, 0.2 * taken]


def test_the_term_of_a_parameter_acts_on_the_store():
    simulator = hs.OdeSimulator(
        room,
        {"air": 20.0, "paper": 18.0},
        second,
        inputs={"t": (0, 8)},
        parameters={
            "resistance": stats.lognorm(0.1, scale=3),
            "heat": stats.norm(4, 0.1),
            "uptake": stats.lognorm(0.1, scale=0.3),
        },
        states=("air", "paper"),
    )
    frame = pd.DataFrame({"t": np.linspace(0, 8, 12)})
    context = context_of(frame, simulator)
    causes = [
        hs.DynamicStore("air", through="resistance"),
        hs.DynamicTerm("paper"),
        hs.DynamicStore("air", through="uptake"),
        hs.DynamicStore("paper"),
    ]
    source, expected = written([one.prepare(context) for one in causes], frame, simulator)
    assert re.search(r'"resistance",\s+np\.inf', source)
    found = run(source, room, second, frame=frame)
    np.testing.assert_allclose(found, expected, rtol=1e-4)


@pytest.mark.parametrize("method", ["rosenbrock", pytest.param("LSODA", marks=pytest.mark.slow)])
def test_other_solvers(method):
    simulator = hs.OdeSimulator(
        stiff,
        {"fast": 0.0, "slow": 1.0},
        second,
        inputs={"t": (0, 5)},
        parameters={"rate": hs.truncated_normal(1, 0.2, 0.5, 2)},
        states=("fast", "slow"),
        method=method,
    )
    frame = pd.DataFrame({"t": np.linspace(0, 5, 12)})
    cause = hs.DynamicTerm("slow").prepare(context_of(frame, simulator))
    source, expected = written([cause], frame, simulator)
    found = run(source, stiff, second, frame=frame)
    np.testing.assert_allclose(found, expected, rtol=1e-4)
