"""What a command prints and writes: text, files, stages on a terminal."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pickle import PicklingError
from typing import Any

import pandas as pd

from hybridsurrogate.command_line.options import STDOUT
from hybridsurrogate.diagnosis.fitting.result import DiagnosisResult
from hybridsurrogate.diagnosis.report.report import Report, ending_of
from hybridsurrogate.diagnosis.report.text import aligned
from hybridsurrogate.notebook import doing
from hybridsurrogate.numerics.atomic_file import check_writable, written_whole
from hybridsurrogate.numerics.digits import probability
from hybridsurrogate.saved_file import save

# at once, also where stdout is a file
say = partial(print, flush=True)


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
    shown = by_kind.sort_values(ascending=False, kind="stable").head(5)
    names = [kind if pd.isna(target) else f"{kind} in {target}" for kind, target in shown.index]
    return aligned(
        pd.DataFrame({"cause": names, "probability": [probability(float(one)) for one in shown]})
    )


def write_files(
    given: argparse.Namespace,
    numbers: Any,
    reports: Iterable[tuple[str, str, Callable[[str], None]]] = (),
    saved: Any = None,
    code: str | None = None,
) -> tuple[list[str], list[str]]:
    """Write files and return a line for each that was written, and for each that failed.

    Parameters
    ----------
    given : argparse.Namespace
        With ``json``, and perhaps ``save``.
    numbers : dict
        For ``json``.
    reports : iterable of (what, path, function of a path)
    saved : object, optional
        For ``save``.
    code : str, optional
        The Python file of its simulation.
    """
    files: list[tuple[str, str | None, Callable[[str], Any]]] = [
        *reports,
        ("Numbers", given.json, partial(_write_json, numbers)),
        ("Saved", getattr(given, "save", None), lambda path: save(saved, path, code)),
    ]
    written, failed = [], []
    for what, path, write in files:
        if path is None or path == STDOUT:
            continue
        try:
            write(path)
            written.append(f"{what}: {path}")
        except (OSError, PicklingError) as error:
            failed.append(f"{path} was not written: {error}.")
    return written, failed


def show(
    given: argparse.Namespace, text: str, numbers: Any, written: list[str], failed: list[str]
) -> None:
    """Print a text, the files that were written and, where asked for, the numbers.

    Raises
    ------
    OSError
        At the end, as the text is not lost with a file.
    """
    say("\n".join([text, *([""] if written else []), *written]))
    if given.json == STDOUT:
        say(_as_json(numbers), file=given.result)
    if failed:
        raise OSError(" ".join(failed))


def _write_json(numbers: Any, path: str) -> None:
    with written_whole(path) as part:
        part.write_text(_as_json(numbers) + "\n", encoding="utf-8")


def _as_json(numbers: Any) -> str:
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
        say(table.to_csv(index=False).rstrip("\n"), file=given.result)
        return
    with written_whole(given.table) as part:
        table.to_csv(part, index=False)
    say(f"{len(table)} rows: {given.table}")
