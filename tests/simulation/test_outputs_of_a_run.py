"""Several outputs of a simulation: what functions return, runs on disk, rows of one output each."""

import sys

import numpy as np
import pandas as pd
import pytest
from scipy.stats import uniform

import hybridsurrogate as hs
from hybridsurrogate.simulation.outputs import OUTPUT, AllOutputs

INPUTS, PARAMETERS = {"t": (0, 10)}, {"a": uniform(1, 2), "k": uniform(0.1, 0.4)}


def level_and_flow(t, a, k):
    level = a * np.exp(-k * t)
    return level, 3 * k * level


def as_dict(t, a, k):
    level, flow = level_and_flow(t, a, k)
    return {"flow": flow, "level": level, "more": t}


def as_table(t, a, k):
    return np.column_stack(level_and_flow(t, a, k))


@pytest.fixture
def rows():
    random = np.random.default_rng(0)
    return random.uniform(0, 10, (20, 1)), np.column_stack(
        [random.uniform(1, 3, 20), random.uniform(0.1, 0.5, 20)]
    )


@pytest.mark.parametrize("function", [level_and_flow, as_dict, as_table])
@pytest.mark.parametrize("vectorized", [True, False])
def test_a_function_may_return_a_dict_a_tuple_or_a_table(function, vectorized, rows):
    if function is as_table and not vectorized:
        return  # one row of a table is an array of the outputs
    simulator = hs.Simulator(
        function, INPUTS, PARAMETERS, output=("level", "flow"), vectorized=vectorized
    )
    X, omega = rows
    expected = np.column_stack(level_and_flow(X[:, 0], *omega.T))
    np.testing.assert_allclose(simulator(X, omega), expected, rtol=1e-12)


def test_an_ode_shows_several_outputs(rows):
    simulator = hs.OdeSimulator(
        lambda t, state, k: -k * state,
        initial_state=lambda a: [a],
        observe=lambda state, k: {"level": state[0], "flow": 3 * k * state[0]},
        inputs=INPUTS,
        parameters=PARAMETERS,
        states="level",
        output=("level", "flow"),
    )
    X, omega = rows
    expected = np.column_stack(level_and_flow(X[:, 0], *omega.T))
    np.testing.assert_allclose(simulator(X, omega), expected, rtol=1e-6)
    single = simulator.single_output(np.array([1.0, 2.0]))
    which = np.arange(20) % 2
    found = single(np.column_stack([X, which]), omega)
    np.testing.assert_allclose(found, (expected / [1, 2])[np.arange(20), which], rtol=1e-6)
    # a parameter of the initial state stays one, and what observe takes is none of the rates
    assert single.starts == ("a",)
    assert single.rates == ("k",)


def test_rows_of_one_output_and_back(rows):
    simulator = hs.Simulator(level_and_flow, INPUTS, PARAMETERS, output=("level", "flow"))
    X, omega = rows
    single = simulator.single_output(np.array([2.0, 0.5]))
    stacked = np.column_stack([np.repeat(X, 2, axis=0), np.tile([0.0, 1.0], 20)])
    told = single(stacked, np.repeat(omega, 2, axis=0)).reshape(20, 2) * [2.0, 0.5]
    np.testing.assert_allclose(told, simulator(X, omega), rtol=1e-12)
    again = hs.Simulator(
        AllOutputs(simulator.single_output(np.ones(2)), ("level", "flow")),
        INPUTS,
        PARAMETERS,
        output=("level", "flow"),
    )
    np.testing.assert_allclose(again(X, omega), simulator(X, omega), rtol=1e-12)


def test_one_run_makes_all_outputs_of_a_row(rows):
    calls = []

    def counted(t, a, k):
        calls.append(len(t))
        return level_and_flow(t, a, k)

    single = hs.Simulator(counted, INPUTS, PARAMETERS, output=("h", "q")).single_output(np.ones(2))
    X, omega = rows
    stacked = np.column_stack([np.repeat(X, 2, axis=0), np.tile([0.0, 1.0], 20)])
    single(stacked, np.repeat(omega, 2, axis=0))
    assert calls == [20]


FORMS = ["array", "dict", "long", "dataset"]


@pytest.mark.parametrize("form", FORMS)
def test_curves_of_several_outputs(form):
    t = np.linspace(0, 10, 6)
    omega = pd.DataFrame({"a": np.linspace(1, 3, 5), "k": np.linspace(0.1, 0.5, 5)[::-1]})
    level, flow = level_and_flow(t, omega[["a"]].to_numpy(), omega[["k"]].to_numpy())
    level = level.copy()
    level[2, 3] = np.nan
    long = pd.DataFrame(
        {"run": np.repeat(np.arange(5), 6), "t": np.tile(t, 5), "h": level.ravel()}
    ).assign(q=flow.ravel())
    options = {"parameters": PARAMETERS, "output": ("h", "q")}
    if form == "dataset":
        xarray = pytest.importorskip("xarray")
        data = xarray.Dataset(
            {"h": (("n", "t"), level), "q": (("n", "t"), flow)}
            | {name: ("n", omega[name].to_numpy()) for name in omega},
            coords={"t": t},
        )
        runs = hs.SimulationData.from_curves(data, along="t", **options)
    else:
        Y = {"array": np.stack([level, flow], axis=2), "dict": {"h": level, "q": flow}}
        given = long if form == "long" else Y[form]
        along = "t" if form == "long" else {"t": t}
        runs = hs.SimulationData.from_curves(omega, given, along=along, **options)
    assert runs.outputs == ("h", "q")
    assert runs.y.shape == (30, 2)
    assert np.isnan(runs.y).sum() == 1
    np.testing.assert_allclose(np.sort(runs.y[:, 1]), np.sort(flow.ravel()), rtol=1e-12)
    single = runs.single_output(np.array([1.0, 10.0]))
    assert single.n_rows == 59
    assert single.n_runs == 10
    assert single.input_names == ("t", OUTPUT)
    again = hs.SimulationData.from_frame(runs.to_frame(), ["t"], PARAMETERS, ("h", "q"))
    np.testing.assert_array_equal(again.y, runs.y)


def test_a_store_keeps_all_outputs(tmp_path):
    calls = []

    def slow(t, a, k):
        calls.append(a)
        if a > 2.5:
            raise RuntimeError("no convergence")
        return level_and_flow(t, a, k)

    simulator = hs.Simulator(slow, INPUTS, PARAMETERS, output=("h", "q"), returns="curve")
    with pytest.warns(hs.exceptions.FailedRunsWarning, match="no convergence"):
        first = simulator.run(8, along=6, random_state=0, store=tmp_path / "runs")
    made = len(calls)
    with pytest.warns(hs.exceptions.FailedRunsWarning):
        again = simulator.run(8, along=6, random_state=0, store=tmp_path / "runs")
    assert len(calls) == made
    np.testing.assert_array_equal(first.y, again.y)
    table = pd.read_csv(tmp_path / "runs" / "runs.csv")
    assert {"h", "q"} <= set(table)


def test_a_program_writes_several_columns():
    code = (
        "import numpy as np; t = np.linspace(0, 10, 40); h = {a} * np.exp(-{k} * t); "
        "np.savetxt('out.csv', np.c_[t, h, 3 * {k} * h], delimiter=',', header='t,h,q', "
        "comments='')"
    )
    simulator = hs.CommandSimulator(
        [sys.executable, "-c", code],
        INPUTS,
        PARAMETERS,
        output=("h", "q"),
        read="out.csv",
        returns="curve",
    )
    runs = simulator.run(2, along=np.linspace(0, 10, 40), random_state=0)
    expected = np.column_stack(level_and_flow(runs.X[:, 0], *runs.omega.T))
    np.testing.assert_allclose(runs.y, expected, rtol=1e-6)
    with pytest.raises(ValueError, match="read must name the file"):
        hs.CommandSimulator(
            [sys.executable], INPUTS, PARAMETERS, output=("h", "q"), returns="curve"
        )


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: hs.Simulator(as_table, INPUTS, PARAMETERS, output=("h", "h")), "different names"),
        (lambda: hs.Simulator(as_table, INPUTS, PARAMETERS, output=()), "a name or several"),
        (
            lambda: hs.Simulator(as_dict, INPUTS, PARAMETERS, output=("level", "head"))(
                [1.0], [[1.0, 0.2]]
            ),
            "returned flow, level, more, but no 'head'",
        ),
        (
            lambda: hs.Simulator(as_table, INPUTS, PARAMETERS, output=("a1", "b1", "c1"))(
                [1.0], [[1.0, 0.2]]
            ),
            "must return 3 outputs, a1, b1, c1",
        ),
        (
            lambda: hs.SimulationData(
                [1.0, 2.0], [[1, 0.2], [2, 0.3]], np.ones((2, 3)), ["t"], PARAMETERS, output="hq"
            ),
            r"y must have shape \(n_runs,\)",
        ),
        (
            lambda: hs.SimulationData(
                [1.0, 2.0], [[1, 0.2], [2, 0.3]], np.ones(2), ["t"], PARAMETERS, output=("h", "t")
            ),
            "output 't' is also an input",
        ),
        (
            lambda: hs.SimulationData.from_curves(
                np.ones((2, 2)), np.ones((2, 5, 3)), along={"t": np.arange(5)}, output=("h", "q"),
                parameters=PARAMETERS,
            ),
            "Y has 3 outputs, but output names 2",
        ),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(call, text):
    with pytest.raises(ValueError, match=text):
        call()
