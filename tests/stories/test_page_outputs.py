"""What the pages show runs as it stands, and prints what they say."""

import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"
OUTPUTS = runpy.run_path(str(DOCS / "outputs.py"))
# more than five seconds: searches with folds, equations, emulators
SLOW = {
    "index",  # as the README, whose test runs always
    "first_diagnosis",
    "two_sources",
    "ode",
    "expensive_code",
    "counts",
    "several_outputs",
    "batches_and_subjects",
}
PAGES = [
    pytest.param(page, id=page.stem, marks=[pytest.mark.slow] if page.stem in SLOW else [])
    for page in OUTPUTS["pages"]()
]


@pytest.mark.filterwarnings("default::hybridsurrogate.HybridSurrogateWarning")
@pytest.mark.parametrize("page", PAGES)
def test_the_page_runs_as_it_stands(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for block, printed in OUTPUTS["run"](page):
        if block.shown is None:
            assert printed == ""
            continue
        assert OUTPUTS["differences"](printed, block.shown) == []
