"""The pages of the documentation: none is left out, and Sphinx builds them without a warning."""

import re
import runpy
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import hybridsurrogate as hs

DOCS = Path(__file__).resolve().parents[2] / "docs"


def listed(page):
    lines = (DOCS / page).read_text(encoding="utf-8").splitlines()
    return {line.strip() for line in lines if line.startswith("   ") and ":" not in line}


def test_every_page_is_in_the_contents():
    pages = [page.relative_to(DOCS) for page in DOCS.rglob("*.md") if "_build" not in page.parts]
    assert listed("contents.rst") - {"api", "auto_examples/index"} == {
        page.with_suffix("").as_posix() for page in pages
    }


@pytest.mark.parametrize("page", ["README.md", "docs/index.md"])
def test_figures_of_studies_stand_on_their_pages_alone(page):
    """A second copy is not generated anew, and was wrong: 60 / 75 / 91 next to 61 / 77 / 92."""
    text = (DOCS.parent / page).read_text(encoding="utf-8")
    prose = " ".join(re.sub(r"```.*?```", "", text, flags=re.DOTALL).split())
    # counts of cases, rates by size of the effect, seconds on some machine
    counts = r"\b\d+ of (the )?\d+\b|\d+(, \d+)+ and \d+ %|\d+ / \d+ / \d+|\b\d+ seconds\b"
    assert [found.group() for found in re.finditer(counts, prose)] == []


def test_every_public_name_has_its_page():
    page = runpy.run_path(str(DOCS / "conf.py"))["page_of_names"]()
    names = {line.strip() for line in page.splitlines() if line.startswith("   ")}
    assert names == {*hs.__all__, ":toctree: generated"}


def test_sphinx_builds_the_pages(tmp_path):
    for name in ("sphinx", "sphinx_gallery", "numpydoc", "myst_parser"):
        if find_spec(name) is None:
            pytest.skip(f"{name} is not installed (extra `docs`)")
    if not any(DOCS.rglob("*.png")):
        pytest.skip("the pictures are not here: a source distribution leaves them out")
    # the gallery writes beside the pages: a copy of both, whose examples are shown and not run
    for folder in ("docs", "examples"):
        shutil.copytree(DOCS.parent / folder, tmp_path / folder)
    build = subprocess.run(
        [
            *(sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", "-D", "plot_gallery=0"),
            *(str(tmp_path / "docs"), str(tmp_path / "pages")),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert build.returncode == 0, build.stderr
    built = tmp_path / "pages"
    assert (built / "auto_examples" / "plot_case_1.html").exists()
    assert (built / "generated" / "hybridsurrogate.Step.html").exists()
    assert "Step(x)" in (built / "causes.html").read_text(encoding="utf-8")
