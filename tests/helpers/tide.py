"""A simulation of two inputs, measurements of it, and one case of every kind of cause."""

import numpy as np
import pandas as pd
from problems import make_problem
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.model.context import at_medians, make_context, with_slopes
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.surrogates.families.parametric import ExactBasis

NOISE = 0.1


def tide(t, dose, height, rate, floor):
    return floor + height * np.sin(t) + rate * dose**2


SIMULATOR = hs.Simulator(
    tide,
    inputs={"t": (0, 12), "dose": (0, 4)},
    parameters={
        "height": hs.truncated_normal(3, 0.5, 1, 5),
        "rate": hs.truncated_normal(0.5, 0.1, 0.1, 1),
    },
    assumed={"floor": hs.Assumed(10.0, stats.norm(10, 1))},
    output="level",
)


def measured(n=100):
    rng = np.random.default_rng(11)
    return pd.DataFrame(
        {
            "t": np.linspace(0, 12, n),
            "dose": rng.permutation(np.linspace(0, 4, n)),
            "wind": rng.normal(2, 1, n),
            "batch": rng.permutation(np.arange(n) % 4 + 1.0),
        }
    )


FRAME = measured()


def plain(r, **changed):
    return tide(r.t, r.dose, **({"height": 3.2, "rate": 0.45, "floor": 10.0} | changed))


def drifting(shift):
    return lambda r: plain(r, height=3.2 + shift(r))


# cause, what is measured without noise, and the numbers a report should state
CASES = {
    "offset": (hs.Offset(), lambda r: plain(r) + 0.8, {"amplitude": 0.8}),
    "trend": (
        hs.Trend("t"),
        lambda r: plain(r) + 0.3 + 0.15 * (r.t - 6),
        {"level": 0.3, "slope": 0.15},
    ),
    "parabola": (
        hs.Trend("t", degree=2),
        lambda r: plain(r) + 0.3 + 0.1 * (r.t - 6) + 0.04 * (r.t - 6) ** 2,
        {"level": 0.3, "slope": 0.1, "curvature": 0.04},
    ),
    "periodic": (
        hs.Periodic("t"),
        lambda r: plain(r) + 0.5 * np.sin(2 * np.pi * r.t / 2.3 + 1),
        {"period": 2.3, "amplitude": 0.5},
    ),
    "overtone": (
        hs.Periodic("t", harmonics=2),
        lambda r: (
            plain(r) + 0.5 * np.sin(2 * np.pi * r.t / 2.3 + 1) + 0.3 * np.sin(4 * np.pi * r.t / 2.3)
        ),
        {"period": 2.3, "amplitude": 0.5, "overtone": 0.3},
    ),
    "step": (hs.Step("t"), lambda r: plain(r) + 0.6 * (r.t > 7.5), {"amplitude": 0.6}),
    "ramp": (
        hs.Ramp("t"),
        lambda r: plain(r) + 0.3 * np.maximum(r.t - 7, 0),
        {"location": 7.0, "slope": 0.3},
    ),
    "bump": (
        hs.Bump("t"),
        lambda r: plain(r) + 0.9 * np.exp(-0.5 * ((r.t - 4) / 0.7) ** 2),
        {"location": 4.0, "width": 0.7, "amplitude": 0.9},
    ),
    "decay": (
        hs.Decay("t"),
        lambda r: plain(r) + 1.2 * np.exp(-r.t / 2.5),
        {"amplitude": 1.2, "scale": 2.5},
    ),
    "saturation": (
        hs.Saturation("t"),
        lambda r: plain(r) + 1.5 * r.t / (r.t + 2.0),
        {"amplitude": 1.5, "half": 2.0},
    ),
    "gain": (hs.Gain(), lambda r: 1.1 * plain(r), {"gain": 1.1}),
    "wrong-constant": (
        hs.WrongConstant("floor"),
        lambda r: plain(r, floor=10.9),
        {"value": 10.9},
    ),
    "delay": (
        hs.Delay("t"),
        lambda r: tide(r.t - 0.4, r.dose, 3.2, 0.45, 10.0),
        {"lag": 0.4},
    ),
    "drift": (
        hs.ParameterDrift("height", "t"),
        drifting(lambda r: 0.1 * (r.t - 6)),
        {"slope": 0.1},
    ),
    "drift over an extra": (
        hs.ParameterDrift("height", "wind"),
        drifting(lambda r: 0.3 * r.wind),
        {"slope": 0.3},
    ),
    "drift, step": (
        hs.ParameterDrift("height", "t", shape="step"),
        drifting(lambda r: 0.8 * (r.t > 6.95)),
        {"change": 0.8},
    ),
    "drift, logistic": (
        hs.ParameterDrift("height", "t", shape="logistic"),
        drifting(lambda r: 1.5 / (1 + np.exp(-(r.t - 5) / 0.8))),
        {"change": 1.5, "location": 5.0, "width": 0.8},
    ),
    "drift, periodic": (
        hs.ParameterDrift("height", "t", shape="periodic"),
        drifting(lambda r: 0.8 * np.sin(2 * np.pi * r.t / 3.7 + 0.5)),
        {"period": 3.7, "amplitude": 0.8},
    ),
    "missing input": (
        hs.MissingInput("wind"),
        lambda r: plain(r) + 0.2 * (r.wind - FRAME.wind.mean()),
        {"slope": 0.2},
    ),
    "missing input, quadratic": (
        hs.MissingInput("wind", shape="quadratic"),
        lambda r: (
            plain(r) + 0.2 * (r.wind - FRAME.wind.mean()) + 0.1 * (r.wind - FRAME.wind.mean()) ** 2
        ),
        {"slope": 0.2, "curvature": 0.1},
    ),
    "missing input, categorical": (
        hs.MissingInput("batch", shape="categorical"),
        lambda r: plain(r) + r.batch.map({1.0: 0.4, 2.0: -0.1, 3.0: 0.1, 4.0: -0.4}),
        {"level_1": 0.4, "level_2": -0.1, "level_3": 0.1, "level_4": -0.4},
    ),
    "missing input, level": (
        hs.MissingInput("batch", shape="categorical", level=3),
        lambda r: plain(r) + 0.5 * (r.batch == 3),
        {"amplitude": 0.5},
    ),
    "interaction": (
        hs.Interaction("t", "dose"),
        lambda r: plain(r) + 0.1 * (r.t - 6) * (r.dose - 2),
        {"slope": 0.1},
    ),
    "noise": (hs.Noise("t"), plain, {"slope": 0.2, "ratio": np.exp(0.2 * 12)}),
    "trend since the start": (
        hs.TrendSinceStart("t"),
        lambda r: plain(r) + 0.2 * r.t,
        {"slope": 0.2},
    ),
    "episode": (
        hs.Episode("t"),
        lambda r: plain(r) + 0.7 * ((r.t > 3.03) & (r.t < 6.97)),
        {"amplitude": 0.7},
    ),
    "build-up": (
        hs.BuildUp("t"),
        lambda r: plain(r) * (1 - np.exp(-r.t / 1.5)),
        {"scale": 1.5},
    ),
    "loss": (
        hs.Loss("t"),
        lambda r: plain(r) * np.exp(-np.maximum(r.t - 5, 0) / 8),
        {"location": 5.0, "scale": 8.0},
    ),
    "limit": (hs.Limit(), lambda r: np.minimum(plain(r), 14.5), {"limit": 14.5}),
    "limit, below": (
        hs.Limit(below=True),
        lambda r: np.maximum(plain(r), 10.5),
        {"limit": 10.5},
    ),
    "response": (
        hs.SensorResponse(),
        lambda r: 1.0 + 0.7 * plain(r) + 0.03 * plain(r) ** 2,
        {"curvature": 0.03},
    ),
    "episode, factor": (
        hs.Episode("t", factor=True),
        lambda r: plain(r) * np.where((r.t > 3.03) & (r.t < 6.97), 1.06, 1),
        {"factor": 1.06},
    ),
    "drift, exponential": (
        hs.ParameterDrift("height", "t", shape="exponential"),
        lambda r: tide(r.t, r.dose, 3.2 * np.exp(0.05 * (r.t - 6)), 0.45, 10.0),
        {"rate": 0.05},
    ),
}


def context_of(frame=FRAME, simulator=SIMULATOR, likelihood="normal"):
    columns = tuple(frame.columns)
    X = frame.to_numpy(dtype=float)
    n_inputs = len(simulator.input_names)
    basis = ExactBasis(np.empty(0), np.empty(0), simulator)
    normal = as_likelihood(likelihood)
    context = make_context(simulator, columns, n_inputs, X, 1.0, normal, basis, 0.0)
    constants = {name: constant.value for name, constant in simulator.assumed.items()}
    model = MeasuredModel(columns, n_inputs, dict(simulator.parameters), constants, (), 3.0, basis)
    return with_slopes(context, model, X, np.empty(0), at_medians(model))


def problem_of(frame, y, simulator=SIMULATOR):
    X, columns = frame.to_numpy(dtype=float), tuple(frame.columns)
    normal = as_likelihood("normal")
    return make_problem(simulator, hs.ExactSurrogate(), normal, None, (), columns, X, y)


def prepared(name):
    return CASES[name][0].prepare(context_of())
