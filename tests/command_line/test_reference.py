"""The reference page holds what the parsers take."""

from pathlib import Path

from hybridsurrogate.command_line.commands import COMMANDS
from hybridsurrogate.command_line.reference import reference_page

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "command-line.md"


def test_the_page_is_current():
    """Else: python -m hybridsurrogate.command_line.reference > docs/reference/command-line.md."""
    assert PAGE.read_text(encoding="utf-8") == reference_page()


def test_every_command_and_option_is_on_the_page():
    page = reference_page()
    for command in COMMANDS:
        section = page.split(f"## {command.name}\n")[1].split("\n## ")[0]
        assert f"$ {command.example}" in section
        for option in command.options:
            assert f"| `{option.metavar if option.positional else option.flag}" in section
