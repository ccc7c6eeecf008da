"""What the README shows runs as it stands."""

import re
from pathlib import Path

import numpy as np
import pytest

README = Path(__file__).resolve().parents[2] / "README.md"


@pytest.mark.filterwarnings("error")
def test_the_example_finds_the_wave_without_a_warning(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    code = re.search(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.S)
    shown = {}
    exec(compile(code.group(1), str(README), "exec"), shown)
    assert "named periodic" in capsys.readouterr().out
    estimates = shown["diagnosis"].best_cause_.estimates
    for name, truth in (("period", 2 * np.pi / 1.3), ("amplitude", 2.0)):
        _, low, high = estimates[name]
        assert low < truth < high
    assert shown["diagnosis"].gain_.elpd_difference > 5 * shown["diagnosis"].gain_.standard_error
    assert (tmp_path / "report.html").stat().st_size > 10_000
