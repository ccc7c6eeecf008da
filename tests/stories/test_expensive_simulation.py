"""A simulation that is known from runs alone, each of them a curve."""

import json

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import qmc, uniform

import hybridsurrogate as hs
from hybridsurrogate.cli import main

TIMES = np.linspace(0, 20, 300)
MEASURED = np.linspace(0.3, 18, 60)


def design(ranges, n, seed):
    return qmc.scale(qmc.LatinHypercube(len(ranges), seed=seed).random(n), *np.transpose(ranges))


@pytest.mark.parametrize("seed", [0, 1])
def test_a_step_beside_an_oscillation_that_80_runs_tell(seed):
    ranges = [(1, 3), (0.05, 0.3), (0.5, 1.5)]

    def outputs(t, points):
        a, k, w = points.T[:, :, None]
        return a * np.exp(-k * t) * np.cos(w * t) + 0.3 * a

    points = design(ranges, 80, seed)
    priors = {
        name: uniform(low, high - low) for name, (low, high) in zip("akw", ranges, strict=True)
    }
    simulation = hs.SimulationData.from_curves(
        points, outputs(TIMES, points), along={"t": TIMES}, parameters=priors
    )
    y = outputs(MEASURED, np.array([[2.0, 0.12, 1.0]]))[0] + 0.2 * (MEASURED > 6)
    y += 0.05 * np.random.default_rng(seed).normal(size=60)
    model = hs.PowerScaledSurrogate(simulation, surrogate=hs.Kriging(), random_state=0)
    found = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(MEASURED[:, None], y)
    assert (found.verdict_, found.best_cause_.kind) == ("named", "step")
    _, low, high = found.best_cause_.estimates["location"]
    assert low < 6.3
    assert high > 6.0  # the rows around the step are at 6.0 and 6.3
    _, low, high = found.best_cause_.estimates["amplitude"]
    assert low < 0.2 < high


def level(t, q, c, h0, leak=0.0):
    """Return the level of a tank that is filled at a rate q and drains by c sqrt(h)."""

    def rate(time, h):
        return q - (c + leak * (time > 6)) * np.sqrt(np.maximum(h, 0))

    return solve_ivp(rate, (0, 20), [h0], t_eval=t, max_step=0.1, rtol=1e-8).y[0]


@pytest.fixture(scope="module")
def tank(tmp_path_factory):
    """A folder with 80 runs of 300 times in a csv file."""
    folder = tmp_path_factory.mktemp("tank")
    points = design([(0.1, 0.5), (0.1, 0.5), (0.5, 2)], 80, 0)
    frame = pd.DataFrame(
        {
            "t": np.tile(TIMES, 80),
            **dict(zip(("q", "c", "h0"), np.repeat(points, 300, axis=0).T, strict=True)),
            "h": np.concatenate([level(TIMES, *point) for point in points]),
        }
    )
    frame.to_csv(folder / "runs.csv", index=False)
    return folder


def measured_level(leak):
    noise = 0.02 * np.random.default_rng(0).normal(size=60)
    return level(MEASURED, 0.3, 0.28, 1.5, leak) + noise


def test_a_tank_without_a_leak_is_adequate_by_the_command_line(tank, capsys):
    table = pd.DataFrame({"t": MEASURED, "h": measured_level(0.0)})
    table.to_csv(tank / "measured.csv", index=False)
    files = [str(tank / name) for name in ("measured.csv", "runs.csv", "report.html", "out.json")]
    code = main(
        ["diagnose", files[0], "--simulation", files[1], "--inputs", "t", "--parameters"]
        + ["q", "c", "h0", "--output", "h", "--report", files[2], "--json", files[3]]
    )
    assert code == 0
    assert json.loads((tank / "out.json").read_text())["verdict"] == "adequate"
    assert "leave the simulation open" not in capsys.readouterr().err


def test_a_leak_of_the_tank_is_found_and_placed(tank):
    priors = {"q": uniform(0.1, 0.4), "c": uniform(0.1, 0.4), "h0": uniform(0.5, 1.5)}
    simulation = hs.read_simulation(tank / "runs.csv", ["t"], priors, "h")
    model = hs.PowerScaledSurrogate(simulation, surrogate=hs.Kriging(), random_state=0)
    found = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
    found.fit(MEASURED[:, None], measured_level(0.06))
    assert found.verdict_ != "adequate"
    # a drain that grows is a drift of c, or an inflow that falls; a bump draws much the same
    kinds = found.causes_["kind"].to_numpy()
    assert {"bump", "parameter-drift"} & set(kinds[:2])
    assert found.emulator_check_.left_open < 0.2
