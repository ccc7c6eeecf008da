"""Parsers of all commands, which ask of a misspelt word whether another was meant."""

from __future__ import annotations

import argparse
import sys
from textwrap import fill
from typing import Any, NoReturn

import hybridsurrogate
from hybridsurrogate.command_line.commands import COMMANDS
from hybridsurrogate.command_line.options import add_options
from hybridsurrogate.exceptions import did_you_mean

EXIT_CODES = (
    "Exit codes: 0 done; 1 with --check where the verdict is not adequate; 2 for a word or data "
    "that cannot be used."
)


class Parser(argparse.ArgumentParser):
    """A parser that suggests a correction for a misspelt word."""

    def __init__(self, **settings: Any) -> None:
        self.words: list[str] = []
        self.given: list[str] = []
        super().__init__(**settings)

    def add_argument(self, *names: str, **settings: Any) -> argparse.Action:
        """As of `argparse`; what may be typed is kept."""
        self.words += [*names, *settings.get("choices", ())]
        return super().add_argument(*names, **settings)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As of `argparse`; what was typed is kept."""
        self.given = list(sys.argv[1:] if args is None else args)
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Print usage and message, with a question, and exit with code 2."""
        given = [word.partition("=")[0] for word in self.given]
        strange = [w for w in given if w not in self.words and (w in message or w[:2] == "--")]
        meant = "".join(did_you_mean(word, self.words) for word in strange)
        super().error(f"{message.rstrip('.')}.{meant}" if meant else message)


def make_parser() -> Parser:
    """Return the parser of the command line; what it parses has ``command``, a `Command`."""
    parser = Parser(
        prog="hybridsurrogate",
        description="Find out what a simulation gets wrong.",
        epilog=f"Example: {COMMANDS[0].example}",
    )
    parser.add_argument(
        "--version", action="version", version=f"hybridsurrogate {hybridsurrogate.__version__}"
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in COMMANDS:
        own = commands.add_parser(
            command.name,
            help=command.purpose,
            description=fill(command.description),
            epilog=f"{fill(EXIT_CODES)}\n\nExample:\n  {command.example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        add_options(own, command.options)
        own.set_defaults(command=command)
        parser.words += [command.name, *own.words]
    return parser
