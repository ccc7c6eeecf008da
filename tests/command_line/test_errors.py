"""Error bars on the command line."""

import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

import hybridsurrogate as hs
from hybridsurrogate.command_line.main import main
from hybridsurrogate.effects.registry import kinds


def test_a_column_of_errors_is_taken(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(0)
    t = np.linspace(0, 10, 20)
    runs = pd.DataFrame({"t": random.uniform(0, 10, 60), "rate": random.uniform(0.1, 0.5, 60)})
    runs["y"] = np.exp(-runs["rate"] * runs["t"])
    runs.to_csv("runs.csv", index=False)
    error = np.where(t < 5, 0.001, 0.1)
    y = np.exp(-0.25 * t) + error * random.standard_normal(20)
    pd.DataFrame({"t": t, "error": error, "y": y}).to_csv("measured.csv", index=False)
    words = "--simulation runs.csv --inputs t --parameters rate --output y --errors error"
    words = f"{words} --noise scaled --surrogate polynomial-chaos --degree 5 --beta 0.9"
    assert main(["fit", "measured.csv", *words.split(), "--json", "-"]) == 0
    names = [one["name"] for one in json.loads(capsys.readouterr().out)["estimates"]]
    assert names == ["rate", "sigma", "error_factor"]
    assert (
        main(["fit", "measured.csv", *words.replace("--errors error", "--errors eror").split()])
        != 0
    )


def test_limits_and_rounding_are_taken(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(0)
    Path("falling_line.py").write_text("def line(t, rate):\n    return 10 - rate * t\n")
    t = np.linspace(0, 10, 40)
    y = np.maximum(np.round(10 - 0.8 * t + 0.3 * random.standard_normal(40), 1), 5.0)
    pd.DataFrame({"t": t, "y": y}).to_csv("measured.csv", index=False)
    words = "--simulation falling_line.py:line --inputs t --prior rate=0.5,0.5 --output y"
    words = f"{words} --below 5 --rounded 0.1"
    assert main(["fit", "measured.csv", *words.split(), "--json", "-"]) == 0
    out = capsys.readouterr().out
    rate, _ = json.loads(out[out.index("{") :])["estimates"]
    assert abs(rate["mean"] - 0.8) < 3 * rate["sd"]
    assert main(["fit", "measured.csv", *words.replace("below 5", "below 30").split()]) != 0
    assert "None of the 40 measured values" in capsys.readouterr().err


def test_a_column_holds_the_limit_of_each_row(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    random = np.random.default_rng(0)
    Path("falling_slope.py").write_text("def line(t, rate):\n    return 10 - rate * t\n")
    t = np.linspace(0, 10, 40)
    y = 10 - 0.8 * t + 0.3 * random.standard_normal(40)
    limit = np.where(t > 5, random.choice([3.0, 5.0], 40), np.nan)
    frame = pd.DataFrame({"t": t, "y": np.fmax(y, limit), "limit": limit})
    frame.to_csv("measured.csv", index=False)
    words = "--simulation falling_slope.py:line --inputs t --prior rate=0.5,0.5 --output y"
    fit = ["fit", "measured.csv", *words.split(), "--below", "limit", "--save", "fit.hs"]
    assert main([*fit, "--json", "-"]) == 0
    out = capsys.readouterr().out
    rate, _ = json.loads(out[out.index("{") :])["estimates"]
    assert abs(rate["mean"] - 0.8) < 3 * rate["sd"]
    # new rows have limits that no measured row had
    pd.DataFrame({"t": [1.0, 9.0, 9.0], "limit": [4.0, 4.0, np.nan]}).to_csv("new.csv")
    for limits in ([], ["--below", "limit"]):
        assert main(["predict", "fit.hs", "new.csv", "--table", "predicted.csv", *limits]) == 0
        low, high = (pd.read_csv("predicted.csv")[f"y_{end}"] for end in ("low", "high"))
        assert low[0] > 7
        assert high[2] < 4
        assert (low[1] == high[1] == 4.0) == bool(limits)
    # of two outputs one limit each
    Path("two_slopes.py").write_text("def lines(t, rate):\n    return 10 - rate * t, rate * t\n")
    frame.drop(columns="limit").assign(z=0.8 * t + 0.1 * y).to_csv("two.csv", index=False)
    two = words.replace("falling_slope.py:line", "two_slopes.py:lines") + " z"
    assert main(["fit", "two.csv", *two.split(), "--save", "two.hs"]) == 0
    predict = ["predict", "two.hs", "new.csv", "--table", "predicted.csv", "--below"]
    assert main([*predict, "limit,1.5"]) == 0
    low, high = (pd.read_csv("predicted.csv")[[f"y_{end}", f"z_{end}"]] for end in ("low", "high"))
    assert low["y_low"][1] == 4.0
    assert low["y_low"][2] < 4  # the third row has no limit
    assert low["z_low"][0] == 1.5
    assert main([*predict, "limit"]) == 2
    assert "each of the outputs y, z" in capsys.readouterr().err
    assert main(["fit", "two.csv", *two.split(), "--below", "1,2"]) == 2
    assert "limits are of one output" in capsys.readouterr().err
    assert main(["predict", "fit.hs", "new.csv", "--below", "limitt"]) == 2
    assert "nor a column of new.csv" in capsys.readouterr().err
    assert main(["fit", "measured.csv", *words.split(), "--below", "limitt"]) == 2
    assert "neither a number nor a column" in capsys.readouterr().err
    frame.assign(limit=30.0).to_csv("measured.csv", index=False)
    assert main(["fit", "measured.csv", *words.split(), "--below", "limit"]) == 2
    assert "None of the 40 values lies between its limits" in capsys.readouterr().err


T, NAMES = np.linspace(0, 10, 25), ["u", "v", "w"]
CORRELATION = np.array([[1.0, 0.7, -0.3], [0.7, 1.0, 0.1], [-0.3, 0.1, 1.0]])


def falling(t, rate):
    return 10 - rate * t, rate * t, 5 + 0 * rate * t


@pytest.fixture
def correlated(tmp_path, monkeypatch):
    """Return what is typed for a number of outputs whose errors are correlated, and their sd."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    sd = np.where(T < 5, 0.2, 0.5)[:, None] * [1.0, 0.5, 2.0]
    errors = np.random.default_rng(3).multivariate_normal(np.zeros(3), CORRELATION, len(T))
    y = np.column_stack(np.broadcast_arrays(*falling(T, 0.8))) + sd * errors
    frame = pd.DataFrame({"t": T})
    for k, name in enumerate(NAMES):
        frame[name], frame[f"sd_{name}"] = y[:, k], sd[:, k]
    frame.loc[4, ["v", "sd_v"]] = np.nan
    frame.to_csv("measured.csv", index=False)

    def typed(k, *more, errors=True):
        falls = ", ".join(["10 - rate * t", "rate * t", "5 + 0 * rate * t"][:k])
        Path(f"fall_{k}.py").write_text(f"def fall(t, rate):\n    return {falls}\n")
        words = f"measured.csv --simulation fall_{k}.py:fall --inputs t --prior rate=0.5,0.5"
        named = [f"sd_{name}" for name in NAMES[:k]] if errors else []
        option = ["--errors", *named] if errors else []
        return [*words.split(), "--output", *NAMES[:k], *option, *more]

    return typed, frame, sd


def estimates(capsys):
    out = capsys.readouterr().out
    return {one["name"]: one for one in json.loads(out[out.index("{") :])["estimates"]}


@pytest.mark.parametrize(("k", "text"), [(2, "0.7"), (3, "0.7,-0.3,0.1")])
def test_known_correlations_of_outputs_are_covariances(correlated, capsys, k, text):
    typed, frame, sd = correlated
    options = "--noise", "known", f"--error-correlation={text}", "--json", "-"
    assert main(["fit", *typed(k, *options)]) == 0
    found = estimates(capsys)["rate"]
    simulator = hs.Simulator(
        lambda t, rate: falling(t, rate)[:k],
        {"t": (0, 10)},
        {"rate": norm(0.5, 0.5)},
        output=NAMES[:k],
    )
    covariance = CORRELATION[:k, :k] * sd[:, :k, None] * sd[:, None, :k]
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), noise="known", random_state=0
    )
    # further columns of a file are columns that the simulation ignores
    rows = frame.drop(columns=[*NAMES[:k], *(f"sd_{name}" for name in NAMES[:k])])
    rows = rows.dropna(axis="columns")
    model.fit(rows, frame[NAMES[:k]], y_err=covariance)
    expected = model.summary().loc["rate"]
    assert found["mean"] == pytest.approx(expected["mean"], rel=1e-6)
    assert found["sd"] == pytest.approx(expected["sd"], rel=1e-6)


@pytest.mark.parametrize("errors", [True, False])
def test_a_correlation_of_outputs_is_estimated(correlated, capsys, errors):
    typed, frame, _ = correlated
    frame.drop(index=4).to_csv("measured.csv", index=False)
    options = "--error-correlation", "estimated", "--json", "-"
    assert main(["fit", *typed(2, *options, errors=errors)]) == 0
    found = estimates(capsys)["correlation"]
    assert abs(found["mean"] - 0.7) < 3 * found["sd"]


@pytest.mark.parametrize("text", ["0.7", "estimated"])
def test_a_diagnosis_takes_correlated_errors(correlated, capsys, text):
    typed, frame, _ = correlated
    frame[-5:].to_csv("later.csv", index=False)
    frame[:-5].to_csv("measured.csv", index=False)
    others = [kind for kind in kinds() if kind not in ("offset", "trend")]
    options = "--error-correlation", text, "--no-folds", "--new", "later.csv", "--json", "out.json"
    assert main(["diagnose", *typed(2, *options, "--exclude", *others)]) == 0
    assert json.loads(Path("out.json").read_text())["verdict"] == "adequate"
    assert "Since then" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("k", "errors", "option", "message"),
    [
        (2, True, "--error-correlation=high", "neither numbers nor the word estimated"),
        (2, True, "--error-correlation=1", "lies between -1 and 1"),
        (2, True, "--error-correlation=nan", "lies between -1 and 1"),
        (3, True, "--error-correlation=0.9,-0.9,0.9", "no 3 outputs have such"),
        (3, True, "--error-correlation=0.9,0.1", "3 numbers, of u and v, u and w, v and w"),
        (2, False, "--error-correlation=0.7", "needs --errors, a column for each of u, v"),
        (1, True, "--error-correlation=0.7", "--output names one"),
        (1, True, "--error-correlation=estimated", "--output names one"),
    ],
)
def test_correlations_that_cannot_be_are_refused(correlated, capsys, k, errors, option, message):
    typed, *_ = correlated
    assert main(["fit", *typed(k, option, errors=errors)]) == 2
    assert message in capsys.readouterr().err


def test_errors_must_be_positive_and_a_method_has_no_estimated_correlation(correlated, capsys):
    typed, frame, _ = correlated
    options = "--error-correlation", "estimated", "--method", "predictive-weighting", "--runs", "20"
    assert main(["fit", *typed(2, *options)]) == 2
    assert "--method power-scaling" in capsys.readouterr().err
    frame.assign(sd_u=-0.2).to_csv("measured.csv", index=False)
    assert main(["fit", *typed(2, "--error-correlation", "0.7")]) == 2
    assert "the errors in ['sd_u', 'sd_v'] must be positive" in capsys.readouterr().err
