"""A misspelt name is refused with the one that was probably meant."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import uniform

import hybridsurrogate as hs
from hybridsurrogate.exceptions import did_you_mean

X = pd.DataFrame({"time": np.linspace(0.1, 3.9, 20), "wind": np.arange(20.0)})
Y = X["time"].to_numpy()
PRIOR = {"speed": uniform(0, 3)}


def way(time, speed, gain):
    return gain * speed * time


SIMULATOR = hs.Simulator(
    way, {"time": (0, 4)}, PRIOR, {"gain": hs.Assumed(1.0, uniform(0.5, 1))}, output="distance"
)
TWO = hs.Simulator(
    lambda time, speed: {"distance": speed * time, "height": time}, {"time": (0, 4)}, PRIOR,
    output=["distance", "height"],
)  # fmt: skip
RUNS = pd.DataFrame({"time": np.arange(9.0), "speed": np.arange(9.0) % 4, "distance": 1.0})


def model(**settings):
    return hs.PowerScaledSurrogate(SIMULATOR, surrogate=hs.ExactSurrogate(), **settings)


def diagnosis(**settings):
    return hs.DiscrepancyDiagnosis(model(), **settings)


CALLS = {
    "kind": (lambda: diagnosis(exclude=["delya"]).fit(X, Y), "delay"),
    "input of measured rows": (lambda: model().fit(X.rename(columns={"time": "Time"}), Y), "Time"),
    "column of runs": (
        lambda: hs.SimulationData.from_frame(RUNS, ["tiem"], PRIOR, "distance"),
        "time",
    ),
    "parameter of runs": (
        lambda: hs.SimulationData.from_frame(RUNS, ["time"], {"sped": uniform(0, 3)}, "distance"),
        "speed",
    ),
    "output of runs": (
        lambda: hs.SimulationData.from_frame(RUNS, ["time"], PRIOR, "distanc"),
        "distance",
    ),
    "output of a function": (
        lambda: hs.Simulator(TWO.function, {"time": (0, 4)}, PRIOR, output="hieght")([1.0], [1.0]),
        "height",
    ),
    "output of measured rows": (
        lambda: hs.PowerScaledSurrogate(TWO, surrogate=hs.ExactSurrogate()).fit(
            X, pd.DataFrame({"distance": Y, "hight": Y})
        ),
        "hight",
    ),
    "argument": (lambda: hs.Simulator(way, {"tme": (0, 4)}, PRIOR), "time"),
    "column of a cause": (lambda: model(effects=[hs.Trend("winds")]).fit(X, Y), "wind"),
    "parameter of a cause": (
        lambda: model(effects=[hs.ParameterDrift("spede", "time")]).fit(X, Y),
        "speed",
    ),
    "constant of a cause": (lambda: model(effects=[hs.WrongConstant("gian")]).fit(X, Y), "gain"),
    "parameter by experiment": (
        lambda: model(experiment="wind", by_experiment={"speeds": "own"}).fit(X, Y),
        "speed",
    ),
    "column of experiments": (lambda: model(experiment="wnid").fit(X, Y), "wind"),
    "likelihood": (lambda: model(likelihood="student_t").fit(X, Y), "student-t"),
    "sampler": (lambda: model(sampler="emce").fit(X, Y), "emcee"),
}


@pytest.mark.parametrize("call", CALLS)
def test_the_name_that_was_meant_is_asked_for(call):
    wrong, meant = CALLS[call]
    with pytest.raises((ValueError, TypeError), match=f"Did you mean '{meant}'\\?"):
        wrong()


def test_nothing_is_asked_where_nothing_is_alike():
    with pytest.raises(ValueError, match=r"the kinds are .*[a-z]\.$"):
        diagnosis(exclude=["weather"]).fit(X, Y)
    assert did_you_mean("T", ["t", "time"]) == " Did you mean 't'?"
    assert did_you_mean(["tiem", "sped"], ["time", "speed"]) == (
        " Did you mean 'time' instead of 'tiem'? Did you mean 'speed' instead of 'sped'?"
    )
