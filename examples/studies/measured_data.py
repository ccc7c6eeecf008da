"""The diagnosis on measured data sets whose missing cause is known: does it find it?

Usage: ``python examples/studies/measured_data.py [NAME] [--more] [--folder FOLDER] [--rows FILE]
[--fast]``. Without a name a Markdown page of the first sets, or of more of them; with one, that
set's report. The files and their sources
are described in the shared INDEX.md; a file that is absent is said and skipped.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from measured_sets import SETS, DataSet, Frame
from measured_sets_more import MORE_SETS

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.search.forward_selection import tested
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.numerics.atomic_file import written_whole

FAST = ("nile", "school-influenza", "adsorption", "ageing")
# a curve that is no farther from another one is the same: the rule of examples/studies/hidden_effects
SAME_CURVE = 0.05


def find_folder(given: str | None) -> Path:
    """Return where the data are: the named folder, the environment's, or the shared one."""
    if given:
        return Path(given)
    shared = Path(__file__).resolve().parents[3] / "shared"
    return Path(os.environ.get("HYBRIDSURROGATE_SHARED", shared)) / "data"


def split(data: DataSet, frame: Frame) -> tuple[tuple[Frame, np.ndarray], tuple[Frame, np.ndarray]]:
    """Return X and y of the rows that train, thinned regularly, and of those held out."""
    frame = data.load(frame)
    output = data.output if isinstance(data.output, str) else list(data.output)
    frame = frame.dropna(subset=[*data.columns, *np.atleast_1d(output)])
    train = data.train(frame)
    test = ~train if data.test is None else data.test(frame)
    parts = []
    for rows in (frame[train].iloc[:: data.every], frame[test].iloc[:: data.every]):
        X = rows[list(data.columns)].astype(float).rename(columns=data.columns)
        parts.append((X.reset_index(drop=True), rows[output].to_numpy(dtype=float)))
    return parts[0], parts[1]


def fit_model(data: DataSet, train: tuple[Frame, np.ndarray], *effects: hs.Cause):
    """Return the first simulation with these causes, fitted to the training rows."""
    model = model_before(data).set_params(effects=effects)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        return model.fit(*train, y_err=data.errors)


def model_before(data: DataSet) -> hs.PowerScaledSurrogate:
    return hs.PowerScaledSurrogate(
        data.simulator(),
        surrogate=hs.ExactSurrogate(),
        likelihood=data.likelihood,
        experiment=data.experiment,
        by_experiment=data.by_experiment,
        random_state=0,
    )


def diagnose(data: DataSet, frame: Frame, fast: bool):
    """Return the fitted diagnosis, which has seen the training rows only, and both parts."""
    train, test = split(data, frame)
    # the split replaces the folds beyond the measured range
    diagnosis = hs.DiscrepancyDiagnosis(
        model_before(data),
        causes=data.own,
        n_replicates=39 if fast else 200,
        cv=None if fast else 5,
        random_state=0,
    )
    with warnings.catch_warnings():
        # of draws that are doubtful in a model known to be wrong; the report repeats them
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        return diagnosis.fit(*train, y_err=data.errors), train, test


def error(data: DataSet, model, X: Frame, y: np.ndarray) -> float:
    """Return the RMSE of the predictive mean, of logarithms where INDEX has those."""
    difference = model.predict(X) - y
    if "(ln)" in data.index:
        difference = np.log(np.maximum(model.predict(X), 1e-9)) - np.log(y)
    return float(np.sqrt(np.mean(difference**2)))


def without_own(data: DataSet, found: Search) -> tuple[hs.Cause, float]:
    """Return who leads a search, and with what probability, where own causes are left out."""
    own = {cause.kind for cause in data.own}
    kept = [weighed for weighed in found.candidates if weighed.kind not in own]
    rest = replace(found, candidates=kept)
    best, probability = rest.leader, rest.probability
    return kept[best].cause, float(probability[best] / (1 - probability[0]))


def label(cause) -> str:
    """Return the word for a cause: its kind, and what it concerns."""
    return f"{cause.kind}({cause.target})" if cause.target else cause.kind


def apart(data: DataSet, models: tuple, X: Frame) -> float:
    """Return how far two curves are apart, as a share of what the simulation misses.

    ``models`` are the simulation alone, the one with the documented cause, and another one.
    """
    curves = [model.predict(X) for model in models]
    if data.likelihood == "lognormal":
        curves = [np.log(np.maximum(curve, 1e-9)) for curve in curves]
    before, documented, other = curves
    misses = np.mean((documented - before) ** 2)
    return float(np.sqrt(np.mean((other - documented) ** 2) / misses))


def judge(data: DataSet, cause, models: tuple, train, test) -> str:
    """Return whether a leading cause is the documented one, in word or in effect.

    In effect: on the training rows and on those held out its curve is nowhere as far as 5 % of what
    the simulation misses from that of the documented cause.
    """
    if cause.kind == "none" or not data.documented:
        return "yes" if cause.kind == "none" and not data.documented else "no"
    counted = (*data.documented, *data.by_catalogue)
    if (label(cause), cause.variant) in {(label(doc), doc.variant) for doc in counted}:
        return "yes"
    models = (*models, fit_model(data, train, cause))
    shares = [apart(data, models, X) for X, _ in (train, test)]
    told = f"{shares[0]:.0%} / {shares[1]:.0%} apart"
    return f"{'yes' if max(shares) < SAME_CURVE else 'no'}, {told}"


def judge_all(data: DataSet, causes: list, models: tuple, train, test) -> str:
    """Return whether one of several accepted causes is the documented one, else of the first."""
    told = [judge(data, cause, models, train, test) for cause in causes]
    return next((word for word in told if word.startswith("yes")), told[0])


def named(diagnosis) -> str:
    """Return the accepted causes, their probabilities, and that where others count, too."""
    right = diagnosis.probability_right_
    if diagnosis.best_cause_.kind == "none":
        return "none"
    others = "" if right is None else f" ({right:.2f})"
    steps = tested(diagnosis.result_.steps)
    found = zip(diagnosis.found_causes_, steps, strict=False)
    return " and ".join(f"{label(one)}, {one.probability:.2f}" for one, _ in found) + others


def row(data: DataSet, frame: Frame, fast: bool) -> list[str]:
    """Return one line of the table."""
    start = time.perf_counter()
    diagnosis, train, test = diagnose(data, frame, fast)
    seconds = time.perf_counter() - start
    best, found = diagnosis.best_cause_, diagnosis.search_
    models = (diagnosis.estimator_, fit_model(data, train, *data.documented))
    leading = [step.chosen.cause for step in tested(diagnosis.result_.steps)] or [best]
    if len(leading) == 1 and best.kind != "none":
        leading = [found.candidates[found.leader].cause]
    right = judge_all(data, leading, models, train, test)
    kinds = {cause.kind for cause in (*data.documented, *data.by_catalogue)}
    if right.startswith("no") and diagnosis.verdict_ in ("ambiguous", "nearest"):
        rival = kinds & set(diagnosis.indistinguishable_)
        right = right.replace("no", "among alternatives") if rival else right
    estimates = "; ".join(
        ", ".join(
            f"{name} {mean:.4g} ({low:.4g} to {high:.4g})"
            for name, (mean, low, high) in one.estimates.items()
            if "peak" not in name  # not documented
        )
        for one, _ in zip(diagnosis.found_causes_, leading, strict=False)
    )
    errors = (diagnosis.estimator_, diagnosis.extended_estimator_, models[1])
    errors = [f"{error(data, model, *test):.4g}" for model in errors]
    thinned = f", 1 row in {data.every}" if data.every > 1 else ""
    other = "-"
    if data.own:
        cause, probability = without_own(data, found)
        other = f"{label(cause)}, {probability:.2f}: {judge(data, cause, models, train, test)}"
    scores, held, gain = foreseen(diagnosis, test, data.errors)
    return [
        data.name,
        f"{len(train[1])} / {len(test[1])}{thinned}",
        data.cause,
        diagnosis.verdict_,
        named(diagnosis),
        right,
        other,
        f"{diagnosis.p_value_:.3f}",
        estimates or "-",
        data.value or "-",
        " -> ".join(errors[:2]),
        errors[2] if data.documented else "-",
        " / ".join(f"{score:.2f}" for score in scores),
        " / ".join(f"{share:.0%}" for share in held),
        within(diagnosis),
        data.index,
        f"{seconds:.0f}",
        gain,
    ]


def within(diagnosis) -> str:
    """Return what the extended model gains on rows held out within the measured range."""
    gain = diagnosis.gain_
    return "-" if gain is None else f"{gain.elpd_difference:+.2f} ± {gain.standard_error:.2f}"


def foreseen(diagnosis, test, errors: str | None = None) -> tuple[list[float], list[float], str]:
    """Return log density a row and coverage of held-out rows: plain, named cause, extended.

    And what the last gains upon the first a row, with the standard error of that difference.
    """
    after = diagnosis.extended_estimator_
    models = [diagnosis.estimator_, getattr(after, "estimators_", [after])[0], after]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        densities = [
            np.ravel(model.log_predictive_density(*test, y_err=errors)) for model in models
        ]
        held = [float(np.mean(model.interval_holds(*test, y_err=errors)[0])) for model in models]
    gains = densities[2] - densities[0]
    told = f"{gains.mean():+.2f} ± {gains.std(ddof=1) / np.sqrt(len(gains)):.2f}"
    return [float(density.mean()) for density in densities], held, told


HEAD = (
    "data set", "rows, train / held out", "documented cause", "verdict",
    "named, probability", "right", "without own cause", "p-value", "estimates (90 %)", "documented",
    "RMSE held out", "with the documented cause", "score: plain / one cause / extended",
    "90 % intervals hold", "gain within", "INDEX", "s", "gain beyond",
)  # fmt: skip


def page(
    sets: tuple[DataSet, ...], introduction: str, folder: Path, fast: bool, kept: Path | None
) -> None:
    """Print the page, a line at a time; rows that a file keeps are not computed anew."""
    known = json.loads(kept.read_text()) if kept and kept.exists() else {}
    print(introduction)
    print("| " + " | ".join(HEAD) + " |")
    print("|" + "---|" * len(HEAD))
    outcomes = []
    for data in sets:
        path = folder / data.file
        if not path.exists():
            print(f"{data.name}: {path} does not exist, skipped.", file=sys.stderr)
            continue
        cells = known.get(data.name) or row(data, pd.read_csv(path, comment="#"), fast)
        known[data.name] = cells
        if kept:
            with written_whole(kept) as part:
                part.write_text(json.dumps(known), encoding="utf-8")
        print("| " + " | ".join(cells) + " |", flush=True)
        outcomes.append((data, cells[5], cells[6]))
    words = [right for _, right, _ in outcomes]
    alone = [right if other == "-" else other.partition(": ")[2] for _, right, other in outcomes]
    yes, alone_yes = (sum(w.startswith("yes") for w in given) for given in (words, alone))
    others, alone_others = (sum(w.startswith("among") for w in given) for given in (words, alone))
    rest = f"{others} more with the documented kind among the alternatives"
    print(f"\n{yes} of {len(words)} as documented, {rest}. ", end="")
    print(f"Without own causes {alone_yes} as documented, {alone_others} among the alternatives.")
    told = [(cells[1], cells[12], cells[13]) for cells in (known[d.name] for d, *_ in outcomes)]
    print(beyond_in_words(told))
    for where, cell in {"Within the measured range": 14, "On held-out rows": 17}.items():
        print(losses_in_words(where, [known[data.name][cell] for data, *_ in outcomes]))
    notes = [f"- {data.name}: {data.remark}" for data, *_ in outcomes if data.remark]
    if notes:
        print("\n## Remarks (readings of the table, not tested)\n\n" + "\n".join(notes))


def beyond_in_words(told: list[tuple[str, str, str]]) -> str:
    """Return how well held-out rows are foreseen, from the cells of counts, scores and shares."""
    n = np.array([int(rows.split(" / ")[1].split(",")[0]) for rows, *_ in told])
    scores = np.array([[float(x) for x in cell.split(" / ")] for _, cell, _ in told])
    held = np.array([[float(x.rstrip("%")) for x in cell.split(" / ")] for *_, cell in told])
    better = [int(np.sum(scores[:, k] >= scores[:, 0])) for k in (1, 2)]
    rows, sets = np.average(held, axis=0, weights=n), held.mean(axis=0)
    return (
        f"Held-out rows are predicted no worse (log density a row) than by the plain simulation in "
        f"{better[1]} of {len(told)} sets by the extended model (in {better[0]} by its most "
        "probable cause alone). 90 % "
        f"intervals hold {rows[0]:.0f} / {rows[1]:.0f} / {rows[2]:.0f} % of all held-out rows, "
        f"{sets[0]:.0f} / {sets[1]:.0f} / {sets[2]:.0f} % on average over the sets."
    )


def losses_in_words(where: str, cells: list[str]) -> str:
    """Return in how many sets rows that were held out are foreseen worse."""
    gains = [[float(x) for x in cell.split(" ± ")] for cell in cells if cell != "-"]
    worse = sum(gain < -2 * error for gain, error in gains)
    return f"{where} {worse} of {len(gains)} sets lose more than two standard errors."


INTRODUCTION = """# Measured data with a known cause

Printed by `python examples/studies/measured_data.py > docs/evidence/measured_data.md` in some minutes;
`--rows FILE` keeps finished rows, so that a run that was stopped goes on. Each data set meets the
simulation that a scientist would write first. The diagnosis sees that simulation, its priors and
the training rows; "RMSE held out" is on rows that it never saw, before -> after the cause that it
named, then with the documented cause in its place; INDEX is the same with the documented cause
fitted by least squares. "Right" says whether the most probable cause is the documented one,
whatever the verdict is; where residual structure remained, so that a further one was searched and accepted, one of them. One of another name counts where its curve is less than 5 % of what the
simulation misses apart from that of the documented cause, on the training rows and on those held
out (both shares are given); "among alternatives": it is not right, but the documented kind is
among those that cannot be separated, or among those of which the nearest comes first. A
probability in brackets counts causes that the catalogue does not hold as well
(`probability_right_`). The score is the mean log density of a held-out row, of the plain
simulation, of the most probable cause alone and of the
extended model, which averages over the causes; then how many of these rows the 90 % interval of
each holds. "Gain within": what the score gains on training rows held out in five folds, the search
repeated in each, with its standard error.

Where the catalogue has no cause of the documented form, that formula was compared too, as the
scientist's own cause, with a prior of the field (`examples/studies/measured_mechanisms.py`). "Without own
cause" says what comes first in the same search where it is left out, and whether that is right.

No rows of these files are part of the package, apart from `nile`, `mauna-loa`, `enso` and
`ultrasound`, which are in the public domain.
"""

MORE = """# More measured data with a known cause

Printed by `python examples/studies/measured_data.py --more --rows FILE`. The form, and the rules of what
counts as right, are those of [measured data with a known cause](measured_data.md); "gain beyond" is what the
extended model gains upon the simulation in log density, a held-out row, with the standard error of that
paired difference. All rows are read from files outside the repository, and none is part of the package.

Simulations, priors, splits and what counts as documented were written before the first diagnosis, and none was
changed afterwards. Only the package was changed: see the remark on the dialyzers. One thing more counts as documented
since then: for phones an episode that multiplies, as minutes instead of calls do; the catalogue had none before.
"""


def main() -> None:
    """Print the page, or one report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="?", choices=[data.name for data in (*SETS, *MORE_SETS)])
    parser.add_argument("--more", action="store_true", help="the sets of the second page")
    parser.add_argument("--folder", help="where the files are")
    parser.add_argument("--rows", help="a JSON file that keeps finished rows, to go on from")
    parser.add_argument("--fast", action="store_true", help="two small sets, few replicates")
    given = parser.parse_args()
    folder = find_folder(given.folder)
    if given.name is None:
        fast = given.fast
        kept = Path(given.rows) if given.rows else None
        sets, introduction = (MORE_SETS, MORE) if given.more else (SETS, INTRODUCTION)
        chosen = tuple(d for d in sets if d.name in FAST) if fast else sets
        page(chosen, introduction, folder, fast, kept)
        return
    data = next(data for data in (*SETS, *MORE_SETS) if data.name == given.name)
    if not (folder / data.file).exists():
        sys.exit(f"{folder / data.file} does not exist: name its folder with --folder.")
    frame = pd.read_csv(folder / data.file, comment="#")
    diagnosis, _, test = diagnose(data, frame, given.fast)
    print(diagnosis.report(test=test))


if __name__ == "__main__":
    main()
