"""What was found, in prose: verdict, place, extension."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hybridsurrogate import digits
from hybridsurrogate.diagnosis.checks.identifiability import confounded, sentences
from hybridsurrogate.diagnosis.checks.outside import DOCUMENTED, N_CASES, NOT_HELD
from hybridsurrogate.diagnosis.checks.residuals import STRANGE
from hybridsurrogate.diagnosis.report.tables import noise_of, thirds, unit_of
from hybridsurrogate.diagnosis.report.view import (
    View,
    averaged,
    label_of,
    label_of_cause,
)
from hybridsurrogate.diagnosis.search.evidence import kind_shares
from hybridsurrogate.effects import Remainder
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.in_output import InOutput
from hybridsurrogate.effects.output.remainder import GROWTH
from hybridsurrogate.effects.registry import meaning_of

if TYPE_CHECKING:
    from hybridsurrogate.diagnosis.answers.finding import CauseFinding

# estimates that a sentence holds
_MOST_TOLD = 6


def title_of(view: View) -> str:
    """Return what the report is about."""
    return f"Diagnosis of the simulation {name_of(view)}"


def name_of(view: View) -> str:
    """Return the name of the simulation, or of its output."""
    simulator = view.diagnosis.estimator_.simulation.simulator
    return f"'{simulator.name}'" if simulator is not None else f"of {view.output}"


def verdict(view: View) -> list[str]:
    """Say whether anything is wrong, then why to doubt that, what it is, and how sure."""
    first, *further = _verdict(view)
    return [first, *(one.sentence for one in view.diagnosis.cautions_), *further]


def _verdict(view: View) -> list[str]:
    d = view.diagnosis
    counted = [f"{len(view.of(name).y)} measurements of {name}" for name in view.outputs]
    data = digits.listing(counted)
    if d.verdict_ == "adequate":
        return [
            f"Adequate: {data} give no reason to doubt the simulation {name_of(view)}.",
            chance(view),
            *_why_adequate(view),
            *_at_prior_ends(view),
            _would_have_shown(view),
        ]
    if d.verdict_ == "undecided":
        return _undecided(view, data)
    first = _at_fault(view, data)
    if d.verdict_ == "unexplained":
        return [
            f"Unexplained: {_lower(first)}",
            "No cause of the catalogue accounts for it better than a smooth curve of unknown "
            f"shape, which has {digits.probability(d.best_cause_.probability)} of the probability.",
            *_at_prior_ends(view),
            chance(view),
        ]
    shares = kind_shares(view.search)
    finding, cause = view.findings[0]
    found = f"{label_of_cause(cause)}{_with_estimates(view, finding, cause)}{_or_same(finding)}"
    if d.verdict_ == "named":
        return [
            f"Named: {_lower(first)}",
            f"The cause: {found}.",
            *_meaning(view, finding, cause),
            *_outside(view),
            *_at_prior_ends(view),
            chance(view),
            *_further(view),
        ]
    if d.verdict_ == "nearest":
        return [
            f"Nearest: {_lower(first)}",
            f"The nearest cause in the catalogue: {found}.",
            *_left_behind(view),
            *_outside(view),
            *_at_prior_ends(view),
            chance(view),
            *_further(view),
        ]
    kinds = [f"{kind} ({digits.probability(shares[kind])})" for kind in d.indistinguishable_]
    return [
        f"Ambiguous: {_lower(first)}",
        "The data do not single out one cause. Given that something is wrong, these together "
        f"have at least 90 % of the probability: {digits.listing(kinds)}.",
        f"The leading one: {found}.",
        *_outside(view),
        *_meaning(view, finding, cause),
        *_at_prior_ends(view),
        chance(view),
        *_further(view),
    ]


def _or_same(finding: CauseFinding) -> str:
    """Name the kinds that draw the same curve."""
    if not finding.same_curve:
        return ""
    return f"; {digits.listing(list(finding.same_curve))} would be the same curve here"


def _at_fault(view: View, data: str) -> str:
    """Say what is wrong: the simulation, or what it is compared with."""
    name = name_of(view)
    return {
        "simulation": f"The simulation {name} is wrong, and {data} show it.",
        "noise": f"The mean of the simulation {name} stands; how {data} scatter is not as assumed.",
        "inputs": f"The simulation {name} stands; a measured input of {data} is in error.",
        "data": f"The simulation {name} is not to blame: of {data} a few are unlike the others.",
        "prior": f"The simulation {name} may be right: the prior of a parameter excludes the value "
        f"that {data} ask for.",
    }[view.diagnosis.concerns_ or "simulation"]


def _undecided(view: View, data: str) -> list[str]:
    """Say what cannot tell, and what would."""
    d = view.diagnosis
    name = name_of(view)
    if d.undecided_by_ == "runs":
        assert d.emulator_check_ is not None  # it decided
        out = [f"Undecided: the runs cannot show whether the simulation {name} is right."]
        if view.extended:
            out.append(
                f"The evidence favours {label_of_cause(view.cause)}, but what the runs leave open "
                "may imitate it."
            )
        out.append(f"What would decide: {_lower(d.emulator_check_.remedy)}")
        if d.emulator_check_.needs_runs:
            out.append("next_runs(n) says which runs are best.")
    elif d.undecided_by_ == "rows":
        out = [
            f"Undecided: {data} are unlike what the simulation {name} gives, but no cause of the "
            "catalogue predicts them better than it does.",
            "What would decide: more measurements, or a mechanism of your own among the causes.",
        ]
    else:
        out = [
            f"Undecided: {data} push a parameter of the simulation {name} against an end of its "
            "prior, where its runs end too.",
            f"The evidence favours {label_of_cause(view.cause)}, but a value beyond the prior may "
            "explain as much.",
            "What would decide: a wider prior, and runs of the simulation there.",
        ]
    # what would have shown was asked only where nothing was found
    shown = [] if d.smallest_detectable_ is None else [_would_have_shown(view)]
    return [*out, *_at_prior_ends(view), chance(view), *shown]


def _would_have_shown(view: View) -> str:
    """Say how large a fault would have to be to be seen."""
    d = view.diagnosis
    least = d.smallest_detectable_
    if least is None:
        return (
            "This is no proof that it is right: a fault well below the noise, whose standard "
            f"deviation is about {noise_of(view)}, would not show."
        )
    scale = f"log {view.output}" if view.log_scale else view.output
    return (
        f"A fault with a root mean square of {digits.number(least * view.unit, 2)} in units of "
        f"{scale} would have shown in nine of ten such data sets; a smaller one may be there. The "
        f"noise is about {noise_of(view)}."
    )


def _left_behind(view: View) -> list[str]:
    """Say what a cause leaves that noise does not."""
    check = view.diagnosis.residual_check_
    if check is None or check.p_value > STRANGE:
        return ["But a smooth curve beside it explains more than noise would leave."]
    share = digits.percent(check.statistics[check.worst])
    return [
        "But it leaves more than noise: of replicated noise, fitted in the same way, only "
        f"{digits.percent(check.p_value)} looks as strange, first of all by its {check.worst} "
        f"(alone {share}). What is at fault may be something that the catalogue does not hold."
    ]


def _outside(view: View) -> list[str]:
    """Say how sure the name is, where causes outside the catalogue count."""
    right = view.diagnosis.probability_right_
    if right is None:
        return []
    return [
        "All this supposes that what is at fault is in the catalogue. Of "
        f"{DOCUMENTED} measured data sets with a documented cause {NOT_HELD} had one that it does "
        f"not hold. Where such causes count, this one is right with a probability of "
        f"{digits.probability(right)}, by {N_CASES} blind cases with and without their kind in the "
        "catalogue."
    ]


def _at_prior_ends(view: View) -> list[str]:
    """Say which parameters the data push against the end of their prior."""
    out = []
    for name, side, mean, end in view.diagnosis.at_prior_end_:
        beyond = "less" if side == "low" else "more"
        what = "what was found may stand for that" if view.extended else "widen it if that may be"
        out.append(
            f"The parameter {name} is at the {side} end of its prior ({digits.number(mean)}, where "
            f"2 % of the prior lie at {digits.number(end)} or {beyond}): the data ask for "
            f"{'still ' if view.extended else ''}{beyond} than it allows, and {what}."
        )
    return out


def chance(view: View) -> str:
    """Say what the p-value counts."""
    d = view.diagnosis
    n, test = d.result_.n_replicates, d.result_.test
    as_bad = round(test.share * (n + 1)) - 1
    how_many = {0: "none", n: "all"}.get(as_bad, str(as_bad))
    made_up = f"Of {n} data sets made up by the simulation itself, with noise, and searched"
    limit = d.result_.false_alarm_rate
    p_value = f"p = {digits.number(d.p_value_, 2)}, where up to {limit:g} counts as wrong."
    if test.p_value == test.share:
        return f"{made_up} in the same way, {how_many} looked as wrong as yours: {p_value}"
    million = test.bound < 1e-6
    odds = "more than a million" if million else digits.number(1 / test.bound, 2)
    return (
        f"{made_up} by tangents, {how_many} looked as wrong as yours. But in full the evidence "
        f"against the simulation is {odds} to one, and where nothing is wrong that "
        f"happens {'less often than' if million else 'as rarely as'} once in that many: {p_value}"
    )


def _numbered(view: View) -> list[str]:
    """Say which number stands for which experiment, where these had names."""
    experiments = view.diagnosis.estimator_.experiments_
    if experiments is None or experiments.labels is None:
        return []
    names = digits.listing([f"{k} stands for {name}" for k, name in enumerate(experiments.labels)])
    return [f"In {experiments.column} {names}."]


def where(view: View) -> list[str]:
    """Say in which part of the measured range the simulation is wrong, and by how much."""
    band = view.band
    values = band.grid[:, view.columns.index(band.column)]
    scale = f"log {view.output}" if view.log_scale else view.output
    stretches = band.stretches(values)
    out = _numbered(view)
    if not view.extended:
        out.append(
            "Nowhere that the data could show. The picture's band is pointwise: it leaves zero in "
            "places even where nothing is wrong."
        )
        return out
    if not any(cause.changes_output for _, cause in view.findings):
        out.append(
            "The simulation's curve stays as it is; what changes is how far the measurements "
            "scatter around it, and with that how much each of them counts."
        )
        return out
    if not thirds(view):
        out.append("The predicted mean stays as it is; what changes is its uncertainty.")
    else:
        change = np.abs(view.change)
        most = int(np.argmax(change))
        place = digits.listing(
            [f"{n} = {digits.number(v)}" for n, v in zip(view.columns, view.X[most], strict=True)]
        )
        out.append(
            "The extended model moves the calibrated simulation's predictions at the measured rows "
            f"by {digits.number(float(np.sqrt(np.mean(change**2))), 3)} (root mean square, in "
            f"units of {scale}), and by {digits.number(float(view.change[most]), 3)} where "
            f"it moves them most, at {place}."
        )
        part = max((t for t in thirds(view) if t.column == view.name), key=lambda t: t.share)
        ends = [digits.number(end) for end in (part.low, part.high)]
        span = ends[0] if part.low == part.high else f"between {ends[0]} and {ends[1]}"
        out.append(
            f"Of this (as a sum of squares) {digits.percent(part.share)} lies where {part.column} "
            f"is {span}, which holds {digits.percent(part.rows)} of the rows."
        )
    if view.name not in view.inputs:
        # the smooth curve knows the inputs only, and would draw the scatter that the column makes
        return out
    stretches = [s for s in stretches if s[1] > s[0]]
    if stretches:
        spans = [
            f"{'+' if sign > 0 else '-'} from {digits.number(low)} to {digits.number(high)}"
            for low, high, sign in stretches[:4]
        ]
        more = f" and {len(stretches) - 4} more stretches" if len(stretches) > 4 else ""
        out.append(
            f"A smooth curve through measured minus simulated {scale} is clear of zero (pointwise "
            f"90 % band) over {digits.percent(band.share_outside)} of the measured range of "
            f"{band.column}{_elsewhere(view)}: "
            f"{', '.join(spans)}{more}."
        )
    else:
        out.append(
            f"A smooth curve through measured minus simulated {scale} is nowhere clear of zero "
            f"(pointwise 90 % band) over the measured range of {band.column}{_elsewhere(view)}: "
            "what was found is no smooth curve over that column."
        )
    return out


def by_output(view: View) -> list[str]:
    """Say of each of several outputs whether the causes that were found concern it."""
    out = []
    for name in view.outputs:
        own = [c for _, c in view.findings if not isinstance(c, InOutput) or c.output == name]
        if not own:
            out.append(f"{name}: the simulation does as it is.")
            continue
        shared = "" if all(isinstance(c, InOutput) for c in own) else ", which all outputs share"
        out.append(f"{name}: {digits.listing([label_of_cause(c) for c in own])}{shared}.")
    out.append(
        "What is left is the root mean square of measured minus predicted, in the units of the "
        "output; where the model is right it is about the noise."
    )
    return out


def extension(view: View) -> list[str]:
    """Say what was added to the simulation and what the numbers are."""
    if not view.extended:
        return ["Nothing was added: the extended model is the simulation as it is."]
    d = view.diagnosis
    out = []
    if view.log_scale:
        out.append(
            f"Under the {view.likelihood} likelihood the cause acts on log {view.output}: adding "
            f"0.1 there makes {view.output} larger by a factor of 1.105."
        )
    if len(view.findings) > 1:
        out.append(
            f"It holds {len(view.findings)} causes at once; each formula shows one, with the other "
            "causes inside 'simulation'."
        )
    out.append(
        "Means, with 90 % intervals in brackets; the simulation's parameters were estimated anew "
        "beside the cause."
    )
    out += _averaged(view)
    out += sentences(confounded(d.confounded_))
    out += _beyond(view)
    if d.extended_simulator_ is not None:
        # the waves of curves mean nothing one by one; not every curve is part of the simulator
        waves = {name for _, c in view.findings if c.is_process for name in c.coefficients}
        every = d.extended_simulator_.parameter_names
        names = [name for name in every if name not in waves]
        if len(names) < len(every):
            names.append(f"{len(every) - len(names)} amplitudes of waves")
        told = digits.listing(names)
        out.append(f"extended_simulator_ runs the formula, with the parameters {told}.")
    return out


def _averaged(view: View) -> list[str]:
    """Say over what predictions are averaged."""
    known = averaged(view)
    if len(known) < 2:
        return []
    shares = [f"{label} {digits.probability(weight)}" for _, label, weight in known]
    return [
        "The numbers are those of the cause that leads. Predictions do not bet on it: "
        f"extended_estimator_ averages over the {len(known)} explanations that have 5 % of the "
        f"probability or more, with the weights {digits.listing(shares)}."
    ]


def _beyond(view: View) -> list[str]:
    """Say what the extension keeps for what may be lacking beyond the measured range."""
    kept = [e for e in view.diagnosis.extended_estimator_.effects if not e.is_learned]
    own = [e for e in kept if not isinstance(e, InOutput) or e.output == view.output]
    plain = [e.cause if isinstance(e, InOutput) else e for e in own]
    found = next((e for e in plain if isinstance(e, Remainder)), None)
    if found is None:
        return []
    at_half = view.unit * 0.5**GROWTH
    low, high = (
        digits.number(at_half * float(found.parameters["amplitude"].ppf(share)), 2)
        for share in (0.05, 0.95)
    )
    scale = f"log {view.output}" if view.log_scale else view.output
    return [
        "Beyond the measured range the extended model is less sure than its formula: what else the "
        "simulation may lack there has, at a distance of half that range, a standard deviation of "
        f"{low} to {high} in units of {scale} (90 %), in proportion to what was found within."
    ]


def _elsewhere(view: View) -> str:
    return "" if view.is_curve else ", the other columns at their medians"


def _lower(sentence: str) -> str:
    return sentence[0].lower() + sentence[1:]


def _why_adequate(view: View) -> list[str]:
    none = float(view.search.probability[0])
    odds = f"That nothing is wrong has {digits.probability(none)} of the probability"
    if none <= 0.5:
        shares = kind_shares(view.search)
        first = max(shares, key=lambda kind: shares[kind])
        return [
            f"{odds}; {first} looks more probable, but chance alone often brings forth as much."
        ]
    return [f"{odds}."]


def _with_estimates(view: View, finding: CauseFinding, cause: Cause) -> str:
    told = dict(list(finding.estimates.items())[:_MOST_TOLD])
    parts = [f"{name} {digits.interval(*values)}" for name, values in told.items()]
    if not parts:
        return ""
    if len(finding.estimates) > len(told):
        parts.append(f"and {len(finding.estimates) - len(told)} more in the table below")
    named: dict[str, list[str]] = {}
    for name in told:
        named.setdefault(unit_of(view, cause, name), []).append(name)
    in_units = [
        f"{digits.listing(names)} {unit if unit.startswith('a ') else f'in units of {unit}'}"
        for unit, names in named.items()
        if unit
    ]
    return f", with {', '.join(parts)}; {', '.join(['90 % intervals', *in_units])}"


def _meaning(view: View, finding: CauseFinding, cause: Cause) -> list[str]:
    meaning = meaning_of(cause)
    if meaning is None:
        return []
    if isinstance(cause, InOutput):
        inner = replace(finding, target=cause.cause.target)
        return _meaning(view.of(cause.output), inner, cause.cause)
    column = getattr(cause, "column", None) or finding.target
    target = (finding.target or "").replace(" * ", " and ")
    names = {"output": view.output, "target": target, "column": column}
    return [f"That means: {meaning.format(**names)}."]


def _further(view: View) -> list[str]:
    """Say what was found beside the first cause, each by a search of its own."""
    out = []
    for finding, cause in view.findings[1:]:
        if finding.kind == "unexplained":
            out.append("Beside it a smooth curve of unknown shape is needed.")
            continue
        known = f"{label_of_cause(cause)}{_with_estimates(view, finding, cause)}"
        out.append(
            f"Beside it a further search found: {known}. Its kind has "
            f"{digits.probability(finding.probability)} of the probability there."
        )
        out += _meaning(view, finding, cause)
    return out


def sureness(view: View) -> list[str]:
    """Say how probable the cause is, its kind and the nearest rival, and what it is confused with.

    A kind may have several forms and places, and the data know the kind better.
    """
    own = digits.probability(view.own_probability)
    kind = digits.probability(view.diagnosis.best_cause_.probability)
    of_kind = f", its kind in all its forms {kind}" if kind != own else ""
    rival = next((pair for pair in view.candidates if pair[0].cause is not view.cause), None)
    nearest = (
        f", the nearest rival ({label_of(rival[0])}) {digits.probability(rival[1])}"
        if rival is not None
        else ""
    )
    others = [label_of_cause(cause) for f, cause in view.findings[1:] if f.kind != "unexplained"]
    has = f"Beside {digits.listing(others)} it has" if others else "It has"
    out = [f"{has} {own} of the probability{of_kind}{nearest}."]
    if view.kindred():
        names = [label_of_cause(view.cause), *map(label_of, view.kindred())]
        if view.diagnosis.verdict_ in ("named", "nearest"):
            known = "The data tell the kind, but not which of these it is"
        else:
            known = "Of this kind it may be each of these"
        out.append(f"{known}: {digits.listing(names)}.")
    return out
