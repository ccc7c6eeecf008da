"""A report for machines."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd

from hybridsurrogate.diagnosis.checks.residuals import ResidualCheck
from hybridsurrogate.diagnosis.report.elements.section import FirstScreen, Section
from hybridsurrogate.diagnosis.report.elements.tables import parameter_intervals, thirds
from hybridsurrogate.diagnosis.report.elements.view import View, averaged
from hybridsurrogate.diagnosis.validation.beta_scan import best_beta
from hybridsurrogate.diagnosis.validation.gain import HeldOutGain
from hybridsurrogate.estimators.emulation import Emulation

# raised whenever a key changes its meaning or goes away
SCHEMA_VERSION = 3


def summary(
    view: View,
    first: FirstScreen,
    sections: tuple[Section, ...],
    gains: Mapping[str, HeldOutGain | None],
    scans: tuple[pd.DataFrame | None, pd.DataFrame | None],
) -> dict[str, Any]:
    """Return the numbers and the sentences of a report; ``json.dumps`` takes it as it is."""
    result = view.result
    band = view.band
    within, beyond = scans
    values = {
        "schema_version": SCHEMA_VERSION,
        "headline": first.headline,
        "lead": list(first.lead),
        "cards": [card._asdict() for card in first.cards],
        "next": [one._asdict() for one in first.advice],
        "units": dict(view.units),
        "verdict": result.conclusion.verdict,
        "concerns": result.conclusion.concerns,
        "undecided_by": result.conclusion.undecided_by,
        "smallest_detectable": result.conclusion.smallest_detectable,
        "detectable": _records(result.conclusion.detectable),
        "cautions": [one._asdict() for one in result.cautions],
        "probability_right": result.conclusion.probability_right,
        "p_value": result.test.p_value,
        "false_alarm_rate": result.settings.false_alarm_rate,
        "n_replicates": result.settings.n_replicates,
        "n_rows": len(view.y),
        "output": view.output,
        "columns": list(view.columns),
        "log_scale": view.log_scale,
        "best_cause": asdict(result.extension.best_cause),
        "found_causes": [asdict(finding) for finding in result.extension.found_causes],
        "indistinguishable": list(result.indistinguishable),
        "averaged": [{"causes": label, "weight": weight} for _, label, weight in averaged(view)],
        "causes": result.causes.to_dict("records"),
        "parameters": parameter_intervals(view),
        "discrepancy": {
            "column": band.column,
            "grid": band.grid[:, view.columns.index(band.column)],
            "mean": band.mean,
            "lower": band.lower,
            "upper": band.upper,
            "share_outside": band.share_outside,
            "thirds": [third._asdict() for third in thirds(view)],
        },
        "residual_rms": {
            "before": np.sqrt(np.mean((view.y - view.before) ** 2)),
            "after": np.sqrt(np.mean((view.y - view.after) ** 2)),
        },
        "gain": _record(gains["within"]),
        "gain_out_of_range": _record(gains["beyond"]),
        "gain_on_test": _record(gains["held out"]),
        "beta_scan": _records(within),
        "beta_scan_out_of_range": _records(beyond),
        "best_beta": _best(within),
        "best_beta_out_of_range": _best(beyond),
        "next_measurement": result.next_measurement.place,
        "next_information": result.next_measurement.information,
        "residual_check": _record(result.conclusion.residual_check),
        "at_prior_end": [one._asdict() for one in result.extension.at_prior_end],
        "confounded": result.extension.confounded.to_dict("records"),
        "emulator": None if result.emulator_check is None else result.emulator_check._asdict(),
        "emulation": _emulation(result.before.emulation_),
        "draws": {
            "before": asdict(result.before.diagnostics_),
            "after": asdict(view.found.diagnostics_),
        },
        "sections": [
            {
                "title": section.title,
                "sentences": list(section.sentences),
                "formulas": {name: plain for name, plain, _ in section.formulas},
                "tables": [
                    {"caption": table.caption, "rows": table.rows.to_dict("records")}
                    for table in section.tables
                ],
            }
            for section in sections
        ],
    }
    return plain(values)


def _emulation(made: Emulation | None) -> dict[str, float] | None:
    if made is None:
        return None
    return {"n_runs": made.runs.n_runs, "seconds": made.seconds, "left_open": made.left_open}


def _record(one: HeldOutGain | ResidualCheck | None) -> dict[str, Any] | None:
    return None if one is None else asdict(one)


def _records(table: pd.DataFrame | None) -> list[dict[Hashable, Any]] | None:
    return None if table is None else table.to_dict("records")


def _best(scan: pd.DataFrame | None) -> dict[str, float] | None:
    return None if scan is None else {word: best_beta(scan, word) for word in ("before", "after")}


def plain(value: Any) -> Any:
    """Return a value made of dict, list, str, int, float, bool and None; NaN becomes None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
