"""A simulation that is known from runs alone, each of them a curve."""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import qmc, uniform

import hybridsurrogate as hs
from hybridsurrogate.command_line.main import main

TIMES = np.linspace(0, 20, 300)
MEASURED = np.linspace(0.3, 18, 60)


def design(ranges, n, seed):
    return qmc.scale(qmc.LatinHypercube(len(ranges), seed=seed).random(n), *np.transpose(ranges))


@pytest.mark.slow
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


def level(t, q, c, h0):
    """Return the level of a tank that is filled at a rate q and drains by c sqrt(h)."""
    solved = solve_ivp(lambda _, h: q - c * np.sqrt(h.clip(0)), (0, 20), [h0], t_eval=t, rtol=1e-8)
    return solved.y[0]


def measured_level():
    return level(MEASURED, 0.3, 0.28, 1.5) + 0.02 * np.random.default_rng(0).normal(size=60)


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


@pytest.mark.slow
def test_a_tank_without_a_leak_is_adequate_by_the_command_line(tank, capsys):
    table = pd.DataFrame({"t": MEASURED, "h": measured_level()})
    table.to_csv(tank / "measured.csv", index=False)
    files = [str(tank / name) for name in ("measured.csv", "runs.csv", "report.html", "out.json")]
    code = main(
        f"diagnose {files[0]} --simulation {files[1]} --inputs t --parameters q c h0 --output h "
        f"--report {files[2]} --json {files[3]} --jobs 1".split()
    )
    assert code == 0
    assert json.loads((tank / "out.json").read_text())["verdict"] == "adequate"
    assert "leave the simulation open" not in capsys.readouterr().err


@pytest.mark.slow
def test_the_page_goes_from_slow_runs_to_a_verdict(tmp_path, monkeypatch):
    page = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "expensive_code.md"
    code = "\n".join(re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S))
    monkeypatch.chdir(tmp_path)
    shown = {}
    exec(compile(code, str(page), "exec"), shown)
    found = shown["found"]
    # a leak from the ninth hour on: a share of the water is lost, or the drain drifts
    assert found.verdict_ in ("named", "nearest", "ambiguous")
    assert {"ramp", "parameter-drift"} & set(found.causes_["kind"][:2])
    _, low, high = found.best_cause_.estimates["location"]
    assert low - 0.5 < 9 < high + 0.5
    assert found.refinement_["left_open"].iloc[0] > 1
    assert found.refinement_["left_open"].iloc[-1] < 0.5
    assert len(pd.read_csv(tmp_path / "runs" / "runs.csv")) == 8 * 60


@pytest.mark.slow
def test_counts_beside_runs_of_expected_counts_agree_with_the_simulation_itself():
    simulator = hs.Simulator(
        lambda t, first, rate: first * np.exp(-rate * t),
        {"t": (0, 10)},
        {"first": uniform(10, 20), "rate": uniform(0.05, 0.4)},
    )
    t = np.linspace(0.2, 9.8, 30)
    counts = np.random.default_rng(0).poisson(20 * np.exp(-0.1 * t) * np.where(t > 5, 3.0, 1.0))
    found = []
    for simulation, surrogate in (
        (simulator, hs.ExactSurrogate()),
        (simulator.run(40, along=30, random_state=0), hs.Kriging()),
    ):
        model = hs.PowerScaledSurrogate(
            simulation, surrogate=surrogate, likelihood="poisson", n_draws=300, random_state=0
        )
        diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, n_replicates=19, random_state=0)
        found.append(diagnosis.fit(t[:, None], counts.astype(float)))
    exact, emulated = found
    assert emulated.verdict_ == exact.verdict_ == "named"
    assert emulated.best_cause_.kind == exact.best_cause_.kind
    leading = [one.causes_.set_index("form")["probability"].head(3) for one in found]
    for form, probability in leading[0].items():
        assert leading[1].get(form, 0.0) == pytest.approx(probability, abs=0.1)
