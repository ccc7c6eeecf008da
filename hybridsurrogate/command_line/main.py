"""The command line from words to exit code."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from typing import Any

from tqdm import tqdm

from hybridsurrogate.command_line.commands import COMMANDS, Subcommand
from hybridsurrogate.command_line.options import completed
from hybridsurrogate.command_line.output import STDOUT, Unbroken
from hybridsurrogate.command_line.parsers import make_parser
from hybridsurrogate.command_line.study_file import read_study
from hybridsurrogate.exceptions import HybridSurrogateWarning

_UNUSABLE, _INTERRUPTED = 2, 130


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
    words = vars(make_parser().parse_args(argv))
    command: Subcommand = words.pop("command")
    with warnings.catch_warnings():
        warnings.simplefilter("always", HybridSurrogateWarning)
        warnings.showwarning = _PrintOnce()  # catch_warnings restores it
        try:
            with redirect_stdout(Unbroken(sys.stdout)):
                given = _settings(command, words)
                with _texts_of(given):
                    return command.run(given)
        except (ValueError, TypeError, OSError) as error:
            print(f"hybridsurrogate: {error}", file=sys.stderr)
            return _UNUSABLE
        except KeyboardInterrupt:
            print("hybridsurrogate: interrupted.", file=sys.stderr)
            return _INTERRUPTED


def _settings(command: Subcommand, words: dict[str, Any]) -> argparse.Namespace:
    """Return a value for each option of a command, and ``result``, where results are printed."""
    known = [option for one in COMMANDS for option in one.options]
    from_file = read_study(words["config"], known) if "config" in words else {}
    return argparse.Namespace(**completed(command.options, words, from_file), result=sys.stdout)


@contextmanager
def _texts_of(given: argparse.Namespace) -> Iterator[None]:
    """Send texts to stderr where stdout is for a result, and nowhere where they are not wanted."""
    results = (getattr(given, "json", None), getattr(given, "table", None))
    if given.quiet:
        with redirect_stdout(StringIO()):
            yield
    elif STDOUT in results:
        with redirect_stdout(sys.stderr):
            yield
    else:
        yield


class _PrintOnce:
    """Prints each warning once: a diagnosis fits and predicts on the same rows many times."""

    def __init__(self) -> None:
        self._known: set[str] = set()

    def __call__(self, message: Any, *_: Any, **__: Any) -> None:
        if str(message) not in self._known:
            self._known.add(str(message))
            # not into the line of the stage on a terminal
            tqdm.write(f"Warning: {message}", file=sys.stderr)
