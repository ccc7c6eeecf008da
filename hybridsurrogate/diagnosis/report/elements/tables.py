"""The tables of a report."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from hybridsurrogate.diagnosis.answers.discrepancy import Third, shares_of_thirds
from hybridsurrogate.diagnosis.answers.finding import form_of
from hybridsurrogate.diagnosis.report.elements.view import SETTINGS, View, root_mean_square
from hybridsurrogate.diagnosis.search.candidate import total_evidence
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.context import label_columns
from hybridsurrogate.effects.noise.known_errors import SharedErrors
from hybridsurrogate.effects.parameters.parameter_by_experiment import ParameterByExperiment
from hybridsurrogate.numerics import digits
from hybridsurrogate.types import FloatArray

Interval = tuple[float, float, float]


def compared_causes(view: View) -> pd.DataFrame:
    """Return the causes that were compared, most probable first."""
    candidates = view.search.candidates
    evidence = total_evidence(candidates)
    above_none = {id(w): value - evidence[0] for w, value in zip(candidates, evidence, strict=True)}
    shown = view.candidates[: SETTINGS.max_causes]
    return pd.DataFrame(
        {
            "cause": [form_of(w.cause) if w.cause else "nothing" for w, _ in shown],
            "of": [(w.cause.target or "") if w.cause else "" for w, _ in shown],
            "probability": [digits.probability(p) for _, p in shown],
            "log evidence": [f"{above_none[id(w)]:.1f}" for w, _ in shown],
        }
    )


def thirds(view: View) -> list[Third]:
    """Return where the extension changes the predictions; nothing without an extension."""
    if not any(cause.changes_output for _, cause in view.findings) or not np.any(view.change):
        return []
    rows = dict(zip(view.columns, view.X.T, strict=True))
    labels = label_columns(rows, len(view.inputs), view.result.before.experiment, view.labels)
    found = shares_of_thirds(view.X, view.change, view.columns, labels)
    # other columns than inputs and what a cause looks at have a share by accident
    matter = {*view.inputs, *(name for _, cause in view.findings for name in cause.reads)}
    return [third for third in found if third.column in matter]


def third_table(view: View) -> pd.DataFrame | None:
    """Return the shares of the discrepancy by thirds of each column's measured range."""
    found = thirds(view)
    if not found:
        return None
    return pd.DataFrame(
        {
            "column": [t.column for t in found],
            "from": [view.value(t.column, t.low) for t in found],
            "to": [view.value(t.column, t.high) for t in found],
            "share of the discrepancy": [digits.percent(t.share) for t in found],
            "share of the rows": [digits.percent(t.rows) for t in found],
        }
    )


def parameter_intervals(view: View) -> dict[str, dict[str, Interval]]:
    """Return mean and 90 % interval of parameters and noise, before and after the extension."""
    out: dict[str, dict[str, Interval]] = {}
    # what a cause replaces has its value there
    replaced = {cause.replaces for _, cause in view.findings}
    for word, model in (("before", view.result.before), ("after", view.found)):
        draws = model.posterior_.named()
        names = view.result.before.simulation.parameter_names
        for name in (*names, "noise_sigma" if "sigma" in names else "sigma", "jitter"):
            # each of several outputs has separate noise, and a separate table
            if word == "after" and name in replaced:
                continue
            if name in draws and (name in names or view.stacking is None):
                out.setdefault(name, {})[word] = _interval(draws[name])
        for name, values in {**_by_experiment(model), **_known(view, model)}.items():
            out.setdefault(name, {})[word] = _interval(values)
        for output in view.outputs if view.stacking is not None else ():
            noise = view.of(output).noise_draws(model)
            out.setdefault(f"noise of {output}", {})[word] = _interval(noise)
    return out


def _known(view: View, model: Any) -> dict[str, FloatArray]:
    """Return draws of effects that were known before the diagnosis."""
    return {
        f"{effect.name}: {name}": values
        for k, effect in enumerate(view.result.before.effects)
        for name, values in model.posterior_.estimates(k).items()
    }


def _by_experiment(model: Any) -> dict[str, FloatArray]:
    """Return draws of what was declared to differ between experiments."""
    declared = model.by_experiment or {}
    effects = [*enumerate(model.posterior_.model.effects)]
    differing = {k: one.parameter for k, one in effects if isinstance(one, ParameterByExperiment)}
    words = {k: name for k, name in differing.items() if name in declared}
    if not declared.keys().isdisjoint(model.simulation.outputs):
        words |= {k: "shared error:" for k, one in effects if isinstance(one, SharedErrors)}
    return {
        f"{word} {name}": values
        for k, word in words.items()
        for name, values in model.posterior_.estimates(k).items()
    }


def estimate_table(view: View) -> pd.DataFrame:
    """Return the estimates of causes and parameters with 90 % intervals and units."""
    rows = [
        (f"{finding.kind}: {name}", unit_of(view, cause, name), "", digits.interval(*limits))
        for finding, cause in view.findings
        for name, limits in finding.estimates.items()
    ]
    for name, limits in parameter_intervals(view).items():
        shown, unit = ("noise", view.scale) if name == "sigma" else (name, view.units.get(name, ""))
        if view.stacking is not None and name.startswith("noise of "):
            unit = view.of(name.removeprefix("noise of ")).scale
        before, after = (digits.interval(*limits[w]) if w in limits else "" for w in _WORDS)
        rows.append((shown, unit, before, after))
    table = pd.DataFrame(rows, columns=["quantity", "unit", *_WORDS])
    return table if view.extended else table.drop(columns="after")


_WORDS = ("before", "after")
_ALONG = ("location", "end", "period", "peak", "width", "duration", "scale", "half", "lag")


def unit_of(view: View, cause: Cause, name: str) -> str:
    """Return the unit of an estimate of a cause, by the units or names of columns; "" if unknown.

    Parameters
    ----------
    view : View
    cause : Cause
    name : str
        Of the estimate.
    """
    if cause.output is not None:
        return unit_of(view.of(cause.output), cause.inner, name)
    along = getattr(cause, "column", None) or view.inputs[0]
    column = view.unit_of(along)
    if cause.kind == "interaction":
        column = " ".join(map(view.unit_of, cause.reads))
    target = view.unit_of(cause.target or "")
    if isinstance(cause, ParameterByExperiment):
        return target
    moved = target if cause.kind == "parameter-drift" else view.scale
    if name.startswith(("level_", "jump_")):
        return view.scale
    if cause.kind == "noise" and name == "slope":
        return f"log noise per {column}"
    inside = cause.modification is not None
    form = getattr(cause, "form", "")
    if name == "amplitude" and form == "seasonal":
        return f"{target} per {column}"
    if name in ("amount", "amplitude") and inside:
        return f"a share of {target}"
    if name == "rate" and inside:
        return f"{target} per {column}" if form == "constant" else f"per {column}"
    if name.removeprefix("overtone_") in _ALONG:
        return column
    return {
        "amplitude": moved,
        "overtone": moved,
        "change": moved,
        "level": view.scale,
        "limit": view.scale,
        "slope": f"{moved} per {column}",
        "curvature": f"{moved} per {column} squared",
        "value": target,
        "gap": target,
        "spread": target,
        "gain": "a factor",
        "ratio": "a factor",
        "length_scale": "half the measured range",
    }.get(name, "")


def _interval(draws: np.ndarray) -> Interval:
    low, high = np.quantile(draws, [0.05, 0.95])
    return float(np.mean(draws)), float(low), float(high)


def noise_of(view: View, after: bool = False) -> str:
    """Return the size of the noise before or after the extension, with its unit."""
    model = view.found if after else view.result.before
    return view.amount(view.noise(model))


def output_table(view: View) -> pd.DataFrame:
    """Return the residuals of each of several outputs as a root mean square, and its noise."""
    rows = []
    for name in view.outputs:
        one = view.of(name)
        left = [root_mean_square(one.y - p) for p in (one.before, one.after)]
        noise = [one.noise(model) for model in (view.result.before, view.found)]
        rows.append((name, len(one.y), *map(digits.number, [*left, *noise])))
    columns = [f"{what} {when}" for what in ("residual", "noise") for when in _WORDS]
    table = pd.DataFrame(rows, columns=["output", "measurements", *columns])
    return table if view.extended else table.drop(columns=columns[1::2])


def rounded(table: pd.DataFrame, n: int) -> pd.DataFrame:
    """Return a table with its numbers as text of n digits, "" where there is none."""
    out = table.copy()
    for name in out.select_dtypes("number"):
        out[name] = [digits.number(float(x), n) if x == x else "" for x in out[name]]
    return out
