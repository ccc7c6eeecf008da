"""What the extension is worth on held-out rows, and which weight beta the simulation deserves."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

import pandas as pd

from hybridsurrogate.diagnosis.report.details import pictures
from hybridsurrogate.diagnosis.report.elements.section import Picture, Section, Table
from hybridsurrogate.diagnosis.report.elements.view import View
from hybridsurrogate.diagnosis.validation.beta_scan import has_weight, is_slow
from hybridsurrogate.diagnosis.validation.gain import INNER_LEVEL, HeldOutGain
from hybridsurrogate.numerics import digits
from hybridsurrogate.scoring.scores import COVERAGE_LEVEL, last_of_the_best

_EXPLAINED = (
    "The log score (ELPD) is the logarithm of the probability density that a model gave to a "
    "held-out measurement. Higher is better; 0.7 more means twice the density."
)


def section(view: View, gains: Mapping[str, HeldOutGain | None]) -> Section:
    """Return the section.

    Parameters
    ----------
    view : View
    gains : dict of str to HeldOutGain or None
        "within", "beyond" and "held out".
    """
    known = {name: gain for name, gain in gains.items() if gain is not None}
    if not known:
        how = (
            "The gain was not measured by cross-validation. Fit with cv=5, or give held-out rows: "
            "report(test=(X_test, y_test))."
        )
        return Section("Gain in detail", "not measured", (how,))
    sentences = [_EXPLAINED, *(f"{_rows(view, n, g)}: {judgement(g)}." for n, g in known.items())]
    sentences += [
        f"{name.capitalize()}: of the extended model's 90 % intervals "
        f"{digits.percent(gain.coverage_after)} cover the row, {coverage_word(gain)}."
        for name, gain in known.items()
    ]
    sentences += [
        f"{name.capitalize()}: the search was repeated without the held-out rows; its folds chose "
        f"{digits.listing([f'{kind} ({n})' for kind, n in Counter(gain.kinds).most_common()])}."
        for name, gain in known.items()
        if gain.kinds
    ]
    if gains.get("within") is not None and gains.get("beyond") is None:
        sentences.append(
            "Beyond the measured range nothing was tested: that takes 14 rows with an order along "
            "one input, or held-out rows, report(test=(X_test, y_test))."
        )
    tables = tuple(
        Table(score_table(view, gain), _rows(view, n, gain)) for n, gain in known.items()
    )
    counted = [f"{len(g.folds)} folds {n}" if g.folds else f"{g.n_rows} rows held out by you"
               for n, g in known.items()]  # fmt: skip
    picture = Picture(pictures.picture_gain, known)
    return Section(
        "Gain in detail", ", ".join(counted), tuple(sentences), tables=tables, pictures=(picture,)
    )


def score_table(view: View, gain: HeldOutGain) -> pd.DataFrame:
    """Return scores before and after with the standard error of their difference."""
    unit = view.units.get(view.output, "") if view.stacking is None else "standard deviations"
    rows = [
        (
            "log score a row",
            digits.score(gain.elpd_before, gain.standard_error),
            digits.score(gain.elpd_after, gain.standard_error),
            digits.plus_minus(gain.elpd_difference, gain.standard_error, sign=True),
        ),
        (
            f"error (RMSE{f', {unit}' if unit else ''})",
            digits.number(gain.rmse_before, 3),
            digits.number(gain.rmse_after, 3),
            digits.plus_minus(gain.rmse_after - gain.rmse_before, gain.rmse_error, sign=True),
        ),
    ]
    for level, before, after in (
        (COVERAGE_LEVEL, gain.coverage_before, gain.coverage_after),
        (INNER_LEVEL, gain.half_before, gain.half_after),
    ):
        name = f"covered by {100 * level:.0f} % intervals"
        rows.append((name, digits.percent(before), digits.percent(after), ""))
    return pd.DataFrame(rows, columns=["", "before", "after", "difference"])


def judgement(gain: HeldOutGain) -> str:
    """Return in plain words what a difference of scores and its standard error amount to."""
    difference, error = gain.elpd_difference, gain.standard_error
    if difference == 0:
        return "the extension changes nothing"
    if not math.isfinite(error) or error <= 0:
        return "too few rows for a standard error, so that nothing follows from the difference"
    if is_better(gain):
        return "the extended model predicts better"
    if is_worse(gain):
        return "the extended model predicts worse: do not use it for rows like these"
    if abs(difference) <= error:
        return "no clear gain: the difference is within its standard error"
    word = "better" if difference > 0 else "worse"
    return f"the extended model seems to predict {word}, by less than two standard errors"


def is_better(gain: HeldOutGain) -> bool:
    """Return whether the model after predicts better, by more than two standard errors."""
    error = gain.standard_error
    return math.isfinite(error) and error > 0 and gain.elpd_difference > 2 * error


def is_worse(gain: HeldOutGain | None) -> bool:
    """Return whether the model after predicts worse, by two standard errors; False of None."""
    if gain is None or not math.isfinite(gain.standard_error):
        return False
    return gain.elpd_difference < -2 * gain.standard_error


def coverage_word(gain: HeldOutGain) -> str:
    """Return whether the 90 % intervals of the model after cover as many rows as they should."""
    allowed = 2 * math.sqrt(COVERAGE_LEVEL * (1 - COVERAGE_LEVEL) / gain.n_rows)
    off = gain.coverage_after - COVERAGE_LEVEL
    if abs(off) <= allowed:
        return "as they should, within chance"
    return "too few: they are too narrow" if off < 0 else "too many: they are too wide"


def _rows(view: View, name: str, gain: HeldOutGain) -> str:
    """Return which rows a gain is of."""
    if name == "within":
        return f"Within the measured range ({gain.n_rows} rows, {len(gain.folds)} random folds)"
    if name == "beyond":
        blocks = len(gain.folds)
        parts = "one block" if blocks == 1 else f"{blocks} blocks"
        return (
            f"Beyond the measured range (the last {gain.n_rows} rows along {view.inputs[0]}, "
            f"{parts}, each predicted from all rows before it)"
        )
    return f"On the rows that you held out ({gain.n_rows} rows)"


def section_on_weights(
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
    drawn = () if within is None else (Picture(pictures.picture_weight, within, beyond),)
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
        _best_weight(view, within, "Within the measured range"),
    ]
    if beyond is not None:
        out.append(_best_weight(view, beyond, "Beyond it"))
    return out


def _best_weight(view: View, scan: pd.DataFrame, where: str) -> str:
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
