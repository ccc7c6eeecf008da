"""Bad input at the doors: what was expected, what came, and no message of another library."""

import functools
import http.server
import io
import os
import pickle
import threading
import traceback
from pathlib import Path

import cloudpickle
import joblib
import numpy as np
import pandas as pd
import pytest
from conftest import fall
from scipy import stats
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate import scoring

G = {"gravity": hs.truncated_normal(9.8, 1, 5, 15)}
T = {"t": (0, 4)}
ROOT = str(Path(hs.__file__).parent)
PLACES, RATES = np.linspace(0, 4, 8), np.linspace(6, 14, 6)
CURVES = fall(PLACES, RATES[:, None])
COMMAND = ["echo", "{gravity} {t}"]


def table():
    t, gravity = (a.ravel() for a in np.meshgrid(np.linspace(0, 4, 5), np.linspace(6, 14, 5)))
    return pd.DataFrame({"t": t, "gravity": gravity, "y": fall(t, gravity)})


def simulator(**other):
    return hs.Simulator(**{"function": fall, "inputs": T, "parameters": G, **other})


def ode(**other):
    given = {
        "rhs": lambda t, state, gravity: np.stack([state[1], -gravity + 0 * state[1]]),
        "initial_state": [100.0, 0.0],
        "observe": lambda state: state[0],
        "inputs": T,
        "parameters": G,
        "states": ("z", "v"),
        "max_step": 0.1,
    }
    return hs.OdeSimulator(**{**given, **other})


def command(**other):
    return hs.CommandSimulator(**{"command": COMMAND, "inputs": T, "parameters": G, **other})


def data(**other):
    frame = table()
    given = {"X": frame.t, "omega": frame.gravity, "y": frame.y, "inputs": T, "parameters": G}
    return hs.SimulationData(**{**given, **other})


def from_frame(**other):
    return hs.SimulationData.from_frame(**{"frame": table(), "inputs": T, "parameters": G, **other})


def from_curves(**other):
    given = {"omega": RATES, "Y": CURVES, "along": {"t": PLACES}, "parameters": G}
    return hs.SimulationData.from_curves(**{**given, **other})


def read(**other):
    table().to_csv("runs.csv", index=False)
    return hs.read_simulation(**{"path": "runs.csv", "inputs": T, "parameters": G, **other})


def run(**other):
    return simulator().run(**{"n_runs": 4, "random_state": 0, **other})


def run_one_by_one(**other):
    return simulator(vectorized=False).run(**{"n_runs": 4, "random_state": 0, **other})


def called(X=((1.0,), (2.0,)), omega=((9.0,), (10.0,)), **other):
    return simulator()(np.array(X), np.array(omega), **other)


def ode_called(X=((1.0,), (2.0,)), omega=((9.0,), (10.0,))):
    return ode()(np.array(X), np.array(omega))


def run_at(**columns):
    return simulator().run_at(pd.DataFrame({"t": [1.0, 2.0], "gravity": [9.0, 10.0], **columns}))


def curves_at(**columns):
    return simulator().run_at(pd.DataFrame({"gravity": [9.0, 10.0], **columns}), along=8)


SIMULATIONS = [simulator, ode, command]
RUNS = [data, from_frame, from_curves, read]
NO_MAPPING = [5, "gravity", ["gravity"], ("t", 1), {"t"}, np.zeros(3), pd.DataFrame({"t": [1.0]})]
NO_NAMES = [5, None, {"t"}, b"t", [1, 2], [["t"]], np.zeros(2), np.array(5.0), int, object()]
NAN, INF = float("nan"), float("inf")


def rows(doors, argument, values, words):
    return [(door, {argument: value}, words) for door in doors for value in values]


TABLE = [
    *rows(SIMULATIONS, "parameters", NO_MAPPING, "parameters must be a dict of name"),
    # of runs names will do: their priors are uniform over the runs
    *rows(RUNS, "parameters", [5, {"t"}, np.zeros(3)], "parameters must be a dict of name"),
    *rows([*SIMULATIONS, *RUNS], "assumed", NO_MAPPING, "assumed must be a dict of name"),
    *rows([*SIMULATIONS, *RUNS], "parameters", [{1: G}], "names in parameters must be text, got 1"),
    *rows([*SIMULATIONS, *RUNS], "assumed", [{"a": 1.0}], "must be Assumed.*got 1"),
    *rows(SIMULATIONS, "inputs", [*NO_MAPPING, None], "inputs must be a dict of name to range"),
    *rows(RUNS, "inputs", NO_NAMES, "inputs must be a name or a list of names"),
    *rows([simulator, data], "inputs", [{"t": 1}, {"t": "ab"}, {"t": (1, 2, 3)}], "must be a pair"),
    *rows([simulator, data], "inputs", [{"t": (1, NAN)}, {"t": (2, 1)}], "must be finite"),
    *rows([*SIMULATIONS, *RUNS], "output", NO_NAMES, "output must be a name or a list of names"),
    *rows(
        [simulator, command], "returns", [5, None, ["curve"], np.zeros(2)], "returns must be one"
    ),
    *rows([simulator], "vectorized", ["no", None, 1, np.zeros(2)], "vectorized must be True"),
    *rows([simulator], "function", [5, None, "fall"], "function must be callable, such as"),
    *rows([ode], "rhs", [5, None], "rhs must be callable"),
    *rows([ode], "observe", [[], None], "observe must be callable"),
    *rows([ode], "states", NO_NAMES, "states must be a name or a list of names"),
    *rows([ode], "method", [5, np.zeros(2)], "method must be one of auto"),
    *rows([ode], "max_step", ["a", [1, 2]], "max_step must be a number"),
    *rows([ode], "modifications", [5, "step", [1]], "modifications must"),
    *rows([command], "command", [5j, {}, [None]], "command must be text"),
    *rows([command], "files", [5, ["a"], "input.txt"], "files must be a dict of name to template"),
    *rows([command], "files", [{"a": 1}], "template of 'a' must be text, got 1"),
    *rows([command], "read", [5, ["out.csv"]], "read must be the name of the file"),
    *rows([from_curves], "along", [5, {}, NAN, ["t"], {1: PLACES}], "along must be a name or one"),
    *rows([run], "n_runs", ["4", 4.5, None, [4]], "n_runs must be an instance of"),
    *rows([run], "n_runs", [0, -1, 10**400], "n_runs == "),
    *rows([run], "random_state", ["a", -1, 1.5, [1, 2], 1j], "random_state must be None, an int"),
    *rows([run, run_one_by_one, called], "n_jobs", ["2", 1.5, 0, [2]], "n_jobs must be a number"),
    *rows([run], "progress", ["yes", None], "progress must be True or False"),
    *rows([run], "design", [5, ["sobol"], "grid"], "design must be one of sobol, latin-hypercube"),
    *rows([run_one_by_one], "store", [5, ["a"], int], "store must be text or a pathlib.Path, got"),
    *rows([run_one_by_one], "store", ["s3://a/b"], "store must be on this machine"),
    *rows([read], "path", [5, None, ["runs.csv"], b"runs.csv"], "path must be text or a"),
    *rows([read], "path", ["", "a\0b"], "path must name a file"),
    *rows([called, ode_called], "X", [((NAN,), (1.0,))], "X holds NaN .* 1 of 2 .*'t' of row 1"),
    *rows([called, ode_called], "X", [((1.0,), (INF,))], "X holds .* 't' of row 2: inf"),
    *rows([called, ode_called], "omega", [((9.0,), (NAN,))], "omega holds .*'gravity' of row 2"),
    *rows(
        [run_at, curves_at],
        "gravity",
        [[9.0, NAN], [9.0, None]],
        "runs holds .*'gravity' of row",
    ),
    *rows([run_at], "t", [[INF, 1.0]], "runs holds .* 't' of row 1"),
    *rows([hs.Assumed], "value", ["a", None, [1, 2]], "value of an assumed constant must be a num"),
]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("door", "given", "words"), TABLE, ids=lambda v: getattr(v, "__name__", None) or "-"
)
def test_what_came_and_what_was_expected(door, given, words):
    if door is hs.Assumed:
        door = functools.partial(door, prior=stats.norm(1, 1))
    with pytest.raises((ValueError, TypeError), match=words) as caught:
        door(**given)
    files = [frame.filename for frame in traceback.extract_tb(caught.value.__traceback__)]
    # the errors of scikit-learn's check_scalar name the argument, what was expected and what came
    assert files[-1].startswith(ROOT) or "sklearn" in files[-1]


@pytest.mark.parametrize("value", ["a", None, [1, 2], 1j])
@pytest.mark.parametrize("argument", ["mean", "sd", "low", "high"])
def test_numbers_of_a_prior(argument, value):
    given = {"mean": 0.0, "sd": 1.0, "low": -1.0, "high": 1.0, argument: value}
    with pytest.raises(TypeError, match=f"{argument} must be a number, got"):
        hs.truncated_normal(**given)
    assert hs.truncated_normal(1, 1, 0, INF).support() == (0, INF)


def fit(**other):
    runs = simulator().run(16, random_state=0)
    given = {"simulation": runs, "surrogate": hs.PolynomialChaos(2), "n_draws": 10}
    model = hs.PowerScaledSurrogate(
        **{**given, "sampler": "importance", "random_state": 0, **other}
    )
    return model.fit(PLACES[1:, None], fall(PLACES[1:], 9.3))


def fit_sources(*sources):
    return hs.MultiSourceSurrogate(*sources, n_draws=10).fit(PLACES[:, None], CURVES[0])


@pytest.mark.parametrize(
    ("door", "words"),
    [
        (lambda: fit(effects=[hs.Trend(["t"])]), "column of Trend must be a name"),
        (lambda: fit(effects=[hs.Trend("t", degree="2")]), "degree of Trend must be an inst"),
        (lambda: fit(effects=[hs.Step("t", before="yes")]), "before of Step must be True or False"),
        (lambda: fit(effects=[hs.Step("t", location=2.0)]), "prior of 'location of Step' must"),
        (lambda: fit(effects=[hs.ParameterDrift(5, "t")]), "parameter of ParameterDrift must"),
        (lambda: fit(effects=[hs.Remainder("big")]), "size of Remainder must be a number"),
        (lambda: fit(effects=[hs.InOutput("step", "y")]), "cause of InOutput must be a cause"),
        (lambda: fit(effects=[hs.InOutput(hs.Step(5), "y")]), "column of Step must be a name"),
        (lambda: fit(likelihood=hs.StudentT("4")), "df must be a number, got '4'"),
        (lambda: fit(likelihood=hs.Binomial([4])), r"trials must be a number, got \[4\]"),
        (lambda: fit(likelihood=hs.CustomLikelihood("normal")), "log_density_function must"),
        (lambda: fit(surrogate=hs.GaussianProcess(kernel=["rbf"])), "kernel must be one of"),
        (lambda: fit(surrogate=hs.GaussianProcess(mean="a")), "mean must be a number, got 'a'"),
        (lambda: fit(sampler=hs.EnsembleSampler(moves="a")), "moves must be None, a move of emcee"),
        (lambda: fit_sources(5), "sources must be a list of"),
        (lambda: fit_sources([hs.Source(5)]), "data of a source must be"),
        (lambda: fit().interval_holds([[1.0]], [95.0], ["a"]), "levels must hold numbers"),
        (lambda: fit().interval_holds([[1.0]], [95.0], [2]), "levels == 2.0, must be < 1"),
        (lambda: fit().predict([[1.0]], return_std="yes"), "return_std must be True or False"),
        *[
            (lambda units=units: fit().summary(units=units), "units must be a dict of names and")
            for units in (5, "t", [], np.zeros((2, 2)), {"t": 5})
        ],
        (lambda: fit().score([[1.0]], []), r"inconsistent numbers of samples|0 sample"),
        (lambda: fit().fit([[1.0], [2.0]], []), r"inconsistent numbers of samples|0 sample"),
        (lambda: scoring.interval_score_scorer(fit(), [[1.0]], [1.0, 2.0]), "the same rows"),
        (lambda: scoring.neg_crps_scorer(fit(), [[1.0]], [1.0, 2.0]), "the same rows"),
        (lambda: hs.sobol_indices(fit(), [[1.0]], after="yes"), "after must be True or False"),
        (lambda: hs.beta_path(5, [[1.0]], [1.0], [0.5]), "model must be an estimator such as"),
        (
            lambda: hs.choose_beta(fit(), PLACES[:, None], CURVES[0], ["a"]),
            "betas must hold numbers",
        ),
        (lambda: hs.choose_beta(fit(), PLACES[:, None], CURVES[0], cv=[1]), "cv must be as in sc"),
        (lambda: hs.refine(5, [[1.0]], [1.0]), "diagnosis must be a DiscrepancyDiagnosis"),
        (
            lambda: hs.AveragedSurrogate(5, [1.0]).fit([[1.0]], [1.0]),
            "estimators must be a list of",
        ),
    ],
)
def test_what_came_and_what_was_expected_of_models(door, words):
    with pytest.raises((ValueError, TypeError), match=words):
        door()


# ---- what is right stays right


def test_what_may_be_given_is_taken():
    frame = table()
    by_name = [["t"], ("t",), frame.columns[:1], np.array(["t"]), iter(["t"]), "t", {"t": 0}.keys()]
    for inputs in by_name:
        assert from_frame(inputs=inputs).input_names == ("t",)
    assert simulator(vectorized=np.True_).vectorized is True
    assert simulator(inputs={"t": np.array([0, 4])}).input_ranges == {"t": (0.0, 4.0)}
    assert hs.Assumed(np.float32(1), stats.norm(1, 1)).value == 1
    seeds = [0, np.int64(0), None, np.random.default_rng(0), np.random.RandomState(0)]
    assert all(run(random_state=seed).n_runs == 4 for seed in seeds)
    assert run(n_runs=np.int64(4), n_jobs=-1).n_runs == 4


# ---- files


def damaged(folder):
    (folder / "a.folder").mkdir()
    for ending in ("csv", "parquet", "nc"):
        (folder / f"folder.{ending}").mkdir()
    (folder / "bad.parquet").write_bytes(b"PAR1 and nothing else")
    (folder / "bad.nc").write_bytes(b"CDF\x01 and nothing else")
    for ending in ("csv", "parquet", "nc"):
        (folder / f"empty.{ending}").write_bytes(b"")


@pytest.mark.parametrize(
    ("path", "error", "words"),
    [
        *((f"missing.{e}", FileNotFoundError, "there is no such file in") for e in ("csv", "nc")),
        ("missing.parquet", FileNotFoundError, r"'missing.parquet' cannot be read: there is no"),
        ("no/such/runs.csv", FileNotFoundError, "the folder 'no/such' does not exist"),
        *((f"folder.{e}", IsADirectoryError, "is a folder") for e in ("csv", "parquet", "nc")),
        ("a.folder", IsADirectoryError, "'a.folder' is a folder: name a file in it"),
        *((f"{w}.parquet", ValueError, "as a Parquet file: it") for w in ("bad", "empty")),
        *((f"{w}.nc", ValueError, "as a NetCDF file: it is damaged") for w in ("bad", "empty")),
        ("empty.csv", ValueError, "the file is empty"),
    ],
)
def test_files_that_cannot_be_read(folder, path, error, words):
    damaged(folder)
    with pytest.raises(error, match=words):
        hs.read_simulation(path, T, G)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_files_that_cannot_be_written(folder, ending):
    runs = data()
    with pytest.raises(FileNotFoundError, match=r"the folder '.*no/such' does not exist. Make it"):
        runs.save(f"no/such/runs.{ending}")
    (folder / f"there.{ending}").mkdir()
    with pytest.raises(IsADirectoryError, match="is a folder: name a file in it"):
        runs.save(f"there.{ending}")
    with pytest.raises(ValueError, match="path must be on this machine, got the address 's3://"):
        runs.save(f"s3://bucket/runs.{ending}")
    with pytest.raises(TypeError, match=r"path must be text or a pathlib.Path, got 5"):
        runs.save(5)
    assert runs.save(folder / f"runs.{ending}") is None
    assert hs.read_simulation(f"runs.{ending}", T, G).y.tolist() == runs.y.tolist()


def test_a_file_is_whole_or_what_it_was(folder, monkeypatch):
    data().save("runs.csv")
    before = (folder / "runs.csv").read_bytes()

    def full(self, path, **_):
        Path(path).write_text("t,grav")
        raise OSError("no space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_csv", full)
    with pytest.raises(OSError, match="no space left"):
        data().save("runs.csv")
    assert (folder / "runs.csv").read_bytes() == before
    assert os.listdir(folder) == ["runs.csv"]


@pytest.mark.parametrize(
    "text",
    ["run,t\n1,2\n", "run,t,gravity,y,error,seconds,last\n1,a,2,3,,0,1\n", "last\n1\n", "\0\n"],
)
def test_a_damaged_store(folder, text):
    run_one_by_one(store="store")
    (folder / "store" / "runs.csv").write_text(text)
    with pytest.raises(ValueError, match=r"runs.csv is damaged .*: name a new folder as store"):
        run_one_by_one(store="store")


def test_a_store_that_is_a_file(folder):
    (folder / "file").write_text("")
    with pytest.raises(FileExistsError, match="store must name a folder, and 'file' cannot be one"):
        run_one_by_one(store="file")
    (folder / "folder").mkdir()
    (folder / "folder" / "about.json").write_text("[1, 2]")
    with pytest.raises(ValueError, match=r"about.json is broken"):
        run_one_by_one(store="folder")


# ---- addresses


@pytest.fixture
def address(folder, monkeypatch):
    """A server on this machine, the address of its folder and the requests that came."""
    table().to_csv("runs.csv", index=False)
    table().to_parquet("runs.parquet", index=False)
    asked = []

    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            asked.append(self.path)

    monkeypatch.setenv("no_proxy", "127.0.0.1")
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}", asked
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.mark.parametrize("file", ["runs.csv", "runs.parquet", "runs.csv?version=2"])
def test_addresses_are_fetched_only_when_asked_for(address, file):
    url, asked = address
    with pytest.raises(ValueError, match=r"path must be on this machine, got .*allow_urls=True"):
        hs.read_simulation(f"{url}/{file}", T, G)
    assert asked == []
    runs = hs.read_simulation(f"{url}/{file}", T, G, allow_urls=True)
    assert runs.y.tolist() == table().y.tolist()
    assert asked == [f"/{file}"]


def test_addresses_that_do_not_answer(address):
    url, _ = address
    with pytest.raises(OSError, match=r"missing.csv cannot be fetched: HTTP Error 404"):
        hs.read_simulation(f"{url}/missing.csv", T, G, allow_urls=True)
    with pytest.raises(TypeError, match="allow_urls must be True or False, got 'yes'"):
        hs.read_simulation("runs.csv", T, G, allow_urls="yes")


@pytest.mark.parametrize(
    "url",
    [
        "s3://bucket/runs.parquet",
        "ftp://host/a.csv",
        "file:///a.csv",
        "simplecache::s3://bucket/runs.csv",
        "http://host/runs.nc",
    ],
)
def test_no_address_is_opened_unasked(url):
    with pytest.raises(ValueError, match="path must be on this machine, got the address"):
        hs.read_simulation(url, T, G)


# ---- pickles


LAMBDA = lambda t, gravity: 100 - gravity / 2 * t**2  # noqa: E731


def lambda_model():
    runs = hs.Simulator(LAMBDA, T, G).run(16, random_state=0)
    return hs.PowerScaledSurrogate(
        runs, surrogate=hs.PolynomialChaos(2), n_draws=50, sampler="importance", random_state=0
    )


@pytest.mark.parametrize(
    "thing",
    [
        lambda: hs.Simulator(LAMBDA, T, G),
        lambda: hs.Simulator(functools.partial(LAMBDA), T, G),
        lambda: lambda_model().simulation,
        lambda_model,
        lambda: hs.DiscrepancyDiagnosis(lambda_model()),
        lambda: hs.DiscrepancyDiagnosis(hs.AveragedSurrogate([lambda_model()], [1.0])),
        ode,
        lambda: hs.CustomLikelihood(lambda y, eta, sigma: -((y - eta) ** 2)),
        lambda: hs.ParametricSurrogate(lambda X, omega, constants: X[:, 0], {}),
    ],
)
def test_the_error_of_a_pickle_says_to_name_the_function(thing, folder):
    thing = thing()
    for write in (pickle.dumps, functools.partial(joblib.dump, filename="file")):
        with pytest.raises(pickle.PicklingError, match=r"is a lambda.*write it as `def name"):
            write(thing)


def test_a_function_inside_another_one_has_no_name_for_pickle():
    def inner(t, gravity):
        return gravity * t

    words = r"is 'test_a_function_.*<locals>.inner', and pickle keeps a function by the name"
    with pytest.raises(pickle.PicklingError, match=words):
        pickle.dumps(hs.Simulator(inner, T, G))


def test_copies_and_processes_take_any_function():
    """A lambda goes to other processes by cloudpickle, and a copy is made of none."""
    import copy

    model = lambda_model()
    X, y = PLACES[1:, None], fall(PLACES[1:], 9.3)
    expected = model.fit(X, y).predict(X)
    for again in (copy.deepcopy(model), cloudpickle.loads(cloudpickle.dumps(model))):
        np.testing.assert_allclose(again.predict(X), expected)
    assert clone(model).simulation is model.simulation
    buffer = io.BytesIO()
    pickle.dump(simulator().run(4, random_state=0), buffer)  # a named one
    assert pickle.loads(buffer.getvalue()).simulator.function is fall


def test_processes_that_cannot_take_a_function():
    lock = threading.Lock()

    def locked(t, gravity):
        with lock:
            return gravity * t

    simulation = hs.Simulator(locked, T, G, vectorized=False)
    with pytest.raises(pickle.PicklingError, match=r"n_jobs=2.*'locked'.*top of a module"):
        simulation.run(4, random_state=0, n_jobs=2)


# ---- NaN


@pytest.mark.parametrize(
    ("score", "arguments", "words"),
    [
        (scoring.elpd, ([-1.0, NAN],), "must hold no NaN: 1 of 2 .*in row 2"),
        (scoring.elpd, ([-1.0, INF],), "log_predictive_density must be below infinity"),
        (scoring.elpd, ([],), r"got log_predictive_density \(0,\)"),
        (scoring.elpd, ([[-1.0]],), r"got log_predictive_density \(1, 1\)"),
        (scoring.rmse, ([[0.0, NAN]], [0.0, 1.0]), "draws must be finite"),
        (scoring.rmse, ([[0.0, 1.0]], [0.0, NAN]), "truth must be finite.*nan, in row 2"),
        (scoring.rmse, ([[0.0, 1.0]], [0.0]), r"draws must have shape \(n_draws, 1\)"),
        (scoring.rmse, (np.zeros((2, 0)), []), r"got truth \(0,\)"),
        (scoring.coverage, ([NAN], [0.0], [1.0]), "y must hold no NaN"),
        (scoring.coverage, ([0.5], [NAN], [1.0]), "lower must hold no NaN"),
        (scoring.interval_width, ([0.0], [NAN]), "upper must be finite"),
        (scoring.interval_width, ([], []), r"got lower \(0,\), upper \(0,\)"),
        (scoring.interval_score, ([0.0], [0.0], [NAN]), "upper must be finite"),
        (scoring.interval_score, ([0.0], [0.0], [1.0], "a"), "level must be a number, got 'a'"),
        (scoring.paired_difference, ([NAN], [0.0]), "after must hold no NaN"),
        (scoring.paired_difference, ([], []), r"got after \(0,\), before \(0,\)"),
        (scoring.paired_difference, ([0.0, 1.0], [0.0]), r"got after \(2,\), before \(1,\)"),
    ],
)
def test_scores_of_nan_and_of_nothing(score, arguments, words):
    with pytest.raises((ValueError, TypeError), match=words):
        score(*arguments)


def test_scores_of_rows_that_are_impossible():
    assert scoring.elpd([-1.0, -INF])[0] == -INF
    assert np.isnan(scoring.elpd([-1.0, -INF])[1])
    found = scoring.paired_difference([-1.0, -INF], [-3.0, -INF])
    # differences of 2 and 0: mean 1, standard error 1
    assert (found.difference, found.standard_error) == (1.0, pytest.approx(1.0))
    assert scoring.paired_difference([-1.0], [-INF]).difference == INF
    assert scoring.coverage([1.0, 2.0], [-INF, 3.0], [INF, INF]) == 0.5


def logarithm(t, slope):
    with np.errstate(all="ignore"):
        return slope * np.log(t)


@pytest.fixture(scope="module")
def exact():
    """A simulation that has no output before t = 0, as its own surrogate."""
    simulation = hs.Simulator(logarithm, {"t": (0.1, 4)}, {"slope": stats.norm(1, 0.2)})
    t = np.linspace(0.2, 3.9, 20)
    y = 1.1 * np.log(t) + np.random.default_rng(0).normal(0, 0.1, 20)
    model = hs.PowerScaledSurrogate(
        simulation, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    )
    return model.fit(t[:, None], y)


def test_rows_without_a_prediction_have_a_warning(exact):
    X = [[1.0], [-1.0]]
    for ask in (
        exact.predict,
        exact.predict_interval,
        exact.sample_predictive_mean,
        exact.sample_posterior_predictive,
    ):
        with pytest.warns(hs.FailedRunsWarning, match="^At 1 of 2 rows every draw fails"):
            found = np.asarray(ask(X))
        assert np.isnan(found[..., 1]).all()
        assert np.isfinite(found[..., 0]).all()


def test_a_row_that_no_draw_predicts_is_impossible(exact):
    with pytest.warns(hs.FailedRunsWarning, match="^At 1 of 2 rows every draw fails"):
        density = exact.log_predictive_density([[1.0], [-1.0]], [0.0, 0.0])
    assert np.isfinite(density[0])
    assert density[1] == -INF
    with pytest.warns(hs.FailedRunsWarning):  # no score leaves it out
        assert exact.score([[1.0], [-1.0]], [0.0, 0.0]) == -INF


@pytest.mark.parametrize("bad", [NAN, INF])
@pytest.mark.parametrize(
    "method", ["predict", "predict_interval", "sample_predictive_mean", "log_predictive_density"]
)
def test_predictions_at_nan(exact, method, bad):
    y = {"y": [0.0, 0.0]} if method == "log_predictive_density" else {}
    with pytest.raises(ValueError, match=r"contains (NaN|infinity)"):
        getattr(exact, method)([[1.0], [bad]], **y)
