"""A report for machines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pandas as pd

from hybridsurrogate.diagnosis.report.elements.section import FirstScreen, Section
from hybridsurrogate.diagnosis.report.elements.tables import parameter_intervals, thirds
from hybridsurrogate.diagnosis.report.elements.view import View, averaged, root_mean_square
from hybridsurrogate.diagnosis.validation.beta_scan import best_beta
from hybridsurrogate.diagnosis.validation.gain import HeldOutGain

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
    made = result.before.emulation_
    values = {
        "schema_version": SCHEMA_VERSION,
        "headline": first.headline,
        "lead": first.lead,
        "cards": first.cards,
        "next": first.advice,
        "units": view.units,
        "verdict": result.conclusion.verdict,
        "concerns": result.conclusion.concerns,
        "undecided_by": result.conclusion.undecided_by,
        "smallest_detectable": result.conclusion.smallest_detectable,
        "detectable": result.conclusion.detectable,
        "cautions": result.cautions,
        "probability_right": result.conclusion.probability_right,
        "p_value": result.test.p_value,
        "false_alarm_rate": result.settings.false_alarm_rate,
        "n_replicates": result.settings.n_replicates,
        "n_rows": len(view.y),
        "output": view.output,
        "columns": view.columns,
        "log_scale": view.log_scale,
        "best_cause": result.extension.best_cause,
        "found_causes": result.extension.found_causes,
        "indistinguishable": result.indistinguishable,
        "averaged": [{"causes": label, "weight": weight} for _, label, weight in averaged(view)],
        "causes": result.causes,
        "parameters": parameter_intervals(view),
        "discrepancy": {
            "column": band.column,
            "grid": view.band_x,
            "mean": band.mean,
            "lower": band.lower,
            "upper": band.upper,
            "share_outside": band.share_outside,
            "thirds": thirds(view),
        },
        "residual_rms": {
            "before": root_mean_square(view.y - view.before),
            "after": root_mean_square(view.y - view.after),
        },
        "gain": gains["within"],
        "gain_out_of_range": gains["beyond"],
        "gain_on_test": gains["held out"],
        "beta_scan": within,
        "beta_scan_out_of_range": beyond,
        "best_beta": _best(within),
        "best_beta_out_of_range": _best(beyond),
        "next_measurement": result.place,
        "next_information": result.next_measurement.information,
        "residual_check": result.conclusion.residual_check,
        "at_prior_end": result.extension.at_prior_end,
        "confounded": result.extension.confounded,
        "emulator": result.emulator_check,
        "emulation": made
        and {"n_runs": made.runs.n_runs, "seconds": made.seconds, "left_open": made.left_open},
        "draws": {
            "before": result.before.diagnostics_,
            "after": view.found.diagnostics_,
        },
        "sections": [
            {
                "title": section.title,
                "sentences": section.sentences,
                "formulas": {name: plain for name, plain, _ in section.formulas},
                "tables": section.tables,
            }
            for section in sections
        ],
    }
    return plain(values)


def _best(scan: pd.DataFrame | None) -> dict[str, float] | None:
    return None if scan is None else {word: best_beta(scan, word) for word in ("before", "after")}


def plain(value: Any) -> Any:
    """Return a value made of dict, list, str, int, float, bool and None; NaN becomes None.

    Of a table a list of its rows by name, of a dataclass or a named tuple a dict of its fields.
    """
    if isinstance(value, pd.DataFrame):
        value = value.to_dict("records")
    elif is_dataclass(value):
        value = {one.name: getattr(value, one.name) for one in fields(value)}
    elif hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
