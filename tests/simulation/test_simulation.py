import copy
import pickle
import warnings

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm, uniform
from sklearn.base import clone

from hybridsurrogate.exceptions import FailedRunsWarning, PriorWarning
from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.simulation.design import draw_design
from hybridsurrogate.simulation.simulator import Assumed, SimulationData, Simulator, read_simulation

INPUTS = {"t": (0, 4)}
PARAMETERS = {"gravity": truncated_normal(9.8, 1, 5, 15)}
ASSUMED = {"start": Assumed(100, uniform(50, 100))}


def height(t, gravity, start):
    return start - gravity / 2 * t**2


def fragile(t, gravity):
    if t > 3:
        raise ZeroDivisionError("too late")
    return gravity * t


@pytest.fixture
def simulator():
    return Simulator(height, INPUTS, PARAMETERS, ASSUMED, output="height")


@pytest.fixture
def runs():
    """Columns of a design that varies everything over its range."""
    t, gravity, start = draw_design([(0, 4), (5, 15), (50, 150)], 64, random_state=0).T
    return {"t": t, "gravity": gravity, "start": start, "height": height(t, gravity, start)}


def data(runs, inputs=INPUTS, parameters=PARAMETERS, assumed=ASSUMED):
    omega = np.column_stack([runs["gravity"], runs["start"]])
    return SimulationData(runs["t"], omega, runs["height"], inputs, parameters, assumed)


class TestSimulator:
    def test_names_and_ranges(self, simulator):
        assert simulator.input_names == ("t",)
        assert simulator.parameter_names == ("gravity",)
        assert simulator.assumed_names == ("start",)
        assert simulator.input_ranges == {"t": (0, 4)}
        assert list(simulator.parameter_ranges) == ["gravity", "start"]
        assert simulator.parameter_ranges["start"] == (50, 150)
        assert simulator.name == "height"
        assert simulator.simulator is simulator
        assert repr(simulator) == (
            "Simulator(height: t -> height, parameters: gravity, assumed: start)"
        )

    def test_assumed_constants_take_their_value_unless_given(self, simulator):
        t, gravity = [1.0, 2.0], [10.0, 10.0]
        np.testing.assert_allclose(simulator(t, gravity), [95, 80])
        np.testing.assert_allclose(simulator(t, [[10, 60], [10, 60]]), [55, 40])
        frame = pd.DataFrame({"start": [60, 60], "gravity": [10, 10]})
        np.testing.assert_allclose(simulator(t, frame), [55, 40])

    def test_simulation_without_unknowns(self):
        simulator = Simulator(lambda a, b: a - b, {"a": (0, 1), "b": (0, 1)})
        np.testing.assert_allclose(simulator([[3, 1], [5, 1]]), [2, 4])
        assert simulator.run(8, random_state=0).omega.shape == (8, 0)

    def test_one_run_at_a_time_gives_nan_where_it_fails(self):
        simulator = Simulator(fragile, INPUTS, PARAMETERS, vectorized=False)
        np.testing.assert_array_equal(simulator([1.0, 3.5], [10.0, 10.0]), [10, np.nan])

    def test_frozen_picklable_and_its_own_clone(self, simulator):
        again = pickle.loads(pickle.dumps(simulator))
        np.testing.assert_allclose(again([1.0], [10.0]), [95])
        assert clone(simulator) is simulator
        with pytest.raises(AttributeError):
            simulator.output = "other"

    @pytest.mark.parametrize("design", ["sobol", "latin-hypercube"])
    @pytest.mark.parametrize("n_runs", [10, 64])
    def test_runs_fill_the_ranges(self, simulator, design, n_runs):
        simulation = simulator.run(n_runs, design, random_state=1)
        assert simulation.n_runs == n_runs
        np.testing.assert_allclose(
            simulation.y, height(simulation.X[:, 0], *simulation.omega.T), rtol=1e-14
        )
        for column, low, high in zip(
            np.column_stack([simulation.X, simulation.omega]).T,
            (0, 5, 50),
            (4, 15, 150),
            strict=True,
        ):
            assert low <= column.min() < low + 0.2 * (high - low)
            assert high >= column.max() > high - 0.2 * (high - low)
        assert simulation.simulator is simulator
        assert repr(simulation) == (
            f"SimulationData({n_runs} runs of height: t -> height, parameters: gravity, "
            "assumed: start)"
        )

    def test_same_seed_same_runs_whatever_the_jobs(self):
        simulator = Simulator(fragile, {"t": (0, 2)}, PARAMETERS, vectorized=False)
        one, two = simulator.run(12, random_state=3), simulator.run(12, random_state=3, n_jobs=2)
        np.testing.assert_array_equal(one.X, two.X)
        np.testing.assert_array_equal(one.y, two.y)
        assert not np.array_equal(one.y, simulator.run(12, random_state=4).y)
        legacy = [simulator.run(12, random_state=np.random.RandomState(0)).y for _ in range(2)]
        np.testing.assert_array_equal(*legacy)

    def test_progress_bar_only_if_asked(self, capsys):
        simulator = Simulator(fragile, {"t": (0, 2)}, PARAMETERS, vectorized=False)
        simulator.run(8, random_state=0)
        assert capsys.readouterr().err == ""
        simulator.run(8, random_state=0, progress=True)
        assert "fragile" in capsys.readouterr().err

    def test_failed_runs_are_dropped_with_one_warning(self):
        simulator = Simulator(fragile, INPUTS, PARAMETERS, vectorized=False)
        with pytest.warns(FailedRunsWarning) as caught:
            simulation = simulator.run(32, random_state=0)
        assert len(caught) == 1
        text = str(caught[0].message)
        assert text.startswith("8 of 32 runs of 'fragile' failed and were dropped (rows ")
        assert text.endswith("First error: ZeroDivisionError: too late")
        assert caught[0].filename == __file__
        assert simulation.n_runs == 24
        assert simulation.X.max() <= 3

    def test_all_runs_failed(self):
        simulator = Simulator(fragile, {"t": (3.5, 4)}, PARAMETERS, vectorized=False)
        with pytest.raises(ValueError, match=r"All 8 runs of 'fragile' failed.*too late"):
            simulator.run(8)

    def test_error_of_a_vectorised_function_comes_through(self):
        def broken(t):
            raise ZeroDivisionError("too late")

        with pytest.raises(ZeroDivisionError, match="too late"):
            Simulator(broken, INPUTS).run(8)

    @pytest.mark.parametrize(
        ("options", "error", "match"),
        [
            ({"inputs": {"x": (0, 1)}}, TypeError, "'height' needs t, which is no input"),
            ({"assumed": None}, TypeError, "'height' needs start, which is no input"),
            ({"inputs": {"gravity": (0, 1)}}, ValueError, "gravity named more than once"),
            ({"inputs": {}}, ValueError, "at least one input"),
            ({"inputs": {"t": (4, 0)}}, ValueError, "range of 't' must be finite"),
            ({"parameters": {"gravity": 9.8}}, TypeError, "prior of 'gravity' must be a frozen"),
            ({"assumed": {"start": 100}}, TypeError, r"'start' must be Assumed\(value, prior\)"),
        ],
    )
    def test_bad_description(self, options, error, match):
        full = {"inputs": INPUTS, "parameters": PARAMETERS, "assumed": ASSUMED} | options
        with pytest.raises(error, match=match):
            Simulator(height, **full)

    def test_keyword_arguments_and_defaults_are_free(self):
        Simulator(lambda **names: names["t"], INPUTS)
        Simulator(lambda t, unused=1: t, INPUTS)

    @pytest.mark.parametrize(
        ("function", "vectorized", "match"),
        [
            (lambda t: t[:2], True, r"returned an array of shape \(2,\), expected \(3,\)"),
            (lambda t: [t, t], False, r"returned an array of shape \(2,\), expected \(\)"),
        ],
    )
    def test_wrong_output_shape(self, function, vectorized, match):
        with pytest.raises(ValueError, match=match):
            Simulator(function, INPUTS, vectorized=vectorized)([1, 2, 3])

    @pytest.mark.parametrize(
        ("X", "omega", "match"),
        [
            (np.ones((3, 2)), np.ones(3), r"X must have shape \(n, 1\), columns t, got \(3, 2\)"),
            (np.ones(3), np.ones((3, 4)), r"omega must have shape \(n, 1\), columns gravity"),
            (np.ones(3), None, r"omega must have shape \(n, 1\), columns gravity"),
            (np.ones(3), np.ones(2), "numbers of rows differ: X 3, omega 2"),
        ],
    )
    def test_wrong_points(self, simulator, X, omega, match):
        with pytest.raises(ValueError, match=match):
            simulator(X, omega)

    def test_unknown_design(self, simulator):
        with pytest.raises(ValueError, match="design must be one of sobol, latin-hypercube"):
            simulator.run(8, design="grid")
        with pytest.raises(ValueError, match="n_runs == 0, must be >= 1"):
            simulator.run(0)


class TestAssumed:
    def test_value_outside_its_prior(self):
        with pytest.raises(
            ValueError, match=r"value 2 lies outside the range of its prior, 0 to 1"
        ):
            Assumed(2, uniform(0, 1))


class TestSimulationData:
    def test_attributes(self, runs):
        simulation = data(runs)
        assert simulation.X.shape == (64, 1)
        assert simulation.omega.shape == (64, 2)
        assert simulation.n_runs == 64
        assert simulation.input_names == ("t",)
        assert simulation.parameter_names == ("gravity",)
        assert simulation.assumed_names == ("start",)
        assert simulation.input_ranges == {"t": (0, 4)}
        assert simulation.parameter_ranges == {"gravity": (5, 15), "start": (50, 150)}
        assert simulation.simulator is None
        assert repr(simulation) == (
            "SimulationData(64 runs: t -> y, parameters: gravity, assumed: start)"
        )

    def test_copied_and_read_only_also_after_pickling(self, runs):
        simulation = data(runs)
        runs["height"][0] = -1
        assert simulation.y[0] != -1
        for same in (simulation, pickle.loads(pickle.dumps(simulation)), copy.deepcopy(simulation)):
            np.testing.assert_array_equal(same.y, simulation.y)
            with pytest.raises(ValueError, match="read-only"):
                same.y[0] = 0
        with pytest.raises(AttributeError):
            simulation.y = runs["height"]

    def test_scikit_learn_neither_slices_nor_copies_it(self, runs):
        simulation = data(runs)
        assert clone(simulation) is simulation
        assert not any(hasattr(simulation, word) for word in ("__len__", "shape", "__array__"))

    def test_ranges_from_the_runs(self, runs):
        simulation = data(runs, inputs=["t"], parameters={"gravity": norm(10, 1)})
        assert simulation.input_ranges == {"t": (runs["t"].min(), runs["t"].max())}
        assert simulation.parameter_ranges["gravity"] == (
            runs["gravity"].min(),
            runs["gravity"].max(),
        )
        beyond = data(runs, parameters={"gravity": truncated_normal(10, 1, 7, 13)})
        assert beyond.parameter_ranges == simulation.parameter_ranges | {"start": (50, 150)}

    def test_runs_without_unknowns(self):
        for omega in (None, np.empty((3, 0))):
            simulation = SimulationData([1, 2, 3], omega, [1, 4, 9], inputs=["t"])
            assert simulation.omega.shape == (3, 0)
            assert simulation.parameter_ranges == {}

    def test_failed_runs_are_dropped(self, runs):
        runs["height"][[3, 5]] = np.nan, np.inf
        runs["t"][7] = np.nan
        with pytest.warns(
            FailedRunsWarning, match=r"3 of 64 runs failed.*\(rows 3, 5, 7\)"
        ) as seen:
            simulation = data(runs)
        assert seen[0].filename == __file__
        assert simulation.n_runs == 61
        runs["height"][:] = np.nan
        with pytest.raises(ValueError, match="All 64 runs failed"):
            data(runs)

    @pytest.mark.parametrize(
        ("X", "omega", "y", "match"),
        [
            (
                np.ones((4, 2)),
                np.ones(4),
                np.ones(4),
                r"X must have shape \(n, 1\), columns t, got",
            ),
            (np.ones(4), np.ones((4, 3)), np.ones(4), r"omega must have shape \(n, 1\), columns g"),
            (np.ones(4), None, np.ones(4), r"omega must have shape \(n, 1\), columns gravity, got"),
            (np.ones(4), np.ones(4), np.ones((4, 1)), r"y must have shape \(n_runs,\), got \(4, 1"),
            (np.ones(4), np.ones(4), np.ones(5), "rows differ: X 4, omega 4, y 5"),
        ],
    )
    def test_wrong_shapes(self, X, omega, y, match):
        with pytest.raises(ValueError, match=match):
            SimulationData(X, omega, y, INPUTS, PARAMETERS)

    def test_runs_outside_the_input_range(self, runs):
        with pytest.raises(ValueError, match="input 't', beyond its range, 0 to 3: widen"):
            data(runs, inputs={"t": (0, 3)})

    @pytest.mark.parametrize(
        ("column", "match"),
        [
            (
                "start",
                "assumed constant 'start' was never varied in the runs: "
                "vary it or leave it out of assumed",
            ),
            (
                "gravity",
                "parameter 'gravity' was never varied in the runs: "
                "vary it or leave it out of parameters",
            ),
            (
                "t",
                "input 't' was never varied in the runs: vary it or leave it out of inputs",
            ),
        ],
    )
    def test_never_varied(self, runs, column, match):
        runs[column][:] = runs[column][0]
        with pytest.raises(ValueError, match=match):
            data(runs)

    def test_prior_without_support_over_the_simulated_range(self, runs):
        with pytest.raises(
            ValueError, match=r"Only 0.0% of the prior of 'gravity' lies in its sim"
        ):
            data(runs, parameters={"gravity": norm(30, 1)})

    def test_prior_with_little_support_over_the_simulated_range(self, runs):
        with pytest.warns(PriorWarning, match=r"Only \d\d.\d% of the prior of 'gravity'"):
            data(runs, parameters={"gravity": norm(15, 1)})

    @pytest.mark.parametrize("n_runs", [2, 4, 8, 100])
    def test_few_runs_over_the_whole_range_are_support_enough(self, n_runs):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            Simulator(lambda t, a: a * t, INPUTS, {"a": uniform(0, 1)}).run(n_runs, random_state=0)

    def test_assumed_value_that_was_not_simulated(self, runs):
        with pytest.raises(ValueError, match="200 of 'start' lies outside its simulated range"):
            data(runs, assumed={"start": Assumed(200, norm(150, 20))})
        # a prior of two ends is wider than the runs, and does not widen them
        with pytest.raises(ValueError, match="200 of 'start' lies outside its simulated range"):
            data(runs, assumed={"start": Assumed(200, uniform(50, 200))})


class TestTables:
    def test_from_frame_takes_columns_by_name(self, runs):
        frame = pd.DataFrame(runs)[["height", "start", "t", "gravity"]].assign(note="fine")
        simulation = SimulationData.from_frame(frame, INPUTS, PARAMETERS, "height", ASSUMED)
        np.testing.assert_array_equal(simulation.X[:, 0], runs["t"])
        np.testing.assert_array_equal(simulation.omega.T, [runs["gravity"], runs["start"]])
        np.testing.assert_array_equal(simulation.y, runs["height"])
        assert simulation.output == "height"

    def test_read_simulation(self, runs, tmp_path):
        path = tmp_path / "runs.csv"
        path.write_text("# made elsewhere\n" + pd.DataFrame(runs).to_csv(index=False))
        simulation = read_simulation(path, ["t"], PARAMETERS, output="height", assumed=ASSUMED)
        np.testing.assert_allclose(simulation.y, runs["height"])

    def test_missing_columns(self, runs):
        with pytest.raises(ValueError, match="no column y; there are t, gravity, start, height"):
            SimulationData.from_frame(pd.DataFrame(runs), INPUTS, PARAMETERS)
        with pytest.raises(ValueError, match="no column x, drag; there are"):
            SimulationData.from_frame(
                pd.DataFrame(runs), ["x"], {"drag": norm(0, 1)}, output="height"
            )

    def test_text_in_a_column(self, runs):
        with pytest.raises(ValueError, match="column 't' must hold numbers"):
            SimulationData.from_frame(pd.DataFrame(runs | {"t": "a"}), ["t"], output="height")

    def test_output_is_also_an_input(self, runs):
        with pytest.raises(ValueError, match="output 't' is also an input"):
            SimulationData.from_frame(pd.DataFrame(runs), ["t"], output="t")
