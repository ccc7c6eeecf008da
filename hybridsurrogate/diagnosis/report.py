"""The report of a diagnosis: text, one self-contained HTML file, a dict for machines."""

from __future__ import annotations

import base64
import html
import io
import json
import math
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from hybridsurrogate import plotting
from hybridsurrogate.diagnosis.gain import Gain

if TYPE_CHECKING:
    from hybridsurrogate.diagnosis.diagnosis import DiscrepancyDiagnosis

Test = tuple[ArrayLike, ArrayLike] | None
_BETAS = (0.05, 0.25, 0.5, 0.75, 0.95)
_MOST_CAUSES = 8


@dataclass(frozen=True)
class Section:
    """A heading, sentences, and pictures as PNG bytes with their descriptions."""

    title: str
    sentences: tuple[str, ...]
    pictures: tuple[tuple[str, bytes], ...] = ()
    table: pd.DataFrame | None = None


@dataclass(frozen=True)
class Report:
    """What a diagnosis says; prints as text, shows as HTML in a notebook."""

    title: str
    sections: tuple[Section, ...]
    summary: dict[str, Any]

    def __str__(self) -> str:
        lines = [self.title, "=" * len(self.title)]
        for section in self.sections:
            lines += ["", section.title, "-" * len(section.title), *section.sentences]
            if section.table is not None:
                lines.append(section.table.to_string(index=False))
        return "\n".join(lines)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return "\n".join(_section_html(section) for section in self.sections)

    def to_html(self) -> str:
        """Return one self-contained HTML page: no network, pictures inline."""
        return (
            "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
            f"<title>{html.escape(self.title)}</title><style>{_STYLE}</style></head><body>"
            f"<h1>{html.escape(self.title)}</h1>{self._repr_html_()}</body></html>"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers of the report, ready for JSON."""
        return json.loads(json.dumps(self.summary))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the report: text where the name ends in .txt, JSON for .json, else HTML."""
        name = os.fspath(path)
        if name.endswith(".txt"):
            content = str(self) + "\n"
        elif name.endswith(".json"):
            content = json.dumps(self.to_dict(), indent=2)
        else:
            content = self.to_html()
        with open(name, "w", encoding="utf-8") as file:
            file.write(content)


def make_report(diagnosis: DiscrepancyDiagnosis, test: Test = None) -> Report:
    """Write the report of a fitted diagnosis.

    Parameters
    ----------
    diagnosis : DiscrepancyDiagnosis
    test : (X_test, y_test) or None
        Rows held back.
    """
    on_test = diagnosis.gain_on(*test) if test is not None else None
    scan = _beta_scan(diagnosis)
    sections = [
        Section(
            "Verdict",
            tuple(_verdict(diagnosis)),
            (
                _picture("data and calibrated simulation", [plotting.plot_fit(diagnosis)]),
                _picture("where the simulation is wrong", [plotting.plot_discrepancy(diagnosis)]),
            ),
        ),
        Section(
            "Causes weighed",
            tuple(_rivals(diagnosis)),
            (_picture("probabilities of the causes", [plotting.plot_causes(diagnosis)]),),
            _cause_table(diagnosis),
        ),
        Section(
            "The extended model",
            tuple(_extension(diagnosis)),
            (
                _picture(
                    "predictions before and after", plotting.plot_before_after(diagnosis, test)
                ),
                _picture("residuals before and after", plotting.plot_residuals(diagnosis)),
            ),
        ),
        Section("What it gains", tuple(_gains(diagnosis, on_test))),
        Section(
            "Trust in the simulation",
            tuple(_trust(scan)),
            ()
            if scan is None
            else (_picture("ELPD against beta", [plotting.plot_beta_scan(scan)]),),
        ),
        Section("Next measurement", tuple(_next(diagnosis))),
        Section("How far the numbers can be trusted", tuple(_draws(diagnosis))),
    ]
    return Report(
        f"Diagnosis of the simulation {_name(diagnosis)}",
        tuple(sections),
        _summary(diagnosis, on_test, scan),
    )


# ------------------------------------------------------------------------------------ sentences


def _name(diagnosis: DiscrepancyDiagnosis) -> str:
    simulation = diagnosis.estimator_.simulation
    simulator = simulation.simulator
    return f"'{simulator.name}'" if simulator is not None else f"of {simulation.output}"


def _number(value: float) -> str:
    return f"{value:.4g}"


def _estimates(diagnosis: DiscrepancyDiagnosis) -> str:
    return ", ".join(
        f"{name} {_number(mean)} ({_number(low)} to {_number(high)})"
        for name, (mean, low, high) in diagnosis.best_cause_.estimates.items()
    )


def _what(diagnosis: DiscrepancyDiagnosis) -> str:
    best = diagnosis.best_cause_
    return f"{best.kind} in {best.target}" if best.target else best.kind


def _verdict(diagnosis: DiscrepancyDiagnosis) -> list[str]:
    p = f"p = {diagnosis.p_value_:.3g}"
    meaning = (
        f"If the simulation were right, a search like this one would find as much in a share "
        f"{diagnosis.p_value_:.3g} of all data sets."
    )
    name, best = _name(diagnosis), diagnosis.best_cause_
    if diagnosis.verdict_ == "adequate":
        return [
            f"The data give no reason to doubt the simulation {name} ({p}; 'none' has "
            f"{100 * best.probability:.0f} % of the probability).",
            meaning,
            "That is not a proof: an effect well below the noise would not show.",
        ]
    first = f"The simulation {name} is wrong in a way that the data show ({p})."
    if diagnosis.verdict_ == "unexplained":
        band = diagnosis.discrepancy_
        return [
            first,
            meaning,
            "No cause of the catalogue explains it better than a smooth curve of unknown shape. "
            f"Over {100 * band.share_outside:.0f} % of the measured range of {band.column} the "
            "90 % band of that curve excludes zero.",
        ]
    share = 100 * best.probability
    named = f"{_what(diagnosis)}, with {_estimates(diagnosis)} (90 % intervals)"
    if diagnosis.verdict_ == "named":
        return [first, f"The cause: {named}. Its probability is {share:.1f} %.", meaning]
    return [
        first,
        "The data do not single out one cause. These kinds together have 90 % of the "
        f"probability: {', '.join(diagnosis.indistinguishable_)}.",
        f"The first of them: {named}. Its probability is {share:.1f} %.",
        meaning,
    ]


def _rivals(diagnosis: DiscrepancyDiagnosis) -> list[str]:
    best = diagnosis.causes_[diagnosis.causes_["kind"] == diagnosis.best_cause_.kind].iloc[0]
    out = [
        "Probabilities given the data; half of the prior is on 'none', that nothing is wrong. "
        "log_evidence is against 'none', in nats."
    ]
    remainder = float(best["remainder"])
    if diagnosis.verdict_ in ("named", "ambiguous") and remainder > 0.5:
        X, y = diagnosis.estimator_._measured
        rows = plotting.as_given(diagnosis, X)
        before = float(np.var(y - diagnosis.estimator_.predict(rows)))
        after = y - diagnosis.extended_estimator_.predict(rows)
        order = np.argsort(X[:, 0], kind="stable")
        lag = float(np.corrcoef(after[order][:-1], after[order][1:])[0, 1])
        out.append(
            f"The cause is not the whole story: with probability {remainder:.2f} a smooth "
            f"remainder is needed beside it. The extension removes "
            f"{100 * (1 - float(np.var(after)) / before):.0f} % of the residual variance; what is "
            f"left has a correlation of {lag:.2f} between neighbouring rows."
        )
    return out


def _cause_table(diagnosis: DiscrepancyDiagnosis) -> pd.DataFrame:
    table = diagnosis.causes_
    weighed = table[table["note"] == ""].head(_MOST_CAUSES)
    shown = pd.concat([weighed, table[table["note"] != ""]])
    return pd.DataFrame(
        {
            "cause": shown["kind"],
            "target": [t if isinstance(t, str) else "" for t in shown["target"]],
            "probability": [f"{p:.3f}" for p in shown["probability"]],
            "log_evidence": ["" if math.isnan(e) else f"{e:.1f}" for e in shown["log_evidence"]],
            "note": shown["note"],
        }
    )


def _extension(diagnosis: DiscrepancyDiagnosis) -> list[str]:
    if diagnosis.verdict_ == "adequate":
        return ["Nothing was added: the extended model is the simulation as it is."]
    scale = diagnosis.search_.problem.likelihood.log_scale
    out = [
        f"{'log ' if scale else ''}{diagnosis.estimator_.simulation.output} = "
        f"{diagnosis.best_cause_.formula}"
    ]
    if diagnosis.extended_simulator_ is not None:
        names = ", ".join(diagnosis.extended_simulator_.parameter_names)
        out.append(f"extended_simulator_ runs it, with the parameters {names}.")
    return out


def _gain_sentence(gain: Gain, where: str) -> str:
    return (
        f"{where} ({gain.n_rows} rows): log predictive density per row (ELPD) "
        f"{gain.elpd_before:.3f} before, {gain.elpd_after:.3f} after, difference "
        f"{gain.elpd_difference:+.3f} +- {gain.standard_error:.3f}; root mean square error "
        f"{_number(gain.rmse_before)} before, {_number(gain.rmse_after)} after; the 90 % interval "
        f"holds {100 * gain.coverage_before:.0f} % before, {100 * gain.coverage_after:.0f} % after."
    )


def _gains(diagnosis: DiscrepancyDiagnosis, on_test: Gain | None) -> list[str]:
    out = []
    if diagnosis.gain_ is not None:
        kinds = diagnosis.gain_.kinds
        counts = ", ".join(f"{kind} {kinds.count(kind)}" for kind in dict.fromkeys(kinds))
        out.append(_gain_sentence(diagnosis.gain_, "On held-out folds of the measured rows"))
        out.append(
            f"The search was repeated in each of the {len(kinds)} folds, so that choosing the "
            f"cause is paid for; the folds chose: {counts}."
        )
    if on_test is not None:
        out.append(_gain_sentence(on_test, "On the rows held back"))
    return out or ["Not measured: no folds and no rows held back."]


def _trust(scan: pd.DataFrame | None) -> list[str]:
    if scan is None:
        return [
            "The surrogate is the simulation itself and has nothing to learn from the data, so "
            "that there is nothing for beta to weigh."
        ]
    before, after = (scan.iloc[int(np.argmax(scan[word]))] for word in ("before", "after"))
    return [
        f"Before the extension the best weight of the simulation is beta = {before['beta']:g} "
        f"(held-out ELPD {before['before']:.3f}), after it beta = {after['beta']:g} "
        f"({after['after']:.3f})."
    ]


def _next(diagnosis: DiscrepancyDiagnosis) -> list[str]:
    place = ", ".join(f"{k} = {_number(v)}" for k, v in diagnosis.next_measurement_.items())
    return [f"One more measurement would best tell the rivals apart at {place}."]


def _draws(diagnosis: DiscrepancyDiagnosis) -> list[str]:
    out = []
    for word, model in (
        ("before", diagnosis.estimator_),
        ("after", diagnosis.extended_estimator_),
    ):
        d = model.diagnostics_
        khat = "" if math.isnan(d.khat) else f", Pareto k-hat {d.khat:.2f}"
        problems = d.problems()
        trouble = f" Doubtful: {'; '.join(problems)}." if problems else ""
        out.append(
            f"Draws {word} the extension: {d.sampler}, {d.effective_draws:.0f} effective{khat}."
            f"{trouble}"
        )
    return out


def _beta_scan(diagnosis: DiscrepancyDiagnosis) -> pd.DataFrame | None:
    if not diagnosis.estimator_.posterior_.coefficients.shape[1]:
        return None
    X, y = diagnosis.estimator_._measured
    return diagnosis.beta_scan(plotting.as_given(diagnosis, X), y, _BETAS)


def _summary(
    diagnosis: DiscrepancyDiagnosis, on_test: Gain | None, scan: pd.DataFrame | None
) -> dict[str, Any]:
    best = diagnosis.best_cause_
    table = diagnosis.causes_.astype(object).where(diagnosis.causes_.notna(), None)
    return {
        "verdict": diagnosis.verdict_,
        "p_value": float(diagnosis.p_value_),
        "best_cause": asdict(best),
        "indistinguishable": list(diagnosis.indistinguishable_),
        "causes": table.to_dict("records"),
        "gain": None if diagnosis.gain_ is None else asdict(diagnosis.gain_),
        "gain_on_test": None if on_test is None else asdict(on_test),
        "beta_scan": None if scan is None else scan.to_dict("records"),
        "next_measurement": diagnosis.next_measurement_,
    }


# ----------------------------------------------------------------------------------------- HTML

_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;"
    "color:#222;background:#fff}h1{font-size:1.6rem}h2{font-size:1.2rem;margin-top:2rem}"
    "img{max-width:100%;display:block;margin:.5rem 0}table{border-collapse:collapse}"
    "th,td{text-align:left;padding:.2rem .8rem .2rem 0;border-bottom:1px solid #ddd}"
)


def _picture(description: str, axes: Sequence[Axes]) -> tuple[str, bytes]:
    buffer = io.BytesIO()
    figure = axes[0].get_figure(root=True)
    assert figure is not None
    figure.savefig(buffer, format="png", dpi=110)
    return description, buffer.getvalue()


def _section_html(section: Section) -> str:
    parts = [f"<h2>{html.escape(section.title)}</h2>"]
    parts += [f"<p>{html.escape(sentence)}</p>" for sentence in section.sentences]
    for description, png in section.pictures:
        data = base64.b64encode(png).decode()
        parts.append(
            f"<img alt='{html.escape(description, quote=True)}' src='data:image/png;base64,{data}'>"
        )
    if section.table is not None:
        parts.append(section.table.to_html(index=False, border=0, escape=True))
    return "\n".join(parts)
