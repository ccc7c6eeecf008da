"""The report of a diagnosis: text, one self-contained HTML file, a dict for machines."""

from __future__ import annotations

import copy
import json
import os
import textwrap
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import pandas as pd

from hybridsurrogate import digits
from hybridsurrogate.arguments.paths import local_path
from hybridsurrogate.diagnosis.report import findings, html, pictures, rivals, scores, tables, trust
from hybridsurrogate.diagnosis.report.section import Section
from hybridsurrogate.diagnosis.report.summary import summary
from hybridsurrogate.diagnosis.report.view import View, label_of_cause, view_of
from hybridsurrogate.effects.in_output import InOutput
from hybridsurrogate.effects.notation import word as _word
from hybridsurrogate.whole_file import check_writable, written_whole

if TYPE_CHECKING:
    from hybridsurrogate.diagnosis.diagnosis import DiscrepancyDiagnosis
    from hybridsurrogate.diagnosis.report.pictures import Test

_WIDTH, _HOLD = 88, "\u00a0"
_NOTE = (
    "Written by hybridsurrogate. Surrogates on two data sources: Reiser, Bürkner and Guthke, "
    "arXiv 2412.11875."
)


@dataclass(frozen=True)
class Report:
    """What a diagnosis says; prints as text, shows as HTML in a notebook.

    Attributes
    ----------
    title : str
    sections : tuple of Section
    summary : dict
        What ``to_dict`` returns a copy of.
    """

    title: str
    sections: tuple[Section, ...]
    summary: dict[str, Any]

    def __str__(self) -> str:
        lines = [self.title, "=" * len(self.title)]
        for section in self.sections:
            lines += ["", section.title, "-" * len(section.title)]
            lines += [_wrapped(sentence) for sentence in section.sentences]
            lines += [f"{name}:\n    {formula}" for name, formula in section.formulas]
            if section.table is not None:
                lines += ["", *([section.caption] if section.caption else [])]
                lines.append(_aligned(section.table))
        return "\n".join(lines)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return html.fragment(self.sections)

    def to_html(self) -> str:
        """Return one self-contained HTML page: no network, pictures inline."""
        return html.page(self.title, self.sections, _NOTE)

    def to_dict(self) -> dict[str, Any]:
        """Return everything that the report says, ready for JSON.

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
            content = str(self) + "\n"
        elif ending == ".json":
            content = json.dumps(self.to_dict(), indent=2, allow_nan=False) + "\n"
        else:
            content = self.to_html()
        with written_whole(path) as part:
            part.write_text(content, encoding="utf-8")


def ending_of(path: str | os.PathLike[str]) -> str:
    """Return how a file name ends; raise ValueError where no report is written so."""
    ending = local_path(path).suffix.lower()
    if ending not in (".html", ".htm", ".txt", ".json", ""):
        raise ValueError(
            f"A report is written to a file .html, .txt or .json, not to {os.fspath(path)!r}."
        )
    return ending


def make_report(
    diagnosis: DiscrepancyDiagnosis, test: Test = None, beta_scan: bool = False
) -> Report:
    """Write the report of a fitted diagnosis.

    Parameters
    ----------
    diagnosis : DiscrepancyDiagnosis
    test : (X_test, y_test) or None
        Rows held back.
    beta_scan : bool
        Try the weights of the simulation, which takes a while; else only what is known is told.

    Returns
    -------
    Report
    """
    # a notebook that shows a verdict does not wait for matplotlib

    view = view_of(diagnosis)
    if test is not None:
        test = test[0], diagnosis.measured_outputs(test[1], "y_test")
    on_test = diagnosis.gain_on(*test) if test is not None else None
    measured = {
        "folds": diagnosis.gain_,
        "beyond": diagnosis.gain_out_of_range_,
        "held back": on_test,
    }
    known = {name: gain for name, gain in measured.items() if gain is not None}
    scans = diagnosis.beta_scans_
    within, beyond = (
        scans.few(out_of_range) if beta_scan else scans.known.get(out_of_range)
        for out_of_range in (False, True)
    )
    title, experiments = findings.title_of(view), pictures.experiments_of(view)
    sections = (
        Section("Verdict", tuple(findings.verdict(view)), (pictures.picture_fit(view),)),
        Section(
            "Where",
            tuple(findings.where(view)),
            () if experiments is None else (pictures.picture_experiments(view, experiments),),
            table=tables.third_table(view),
            caption="Share of the squared discrepancy by thirds of each measured range",
        ),
        *_by_output(view),
        Section(
            "Causes weighed",
            tuple(rivals.rivals(view)),
            (pictures.picture_causes(view),),
            tables.cause_table(view),
        ),
        Section(
            "The extended model",
            tuple(findings.extension(view)),
            (pictures.picture_extension(view, test), pictures.picture_residuals(view)),
            tables.estimate_table(view),
            formulas=_formulas(view),
        ),
        Section(
            "What it gains",
            tuple(scores.gains(view, on_test)),
            (pictures.picture_gain(known),) if known else (),
        ),
        Section(
            "Trust in the simulation",
            tuple(trust.trust(view, within, beyond)),
            () if within is None else (pictures.picture_trust(within, beyond),),
        ),
        Section("What to do next", tuple(rivals.next_step(view)), (pictures.picture_next(view),)),
        Section("How far the numbers can be trusted", tuple(scores.draws(view))),
    )
    return Report(title, sections, summary(view, title, sections, measured, (within, beyond)))


def short_html(diagnosis: DiscrepancyDiagnosis) -> str:
    """Return what a notebook shows of a fitted diagnosis: verdict, causes, gain and settings.

    Nothing is drawn and nothing is fitted.

    Parameters
    ----------
    diagnosis : DiscrepancyDiagnosis
    """
    view = view_of(diagnosis)
    verdict = Section(
        findings.title_of(view),
        (*findings.verdict(view)[:3], "All else: .report()."),
        table=tables.cause_table(view),
        caption=f"Verdict: {diagnosis.verdict_}",
    )
    gain = "" if diagnosis.gain_ is None else f"<pre>{escape(str(diagnosis.gain_))}</pre>"
    settings = f"<details><summary>Settings</summary><pre>{escape(repr(diagnosis))}</pre></details>"
    return f"{html.fragment((verdict,))}\n{gain}\n{settings}"


def _by_output(view: View) -> tuple[Section, ...]:
    if view.stacking is None:
        return ()

    others = [view.of(name) for name in view.outputs if name != view.output]
    drawn = tuple(pictures.picture_output(other) for other in others)
    told = tuple(findings.by_output(view))
    return (Section("By output", told, drawn, tables.output_table(view)),)


def _formulas(view: View) -> tuple[tuple[str, str], ...]:
    if not view.extended:
        return ()
    out = []
    for finding, cause in view.findings:
        # of several outputs a formula without "in" is of all of them
        whole = view.stacking is not None and not isinstance(cause, InOutput)
        own = digits.listing(list(view.outputs)) if whole else view.output
        own = cause.output if isinstance(cause, InOutput) else own
        output, name = own, _word(own)
        if view.log_scale:
            output, name = f"log {output}", rf"\log {name}"
        which = f", {label_of_cause(cause)}" if len(view.findings) > 1 else ""
        out.append((f"Formula{which}", f"{output} = {finding.formula}"))
        out.append((f"In LaTeX{which}", f"{name} = {finding.latex}"))
    return tuple(out)


def _wrapped(sentence: str) -> str:
    # a number stays with its sign
    unbroken = sentence.replace(" %", _HOLD + "%")
    text = textwrap.fill(unbroken, _WIDTH, break_long_words=False, break_on_hyphens=False)
    return text.replace(_HOLD, " ")


def _aligned(table: pd.DataFrame) -> str:
    """Return a table as text, its columns left-aligned."""
    cells = [[str(name) for name in table.columns]]
    cells += [[str(cell) for cell in row] for row in table.itertuples(index=False)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(table.columns))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in cells
    )
