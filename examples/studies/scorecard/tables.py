"""The statistics of a scorecard: rows of results in, tables out."""

from __future__ import annotations

import json
from collections.abc import Sequence
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
from hidden_effects import noises
from hidden_effects.cases import KINDS
from hidden_effects.limits import best_power
from numpy.typing import ArrayLike
from scipy.stats import binom, binomtest

from .beyond import WORDS
from .run import complete_lines

# curves so alike over a limited range that naming one of them for another is half an answer
NEAR_COPIES = frozenset({"trend", "ramp", "saturation", "decay"})
EDGES = (0.0, 0.2, 0.4, 0.6, 0.75, 0.9, 0.99, 1.0)
_NOISE_EDGES = (0.0, 0.01, 0.03, 0.1, np.inf)
_NOISE_WORDS = ("below 1 %", "1 to 3 %", "3 to 10 %", "above 10 %")
# forms of the kinds that leave no curve, so that there is nothing to gain out of range
_NO_CURVE = ("none", *noises.KINDS)
# a chi-square: the data at hand speak for the truth by half of it, in nats, on average
TOLD_APART = 1.0

_NUMBERS = (
    "size",
    "rows",
    "seed",
    "runs",
    "places",
    "further",
    "noise_share",
    "p_value",
    "p_none",
    "leader_share",
    "right",
    "distance",
    "ratio",
    "left_open",
    *(word for pair in WORDS.values() for word in pair),
    "seconds",
)


# ------------------------------------------------------------------------------------- the rows


def read(path: Path) -> pd.DataFrame:
    """Read results; cases that could not be made are left out, failed diagnoses stay."""
    table = pd.read_csv(StringIO(complete_lines(path)), dtype=str, keep_default_na=False)
    # files from before runs could be curves
    for name in ("places", "further"):
        table[name] = table.get(name, "0")
    table["right"] = table.get("right", "nan")
    table["outside"] = table.get("outside", "False") == "True"
    for name in _NUMBERS:
        table[name] = pd.to_numeric(table[name], errors="coerce")
    return judged(table[table["trouble"] != "infeasible"].reset_index(drop=True))


def judged(table: pd.DataFrame) -> pd.DataFrame:
    """Add what is true or false of each row, and some words to group by."""
    table = table.copy()
    words = table["kind"].str.partition(":")[0]
    failed = table["trouble"] != ""
    table["word"] = words
    table["n_hidden"] = 1 + table["kind"].str.count(r"\+")
    table["detected"] = ~table["verdict"].isin(["adequate", ""]) & ~failed
    table["exact"] = (table["found"] == words) & ~failed
    table["alike"] = table["exact"] | (
        words.isin(list(NEAR_COPIES)) & table["found"].isin(list(NEAR_COPIES))
    )
    table["same"] = table["alike"] | (table["distance"] < TOLD_APART)
    sets = [cell.split("|") if cell else [] for cell in table["credible"]]
    table["covered"] = [word in cell for word, cell in zip(words, sets, strict=True)]
    table["set_size"] = [len(cell) if cell else np.nan for cell in sets]
    table["leads"] = (table["leader"] == words) & ~failed
    table["noise"] = pd.cut(table["noise_share"], _NOISE_EDGES, labels=_NOISE_WORDS)
    truth = [set(kind.split("+")) for kind in table["kind"]]
    named = [set(cell.split("|")) if cell else set() for cell in table["several"]]
    table["n_right"] = [len(a & b) for a, b in zip(truth, named, strict=True)]
    table["named_further"] = [len(cell) > 1 for cell in named]
    table["n_wrong"] = [len(b - a - {"none"}) for a, b in zip(truth, named, strict=True)]
    return table


def single(table: pd.DataFrame) -> pd.DataFrame:
    """Return the cases with one hidden effect."""
    return table[(table["n_hidden"] == 1) & (table["word"] != "none")]


# ------------------------------------------------------------------------------------ statistics


def clopper_pearson(hits: int, n: int, level: float = 0.95) -> tuple[float, float]:
    """Return exact binomial limits of a rate, two-sided (Clopper and Pearson 1934)."""
    if n == 0:
        return 0.0, 1.0
    limits = binomtest(hits, n).proportion_ci(level, method="exact")
    return float(limits.low), float(limits.high)


def upper_limit(hits: int, n: int, level: float = 0.95) -> float:
    """Return the one-sided upper limit of a rate: what it is below, with 95 % confidence."""
    if n == 0:
        return 1.0
    found = binomtest(hits, n, alternative="less")
    return float(found.proportion_ci(level, method="exact").high)


def rates(table: pd.DataFrame, by: str | Sequence[str]) -> pd.DataFrame:
    """Return the rates of single effects, one row a group."""
    found = single(table)
    groups = found.groupby(by, observed=True, sort=True)
    out = groups.agg(
        cases=("exact", "size"),
        detected=("detected", "mean"),
        exact=("exact", "mean"),
        alike=("alike", "mean"),
        same=("same", "mean"),
        covered=("covered", "mean"),
        set_size=("set_size", "mean"),
        further_cause=("named_further", "mean"),
        seconds=("seconds", "median"),
    )
    curves = found[~found["word"].isin(_NO_CURVE)].groupby(by, observed=True)["ratio"]
    out.insert(7, "ratio", curves.median().reindex(out.index))
    if found["runs"].any():
        out.insert(8, "left_open", groups["left_open"].median())
    return out


def _by_forms(table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Split cases into the nine kinds of the first test bed, and all that came after."""
    found = single(table)
    first, noise = found["kind"].isin(KINDS), found["word"].isin(noises.KINDS)
    return {
        "all": found,
        "first kinds": found[first],
        "later forms": found[~first],
        "later forms without noise": found[~first & ~noise],
    }


def first_and_later(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rates by forms, size and rows."""
    by = ["size", "rows"]
    parts = {name: rates(part, by) for name, part in _by_forms(table).items()}
    return pd.concat(parts, names=["forms", *by])


def false_alarms(table: pd.DataFrame) -> pd.DataFrame:
    """Return alarms where nothing is hidden, with an upper 95 % limit, by rows and altogether."""
    nothing = table[(table["word"] == "none") & (table["trouble"] == "")]
    rows = []
    parts = [(str(n), part) for n, part in nothing.groupby("rows")]
    for name, part in [*parts, ("all", nothing)] if len(parts) > 1 else [("all", nothing)]:
        hits, n = int(part["detected"].sum()), len(part)
        if n:
            rows.append((name, n, hits, hits / n, upper_limit(hits, n)))
    columns = ["rows", "cases", "alarms", "rate", "upper"]
    return pd.DataFrame(rows, columns=columns).set_index("rows")


def reliability(
    probability: ArrayLike, right: ArrayLike, edges: Sequence[float] = EDGES
) -> pd.DataFrame:
    """Return how often a stated probability is right, one row a bin that holds any.

    Bins are open below and closed above, the first closed on both sides; the limits are the 95 %
    ones of Clopper and Pearson.
    """
    p, hit = np.asarray(probability, dtype=float), np.asarray(right, dtype=bool)
    known = np.isfinite(p)
    p, hit = p[known], hit[known]
    place = np.clip(np.searchsorted(edges, p, side="left") - 1, 0, len(edges) - 2)
    rows = []
    for k in np.unique(place):
        mine = place == k
        n, hits = int(mine.sum()), int(hit[mine].sum())
        limits = clopper_pearson(hits, n)
        rows.append((edges[k], edges[k + 1], n, float(p[mine].mean()), hits / n, *limits))
    columns = ["above", "up to", "cases", "stated", "right", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def calibration_error(bins: pd.DataFrame) -> float:
    """Return the mean absolute difference of stated and right, weighted by bin count."""
    if not len(bins):
        return float("nan")
    return float(np.average((bins["stated"] - bins["right"]).abs(), weights=bins["cases"]))


def chance_error(bins: pd.DataFrame) -> float:
    """Return the calibration error that is expected if every stated probability is right.

    It is not zero: n cases of a bin are right k times, k binomial.
    """
    if not len(bins):
        return float("nan")
    expected = []
    for n, stated in zip(bins["cases"], bins["stated"], strict=True):
        k = np.arange(n + 1)
        expected.append(float(binom.pmf(k, n, stated) @ np.abs(k / n - stated)))
    return float(np.average(expected, weights=bins["cases"]))


def name_calibration(table: pd.DataFrame) -> pd.DataFrame:
    """Return the reliability of the first kind's probability, where one effect is hidden."""
    found = single(table)
    return reliability(found["leader_share"], found["leads"])


def stated_and_right(table: pd.DataFrame) -> pd.DataFrame:
    """Return the mean probability of the first kind and how often it is right, by forms and size.

    For the number of rows that most cases have.
    """
    out = {}
    for name, part in _by_forms(table).items():
        usual = part[part["rows"].isin(part["rows"].mode()[:1])]
        groups = usual[usual["leader_share"].notna()].groupby(["size", "rows"])
        out[name] = pd.DataFrame(
            {
                "cases": groups.size(),
                "stated": groups["leader_share"].mean(),
                "right": groups["leads"].mean(),
            }
        )
    return pd.concat(out, names=["forms"])


def interval_coverage(table: pd.DataFrame) -> pd.DataFrame:
    """Return how often 90 % intervals hold the true number, one row a number.

    Only of cases in which the right kind was named at the right target and in the very form that
    is hidden: in others the same word means another number. Altogether there are no limits, as the
    numbers of one case depend on each other.
    """
    rows = []
    for cell, kind in zip(table["estimates"], table["kind"], strict=True):
        for name, (true, low, high) in json.loads(cell or "{}").items():
            rows.append((name, kind, low <= true <= high))
    found = pd.DataFrame(rows, columns=["number", "kind", "inside"])
    if found.empty:
        return pd.DataFrame(columns=["cases", "coverage", "low", "high"])
    out = []
    for name, part in found.groupby("number"):
        hits, n = int(part["inside"].sum()), len(part)
        out.append((name, n, hits / n, *clopper_pearson(hits, n)))
    out.append(("all", len(found), found["inside"].mean(), np.nan, np.nan))
    return pd.DataFrame(out, columns=["number", "cases", "coverage", "low", "high"]).set_index(
        "number"
    )


def noise_limits(table: pd.DataFrame) -> pd.DataFrame:
    """Return how often each form of noise is detected, and the most that any test detects.

    For the number of rows that most cases have.
    """
    part = single(table)
    part = part[part["word"].isin(noises.KINDS)]
    part = part[part["rows"].isin(part["rows"].mode()[:1])]
    if part.empty:
        return part
    groups = part.groupby(["kind", "size", "rows"])
    found = groups[["detected", "exact"]].mean()
    found.insert(0, "cases", groups.size())
    found["limit"] = [best_power(*key) for key in found.index]
    return found


def all_named(table: pd.DataFrame, n_hidden: int) -> pd.DataFrame:
    """Return how often several hidden effects are all named, all but one, and something beside."""
    found = table[table["n_hidden"] == n_hidden]
    if found.empty:
        return pd.DataFrame(columns=["cases", "every", "but_one", "wrong", "detected", "seconds"])
    right = found["n_right"]
    found = found.assign(every=right == n_hidden, but_one=right == n_hidden - 1)
    found["wrong"] = found["n_wrong"] > 0
    shares = ["every", "but_one", "wrong", "detected"]
    parts = [*found.groupby("kind"), ("all", found)]
    rows = [
        (name, len(part), *part[shares].mean(), part["seconds"].median()) for name, part in parts
    ]
    columns = ["kinds", "cases", *shares, "seconds"]
    return pd.DataFrame(rows, columns=columns).set_index("kinds")


def confusions(table: pd.DataFrame, most: int = 12) -> pd.DataFrame:
    """Return what was taken for what most often: not detected is taken for none."""
    found = single(table)
    wrong = found[~found["exact"]].assign(found=lambda t: t["found"].where(t["found"] != "", "-"))
    counts = wrong.groupby(["kind", "found"]).size().rename("times").reset_index()
    counts["of"] = counts["kind"].map(found["kind"].value_counts())
    counts = counts.rename(columns={"kind": "hidden", "found": "taken for"})
    order = counts.sort_values(["times", "hidden"], ascending=[False, True], kind="stable")
    return order.head(most).reset_index(drop=True)


def failures(table: pd.DataFrame) -> pd.DataFrame:
    """Return the exceptions of diagnoses, the commonest first."""
    failed = table[table["trouble"] != ""]
    counts = failed.groupby(["trouble", "kind"]).size().rename("times").reset_index()
    return counts.sort_values("times", ascending=False, kind="stable").reset_index(drop=True)
