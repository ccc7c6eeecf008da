"""The pages of the documentation: in the contents, links that lead somewhere, built by Sphinx."""

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
PAGES = sorted(page for page in DOCS.rglob("*.md") if "_build" not in page.parts)
GUIDE = [page for page in PAGES if page.parent.name != "evidence"]
# DESIGN section 3: our words for what the field has words for
REFUSED = (
    r"\btold\b|\bforesee\w*|\bforeseen\b|\bbeside\b|\brivals?\b|\bweighed\b|\bcompanion\b"
    r"|\bunlearned\b|\bkindred\b|\bunmoved\b|\brugged\b|\bstray\w*|\bafar\b|\bhopeless\b"
    r"|\bdriven away\b|\bleading cause\b|\bleads\b"
)
GENERATED = {"reference/api", "auto_examples/index"}


def name_of(page):
    return page.relative_to(DOCS).with_suffix("").as_posix()


def toctrees(page):
    """Return the pages that the table of contents of a page lists, as names from the root."""
    text = page.read_text(encoding="utf-8")
    lines = [
        line.strip()
        for tree in re.findall(r"```\{toctree\}\n(.*?)```", text, re.DOTALL)
        for line in tree.splitlines()
        if line.strip() and not line.startswith(":")
    ]
    names = (re.sub(r".*<(.*)>", r"\1", line) for line in lines)
    return {(page.parent / name).relative_to(DOCS).as_posix() for name in names}


def prose(page):
    """Return the text of a page without code, outputs and addresses."""
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)
    return " ".join(re.sub(r"\]\([^)]*\)", "]", text).split())


def anchors(page):
    """Return what a link may name on a page: its headings as MyST writes them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in headings}


def test_every_page_is_in_the_contents():
    listed = set().union(*map(toctrees, PAGES))
    assert listed - GENERATED == {name_of(page) for page in PAGES} - {"index"}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_within_the_pages_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"https?:|inv:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        written = target.exists() or name_of(target) in GENERATED
        assert written, f"{name_of(page)} links to {link}"
        assert not anchor or anchor in anchors(target), f"{name_of(page)} links to {link}"


@pytest.mark.parametrize("page", [DOCS.parent / "README.md", *GUIDE], ids=lambda page: page.stem)
def test_figures_of_studies_stand_on_pages_of_evidence_alone(page):
    """A second copy is not generated anew, and was wrong: 60 / 75 / 91 next to 61 / 77 / 92."""
    # counts of cases, rates by size of the effect
    counts = r"\b\d+ of (the )?\d+ (cases|data sets|sets)\b|\d+(, \d+)+ and \d+ %|\d+ / \d+ / \d+"
    assert [found.group() for found in re.finditer(counts, prose(page))] == []


@pytest.mark.parametrize("page", GUIDE, ids=name_of)
def test_pages_speak_the_language_of_the_field(page):
    assert re.findall(REFUSED, prose(page), re.IGNORECASE) == []


def test_the_first_page_is_short_and_shows_code_at_once():
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    assert len(text.split()) <= 900
    lines = text.splitlines()
    assert lines.index("```python") < 25
    for phrase in ("OdeSimulator", "vectorized=False", "time series", "resume"):
        assert phrase in text


def test_the_readme_shows_the_example_of_the_first_page():
    """It runs as that of the README (tests/stories/test_readme.py)."""
    first, second = (
        re.search(r"```python\n(.*?)```\n\n```text\n(.*?)```", page.read_text("utf-8"), re.DOTALL)
        for page in (DOCS / "index.md", DOCS.parent / "README.md")
    )
    assert second[1].startswith(first[1])
    assert first[2] == second[2]


def test_every_public_name_has_its_page():
    page = runpy.run_path(str(DOCS / "api.py"))["page_of_names"]()
    of_package, *of_rooms = re.split(r"^\.\. currentmodule:: \S+$", page, flags=re.MULTILINE)[1:]
    assert sorted(re.findall(r"^ {3}(\w+)$", of_package, re.MULTILINE)) == sorted(hs.__all__)
    assert all(re.findall(r"^ {3}(\w+)$", room, re.MULTILINE) for room in of_rooms)


def test_every_warning_is_explained():
    page = (DOCS / "reference" / "warnings.md").read_text(encoding="utf-8")
    assert [name for name in hs.__all__ if name.endswith("Warning") and name not in page] == []


def test_sphinx_builds_the_pages(tmp_path):
    needed = ("sphinx", "sphinx_gallery", "numpydoc", "myst_parser", "pydata_sphinx_theme")
    for name in (*needed, "sphinx_design", "sphinx_copybutton"):
        if find_spec(name) is None:
            pytest.skip(f"{name} is not installed (extra `docs`)")
    if not any(DOCS.rglob("*.png")):
        pytest.skip("the pictures are not here: a source distribution leaves them out")
    # the gallery writes next to the pages: a copy of both, whose examples are shown and not run
    for folder in ("docs", "examples"):
        skip = shutil.ignore_patterns("_build", "auto_examples", "generated", "__pycache__")
        shutil.copytree(DOCS.parent / folder, tmp_path / folder, ignore=skip)
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
    assert (built / "reference" / "generated" / "hybridsurrogate.Step.html").exists()
    causes = (built / "reference" / "causes.html").read_text(encoding="utf-8")
    assert "Step(x)" in causes
    assert "step.svg" in causes
    assert "OdeSimulator" in (built / "index.html").read_text(encoding="utf-8")
