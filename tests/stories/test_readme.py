"""What the README shows runs as it stands."""

import runpy
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
OUTPUTS = runpy.run_path(str(ROOT / "docs" / "outputs.py"))


@pytest.mark.filterwarnings("error")
def test_the_example_finds_the_wave_without_a_warning(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shown = {}
    ((block, printed),) = OUTPUTS["run"](ROOT / "README.md", shown)
    assert OUTPUTS["differences"](printed, block.shown) == []
    assert "misses a cycle of temperature" in printed
    # 2 sin(1.3 minutes) is what the simulation lacks
    estimates = shown["diagnosis"].best_cause_.estimates
    for name, truth in (("period", 2 * np.pi / 1.3), ("amplitude", 2.0)):
        _, low, high = estimates[name]
        assert low < truth < high
    assert shown["diagnosis"].gain_.elpd_difference > 5 * shown["diagnosis"].gain_.standard_error
    assert (tmp_path / "report.html").stat().st_size > 10_000
