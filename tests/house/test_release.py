"""What a release says of itself: one version, a short list of changes, true bounds."""

import re
import tomllib
from pathlib import Path

import hybridsurrogate as hs

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
# what a user notices of one release fits on a screen
MOST_LINES = 40


def releases():
    """Return the lines of each release by its heading."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    parts = re.split(r"^## (.+)$", text, flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], (body.strip().splitlines() for body in parts[1::2]), strict=True))


def test_one_version_everywhere():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {hs.__version__}\n" in citation
    assert PROJECT["version"] == hs.__version__
    assert next(iter(releases())).startswith(hs.__version__)


def test_each_release_has_a_date_and_few_lines():
    for heading, lines in releases().items():
        assert re.fullmatch(r"\d+\.\d+\.\d+ - \d{4}-\d\d-\d\d \(.+\)", heading), heading
        assert 0 < len(lines) <= MOST_LINES, (heading, len(lines))


def test_every_dependency_has_a_lower_bound_and_no_upper_one():
    for bound in PROJECT["dependencies"]:
        assert re.fullmatch(r"[a-z-]+>=[\d.]+", bound), bound
