"""Diagnose blind cases, one row of results each, written as they come."""

from __future__ import annotations

import csv
import json
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from io import StringIO
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from hidden_effects.cases import Case, InfeasibleError, make_case, rms
from hidden_effects.several import make_several

import hybridsurrogate as hs

from .beyond import foreseen
from .likeness import distance

# the words of the truth, in the words of an estimate
NUMBERS = {
    "offset": {"value": "amplitude"},
    "trend": {"slope": "slope"},
    "trend: quadratic": {"slope": "slope", "curvature": "curvature"},
    "periodic": {"period": "period", "amplitude": "amplitude"},
    "step": {"location": "location", "value": "amplitude"},
    "ramp": {"location": "location", "slope": "slope"},
    "bump": {"location": "location", "width": "width", "amplitude": "amplitude"},
    "decay": {"amplitude": "amplitude", "scale": "scale"},
    "saturation": {"amplitude": "amplitude", "half": "half"},
    "gain": {"gain": "gain"},
    "wrong-constant": {"value": "value"},
    "parameter-drift": {"slope": "slope"},
    "parameter-drift: exponential": {"rate": "rate"},
    "parameter-drift: step": {"change": "change", "location": "location"},
    "parameter-drift: logistic": {"change": "change", "location": "location", "width": "width"},
    "parameter-drift: periodic": {"period": "period", "amplitude": "amplitude"},
    "missing-input": {"slope": "slope"},
    "interaction": {"slope": "slope"},
    "delay": {"lag": "lag"},
    "trend: since the start": {"slope": "slope"},
    "episode": {"begin": "location", "end": "end", "amplitude": "amplitude"},
    "build-up": {"scale": "scale"},
    "limit": {"limit": "limit"},
    "ramp: loss": {"location": "location", "scale": "scale"},
    "missing-input: friction": {"viscous": "viscous", "dry": "dry"},
    "response": {"curvature": "curvature"},
    "noise": {"ratio": "ratio"},
    "noise: tails": {"share": "share"},
    "input-error": {"spread": "spread"},
    "random-parameter": {"spread": "spread"},
    "noise: autocorrelation": {"length": "length"},
}
# what an estimate says beside these: together they tell which form of a kind was found
_OTHER_WORDS = {
    "trend": {"level"},
    "trend: quadratic": {"level"},
    "periodic": {"peak"},
    "noise": {"slope"},
    "input-error": {"ratio"},
    "random-parameter": {"ratio"},
    "response": {"level", "gain"},
    "noise: autocorrelation": {"amplitude"},
}
_DRAWS = 200


@dataclass(frozen=True)
class Task:
    """One case to be diagnosed: everything that its result depends on."""

    kind: str  # one of hidden_effects.cases.FORMS, or two or three with a plus between them
    size: float
    rows: int
    seed: int
    runs: int = 0  # of the simulation, that an emulator is trained on; 0: the simulation itself
    places: int = 0  # along the first input at which a run has outputs; 0: one, anywhere
    further: int = 0  # runs at most where the first ones leave most open
    outside: bool = False  # whether the kind is taken out of the catalogue


@dataclass(frozen=True)
class Result:
    """What came out. ``found`` is "none" where the verdict is "adequate"."""

    simulation: str = ""
    noise_share: float = float("nan")  # noise sd in shares of the range of the noise-free output
    verdict: str = ""
    p_value: float = float("nan")
    p_none: float = float("nan")  # probability that nothing is wrong
    found: str = ""
    on_target: bool = False
    leader: str = ""  # most probable kind, given that something is wrong
    leader_share: float = float("nan")
    right: float = float("nan")  # probability that the leader is right, others counted
    credible: str = ""  # the 90 % set, with bars between
    distance: float = float("nan")  # of what was found instead: see likeness
    several: str = ""  # every accepted kind, with bars between
    ratio: float = float("nan")  # out-of-range error against the plain simulation's
    elpd_plain: float = float("nan")  # out of range, a row: of the simulation as it is,
    elpd_named: float = float("nan")  # extended by the cause that was named,
    elpd_averaged: float = float("nan")  # and averaged over the causes
    inside_plain: float = float("nan")  # share of these rows in the 90 % interval
    inside_named: float = float("nan")
    inside_averaged: float = float("nan")
    left_open: float = float("nan")  # by the runs, at the measured rows, in noise sd
    estimates: str = "{}"  # name: [true, low, high]
    seconds: float = float("nan")
    trouble: str = ""  # the exception, if there was one


COLUMNS = (*Task.__dataclass_fields__, *Result.__dataclass_fields__)


# ------------------------------------------------------------------------------------- one case


def score(task: Task) -> dict[str, Any]:
    """Make the case of a task, diagnose it, and compare with the truth."""
    try:
        case = _make(task)
    except InfeasibleError:
        return asdict(task) | asdict(Result(trouble="infeasible"))
    start = time.perf_counter()
    try:
        diagnosis = _diagnose(case, task)
        seconds = time.perf_counter() - start
        result = replace(
            _judge(case, diagnosis, task),
            seconds=round(seconds, 3),
            **foreseen(case, diagnosis, task.seed),
        )
    except Exception as error:  # a diagnosis that fails is a result, and the others go on
        share = case.truth["noise_sd"] / np.ptp(case.truth["mu"])
        trouble = f"{type(error).__name__}: {error}".replace("\n", " ")[:200]
        result = Result(case.simulator.name, share, trouble=trouble)
    return asdict(task) | asdict(result)


def _make(task: Task) -> Case:
    make = make_several if "+" in task.kind else make_case
    # one seed of the test bed has the same noise at every size: pooled, such cases would count
    # several times, and limits that rest on independent cases would be too narrow
    entropy = (task.seed, round(1000 * task.size), task.rows)
    seed = int(np.random.SeedSequence(entropy).generate_state(1)[0])
    return make(task.kind, task.size, seed, task.rows)


def _diagnose(case: Case, task: Task) -> hs.DiscrepancyDiagnosis:
    simulation = None
    if task.runs:
        along = task.places or None
        simulation = case.simulator.run(task.runs, random_state=task.seed, along=along)
    model = hs.PowerScaledSurrogate(
        simulation or case.simulator,
        surrogate=hs.Kriging() if task.runs else hs.ExactSurrogate(),
        n_draws=_DRAWS,
        random_state=task.seed,
    )
    kind = task.kind.partition(":")[0]
    diagnosis = hs.DiscrepancyDiagnosis(
        model,
        exclude=(kind,) if task.outside and kind != "foreign" else (),
        cv=None,
        random_state=task.seed,
    )
    with warnings.catch_warnings():
        # doubtful draws show in the coverage; a simulation left its domain in a rival only
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        warnings.simplefilter("ignore", RuntimeWarning)
        if task.further:
            return hs.refine(diagnosis, case.X, case.y, budget=task.further)
        return diagnosis.fit(case.X, case.y)


def _judge(case: Case, diagnosis: hs.DiscrepancyDiagnosis, task: Task) -> Result:
    best = diagnosis.best_cause_
    shares = kind_probabilities(diagnosis)
    p_none = shares.pop("none", 0.0)
    leader = max(shares, key=lambda kind: shares[kind])
    total = sum(shares.values())
    plain = rms(diagnosis.estimator_.predict(case.X_out) - case.mu_out)
    extended = rms(diagnosis.predict(case.X_out) - case.mu_out)
    on_target = best.kind == case.truth["kind"] and _same_target(case, diagnosis)
    return Result(
        simulation=case.simulator.name,
        noise_share=float(case.truth["noise_sd"] / np.ptp(case.truth["mu"])),
        verdict=diagnosis.verdict_,
        p_value=float(diagnosis.p_value_),
        p_none=p_none,
        found=best.kind,
        on_target=on_target,
        leader=leader,
        leader_share=shares[leader] / total if total else float("nan"),
        right=float("nan") if (right := diagnosis.probability_right_) is None else right,
        credible="|".join(diagnosis.indistinguishable_),
        distance=distance(case, diagnosis),
        several="|".join(found.kind for found in diagnosis.found_causes_),
        ratio=extended / plain,
        left_open=diagnosis.emulator_check_.left_open if task.runs else float("nan"),
        estimates=json.dumps(_estimates(case, best.estimates) if on_target else {}),
    )


def kind_probabilities(diagnosis: hs.DiscrepancyDiagnosis) -> dict[str, float]:
    """Return the probability of each kind, all its targets and forms together, "none" too."""
    table = diagnosis.causes_
    weighed = table[table["log_evidence"].notna()]
    sums = weighed.groupby("kind")["probability"].sum()
    return {str(kind): float(value) for kind, value in sums.items()}


def _same_target(case: Case, diagnosis: hs.DiscrepancyDiagnosis) -> bool:
    truth = case.truth
    if truth["kind"] in ("none", "missing-input"):  # there is one column to miss
        return True
    if (diagnosis.best_cause_.target or "") != truth.get("target", ""):
        return False
    effect = diagnosis.extended_estimator_.effects[0]
    return "along" not in truth or truth["along"] in effect.reads


def _estimates(
    case: Case, found: dict[str, tuple[float, float, float]]
) -> dict[str, tuple[float, float, float]]:
    """Pair each true number with its interval; none where another form of the kind was found."""
    form = case.truth["form"]
    words = NUMBERS.get(form, {})
    if {*words.values()} | _OTHER_WORDS.get(form, set()) != set(found):
        return {}
    return {
        said: (float(case.truth[true]), found[said][1], found[said][2])
        for true, said in words.items()
    }


# ------------------------------------------------------------------------------------ many cases


def tasks(
    kinds: Sequence[str],
    sizes: Sequence[float],
    rows: Sequence[int],
    seeds: range,
    nulls: range,
    several: Mapping[str, range] | None = None,
    runs: int = 0,
    places: int = 0,
    further: int = 0,
    outside: bool = False,
) -> list[Task]:
    """List the cases by seed, so that an interrupted run has some of everything.

    ``several`` are seeds of several effects at once, 40 rows for each.
    """
    found: list[Task] = []
    several = several or {}
    for seed in sorted({*seeds, *nulls}.union(*several.values())):
        if seed in seeds:
            found += [
                Task(k, float(s), n, seed, runs, places, further, outside)
                for k in kinds
                for s in sizes
                for n in rows
            ]
        found += [
            Task(name, 2.0, 40 * len(name.split("+")), seed, runs, places, further)
            for name, own in several.items()
            if seed in own
        ]
        if seed in nulls:
            found += [Task("none", 0.0, n, seed, runs, places, further) for n in rows]
    return found


def run(todo: Iterable[Task], jobs: int = 1) -> Iterator[dict[str, Any]]:
    """Yield the results as they come."""
    if jobs == 1:
        yield from map(score, todo)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for future in as_completed([pool.submit(score, task) for task in todo]):
            yield future.result()


def complete_lines(path: Path) -> str:
    """Return a file without a last line that was cut short."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    return text[: text.rfind("\n") + 1]


def done(path: Path) -> set[Task]:
    """Return the tasks whose results a file already holds."""
    return {_task_of(row) for row in csv.DictReader(StringIO(complete_lines(path)))}


def _task_of(row: dict[str, str]) -> Task:
    numbers = int(row["rows"]), int(row["seed"]), int(row["runs"])
    curves = int(row.get("places") or 0), int(row.get("further") or 0)
    outside = row.get("outside") == "True"
    return Task(row["kind"], float(row["size"]), *numbers, *curves, outside)


def run_into(path: Path, todo: Sequence[Task], jobs: int = 1) -> Iterator[dict[str, Any]]:
    """Diagnose what a file does not hold yet, adding and yielding each row when it is there."""
    have = done(path)
    text = complete_lines(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if not text:
            writer.writeheader()
        for row in run([task for task in todo if task not in have], jobs):
            writer.writerow(row)
            file.flush()
            yield row
