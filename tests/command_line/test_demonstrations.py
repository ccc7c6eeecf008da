"""The demonstrations, as a newcomer sees them."""

import io
import json
import sys
import time

import pytest

from hybridsurrogate.command_line.main import main


def test_the_list_of_demonstrations(capsys):
    assert main(["demo", "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["nile", "co2", "log-sin"]
    assert ["hard:" in line for line in lines] == [False, True, True]


def test_an_unknown_demonstration(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["demo", "moon"])
    assert "invalid choice: 'moon'" in capsys.readouterr().err


class Timed(io.StringIO):
    """A stdout that knows the processor's seconds at which a word was first written."""

    def __init__(self, word):
        super().__init__()
        self.word, self.at = word, None

    def write(self, text):
        if self.at is None and self.word in text:
            self.at = time.process_time()
        return super().write(text)


@pytest.mark.slow
def test_the_demonstration_says_what_is_wrong_within_seconds(tmp_path, monkeypatch):
    """Cobb (1978) dates the fall of the Nile to 1898; bounds are the promise of the front door."""
    monkeypatch.chdir(tmp_path)
    out, began = Timed("probability"), time.process_time()
    monkeypatch.setattr(sys, "stdout", out)
    assert main(["demo", "--jobs", "1", "--json", "numbers.json"]) == 0
    whole = time.process_time() - began
    assert "\nstep in year " in out.getvalue()
    assert "Do not act" not in out.getvalue()
    assert (tmp_path / "report.html").exists()
    numbers = json.loads((tmp_path / "numbers.json").read_text())
    assert (numbers["verdict"], numbers["best_cause"]["kind"]) == ("named", "step")
    _, low, high = numbers["best_cause"]["estimates"]["location"]
    assert low < 1899
    assert high > 1897
    assert high - low < 5
    # two seconds of either go to the imports
    assert out.at - began <= 13
    assert whole <= 43
