"""Runs that are curves, in every form in which they come."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import uniform

import hybridsurrogate as hs

RATE = np.linspace(0.1, 0.5, 12)
T = np.linspace(0, 10, 8)
Y = np.exp(-RATE[:, None] * T)
PRIORS = {"rate": uniform(0.1, 0.4)}


def rows_of(data):
    """Return the rows of a simulation in one order."""
    frame = data.to_frame()[["t", "rate", data.output]]
    return frame.sort_values(["rate", "t"]).to_numpy()


def from_array():
    return hs.SimulationData.from_curves(RATE, Y, along={"t": T}, parameters=PRIORS)


def wide():
    return pd.DataFrame(Y, columns=T)


def long():
    return pd.DataFrame(
        {
            "run": np.repeat(np.arange(12), 8),
            "t": np.tile(T, 12),
            "rate": np.repeat(RATE, 8),
            "y": Y.ravel(),
        }
    )


def dataset():
    xarray = pytest.importorskip("xarray")
    return xarray.Dataset({"y": (("member", "t"), Y), "rate": (("member",), RATE)}, coords={"t": T})


FORMS = {
    "wide": lambda: hs.SimulationData.from_curves(
        pd.DataFrame({"other": 1.0, "rate": RATE}), wide(), along="t", parameters=PRIORS
    ),
    "long": lambda: hs.SimulationData.from_curves(None, long(), along="t", parameters=PRIORS),
    "long with a table of runs": lambda: hs.SimulationData.from_curves(
        pd.DataFrame({"run": np.arange(12), "rate": RATE}),
        long().drop(columns="rate").sample(frac=1, random_state=0),
        along="t",
        parameters=PRIORS,
    ),
    "frame": lambda: hs.SimulationData.from_frame(long(), ["t"], PRIORS),
    "dataset": lambda: hs.SimulationData.from_curves(dataset(), along="t", parameters=PRIORS),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_the_same_simulation(form):
    data = FORMS[form]()
    assert (data.n_runs, data.n_rows) == (12, 96)
    np.testing.assert_allclose(rows_of(data), rows_of(from_array()))
    assert repr(data) == "SimulationData(12 runs of 96 rows: t -> y, parameters: rate)"


def test_ragged_runs_with_missing_values():
    places, outputs = T + RATE[:, None], Y.copy()
    outputs[3, 5:] = np.nan
    data = hs.SimulationData.from_curves(
        RATE, outputs, along={"t": places}, parameters=PRIORS, inputs={"t": (0, 12)}
    )
    assert (data.n_runs, data.n_rows) == (12, 93)
    assert data.input_ranges == {"t": (0.0, 12.0)}
    assert data.X[data.run == 5, 0] == pytest.approx(places[5])


def test_a_run_without_outputs_is_said_to_be_lost():
    outputs = Y.copy()
    outputs[[2, 7]] = np.nan
    with pytest.warns(hs.FailedRunsWarning, match=r"2 of 12 runs failed .* \(runs 2, 7\)"):
        data = hs.SimulationData.from_curves(RATE, outputs, along={"t": T}, parameters=PRIORS)
    assert data.n_runs == 10


def test_further_inputs_have_one_value_a_run():
    depth = np.linspace(1, 2, 12)
    data = hs.SimulationData.from_curves(
        np.column_stack([depth, RATE]), Y, along={"t": T}, inputs=["depth"], parameters=PRIORS
    )
    assert data.input_names == ("t", "depth")
    assert data.input_ranges == {"t": (0.0, 10.0), "depth": (1.0, 2.0)}


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: (RATE, np.ones((12, 8, 2)), {"t": T}), ValueError, r"output names y"),
        (lambda: (RATE, Y[:5], {"t": T}), ValueError, r"one row for each of the 12 runs"),
        (lambda: (RATE, Y, {"t": T[:5]}), ValueError, r"along\['t'\] must have shape \(8,\)"),
        (lambda: (RATE, Y, "t"), ValueError, r"give its values, too"),
        (lambda: (RATE, None, "t"), TypeError, r"only an xarray.Dataset"),
        (lambda: (RATE, Y, ["t", "u"]), TypeError, r"one name with its places"),
        (lambda: (RATE, pd.DataFrame(Y, columns=list("abcdefgh")), "t"), ValueError, r"numbers"),
        (lambda: (np.append(RATE[:-1], 0.1), Y, {"t": T}), ValueError, r"different results of 'y'"),
        (lambda: (RATE, np.full_like(Y, np.nan), {"t": T}), ValueError, r"All 12 runs failed"),
        (
            lambda: (pd.DataFrame({"run": [0], "rate": [0.1]}), long(), "t"),
            ValueError,
            r"runs that omega has not: \[1, 2, 3, 4, 5\]",
        ),
        (
            lambda: (None, long().assign(rate=np.linspace(0.1, 0.5, 96)), "t"),
            ValueError,
            r"Run 0 has several values of 'rate'",
        ),
    ],
)
def test_what_does_not_fit_together_is_refused(call, error, text):
    omega, outputs, along = call()
    with pytest.raises(error, match=text):
        hs.SimulationData.from_curves(omega, outputs, along=along, parameters=PRIORS)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_what_is_saved_is_read_again(tmp_path, ending):
    if ending == "parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / f"runs.{ending}"
    from_array().save(path)
    again = hs.read_simulation(path, ["t"], PRIORS)
    assert again.n_runs == 12
    np.testing.assert_allclose(rows_of(again), rows_of(from_array()), rtol=1e-12)


def test_a_netcdf_dataset_is_read(tmp_path):
    path = tmp_path / "runs.nc"
    dataset().to_netcdf(path, engine="scipy")
    again = hs.read_simulation(path, ["t"], PRIORS)
    assert again.n_runs == 12
    np.testing.assert_allclose(rows_of(again), rows_of(from_array()), rtol=1e-12)


def test_other_endings_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"written to \.csv or \.parquet files, not to '\.txt'"):
        from_array().save(tmp_path / "runs.txt")


# ------------------------------------------------------------------------------- simulators


def curve(t, rate):
    assert t.ndim == 1
    assert np.ndim(rate) == 0
    return np.exp(-rate * t)


def simulator(function=curve, **settings):
    return hs.Simulator(
        function, {"t": (0, 10)}, {"rate": uniform(0.1, 0.4)}, returns="curve", **settings
    )


def test_one_call_is_one_run():
    calls = []

    def counted(t, rate):
        calls.append(len(t))
        return curve(t, rate)

    data = simulator(counted).run(16, random_state=0, along=20)
    assert calls == [20] * 16
    assert (data.n_runs, data.n_rows) == (16, 320)
    np.testing.assert_allclose(data.y, np.exp(-data.omega[:, 0] * data.X[:, 0]))
    # rows of any order go to the run that they are of
    t, rate = np.array([3.0, 1.0, 2.0, 1.0]), np.array([0.2, 0.4, 0.2, 0.2])
    calls.clear()
    np.testing.assert_allclose(simulator(counted)(t, rate), np.exp(-rate * t))
    assert sorted(calls) == [1, 3]


def test_curves_of_a_function_of_arrays_are_the_same():
    plain = hs.Simulator(lambda t, rate: np.exp(-rate * t), {"t": (0, 10)}, PRIORS)
    one, other = (each.run(16, random_state=0, along=20) for each in (plain, simulator()))
    np.testing.assert_allclose(one.to_frame(), other.to_frame())


def test_places_may_be_given():
    data = simulator().run(16, random_state=0, along=[0, 1, 2, 4, 8])
    assert np.unique(data.X).tolist() == [0, 1, 2, 4, 8]
    with pytest.raises(ValueError, match=r"along must be at least 5 different values of 't'"):
        simulator().run(16, along=[0, 1, 2, 4, 80])


def test_a_dict_of_outputs_has_one_by_name():
    both = simulator(lambda t, rate: {"y": curve(t, rate), "z": t})
    assert both([1.0], [0.5]) == pytest.approx(np.exp(-0.5))
    with pytest.raises(ValueError, match=r"returned y, z, but no 'x'"):
        simulator(lambda t, rate: {"y": t, "z": t}, output="x")([1.0], [0.5])


def test_a_curve_of_another_length_is_refused():
    with pytest.raises(ValueError, match=r'returns="curve": as many values as the first input'):
        simulator(lambda t, rate: t[:-1])([1.0, 2.0], [0.5, 0.5])


def test_failed_curves_are_counted():
    def failing(t, rate):
        if rate > 0.45:
            raise RuntimeError("no convergence")
        return np.where(t > 9, np.nan, curve(t, rate))

    said = r"2 of 16 runs .* failed and were dropped, 28 further outputs .* no convergence"
    with pytest.warns(hs.FailedRunsWarning, match=said):
        data = simulator(failing).run(16, random_state=0, along=20)
    assert (data.n_runs, data.n_rows) == (14, 14 * 18)


def test_the_same_curves_whatever_the_processes():
    one, two = (simulator().run(8, random_state=0, n_jobs=n) for n in (1, 2))
    np.testing.assert_array_equal(one.y, two.y)


# ------------------------------------------------------------- wide tables, and no priors


def wide_with_parameters(labels=None):
    table = pd.DataFrame(Y, columns=T if labels is None else labels)
    return pd.concat([pd.DataFrame({"run": np.arange(12), "rate": RATE}), table], axis=1)


WIDE = {
    "numbers": None,
    "text": [str(t) for t in T],
    "name of the input": [f"t={t}" for t in T],
    "name of the output": [f"y_{t}" for t in T],
}


@pytest.mark.parametrize("labels", WIDE)
def test_a_wide_table_with_its_parameters_inside(labels):
    table = wide_with_parameters(WIDE[labels])
    for data in (
        hs.SimulationData.from_curves(None, table, along="t", parameters=PRIORS),
        hs.SimulationData.from_frame(table, ["t"], PRIORS),
        hs.SimulationData.from_frame(table.drop(columns="run"), {"t": (0, 12)}, PRIORS),
    ):
        assert (data.n_runs, data.n_rows) == (12, 96)
        np.testing.assert_allclose(rows_of(data), rows_of(from_array()))


def test_a_wide_table_beside_a_table_of_runs():
    points = pd.DataFrame({"run": np.arange(12)[::-1], "rate": RATE[::-1]})
    table = wide_with_parameters().drop(columns="rate")
    data = hs.SimulationData.from_curves(points, table, along="t", parameters=PRIORS)
    np.testing.assert_allclose(rows_of(data), rows_of(from_array()))


def test_a_wide_file_is_read(tmp_path):
    table = wide_with_parameters()
    table.iloc[3, 6:] = np.nan  # a run that ended early
    table.iloc[7, 2:] = np.nan
    table.to_csv(tmp_path / "wide.csv", index=False)
    with pytest.warns(hs.FailedRunsWarning, match=r"1 of 12 runs failed .* \(runs 7\)"):
        data = hs.read_simulation(tmp_path / "wide.csv", ["t"], PRIORS)
    assert (data.n_runs, data.n_rows) == (11, 84)


def test_a_column_of_a_wide_table_that_is_not_named_is_pointed_out():
    table = wide_with_parameters().assign(load=np.arange(12.0), same=1.0)
    match = r"The columns \['load'\] differ between runs and are not among"
    with pytest.warns(hs.DiagnosisWarning, match=match):
        hs.SimulationData.from_frame(table, ["t"], PRIORS)


@pytest.mark.parametrize(
    "made",
    [
        lambda priors: hs.SimulationData.from_frame(long(), ["t"], priors),
        lambda priors: hs.SimulationData.from_frame(wide_with_parameters(), ["t"], priors),
        lambda priors: hs.SimulationData.from_curves(RATE, Y, along={"t": T}, parameters=priors),
        lambda priors: hs.SimulationData(
            np.tile(T, 12), np.repeat(RATE, 8), Y.ravel(), ["t"], priors
        ),
    ],
    ids=["long", "wide", "curves", "arrays"],
)
@pytest.mark.parametrize("priors", [["rate"], "rate", {"rate": None}], ids=str)
def test_without_priors_they_are_uniform_over_the_runs(made, priors):
    said = r"No prior was given for 'rate': it is taken as uniform over the runs, 0\.1 to 0\.5"
    with pytest.warns(hs.PriorWarning, match=said) as told:
        data = made(priors)
    assert len(told) == 1
    assert data.parameters["rate"].support() == pytest.approx((0.1, 0.5))
    assert data.parameters["rate"].mean() == pytest.approx(0.3)


def test_a_parameter_without_a_prior_must_vary():
    table = long().assign(rate=0.3)
    with pytest.raises(ValueError, match="parameter 'rate' was never varied"):
        hs.SimulationData.from_frame(table, ["t"], ["rate"])
