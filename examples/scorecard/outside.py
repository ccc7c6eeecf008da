"""What is claimed where the true kind has been taken out of the catalogue."""

from __future__ import annotations

import pandas as pd

from .beyond import MODELS, WORDS

SURE = 0.9

INTRODUCTION = """# Truths that are not in the catalogue

Printed by `python -m examples.scorecard --outside --pairs 0 --nulls 0 ...`: blind cases of the
[scorecard](scorecard.md) whose true kind had been taken out of the catalogue before they were
diagnosed. Whatever is named is wrong, though it may be nearly the same curve. `sure`: named with
more than 90 % of the probability, given that something is wrong. The score is the mean log density
of a measurement beyond the measured range, then the share of these that the 90 % interval holds:
of the simulation as it is, of the extension and of the average over causes.
"""


def page_of(table: pd.DataFrame) -> str:
    """Return the page of cases outside the catalogue."""
    cases = table[table["outside"] & (table["trouble"] == "")]
    groups = [("all", cases), *cases.groupby("size"), *cases.groupby("kind")]
    lines = [INTRODUCTION, f"| {' | '.join(_HEAD)} |", "|---" * len(_HEAD) + "|"]
    for name, group in groups:
        lines.append(f"| {' | '.join([str(name), *_cells(group)])} |")
    return "\n".join(lines) + "\n"


_VERDICTS = ("named", "nearest", "ambiguous", "unexplained", "adequate")
_HEAD = (
    "cases", "number", "sure", *_VERDICTS, *(f"score: {model}" for model in MODELS),
    *(f"held: {model}" for model in MODELS),
)  # fmt: skip


def _cells(cases: pd.DataFrame) -> list[str]:
    sure = (cases["verdict"] == "named") & (cases["leader_share"] > SURE)
    verdicts = [f"{(cases['verdict'] == word).mean():.0%}" for word in _VERDICTS]
    scores = [f"{cases[WORDS[model][0]].clip(-20).mean():.2f}" for model in MODELS]
    held = [f"{cases[WORDS[model][1]].mean():.0%}" for model in MODELS]
    return [str(len(cases)), f"{sure.mean():.0%}", *verdicts, *scores, *held]
