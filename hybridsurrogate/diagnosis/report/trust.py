"""What a report says about the weight that the simulation deserves."""

from __future__ import annotations

import pandas as pd

from hybridsurrogate import digits
from hybridsurrogate.diagnosis.report.view import View
from hybridsurrogate.scoring.scores import last_of_the_best


def trust(view: View, within: pd.DataFrame | None, beyond: pd.DataFrame | None) -> list[str]:
    """Say how much the simulation should weigh against the data, before and after.

    Parameters
    ----------
    view : View
    within, beyond : pandas.DataFrame or None
        Held-out scores over beta, within the measured range and beyond it.
    """
    if within is None and view.has_weight:
        takes = (
            "which takes minutes. beta_scan(X, y) does it."
            if view.weight_takes_minutes
            else "which takes a while. report(beta_scan=True) does it."
        )
        return [
            "How much weight the simulation deserves was not tried: this surrogate is fitted anew "
            f"at every weight, {takes}"
        ]
    if within is None:
        return [
            "There is no weight to choose: the surrogate is the simulation itself and learns no "
            "coefficients from the measured data."
        ]
    out = [
        "The weight beta says how much the simulation's runs count against the measured data: 0 is "
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
        meaning = (
            "the two are as good within the errors of the scores, so that the data do not say "
            "whether the simulation deserves another weight"
        )
    else:
        meaning = _meaning_of(moved)
    return (
        f"{where} the best weight of the simulation is beta = {before['beta']:g} before the "
        f"extension (score {before['before']:.3f}) and beta = {after['beta']:g} after it "
        f"({after['after']:.3f}): {meaning}."
    )


def _distinct(scan: pd.DataFrame, before: float, after: float) -> bool:
    """Tell whether either model does worse at the other's best weight, by two standard errors."""
    at = scan.set_index("beta")
    return any(
        at.loc[best, word] - at.loc[other, word] > 2 * at.loc[other, f"{word}_error"]
        for word, best, other in (("before", before, after), ("after", after, before))
    )


def _meaning_of(moved: float) -> str:
    return (
        "with its fault named the simulation deserves more weight"
        if moved > 0
        else "naming the fault does not raise the weight that the simulation deserves"
        if moved == 0
        else "even with its fault named the simulation deserves less weight than before"
    )
