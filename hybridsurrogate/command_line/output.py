"""What a command prints and writes: text, files, stages on a terminal."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pickle import PicklingError
from typing import Any

import pandas as pd

from hybridsurrogate.diagnosis import DiscrepancyDiagnosis
from hybridsurrogate.diagnosis.fitting.result import DiagnosisResult
from hybridsurrogate.diagnosis.report.report import Report, ending_of
from hybridsurrogate.notebook import doing
from hybridsurrogate.numerics.atomic_file import check_writable, written_whole
from hybridsurrogate.numerics.digits import probability

STDOUT = "-"
# rows of the first table of causes
_MOST_CAUSES = 5


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


def say(text: str, stream: Any = None) -> None:
    """Print text at once.

    Parameters
    ----------
    text : str
    stream : text stream or None, default=None
        None: stdout.
    """
    print(text, file=stream, flush=True)


def check_outputs(given: argparse.Namespace) -> None:
    """Raise where a file cannot be written: now, not after minutes.

    Parameters
    ----------
    given : argparse.Namespace
        Of its names report, json, save and table those are checked that it has.

    Raises
    ------
    ValueError, OSError
    """
    if getattr(given, "report", None):
        ending_of(given.report)
    for name in ("report", "json", "save", "table"):
        path = getattr(given, name, None)
        if path is not None and path != STDOUT:
            check_writable(path)


@contextmanager
def stage(what: str, given: argparse.Namespace, shown: bool = True) -> Iterator[None]:
    """Show on a terminal what is being done and, where asked for, print its seconds after it.

    Parameters
    ----------
    what : str
    given : argparse.Namespace
        With ``verbose`` and ``quiet``.
    shown : bool, default=True
        False where what is done shows itself.
    """
    began = time.perf_counter()
    with doing(what, shown and not given.quiet):
        yield
    if given.verbose:
        print(f"{what}: {time.perf_counter() - began:.1f} s", file=sys.stderr, flush=True)


def first_words(report: Report, result: DiagnosisResult) -> str:
    """Return what is printed as soon as the search is done: headline and table of causes.

    Parameters
    ----------
    report : Report
    result : DiagnosisResult
    """
    return "\n".join([report.headline, *report.lead, "", kinds_as_text(result.causes)])


def kinds_as_text(causes: pd.DataFrame) -> str:
    """Return the most probable kinds of cause as text, a line each.

    Parameters
    ----------
    causes : pandas.DataFrame
        As `DiscrepancyDiagnosis.causes_`. The forms of a kind are added up.

    Examples
    --------
    >>> import pandas as pd
    >>> print(kinds_as_text(pd.DataFrame({
    ...     "kind": ["step", "none", "step"], "target": ["year", None, "year"],
    ...     "probability": [0.5, 0.1, 0.4]})))
    cause         probability
    step in year  90 %
    none          10 %
    """
    known = causes[causes["probability"].notna()]
    by_kind = known.groupby(["kind", "target"], dropna=False, sort=False)["probability"].sum()
    shown = by_kind.sort_values(ascending=False, kind="stable").head(_MOST_CAUSES)
    names = [kind if pd.isna(target) else f"{kind} in {target}" for kind, target in shown.index]
    width = max(map(len, [*names, "cause"]))
    lines = [f"{'cause':{width}}  probability"]
    for name, value in zip(names, shown, strict=True):
        lines.append(f"{name:{width}}  {probability(float(value))}")
    return "\n".join(lines)


def report_of(
    diagnosis: DiscrepancyDiagnosis, given: argparse.Namespace, units: dict[str, str], test: Any
) -> Report:
    """Return the report of a diagnosis, with what the command line asks for.

    Parameters
    ----------
    diagnosis : DiscrepancyDiagnosis
    given : argparse.Namespace
        With ``verbose``, and perhaps ``beta_scan``.
    units : dict of str to str
    test : (X, y) or None
        Rows held out.
    """
    beta_scan = getattr(given, "beta_scan", False)
    return diagnosis.report(test=test, beta_scan=beta_scan, units=units, full=given.verbose)


def write_files(
    writers: Sequence[tuple[str, str | None, Callable[[str], None]]],
) -> tuple[list[str], list[str]]:
    """Write files and return a line for each that was written, and for each that failed.

    Parameters
    ----------
    writers : sequence of (what, path or None, function of a path)
        None, and "-", are no files.
    """
    written, failed = [], []
    for what, path, write in writers:
        if path is None or path == STDOUT:
            continue
        try:
            write(path)
            written.append(f"{what}: {path}")
        except (OSError, PicklingError) as error:
            failed.append(f"{path} was not written: {error}.")
    return written, failed


def write_json(numbers: Any, path: str) -> None:
    """Write numbers as JSON, whole or not at all.

    Parameters
    ----------
    numbers : dict
    path : str
    """
    with written_whole(path) as part:
        part.write_text(as_json(numbers) + "\n", encoding="utf-8")


def as_json(numbers: Any) -> str:
    """Return numbers as JSON.

    Parameters
    ----------
    numbers : dict
    """
    return json.dumps(numbers, indent=2, allow_nan=False)


def print_table(table: pd.DataFrame, given: argparse.Namespace) -> None:
    """Write a table as csv to the file that ``table`` names, or as a command's result.

    Parameters
    ----------
    table : pandas.DataFrame
    given : argparse.Namespace
        With ``table`` and ``result``, a text stream.
    """
    if given.table == STDOUT:
        say(table.to_csv(index=False).rstrip("\n"), given.result)
        return
    with written_whole(given.table) as part:
        table.to_csv(part, index=False)
    say(f"{len(table)} rows: {given.table}")
