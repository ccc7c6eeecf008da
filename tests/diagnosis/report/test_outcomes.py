"""Each outcome has a first screen of its own, which was read and is kept beside this file.

Numbers are left out, as they belong to the fits: a word that changes is a change of the report.
"""

import re
from pathlib import Path

import pytest
from outcomes import outcome

KEPT = Path(__file__).parent / "outcomes"
NAMES = sorted(path.stem for path in KEPT.glob("*.txt"))


def words(text):
    """Return a text in one line, without its numbers."""
    return re.sub(r"[−+-]?\d[\d.]*(e[+-]?\d+)?", "#", " ".join(text.split()))


def test_all_outcomes_are_kept():
    assert len(NAMES) == 10


@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
@pytest.mark.filterwarnings("ignore::hybridsurrogate.SamplingWarning")
@pytest.mark.parametrize("name", NAMES)
def test_the_first_screen(name):
    report = outcome(name).report(units={"t": "h", "level <mg>": "mg"})
    assert len(str(report).splitlines()) <= 30
    assert words(str(report)) == words((KEPT / f"{name}.txt").read_text(encoding="utf-8"))
    # one picture, with as much care for a bad outcome
    drawn = report.first.picture.drawn
    assert drawn.svg.startswith(b"<?xml")
    assert len(drawn.data) == 30
