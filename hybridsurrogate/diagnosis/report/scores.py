"""What the extension is worth and how far the numbers can be trusted, in prose."""

from __future__ import annotations

import math

from hybridsurrogate import digits
from hybridsurrogate.diagnosis.checks.emulator import MOST_MISSED, MOST_OPEN, advice
from hybridsurrogate.diagnosis.report.view import View, averaged
from hybridsurrogate.diagnosis.validation.gain import COVERAGE_LEVEL, HALF, Gain
from hybridsurrogate.posterior import KHAT_LIMIT

_EXPLAINED = (
    "Scores are log predictive densities per row (ELPD): the logarithm of the probability density "
    "that a model had given to what was then measured. Higher is better; 0.7 more means twice the "
    "density."
)


def gains(view: View, on_test: Gain | None) -> list[str]:
    """Say what the extension gains on rows that were not seen."""
    d = view.diagnosis
    if d.gain_ is None and (on_test is None or not view.extended):
        return [*_not_measured(), *([] if on_test is None else _same_model(on_test))]
    out = [_EXPLAINED]
    if d.gain_ is not None:
        n = len(d.gain_.folds)
        rows = f"Within the measured range ({d.gain_.n_rows} rows, held out in {n} folds in turn)"
        out += _with_search(d.gain_, view.kinds, rows)
        out += _out_of_range(view)
    if on_test is not None:
        if view.extended:
            out += _gain(on_test, f"On the rows held back ({on_test.n_rows} rows)")
        else:
            out += _same_model(on_test)
    return out


def _out_of_range(view: View) -> list[str]:
    gain, name = view.diagnosis.gain_out_of_range_, view.inputs[0]
    if gain is None:
        return [
            "Beyond the measured range the gain was not measured: it would need one input along "
            "which rows have an order, and 14 rows or more. Give rows held back instead: "
            "report(test=(X_test, y_test))."
        ]
    blocks = len(gain.folds)
    parts = "one part" if blocks == 1 else f"{blocks} parts"
    rows = (
        f"Beyond what a model had seen (the last {gain.n_rows} rows along {name}, in {parts}, each "
        "foreseen from all rows before it)"
    )
    best = view.kinds
    out = _with_search(gain, best, rows)
    if gain.kinds.count(best) < blocks and view.extended:
        out.append("What shows in the last rows alone cannot be foreseen from those before them.")
    return out


def judgement(gain: Gain) -> str:
    """Return in plain words what a difference of scores and its standard error amount to."""
    difference, error = gain.elpd_difference, gain.standard_error
    if difference == 0:
        return "the extension changes nothing"
    if not math.isfinite(error) or error <= 0:
        return "too few rows for a standard error, so that nothing follows from the difference"
    ratio = difference / error
    if abs(ratio) <= 1:
        return "no gain that can be told from chance: the difference is within its standard error"
    if ratio > 2:
        return "the extended model predicts better"
    if ratio > 0:
        return "the extended model seems to predict better, but by less than two standard errors"
    if is_worse(gain):
        return "the extended model predicts worse: do not use it for rows like these"
    return "the extended model seems to predict worse, by less than two standard errors"


def is_worse(gain: Gain) -> bool:
    """Tell whether the model after predicts worse, by more than two standard errors."""
    error = gain.standard_error
    return math.isfinite(error) and gain.elpd_difference < -2 * error


def emulator(view: View) -> list[str]:
    """Say how well the runs, and the surrogate, tell the simulation."""
    check, made = view.diagnosis.emulator_check_, view.diagnosis.estimator_.emulation_
    if check is None:
        return []
    where = ", ".join(f"{rows} along {name}" for name, rows in check.beyond.items())
    beyond = [
        f"Measured rows lie further out than every run ({where}): there the simulation is "
        "continued, not known, and is called wrong more easily. Give runs at the ends of its range."
    ]
    return [
        *([] if made is None else [made.origin]),
        f"At the measured rows the runs leave the simulation open by {_times(check.left_open)} "
        "the noise, which is part of every comparison above"
        + (
            f": effects that are not larger cannot be found. {check.remedy}"
            if check.left_open > MOST_OPEN
            else "."
        ),
        "The surrogate, trained on the runs alone, misses what they tell by "
        f"{_times(check.missed)} the noise there. The comparisons do without it"
        + (
            f", but the predictions rest on it: {advice(view.diagnosis.estimator_.surrogate)}."
            if check.missed > MOST_MISSED
            else "."
        ),
        *(beyond if check.beyond else []),
        *_refinement(view),
    ]


def _refinement(view: View) -> list[str]:
    rounds = getattr(view.diagnosis, "refinement_", None)
    if rounds is None or len(rounds) < 2:
        return []
    first, last = rounds.iloc[0], rounds.iloc[-1]
    return [
        f"{last.n_runs - first.n_runs} further runs where they tell most, beside the first "
        f"{first.n_runs}: what all of them leave open fell from {_times(first.left_open)} to "
        f"{_times(last.left_open)} the noise, and the leading kind went from {first.kind} "
        f"({digits.percent(first.probability)}) to {last.kind} "
        f"({digits.percent(last.probability)})."
    ]


def _times(ratio: float) -> str:
    return "less than a thousandth of" if ratio < 1e-3 else f"{digits.number(ratio, 2)} times"


def draws(view: View) -> list[str]:
    """Say whether the numerical methods behind the numbers did their job."""
    models = [("before", view.diagnosis.estimator_)]
    if view.extended:
        models.append(("after", view.found))
    out = emulator(view)
    for word, model in models:
        d = model.diagnostics_
        # several rounds of proposals may be worth more than the draws that are kept
        effective = min(d.effective_draws, model.n_draws)
        khat = (
            ""
            if math.isnan(d.khat)
            else f" and a Pareto k-hat of {d.khat:.2f} (below {KHAT_LIMIT:g} is good)"
        )
        problems = d.problems()
        trouble = f"Doubtful: {'; '.join(problems)}." if problems else "No problems were found."
        out.append(
            f"The model {word} the extension rests on {effective:.0f} effective draws by "
            f"{d.sampler} sampling{khat}. {trouble}"
        )
    return out + _averaged(view)


def _averaged(view: View) -> list[str]:
    """Say whether draws are doubtful of what the model after averages over, beside the first."""
    doubtful = [
        f"{label} (weight {digits.probability(weight)}): {'; '.join(one.diagnostics_.problems())}"
        for one, label, weight in averaged(view)[1:]
        if one.diagnostics_.problems()
    ]
    if not doubtful:
        return []
    return [
        "Of the other explanations that it averages over, which have fewer draws, these are "
        f"doubtful: {'. '.join(doubtful)}. What that may change is in proportion to their weights."
    ]


def _with_search(gain: Gain, best: str, rows: str) -> list[str]:
    """Say what was gained where the search was repeated on the other rows of each fold."""
    n = len(gain.folds)
    if set(gain.kinds) == {"none"}:
        return [
            f"{rows}: {gain.elpd_before:.3f}. The search was repeated without these rows each time "
            "and never added anything, so that there is no gain to measure.",
            _coverage(gain),
        ]
    counts = {kind: gain.kinds.count(kind) for kind in dict.fromkeys(gain.kinds)}
    chose = ", ".join(f"{kind} {count}" for kind, count in counts.items())
    out = [
        *_gain(gain, rows),
        "The search was repeated without these rows each time, so that choosing the cause is paid "
        f"for; it chose: {chose}.",
    ]
    if counts.get(best, 0) < n:
        out.append(
            f"Of these {n} searches {counts.get(best, 0) or 'none'} chose {best}, as all rows "
            "together do: the score after is that of whatever each of them chose."
        )
    return out


def _gain(gain: Gain, rows: str) -> list[str]:
    error = gain.standard_error
    change = gain.rmse_after / gain.rmse_before - 1 if gain.rmse_before > 0 else 0.0
    way = f"{digits.percent(abs(change))} {'less' if change < 0 else 'more'}"
    way = way if change else "unchanged"
    return [
        f"{rows}: {digits.score(gain.elpd_before, error)} before, "
        f"{digits.score(gain.elpd_after, error)} after, difference "
        f"{digits.plus_minus(gain.elpd_difference, error, sign=True)} (standard error): "
        f"{judgement(gain)}.",
        f"The root mean square error of the predicted mean is {digits.number(gain.rmse_before)} "
        f"before and {digits.number(gain.rmse_after)} after, {way}.",
        _coverage(gain),
    ]


def _coverage(gain: Gain) -> str:
    """Say how many rows the 90 % and the 50 % interval hold."""
    allowed = 2 * math.sqrt(COVERAGE_LEVEL * (1 - COVERAGE_LEVEL) / gain.n_rows)
    off = gain.coverage_after - COVERAGE_LEVEL
    word = (
        "as it should be, within chance"
        if abs(off) <= allowed
        else "too few: the uncertainty stated is too small"
        if off < 0
        else "too many: the uncertainty stated is too large"
    )
    outer, inner = (
        _before_and_after(*pair)
        for pair in (
            (gain.coverage_before, gain.coverage_after),
            (gain.half_before, gain.half_after),
        )
    )
    when = "the last is " if "before" in outer else ""
    return (
        f"The {100 * COVERAGE_LEVEL:g} % interval holds {outer} of these rows: {when}{word}. The "
        f"{100 * HALF:g} % interval holds {inner}."
    )


def _before_and_after(before: float, after: float) -> str:
    if before == after:
        return digits.percent(after)
    return f"{digits.percent(before)} before and {digits.percent(after)} after"


def _same_model(gain: Gain) -> list[str]:
    return [
        f"On the rows held back ({gain.n_rows} rows) the simulation scores {gain.elpd_before:.3f} "
        f"(log predictive density per row, higher is better), with a root mean square error of "
        f"{digits.number(gain.rmse_before)}; its 90 % interval holds "
        f"{digits.percent(gain.coverage_before)} of them. Nothing was added, so that there is no "
        "before and after."
    ]


def _not_measured() -> list[str]:
    return [
        "The gain was not measured by cross-validation. Fit with cv=5, or give rows held back: "
        "report(test=(X_test, y_test))."
    ]
