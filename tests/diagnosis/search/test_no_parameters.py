"""Simulations without unknown parameters are diagnosed like others."""

import numpy as np
import pandas as pd
import pytest

import hybridsurrogate as hs
from hybridsurrogate.command_line.main import main


def line(t):
    return 3 + 0.5 * t


SIMULATOR = hs.Simulator(line, {"t": (0, 40)})
RUNS = hs.SimulationData(
    np.linspace(0, 40, 41), None, line(np.linspace(0, 40, 41)), inputs={"t": (0, 40)}
)
T = np.linspace(0, 40, 30)
NOISE = 0.1 * np.random.default_rng(0).standard_normal(30)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("simulation", "surrogate"),
    [
        (SIMULATOR, hs.ExactSurrogate()),
        (RUNS, hs.PolynomialChaos()),
        (RUNS, hs.Kriging()),
        (RUNS, hs.GaussianProcess()),
    ],
    ids=["simulation", "terms", "kriging", "process"],
)
@pytest.mark.parametrize("hidden", [0.0, 0.5])
def test_a_step_is_found_and_nothing_where_nothing_is(simulation, surrogate, hidden):
    model = hs.PowerScaledSurrogate(simulation, surrogate, n_draws=200, random_state=0)
    y = line(T) + hidden * (T > 22) + NOISE
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=3, random_state=0).fit(T[:, None], y)
    assert diagnosis.best_cause_.kind == ("step" if hidden else "none")
    assert "Is something wrong?" in str(diagnosis.report(full=True))


@pytest.mark.slow
def test_the_command_line_without_parameters(tmp_path, capsys):
    pd.DataFrame({"t": RUNS.X[:, 0], "y": RUNS.y}).to_csv(tmp_path / "runs.csv", index=False)
    pd.DataFrame({"t": T, "y": line(T) + 0.5 + NOISE}).to_csv(tmp_path / "data.csv", index=False)
    given = ["diagnose", str(tmp_path / "data.csv"), "--simulation", str(tmp_path / "runs.csv")]
    given += ["--inputs", "t", "--output", "y", "--report", str(tmp_path / "report.html")]
    given += ["--jobs", "1"]
    assert main(given) == 0
    assert "offset" in capsys.readouterr().out
