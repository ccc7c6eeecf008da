"""What a diagnosis weighs, what it leaves out and why, and causes that cannot work."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from tide import FRAME, NOISE, SIMULATOR, context_of, plain

import hybridsurrogate as hs
from hybridsurrogate.catalogue import catalogue
from hybridsurrogate.diagnosis.answers.finding import form_of
from hybridsurrogate.effects.base import Context
from hybridsurrogate.effects.registry import kinds


@pytest.mark.parametrize(
    "cause",
    [
        hs.Trend("depth"),
        hs.Periodic("depth"),
        hs.Step("depth"),
        hs.Ramp("depth"),
        hs.Bump("depth"),
        hs.Decay("depth"),
        hs.Saturation("depth"),
        hs.Delay("depth"),
        hs.ParameterDrift("height", "depth"),
        hs.MissingInput("depth"),
        hs.Interaction("t", "depth"),
        hs.Noise("depth"),
    ],
    ids=lambda cause: cause.kind,
)
def test_a_column_that_is_not_there(cause):
    with pytest.raises(ValueError, match=r"no measured column 'depth'; the columns are \['t'"):
        cause.prepare(context_of())


@pytest.mark.parametrize(
    ("cause", "message"),
    [
        (hs.Trend("t", degree=3), "degree of a trend is 1 or 2, got 3"),
        (hs.Periodic("t", harmonics=0), "harmonics must be 1 or 2, got 0"),
        (hs.Interaction("t", "t"), "two different columns, got 't' twice"),
        (hs.Delay("wind"), r"shifts an input of the simulation, and 'wind' is none.*\['t', 'dose'"),
        (hs.ParameterDrift("speed", "t"), "'speed' is not a parameter"),
        (hs.ParameterDrift("rate", "t", shape="zigzag"), "shape must be one of.*got 'zigzag'"),
        (hs.MissingInput("wind", shape="cubic"), "shape must be one of.*got 'cubic'"),
        (hs.MissingInput("wind", level=2), "level=2 needs shape='categorical'"),
        (hs.MissingInput("wind", shape="categorical"), "wind has 100 distinct values, 2 to 6"),
        (hs.MissingInput("batch", shape="categorical", level=9), "'batch' is never 9"),
        (hs.BuildUp("wind"), r"'wind' does not begin near zero.*BuildUp\('wind', origin="),
        (hs.Offset("batch"), "an offset at one level needs both"),
        (hs.Offset("batch", level=9), "'batch' is never 9"),
    ],
)
def test_causes_that_cannot_work(cause, message):
    with pytest.raises(ValueError, match=message):
        cause.prepare(context_of())


def test_the_whole_catalogue():
    causes, skipped = catalogue(context_of())
    # compared only where a parameter is at an end of its prior
    assert "narrow-prior" in {one.kind for one in skipped}
    # and where it is passed
    everywhere = {*kinds(), "unexplained"} - {"recurring-jumps"}
    assert {one.kind for one in (*causes, *skipped)} == everywhere
    drifts = [cause for cause in causes if cause.kind == "parameter-drift"]
    levels = [cause for cause in causes if getattr(cause, "level", None) is not None]
    rest = {form_of(cause) for cause in causes if cause not in (*drifts, *levels)}
    assert rest == {
        *("offset", "gain", "wrong-constant", "trend", "trend: quadratic", "periodic"),
        *("periodic: overtone", "step", "ramp", "bump", "decay", "saturation", "delay"),
        *("episode", "episode: factor", "trend: since the start", "build-up", "limit"),
        *("limit: below", "response"),
        *("interaction", "step: before", "missing-input", "missing-input: quadratic"),
        *("missing-input: categorical", "missing-input: with offset", "interaction: from zero"),
        "missing-input: categorical with offset",
        *("noise", "noise: mean", "noise: tails", "noise: autocorrelation", "unexplained"),
        *("input-error", "random-parameter", "ramp: loss", "gross-error", "gross-error: two rows"),
        # batches 1 to 4 are labels
        *("parameter-by-experiment: over batch", "curve-by-experiment: by batch"),
    }
    # a continuous column has no levels, this simulation has no dynamics, and its floor is added
    assert {(s.kind, s.target) for s in skipped} == {
        ("missing-input", "wind"),
        ("missing-term", None),
        ("random-parameter", "floor"),
        ("second-store", None),
        ("narrow-prior", None),
    }
    assert {s.reason.partition(":")[0] for s in skipped} == {
        "categorical",
        "categorical with offset",
        "level",
        "friction",
        "inside the dynamics",
        "the simulation is as steep over floor everywhere",
        "the output itself is measured",
        "the data push no parameter against an end of its prior, or it cannot be run beyond",
    }
    assert sorted((cause.kind, cause.level) for cause in levels) == [
        (kind, level) for kind in ("missing-input", "noise") for level in (1, 2, 3, 4)
    ]
    assert [cause.target for cause in causes if cause.kind == "interaction"] == 2 * ["t * dose"]
    assert len(drifts) == 2 * 2 * 5 + 2 * 2


def test_what_is_left_out_comes_with_a_reason():
    frame = pd.DataFrame({"t": [0.0, 1, 2, 3, 3, 3], "side": [0.0, 0, 0, 1, 1, 1]})
    simulator = hs.Simulator(lambda t: t, inputs={"t": (0, 3)})
    _, skipped = catalogue(context_of(frame, simulator, "lognormal"))
    reasons = {}
    for s in skipped:
        reasons.setdefault(s.kind, []).append(s.reason)
    assert "a factor, compared as gain" in reasons["offset"][0]
    assert reasons["interaction"] == ["a product needs two inputs, the simulation has one"]
    assert reasons["wrong-constant"] == ["the simulation has no assumed constants"]
    assert reasons["parameter-drift"] == ["the simulation has no parameters"]
    assert reasons["delay"] == [
        "t has 4 distinct values one apart, which may be labels; 5 are needed"
    ]
    few = ["t has 4 distinct values, 6 are needed", "side has 2 distinct values, 6 are needed"]
    assert reasons["step"] == few
    assert "overtone: t has 4 distinct values, 12 are needed" in reasons["periodic"]
    few = "6 rows are too few"
    assert sorted(reasons["noise"]) == [few] * 2 + [
        f"autocorrelation: {few}",
        f"mean: {few}",
        f"tails: {few}",
    ]
    assert any("straight line over it is the same" in r for r in reasons["missing-input"])
    _, without = catalogue(context_of(frame[["t"]], simulator))
    assert ("missing-input", "no measured column apart from the inputs") in {
        (s.kind, s.reason) for s in without
    }


def test_a_diagnosis_weighs_the_whole_catalogue():
    frame = FRAME[::2]
    y = plain(frame) + NOISE * np.random.default_rng(0).standard_normal(len(frame))
    model = hs.PowerScaledSurrogate(
        SIMULATOR, surrogate=hs.ExactSurrogate(), random_state=0, n_draws=100
    )
    found = hs.DiscrepancyDiagnosis(model, cv=None, n_replicates=39, random_state=0).fit(frame, y)
    causes, skipped = catalogue(context_of(frame))
    # and "none"
    assert len(found.search_.candidates) == 1 + len(causes)
    assert len(found.causes_) == 1 + len(causes) + len(skipped)


def test_a_jump_and_a_wave_along_an_extra_column():
    """A time or a row number that the simulation ignores may order what happens."""
    n = 20
    frame = {"t": np.linspace(0, 10, n), "day": np.arange(n) * 1.0, "batch": np.arange(n) % 3 * 1.0}
    causes, skipped = catalogue(Context(frame, 1, {}, {}, 1.0))
    weighed = {(cause.kind, cause.target) for cause in causes}
    assert {("step", "day"), ("periodic", "day"), ("step", "t"), ("periodic", "t")} <= weighed
    # three batches, numbered from zero, are labels
    everything = weighed | {(one.kind, one.target) for one in skipped}
    assert not {("step", "batch"), ("periodic", "batch")} & everything
    assert ("missing-input", "batch") in weighed


def test_few_numbers_are_a_quantity_unless_they_count_or_are_declared():
    """A curve of its own for each of four temperatures was named with a probability of one."""
    degrees = np.repeat([20.0, 40, 60, 80], 5)
    columns = {"t": np.linspace(0, 10, 20), "degrees": degrees, "batch": degrees / 20}
    context = Context(columns, 1, {"rate": stats.norm()}, {}, 1.0)
    assert context.labels == ("batch",)
    causes = catalogue(context)[0]
    by = {c.by if c.kind == "curve-by-experiment" else c.column for c in causes if "-by-" in c.kind}
    assert by == {"batch"}
    drifts = {(c.target, c.column) for c in causes if c.kind == "parameter-drift"}
    assert ("rate", "degrees") in drifts
    assert {c.target for c in causes if c.kind == "missing-input"} == {"degrees", "batch"}
    declared = Context(columns, 1, {"rate": stats.norm()}, {}, 1.0, experiment="degrees")
    assert declared.labels == ("degrees", "batch")


def test_a_cause_of_ones_own_replaces_the_built_in_one():
    """Candidate twice it would halve its probability."""
    context = context_of()
    location = stats.uniform(3, 2)
    causes, skipped = catalogue(context, [hs.Step("t", location=location), hs.Periodic("wind")])
    steps = [cause for cause in causes if (form_of(cause), cause.target) == ("step", "t")]
    assert [step.location for step in steps] == [location]
    assert form_count(causes, "periodic", "wind") == 1
    # another form of the same kind and target stays
    assert form_count(causes, "periodic: overtone", "t") == 1
    assert skipped == catalogue(context)[1]


def form_count(causes, form, target):
    return sum((form_of(cause), cause.target) == (form, target) for cause in causes)


def oven(minutes, ambient, rate):
    return ambient + (90 - ambient) * np.exp(-rate * minutes)


@pytest.mark.slow
def test_an_input_of_few_values_may_be_off():
    """The thermometer of the room reads four degrees too little; nearly a saturation in time."""
    simulator = hs.Simulator(
        oven,
        {"minutes": (0, 60), "ambient": (10, 30)},
        {"rate": hs.truncated_normal(0.06, 0.02, 0.01, 0.15)},
    )
    in_set, first = 0, 0
    for seed in range(6):
        random = np.random.default_rng(seed)
        X = np.column_stack([random.uniform(0, 60, 45), random.choice([12.0, 20, 28], 45)])
        y = oven(X[:, 0], X[:, 1] + 4, 0.05) + 0.2 * random.standard_normal(45)
        model = hs.PowerScaledSurrogate(
            simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
        )
        found = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(X, y)
        in_set += "delay" in found.indistinguishable_
        cause = found.best_cause_
        if cause.kind == "delay":
            first += 1
            assert cause.target == "ambient"
            assert cause.estimates["lag"][0] == pytest.approx(-4, abs=0.3)
    assert in_set >= 5
    assert first >= 3
