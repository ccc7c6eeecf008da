"""Each rival does its work, fairly asked; the table counts right."""

from __future__ import annotations

import numpy as np
import pytest
from alternatives import methods, symbolic
from alternatives.__main__ import main
from alternatives.calibration import Measurements, calibrate, with_term
from alternatives.features import features
from alternatives.judging import ask, draws_the_truth
from alternatives.kernel_over import Over
from alternatives.methods import METHODS
from alternatives.run import Task, read, run_into, tasks
from alternatives.table import counts, table
from alternatives.toolbox import _log_p_value
from hidden_effects.cases import make_case, rms
from scipy import stats
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from hybridsurrogate import effects

# plain to see, and a word that the method has
PLAIN = {
    "hybridsurrogate": "periodic",
    "hybridsurrogate-nine": "step",
    "by-hand": "gain",
    "toolbox": "wrong-constant",
    "structure": "bump",
    "pysindy": "periodic",
    "pysindy-default": "missing-input",
    "gplearn": "offset",
}


class Sealed:
    """A case of which only the measurements may be seen."""

    def __init__(self, case):
        self.simulator, self.X, self.y = case.simulator, case.X, case.y

    def __getattr__(self, name):
        raise AssertionError(f"A method looked at {name!r}.")


@pytest.fixture(autouse=True)
def _few_formulas(monkeypatch):
    # for what is plain to see; the comparison breeds more
    monkeypatch.setattr(symbolic, "_POPULATION", 100)
    monkeypatch.setattr(symbolic, "_GENERATIONS", 4)


def able(name):
    if METHODS[name].trouble:
        pytest.skip(METHODS[name].trouble)
    return METHODS[name]


def measured(kind="none", size=0.0, seed=0, **given):
    case = make_case(kind, size, seed, **given)
    return Measurements(case.simulator, case.X, case.y)


# ------------------------------------------------------------------------------------ methods


@pytest.mark.parametrize("name", METHODS)
def test_what_is_plain_to_see(name):
    method = able(name)
    case = make_case(PLAIN[name], 8.0, 0)
    found = ask(method, Sealed(case), 0)
    assert found["kind"] == PLAIN[name]
    assert found["kind"] in method.words
    plain = calibrate(Measurements(case.simulator, case.X, case.y), 0)
    better, before = rms(found["predict"](case.X) - case.truth["mu"]), plain.residual
    assert better < 0.5 * rms(before)


@pytest.mark.parametrize("name", sorted(set(METHODS) - {"hybridsurrogate", "pysindy-default"}))
def test_nothing_where_nothing_is(name):
    case = make_case("none", 0.0, 0)
    found = ask(able(name), Sealed(case), 0)
    assert found["kind"] == "none"
    assert found["predict"](case.X_out).shape == (100,)


def test_a_sealed_case_is_sealed():
    with pytest.raises(AssertionError, match="looked at 'truth'"):
        _ = Sealed(make_case("none", 0.0, 0)).truth


def test_an_absent_library_is_a_reason(monkeypatch, tmp_path):
    monkeypatch.setattr(methods, "find_spec", lambda name: None)
    path = tmp_path / "alternatives.csv"
    assert list(run_into(path, ["pysindy", "gplearn"], tasks([2], 1, 1, 0))) == []
    lines = table([], ["pysindy", "gplearn"]).splitlines()
    assert "skipped: pysindy is not installed (extra `bench`)" in lines[2]
    assert "skipped: gplearn is not installed (extra `bench`)" in lines[3]


# -------------------------------------------------------------------------------------- parts


def test_calibration_leaves_nothing_to_the_parameters():
    calibrated = calibrate(measured("none", 0.0, 1, simulation="heat_transfer"), 0)
    along = calibrated.followed.T @ calibrated.residual
    assert np.abs(along).max() < 1e-3 * np.linalg.norm(calibrated.residual)
    np.testing.assert_allclose(calibrated.beside(calibrated.followed), 0.0, atol=1e-12)


def test_a_term_and_the_parameters_find_their_places():
    case = make_case("trend", 4.0, 0)
    x = case.simulator.input_names.index(case.truth["target"])
    exact = Measurements(case.simulator, case.X, case.truth["mu"])
    refitted = with_term(calibrate(exact, 0), lambda X: np.column_stack([np.ones(len(X)), X[:, x]]))
    # parameters and line share what both can do, so out of range there is one answer
    np.testing.assert_allclose(refitted(case.X), case.truth["mu"], atol=1e-3 * np.ptp(exact.y))


def test_features_are_scaled_by_the_measured_rows():
    data = measured("trend", 2.0, 3, simulation="conversion")
    columns = features(calibrate(data, 0))
    assert columns.words == ("trend", "trend", "missing-input", "gain")
    X = columns(data.X)
    np.testing.assert_allclose(X[:, :2].min(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(X[:, :2].max(axis=0), 1.0)
    np.testing.assert_allclose(X[:, 2].mean(), 0.0, atol=1e-12)
    output = columns.calibrated.output
    np.testing.assert_allclose(X[:, 3], output / output.std())
    np.testing.assert_allclose(X[:, 2:].std(axis=0), 1.0)


def test_the_toolbox_tests_as_nested_regressions_do():
    calibrated = calibrate(measured("trend", 1.0, 0, simulation="colony"), 0)
    y, small = calibrated.residual, calibrated.followed
    line = np.column_stack([np.ones(len(y)), calibrated.problem.X[:, 0]])
    large = np.column_stack([small, line])
    rss = [
        np.sum((y - columns @ np.linalg.lstsq(columns, y)[0]) ** 2) for columns in (small, large)
    ]
    ratio = (rss[0] - rss[1]) / 2 / (rss[1] / (len(y) - 4))
    expected = stats.f.logsf(ratio, 2, len(y) - 4)
    assert _log_p_value(calibrated, line[None], np.empty((len(y), 0))) == pytest.approx(expected)


def test_the_price_of_many_looks():
    """Twenty orthogonal curves are twenty looks, and one curve twenty times is one."""
    # of many rows, or the shares that the curves explain would not be independent
    calibrated = calibrate(measured(n_rows=400), 0)
    rng = np.random.default_rng(0)
    noise = calibrated.beside(rng.normal(size=(400, 3000)))
    free = np.linalg.qr(calibrated.beside(rng.normal(size=(400, 20))))[0]
    many = free.T[:, :, None]
    ratios = [
        np.exp(_log_p_value(calibrated, curves, noise) - best)
        for curves, best in (
            (many, min(_log_p_value(calibrated, one[None], noise) for one in many)),
            (many[[0] * 20], _log_p_value(calibrated, many[:1], noise)),
        )
    ]
    # up to the smallest p-value itself, and to scatter over 3000 draws
    assert ratios[0] == pytest.approx(20, rel=0.15)
    assert ratios[1] == pytest.approx(1, rel=0.1)


def test_a_kernel_over_some_columns():
    X = np.random.default_rng(0).normal(size=(5, 3))
    inner = ConstantKernel(2.0) * RBF(0.7)
    kernel = Over(inner, (1,)) + Over(ConstantKernel(1.0, "fixed"), (0, 2))
    np.testing.assert_allclose(kernel(X), inner(X[:, [1]]) + 1)
    np.testing.assert_allclose(kernel.diag(X), 3.0)
    assert kernel.is_stationary()
    value, gradient = kernel(X, eval_gradient=True)
    for k in range(2):
        moved = kernel.theta.copy()
        moved[k] += 1e-6
        change = (kernel.clone_with_theta(moved)(X) - value) / 1e-6
        np.testing.assert_allclose(gradient[..., k], change, atol=1e-5)


# -------------------------------------------------------------------------------------- judging


def test_a_cause_without_a_word_may_draw_the_same_curve():
    case = make_case("trend", 2.0, 0)
    name = case.truth["target"]
    assert draws_the_truth(case, effects.Trend(name))
    assert not draws_the_truth(case, effects.Bump(name))
    assert draws_the_truth(make_case("ramp", 2.0, 1), effects.Ramp(ramp_target(1)))
    assert not draws_the_truth(case, effects.Noise(name))


def ramp_target(seed):
    return make_case("ramp", 2.0, seed).truth["target"]


def test_the_same_command_goes_on(tmp_path, capsys):
    path = tmp_path / "alternatives.csv"
    given = ["--sizes", "--seeds", "0", "--nulls", "2", "--methods", "toolbox"]
    main([*given, "--out", str(path)])
    assert "Cases: 2 in which nothing is hidden." in capsys.readouterr().out
    rows = read(path)
    assert {row["seed"] for row in rows} == {30_000, 30_001}
    assert list(run_into(path, ["toolbox"], tasks([], 0, 2, 30_000))) == []
    with path.open("a") as file:
        file.write("toolbox,none,0.0,3")  # a run that was cut short
    main(["--from-csv", str(path), "--methods", "toolbox"])
    assert "| toolbox of tests | 9 of 9 |" in capsys.readouterr().out
    assert read(path) == rows
    main(["--from-csv", str(tmp_path / "absent.csv")])
    assert "absent.csv holds no results." in capsys.readouterr().out


def test_the_table_counts():
    def row(kind, size, found, same=None, ratio=0.5, seed=0):
        exact = kind == found
        counted = {"exact": exact, "equivalent": exact if same is None else same, "ratio": ratio}
        asked = {"method": "pysindy", "kind": kind, "size": size, "seed": seed, "found": found}
        return asked | counted | {"seconds": 0.25}

    rows = [
        row("trend", 1.0, "trend", ratio=0.1),
        row("offset", 1.0, "trend", same=True, ratio=0.2),
        row("step", 1.0, "periodic", ratio=np.inf),
        row("bump", 1.0, "none", ratio=1.0),
        row("trend", 4.0, "none", ratio=1.0),
        row("none", 0.0, "none"),
        row("none", 0.0, "none", seed=1),
        row("none", 0.0, "trend", seed=2),
    ]
    cells = table(rows, ["pysindy"]).splitlines()[2].split(" | ")
    assert cells[1:] == [
        "4 of 9",
        "25 / 0 %",
        "50 / 0 %",
        "100 / 0 %",
        "33 % of 3",
        "0.600 / 1.000",
        "- / -",
        "0.2 |",
    ]
    # twice and eight times the diagnosis's error are four times it; a case of its own tells nothing
    ours = [
        row("trend", 1.0, "trend", ratio=0.05) | {"method": "hybridsurrogate"},
        row("offset", 1.0, "offset", ratio=0.025) | {"method": "hybridsurrogate"},
        row("gain", 1.0, "gain", ratio=0.9) | {"method": "hybridsurrogate"},
    ]
    lines = table([*rows, *ours], ["hybridsurrogate", "pysindy"]).splitlines()
    assert lines[2].split(" | ")[-2] == "1.00 / -"
    assert lines[3].split(" | ")[-2] == "4.00 / -"
    assert counts(rows) == "Cases: 4 of size 1, 1 of size 4, 3 in which nothing is hidden."


def test_tasks_by_seed():
    listed = tasks([1, 2], n_seeds=1, n_nulls=2, first_seed=7)
    assert len(listed) == 2 * 9 + 2
    assert listed[-2:] == [Task("none", 0.0, 7), Task("none", 0.0, 8)]
