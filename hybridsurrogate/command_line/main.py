"""The command line from words to exit code, with a parser for each command."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from textwrap import fill
from typing import Any, NoReturn

from tqdm import tqdm

from hybridsurrogate import __version__
from hybridsurrogate.command_line.commands import COMMANDS, Subcommand
from hybridsurrogate.command_line.options import STDOUT, add_options, completed
from hybridsurrogate.exceptions import HybridSurrogateWarning, did_you_mean

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


def make_parser(given: Sequence[str]) -> Parser:
    """Return the parser of what was typed; what it parses has ``command``, a `Subcommand`.

    Only a command that was typed has options: some list what scipy and scikit-learn are needed for.
    """
    parser = Parser(
        prog="hybridsurrogate",
        description="Find out what a simulation gets wrong.",
        epilog=f"Example: {COMMANDS[0].example}",
    )
    version = f"hybridsurrogate {__version__}"
    parser.add_argument("--version", action="version", version=version)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in COMMANDS:
        own = commands.add_parser(
            command.name,
            help=command.purpose,
            description=fill(command.description),
            epilog=f"{fill(EXIT_CODES)}\n\nExample:\n  {command.example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        add_options(own, command.options if command.name in given else ())
        own.set_defaults(command=command)
        parser.words += [command.name, *own.words]
    return parser


class Unbroken:
    """A text stream whose reader may have seen enough, as with ``| head``: the command goes on.

    Parameters
    ----------
    stream : text stream
    """

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write text, which goes nowhere once nobody reads it."""
        with self._until_broken():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Write at once what was kept back."""
        with self._until_broken():
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    @contextmanager
    def _until_broken(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError:
            # what is kept back goes nowhere as well, and Python's end finds no broken pipe
            os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code.

    Parameters
    ----------
    argv : sequence of str or None, default=None
        None: those that Python was started with.

    Returns
    -------
    int
        0 done; 1 with ``--check`` where the verdict is not adequate; 2 for a word or data that
        cannot be used.
    """
    given_words = list(sys.argv[1:] if argv is None else argv)
    words = vars(make_parser(given_words).parse_args(given_words))
    command: Subcommand = words.pop("command")
    with warnings.catch_warnings():
        warnings.simplefilter("always", HybridSurrogateWarning)
        warnings.showwarning = _PrintOnce()  # catch_warnings restores it
        try:
            with redirect_stdout(Unbroken(sys.stdout)):
                given = argparse.Namespace(
                    **completed(command.options, words, _from_file(words.get("config"))),
                    result=sys.stdout,
                )
                with redirect_stdout(_texts_of(given)):
                    return command.run(given)
        except (ValueError, TypeError, OSError) as error:
            print(f"hybridsurrogate: {error}", file=sys.stderr)
            return 2  # as argparse exits
        except KeyboardInterrupt:
            print("hybridsurrogate: interrupted.", file=sys.stderr)
            return 130  # as shells report an interrupt: 128 and the number of the signal


def _from_file(path: str | None) -> dict[str, Any]:
    if path is None:
        return {}
    from hybridsurrogate.command_line.study import read_study

    return read_study(path, [option for one in COMMANDS for option in one.options])


def _texts_of(given: argparse.Namespace) -> Any:
    """Return where texts go: stderr where stdout is for a result, nowhere if not wanted."""
    results = (getattr(given, "json", None), getattr(given, "table", None))
    return StringIO() if given.quiet else sys.stderr if STDOUT in results else sys.stdout


class _PrintOnce:
    """Prints each warning once: a diagnosis fits and predicts on the same rows many times."""

    def __init__(self) -> None:
        self._known: set[str] = set()

    def __call__(self, message: Any, *_: Any, **__: Any) -> None:
        if str(message) not in self._known:
            self._known.add(str(message))
            # not into the line of the stage on a terminal
            tqdm.write(f"Warning: {message}", file=sys.stderr)
