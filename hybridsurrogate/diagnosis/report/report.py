"""The report of a diagnosis: text, one self-contained HTML file, a dict for machines."""

from __future__ import annotations

import copy
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from html import escape
from typing import Any

from hybridsurrogate.arguments import local_path
from hybridsurrogate.diagnosis.fitting.result import DiagnosisResult
from hybridsurrogate.diagnosis.report import html, text
from hybridsurrogate.diagnosis.report.cards import advice, cards
from hybridsurrogate.diagnosis.report.details import (
    checks,
    evidence,
    extended_model,
    gain,
    measurement,
    place,
    provenance,
)
from hybridsurrogate.diagnosis.report.details.checks import cautions
from hybridsurrogate.diagnosis.report.details.pictures import Test, picture_overview
from hybridsurrogate.diagnosis.report.elements.section import FirstScreen, Picture, Section
from hybridsurrogate.diagnosis.report.elements.view import View, view_of
from hybridsurrogate.diagnosis.report.headline import headline, lead, subject
from hybridsurrogate.diagnosis.report.summary import summary
from hybridsurrogate.diagnosis.validation.gain import HeldOutGain, gain_on
from hybridsurrogate.numerics.atomic_file import check_writable, written_whole


@dataclass(frozen=True)
class Report:
    """The result of a diagnosis; prints as text, shows as HTML in a notebook.

    Attributes
    ----------
    first : FirstScreen
        Headline, cards, caution, picture and advice.
    sections : tuple of Section
        The details, which HTML folds.
    summary : dict
        What ``to_dict`` returns a copy of.
    full : bool
        Whether the text has the details too.
    """

    first: FirstScreen
    sections: tuple[Section, ...]
    summary: dict[str, Any]
    full: bool = False

    @property
    def headline(self) -> str:
        """The result, in one sentence."""
        return self.first.headline

    @property
    def lead(self) -> tuple[str, ...]:
        """The sentences that explain the headline."""
        return self.first.lead

    def __str__(self) -> str:
        if not self.full:
            return text.screen(self.first)
        return "\n".join([text.screen(self.first), *map(text.section, self.sections)])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return html.screen(self.first)

    def to_html(self) -> str:
        """Return one self-contained HTML page: no network, no script, pictures inline."""
        return html.page(self.first, self.sections)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of the report, ready for JSON.

        Returns
        -------
        dict
            ``schema_version`` is raised whenever a key changes its meaning or goes away. Numbers
            that do not exist are None.
        """
        return copy.deepcopy(self.summary)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the report: HTML, text where the name ends in .txt, JSON for .json.

        The file is whole or, where writing fails, what it was before. Raises ValueError for
        another ending, OSError where no such file can be written.
        """
        ending = ending_of(path)
        check_writable(path)
        if ending == ".txt":
            content = str(replace(self, full=True)) + "\n"
        elif ending == ".json":
            content = json.dumps(self.to_dict(), indent=2, allow_nan=False) + "\n"
        else:
            content = self.to_html()
        with written_whole(path) as part:
            part.write_text(content, encoding="utf-8")


class Reported:
    """A result that prints as its report, and shows it in a notebook."""

    def report(self, full: bool = False) -> Report:
        """Return the report."""
        raise NotImplementedError

    def __str__(self) -> str:
        return str(self.report())

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()


def ending_of(path: str | os.PathLike[str]) -> str:
    """Return how a file name ends; raise ValueError where no report is written so."""
    ending = local_path(path).suffix.lower()
    if ending not in (".html", ".htm", ".txt", ".json", ""):
        raise ValueError(
            f"A report is written to a file .html, .txt or .json, not to {os.fspath(path)!r}."
        )
    return ending


def make_report(
    result: DiagnosisResult,
    test: Test = None,
    beta_scan: bool = False,
    units: Mapping[str, str] | None = None,
    full: bool = False,
) -> Report:
    """Write the report of a fitted diagnosis.

    Parameters
    ----------
    result : DiagnosisResult
    test : (X_test, y_test) or None
        Rows held out.
    beta_scan : bool
        Try the weights of the simulation, which takes a while; else only what is known is used.
    units : dict of str to str or None
        Of columns, outputs and parameters.
    full : bool
        Whether the text has the details too.

    Returns
    -------
    Report
    """
    view, after = view_of(result, units), result.extension.estimator
    on_test = None if test is None else gain_on(result.before, after, *test)
    gains: dict[str, HeldOutGain | None] = {
        "within": result.gain,
        "beyond": result.gain_out_of_range,
        "held out": on_test,
    }
    scans = result.extension.beta_scans
    within, beyond = (
        scans.few(out_of_range) if beta_scan else scans.known.get(out_of_range)
        for out_of_range in (False, True)
    )
    first = first_screen(view, test, on_test)
    sections = (
        extended_model.section(view),
        evidence.section(view),
        place.section(view),
        *place.section_on_outputs(view),
        gain.section(view, gains),
        *gain.section_on_weights(view, within, beyond),
        measurement.section(view),
        checks.section(view),
        provenance.section(view),
    )
    return Report(
        first, sections, summary(view, first, sections, gains, (within, beyond)), bool(full)
    )


def first_screen(view: View, test: Test = None, on_test: HeldOutGain | None = None) -> FirstScreen:
    """Return what a reader sees first.

    Parameters
    ----------
    view : View
    test : (X_test, y_test) or None
    on_test : HeldOutGain or None
        On these rows.
    """
    doubts = cautions(view)
    rest = f" ({len(doubts) - 1} more under Checks.)" if len(doubts) > 1 else ""
    return FirstScreen(
        f"{subject(view)} · hybridsurrogate {provenance.installed('hybridsurrogate')} · "
        f"seed {view.result.settings.random_state}",
        headline(view),
        lead(view),
        cards(view, on_test),
        doubts[0] + rest if doubts else "",
        Picture(picture_overview, view, test),
        advice(view),
    )


def short_html(result: DiagnosisResult, text: str) -> str:
    """Return what a notebook shows of a fitted diagnosis: the first screen, without its picture.

    Nothing is drawn and nothing is fitted.

    Parameters
    ----------
    result : DiagnosisResult
    text : str
        The diagnosis as it prints.
    """
    screen = html.screen(first_screen(view_of(result)), with_picture=False)
    settings = f"<details><summary>Settings</summary><pre>{escape(text)}</pre></details>"
    return f"{screen}\n{settings}"
