"""What is claimed where the true kind has been taken out of the catalogue."""

from __future__ import annotations

import pandas as pd

from .beyond import MODELS, WORDS

SURE = 0.9

_COLUMNS = """`sure`: named with more than 90 % of the probability within the catalogue, given that
something is wrong; `sure all the same`: named, and with more than 90 % where causes outside the
catalogue count (`probability_right_`), then what that is on average. The score is the mean log
density of a measurement beyond the measured range, then the share of these that the 90 % interval
covers: of the simulation as it is, of the most probable cause alone and of the average over the
causes (`extended_estimator_`).
"""

INTRODUCTION = f"""# Truths that are not in the catalogue

Printed by `python -m examples.studies.scorecard --outside --pairs 0 --nulls 0 ...`: blind cases of the
[scorecard](scorecard.md) whose true kind had been taken out of the catalogue before they were
diagnosed. Whatever is named is wrong, though it may be nearly the same curve.
{_COLUMNS}"""

MECHANISMS = f"""# Mechanisms that no cause draws

Printed by `python -m examples.studies.scorecard --mechanisms --pairs 0 --nulls 0 ...`: what is hidden in
these blind cases is of no kind of the catalogue (`examples/studies/hidden_effects/mechanisms.py`), all of
which is compared. Whatever is named is wrong, though it may be nearly the same curve.
{_COLUMNS}"""


def page_of(table: pd.DataFrame, mechanisms: bool = False) -> str:
    """Return the page of cases outside the catalogue."""
    cases = table[table["outside"] & (table["trouble"] == "")]
    groups = [("all", cases), *cases.groupby("size"), *cases.groupby("kind")]
    introduction = MECHANISMS if mechanisms else INTRODUCTION
    lines = [introduction, f"| {' | '.join(_HEAD)} |", "|---" * len(_HEAD) + "|"]
    for name, group in groups:
        word = str(name).removeprefix("foreign: ").replace("_", " ")
        lines.append(f"| {' | '.join([word, *_cells(group)])} |")
    return "\n".join(lines) + "\n"


_VERDICTS = ("named", "nearest", "ambiguous", "unexplained", "adequate")
_HEAD = (
    "cases", "number", "sure", "sure all the same", "probability", *_VERDICTS,
    *(f"score: {model}" for model in MODELS), *(f"held: {model}" for model in MODELS),
)  # fmt: skip


def _cells(cases: pd.DataFrame) -> list[str]:
    named = cases["verdict"] == "named"
    sure = [(named & (cases[word] > SURE)).mean() for word in ("leader_share", "right")]
    verdicts = [f"{(cases['verdict'] == word).mean():.0%}" for word in _VERDICTS]
    scores = [f"{cases[WORDS[model][0]].clip(-20).mean():.2f}" for model in MODELS]
    held = [f"{cases[WORDS[model][1]].mean():.0%}" for model in MODELS]
    told = [f"{sure[0]:.0%}", f"{sure[1]:.0%}", f"{cases['right'].mean():.0%}"]
    cells = [str(len(cases)), *told, *verdicts, *scores, *held]
    return ["-" if cell.startswith("nan") else cell for cell in cells]
