"""A scorecard as text, and as a page of the documentation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from hidden_effects.cases import FORMS

from . import tables
from .beyond import beyond

_NAMES = {
    "kind": "hidden",
    "exact": "right kind first",
    "alike": "near copies counted",
    "same": "not distinguished counted",
    "covered": "90 % set covers",
    "set_size": "kinds in a set",
    "further_cause": "a further cause named",
    "ratio": "out-of-range error",
    "left_open": "runs leave open",
    "elpd_plain": "score: simulation as it is",
    "elpd_named": "with the named cause",
    "elpd_averaged": "averaged",
    "inside_plain": "90 % holds: as it is",
    "inside_named": "with the named cause",
    "inside_averaged": "averaged",
    "rate": "false alarms",
    "upper": "upper 95 % limit",
    "every": "all named",
    "but_one": "all but one",
    "wrong": "something else too",
    "limit": "best test detects",
    "low": "95 % low",
    "high": "95 % high",
}
_INSIDE = ("inside_plain", "inside_named", "inside_averaged")
_RATES = (
    *_INSIDE,
    "detected",
    "exact",
    "alike",
    "same",
    "covered",
    "further_cause",
    "rate",
    "upper",
    "limit",
)
_SHARES = frozenset(
    [*_RATES, "coverage", "right", "stated", "every", "but_one", "wrong", "low", "high"]
)


def sections(table: pd.DataFrame) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Yield heading, explanation and table, those that have any rows."""
    single = tables.single(table)
    why = "First kinds: the nine that are also fitted by hand. Later forms: all that came after."
    yield "By forms, size and rows", why, tables.first_and_later(table)
    for key, why in (
        ("kind", ""),
        ("noise", "Noise sd in shares of the noise-free output's range."),
        ("simulation", ""),
    ):
        if len(single[key].unique()) > 1:
            yield f"By {key}", why, tables.rates(table, key)
    if len(single["size"].unique()) > 1:
        for rate in ("exact", "same"):
            wide = single.pivot_table(index="kind", columns="size", values=rate, aggfunc="mean")
            wide.columns = pd.Index([f"size {size:g}" for size in wide.columns])
            yield f"By kind and size: {_NAMES[rate]}", "", wide
    yield "False alarms", "", tables.false_alarms(table)
    bins = tables.name_calibration(table)
    error, chance = (100 * f(bins) for f in (tables.calibration_error, tables.chance_error))
    yield (
        "Probability of the first kind against how often it is right",
        "Given that something is wrong; undetected effects too. Mean absolute "
        f"calibration error {error:.1f} points; with so few cases chance alone makes {chance:.1f}.",
        bins,
    )
    yield (
        "Mean probability of the first kind, and how often it is right",
        "The mean says how often a name can be right with these data and these prior odds; a rate "
        "above it needs other data, or odds that know what is hidden.",
        tables.stated_and_right(table),
    )
    yield (
        "Coverage of 90 % intervals",
        "Where the very form was found, at its target; so of effects large enough for that.",
        tables.interval_coverage(table),
    )
    yield (
        "Beyond the measured range",
        "Log predictive density a row (ELPD) and share of rows in 90 % intervals, of new "
        "measurements out of range: for the simulation as it is, extended by the cause that was "
        "named alone, and averaged over the causes by their probabilities, as "
        "`extended_estimator_` does. Effects in the noise are left out.",
        beyond(tables.single(table)),
    )
    yield (
        "Forms of noise",
        "The best test of all is the ratio of the two densities at 5 % false alarms, with the "
        "simulation, the form, its numbers and the size of the noise known (Neyman and Pearson). "
        "No diagnosis detects more; one that knows none of this and weighs the whole catalogue "
        "detects less.",
        tables.noise_limits(table),
    )
    for n, word in ((2, "Two"), (3, "Three")):
        why = f"Size 2 each, {40 * n} rows. The diagnosis does not know how many there are."
        yield f"{word} effects at once", why, tables.all_named(table, n)
    yield "Most frequent confusions", "", tables.confusions(table)
    yield "Diagnoses that failed", "", tables.failures(table)


def cells(table: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Return header and cells of a table as text: shares in percent."""
    if table.index.name or isinstance(table.index, pd.MultiIndex):
        table = table.reset_index()
    header = [_NAMES.get(str(name), str(name)) for name in table.columns]
    rows = []
    for values in table.itertuples(index=False):
        rows.append([_cell(str(c), v) for c, v in zip(table.columns, values, strict=True)])
    return header, rows


def _cell(column: str, value: object) -> str:
    if not isinstance(value, (float, np.floating)):
        return str(value)
    if np.isnan(value):
        return ""
    if column in _SHARES or column.startswith("size "):
        return f"{100 * value:.1f} %"
    return f"{value:g}" if column in ("size", "above", "up to") else f"{value:.2f}"


def as_text(table: pd.DataFrame) -> str:
    """Return a table in columns."""
    header, rows = cells(table)
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(w) if k == 0 else cell.rjust(w) for k, (cell, w) in enumerate(parts))
        for parts in (list(zip(line, widths, strict=True)) for line in [header, *rows])
    ]
    return "\n".join(line.rstrip() for line in lines)


def as_markdown(table: pd.DataFrame) -> str:
    """Return a table in pipes."""
    header, rows = cells(table)
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(c.replace("|", "/") for c in line) + " |" for line in lines)


def report(table: pd.DataFrame, shape: Callable[[pd.DataFrame], str], heading: str) -> str:
    """Return all tables."""
    parts = []
    for title, why, found in sections(table):
        if len(found):
            parts += [f"{heading} {title}", *([why] if why else []), shape(found)]
    return "\n\n".join(parts)


def commands(table: pd.DataFrame) -> list[str]:
    """Return the commands whose results these are, from the rows: one for each number of seeds."""
    single = tables.single(table)
    n_pairs, n_triples = (table[table["n_hidden"] == n]["seed"].nunique() for n in (2, 3))
    seeds = single.groupby(["rows", "size"])["seed"].nunique()
    found = []
    alone = table[table["n_hidden"] == 1]
    # several effects without any single ones have a command, too
    for rows, part in alone.groupby("rows") if len(alone) else [(40, alone)]:
        n_nulls = part[part["word"] == "none"]["seed"].nunique()
        mine = seeds[seeds.index.get_level_values("rows") == rows].droplevel("rows")
        for n_seeds in sorted(mine.unique(), reverse=True) or [0]:
            sizes = mine.index[mine == n_seeds]
            hidden = tables.single(part)
            kinds = dict.fromkeys(hidden[hidden["size"].isin(sizes)]["kind"])
            words = ["python -m examples.studies.scorecard", *_kinds_option(list(kinds))]
            words += ["--sizes", *(f"{size:g}" for size in sizes), f"--rows {rows}"]
            words.append(f"--seeds {n_seeds} --nulls {n_nulls} --pairs {n_pairs}")
            words += [f"--triples {n_triples}"] if n_triples else []
            for word in ("runs", "places", "further"):
                words += [f"--{word} {number}" for number in table[word].unique() if number]
            found.append(" ".join(words) + f" --first-seed {table['seed'].min()}")
            n_nulls = n_pairs = n_triples = 0  # they are said once
    return found


def _kinds_option(kinds: list[str]) -> list[str]:
    if not kinds or {*kinds} == {*FORMS} - {"none"}:
        return []
    return ["--kinds", *(f"'{kind}'" if " " in kind else kind for kind in kinds)]


_HOW = """Effects are hidden in eight simulations and the diagnosis, which weighs its whole
catalogue and does not know how many there are, has to find them. Size is the root mean square of what remains of the effect after the
parameters have been fitted to the noise-free truth, in noise standard deviations. For `noise` the
standard deviation at one end is 1 + size times that at the other; for its other forms, input errors
and random parameters see
`examples/studies/hidden_effects/noises.py`. {simulated}

How often the name is right is counted three times, each time with more counted as right:

1. Right kind first: the verdict names the kind that is hidden, whatever its form and target.
2. Near copies counted: also another one of {{trend, ramp, saturation, decay}}.
3. Not distinguished counted: also a kind that draws the truth. All causes of the kind that was
   found are fitted, with the parameters, to the noise-free truth at the measured inputs. What the
   best of them misses, squared and summed in noise standard deviations, is a chi-square. Below 1
   the data speak for the truth by less than half a nat on average: the best test of one against
   the other, with all numbers known, still errs in 31 of 100 cases. Nothing found, a curve of any
   shape (`unexplained`) and noise draw no truth, and no curve draws noise: such mistakes stay
   mistakes.

The 90 % set is `indistinguishable_`. The out-of-range error is the median of the extended model's
root mean square error beyond the measured range against the plain simulation's. Seconds are the
median of a diagnosis without cross-validation, on one core of a busy machine. Failed diagnoses
count as not detected. Every case has draws of its own, so that limits for independent cases
apply."""


_DIRECTLY = """The simulations are run directly; those
of which [only runs are known](scorecard_emulator.md) have a page of their own."""
_EMULATED = """The diagnosis does not run the
simulations: it gets {runs:.0f} runs each{curves}, all parameters and inputs over their ranges,
and the surrogate `Kriging()`. The cases are those of [the scorecard](scorecard.md)
with the same seeds. "Runs leave open" is the median of how uncertain the runs leave the simulation
at the measured rows, in noise standard deviations (`emulator_check_`): where it is above 1, effects
of size 1 cannot be seen by anyone who has only the runs."""


def _how(table: pd.DataFrame) -> str:
    """Return what was done."""
    runs, places = table["runs"].max(), table["places"].max()
    curves = f", curves of {places:.0f} values" if places else ""
    if table["further"].any():
        curves += f" and at most {table['further'].max():.0f} further ones by `refine`"
    emulated = _EMULATED.format(runs=runs, curves=curves)
    return _HOW.format(simulated=emulated if runs else _DIRECTLY)


def write_page(table: pd.DataFrame, path: Path, source: str, pictures: list[Path]) -> None:
    """Write the page of the documentation."""
    shown = "\n".join(f"![{p.stem}]({_relative(p, path)})" for p in pictures)
    lines = "\n".join(commands(table))
    count = f"It rests on {len(table)} cases."
    if len(table) < 2000:
        count += " That is few: a rate of 80 % over 100 cases is known to 8 points only."
    title = "Scorecard of emulated simulations" if table["runs"].any() else "Scorecard"
    text = f"""# {title}

{_how(table)}

{count} Made by these commands; a run that was stopped early has fewer cases than its command.

```
{lines}
python -m examples.studies.scorecard --from-csv {source} --page docs/evidence/{path.name}
```

{shown}

{report(table, as_markdown, "##")}
"""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def _relative(picture: Path, page: Path) -> str:
    same = picture.resolve().parent == page.resolve().parent
    return picture.name if same else str(picture)
