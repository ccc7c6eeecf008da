"""The words of the field: texts that a user reads have none of a dialect of this project.

Texts are docstrings and string literals of the package, its pages, and the newest release of the
changelog. "Says" is refused where data are the subject; "the message says what came" is English.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import hybridsurrogate

PACKAGE = Path(hybridsurrogate.__file__).parent
PROJECT = Path(__file__).resolve().parents[2]
DOCS = PROJECT / "docs"

# what is refused -> what to write; a space matches a line break too
WORDS = {
    r"\btold\b|\btells?\b|\btelling\b": "estimate, report, predict, depend on, distinguish",
    r"\bsays? (?:nothing|something|little|much|more) (?:of|about)\b": "inform, show, estimate",
    r"\b(?:data|rows|runs|draws) say\b": "given the data: estimate, show, determine",
    r"\b(?:un)?foreseen\b|\bforesees?\b": "predicted, or: does not extrapolate",
    r"\bbeside\b": "given, conditional on, in addition to, next to",
    r"\bweighed\b": "compared (causes), evaluated (evidence), weighted (means)",
    r"\brivals?\b": "alternatives",
    r"\bleading causes?\b|\bcauses? that leads?\b": "the most probable cause",
    r"\bcompanions?\b": "second cause",
    r"\bunlearned\b": "prior-only",
    r"\bkindred\b": "related",
    r"\bunmoved\b": "unchanged",
    r"\brugged\b": "rough",
    r"\bstray(?:s|ed|ing)?\b": "correlated error",
    r"\banother one in (?:every|each)\b": "differs between",
    r"\bof one's own\b|\bunits? of its own\b": "user-defined, separate, or nothing",
    r"\bwhat is left\b": "residual, remaining",
    r"\bleaves? structure\b": "residual structure",
    r"\bheld back\b": "held out",
    r"\bhopeless\b": "pruned, diverged",
    r"\bafar\b": "global start, far away",
    r"\bdriven away\b": "diverged",
    r"\bsettled\b": "converged, decided, fixed",
    r"_prove\b|\bprove[ds]?\b|(?<!\bno\s)\bproofs?\b": "cross-validate",
    r"(?-i:\bDESIGN\b)|\bthe brief\b|\bissue \d+": "a paper, or a page of docs",
}
REFUSED = [
    (re.compile(word.replace(" ", r"\s+"), re.IGNORECASE), instead)
    for word, instead in WORDS.items()
]


def refused(text: str) -> list[tuple[int, str, str]]:
    """Return line (from 0), word and what to write instead, for each refused word of a text."""
    return [
        (text.count("\n", 0, match.start()), " ".join(match.group().split()), instead)
        for pattern, instead in REFUSED
        for match in pattern.finditer(text)
    ]


def literals(path: Path) -> list[tuple[int, str]]:
    """Return line and text of every docstring and string literal, parts of f-strings included."""
    return [
        (node.lineno, node.value)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]


def prose(path: Path) -> str:
    """Return a page without the targets of its links; of the changelog, the newest release."""
    text = path.read_text(encoding="utf-8")
    if path.name == "CHANGELOG.md":
        first, newest = text.split("\n## ")[:2]
        text = first + "\n## " + newest
    return re.sub(r"(?<=\])\([^)\s]*\)", "()", text)


def faults(path: Path, texts: list[tuple[int, str]]) -> list[str]:
    # the package may be installed elsewhere
    root = PACKAGE.parent if path.suffix == ".py" else PROJECT
    return [
        f"{path.relative_to(root)}:{start + line}: {word!r}; write: {instead}"
        for start, text in texts
        for line, word, instead in refused(text)
    ]


ROOMS = sorted({path.parent for path in PACKAGE.rglob("*.py")})
PAGES = [
    *(PROJECT / f"{name}.md" for name in ("README", "CHANGELOG", "SECURITY", "CONTRIBUTING")),
    *(page for page in sorted(DOCS.rglob("*.md")) if "_build" not in page.parts),
]


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: str(room.relative_to(PACKAGE.parent)))
def test_a_room_speaks_the_field_s_language(room):
    found = [fault for path in sorted(room.glob("*.py")) for fault in faults(path, literals(path))]
    assert not found, "\n" + "\n".join(found)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(PROJECT)))
def test_a_page_speaks_the_field_s_language(page):
    found = faults(page, [(1, prose(page))])
    assert not found, "\n" + "\n".join(found)


DIALECT = [
    "The data told it.",
    "A column tells of the state.",
    "It cannot tell them apart.",
    "It says nothing of them.",
    "What the data say.",
    "The value is foreseen.",
    "It foresees nothing.",
    "A cause Beside another.",
    "Causes are weighed.",
    "Its rivals are near.",
    "The leading cause is a step.",
    "The cause that leads.",
    "It has a companion.",
    "An unlearned size.",
    "A kindred effect.",
    "An unmoved draw.",
    "A rugged surface.",
    "It strays.",
    "It is another one in\n    every row.",
    "A cause of one's own.",
    "In a unit of its\nown.",
    "What is left of the signal.",
    "It leaves structure.",
    "Rows held back.",
    "A hopeless start.",
    "Starts from afar.",
    "It was driven away.",
    "It has settled.",
    "See `diagnosis._prove`.",
    "The proof takes long.",
    "As in DESIGN section 6.",
    "As issue 51 asks.",
]


@pytest.mark.parametrize("text", DIALECT)
def test_a_refused_word_is_flagged_once_with_its_line_and_what_to_write(text):
    ((line, word, instead),) = refused("A good line.\n" + text)
    assert line == 1
    assert word.lower() in " ".join(text.lower().split())
    assert instead


@pytest.mark.parametrize("pattern", [pattern for pattern, _ in REFUSED])
def test_every_pattern_is_tried(pattern):
    assert any(pattern.search(text) for text in DIALECT)


@pytest.mark.parametrize(
    "text",
    [
        "The message says what came; rows are held out; the interval holds the truth.",
        "A weight of 2 weighs a row twice; the weighted mean.",
        "A leading zero, an arrival, a stranger, the retold and the improved.",
        "A name is no proof.",
    ],
)
def test_plain_words_pass(text):
    assert refused(text) == []


def test_literals_are_docstrings_messages_and_parts_of_f_strings(tmp_path):
    path = tmp_path / "module.py"
    path.write_text('"""One."""\n# two\nx = f"three {1}" "four"\n', encoding="utf-8")
    assert literals(path) == [(1, "One."), (3, "three "), (3, "four")]
