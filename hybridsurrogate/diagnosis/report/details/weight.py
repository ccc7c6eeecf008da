"""Which weight beta the simulation deserves against the measured data."""

from __future__ import annotations

from functools import partial

import pandas as pd

from hybridsurrogate.diagnosis.report.details import pictures
from hybridsurrogate.diagnosis.report.elements.section import Picture, Section
from hybridsurrogate.diagnosis.report.elements.view import View
from hybridsurrogate.diagnosis.validation.beta_scan import has_weight, is_slow
from hybridsurrogate.numerics import digits
from hybridsurrogate.scoring.scores import last_of_the_best


def section(
    view: View, within: pd.DataFrame | None, beyond: pd.DataFrame | None
) -> tuple[Section, ...]:
    """Return the section, nothing where there is no weight to choose.

    Parameters
    ----------
    view : View
    within, beyond : pandas.DataFrame or None
        Held-out scores over beta, within the measured range and beyond it.
    """
    if within is None and not has_weight(view.result.before):
        return ()
    hint = "not tried" if within is None else "scores over beta"
    drawn = () if within is None else (Picture(partial(pictures.picture_weight, within, beyond)),)
    sentences = tuple(weight(view, within, beyond))
    return (Section("Weight of the simulation", hint, sentences, pictures=drawn),)


def weight(view: View, within: pd.DataFrame | None, beyond: pd.DataFrame | None) -> list[str]:
    """Report how much the simulation should count against the data, before and after."""
    if within is None:
        does_it = "report(beta_scan=True) does it in seconds"
        if any(map(is_slow, view.result.extension.beta_scans.models)):
            does_it = "beta_scan(X, y) does it in minutes"
        return [
            "The surrogate is fitted anew at every weight. Which one suits was not tried: "
            f"{does_it}."
        ]
    out = [
        "The weight beta sets how much the simulation's runs count against the measured data: 0 is "
        "the data only, 1 the simulation only. Tried on held-out rows: "
        f"{digits.listing([f'{beta:g}' for beta in within['beta']])}.",
        _best(view, within, "Within the measured range"),
    ]
    if beyond is not None:
        out.append(_best(view, beyond, "Beyond it"))
    return out


def _best(view: View, scan: pd.DataFrame, where: str) -> str:
    before, after = (scan.iloc[last_of_the_best(scan[word])] for word in ("before", "after"))
    if not view.extended:
        return f"{where} the best is beta = {before['beta']:g} (score {before['before']:.3f})."
    moved = float(after["beta"]) - float(before["beta"])
    if moved and not _distinct(scan, float(before["beta"]), float(after["beta"])):
        meaning = "the two are as good within the errors of the scores"
    elif moved > 0:
        meaning = "with its fault named the simulation deserves more weight"
    elif moved == 0:
        meaning = "naming the fault does not raise the weight that the simulation deserves"
    else:
        meaning = "even with its fault named the simulation deserves less weight than before"
    return (
        f"{where} the best weight is beta = {before['beta']:g} before the extension (score "
        f"{before['before']:.3f}) and beta = {after['beta']:g} after it ({after['after']:.3f}): "
        f"{meaning}."
    )


def _distinct(scan: pd.DataFrame, before: float, after: float) -> bool:
    """Return whether either model does worse at the other's best weight, by two standard errors."""
    at = scan.set_index("beta")
    return any(
        at.loc[best, word] - at.loc[other, word] > 2 * at.loc[other, f"{word}_error"]
        for word, best, other in (("before", before, after), ("after", after, before))
    )
