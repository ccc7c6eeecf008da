"""The command that compares several simulations of the same measurements."""

from __future__ import annotations

import argparse
import inspect
from pathlib import Path
from typing import Any

import pandas as pd

from hybridsurrogate.command_line.output import (
    check_outputs,
    say,
    show,
    stage,
    write_files,
)
from hybridsurrogate.command_line.study import Study, model_of, read_study_data
from hybridsurrogate.command_line.user_code import function_in, is_code
from hybridsurrogate.comparison import SimulationComparison, compare_simulations
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.simulation.curve_tables import long_table
from hybridsurrogate.simulation.table_file import read_table

# what each simulation takes as far as it has it
_SHARED = ("inputs", "parameters", "prior", "assumed", "by_experiment")


def compare(given: argparse.Namespace) -> int:
    """Compare simulations on the user's measurements; return the exit code."""
    check_outputs(given)
    words = list(given.simulations)
    _check_files(words, given)
    names = _names_of(words)
    _check_measured(given)
    there = {word: _names_in(word, given) for word in words}
    _check_all_there(given, set().union(*there.values()))
    named = zip(names, words, strict=True)
    each = {name: _given_to(word, there[word], given) for name, word in named}
    studies = {name: read_study_data(own) for name, own in each.items()}
    _check_same_rows(studies)
    first = next(iter(studies.values()))
    models = {name: model_of(one, each[name], given.beta) for name, one in studies.items()}
    for name, one in studies.items():
        reads = [*one.simulation.input_names, *one.simulation.parameter_names]
        say(f"{name} depends on {', '.join(reads)}.")
    with stage("Comparison", given):
        found = compare_simulations(
            models,
            first.X,
            first.y,
            y_err=first.y_err,
            diagnose=not given.no_diagnosis,
            cv=given.folds,
            max_causes=given.max_causes,
            n_jobs=given.jobs,
            random_state=given.seed,
        )
    return _reported(found, given)


def _reported(found: SimulationComparison, given: argparse.Namespace) -> int:
    """Write the files, then print the report; return the exit code."""
    with stage("Report", given):
        made = found.report(full=given.verbose)
        numbers = made.to_dict()
        reports = [("With pictures", given.report, made.save)]
        for name, one in found.diagnoses.items():
            file = _next_to(given.report, name)
            reports.append((f"Diagnosis of {name}", file, one.report().save))
        files = write_files(given, numbers, reports)
    show(given, f"\n{made}", numbers, *files)
    return 0


def _next_to(report: str, name: str) -> str:
    """Return the file of one simulation's diagnosis.

    Examples
    --------
    >>> _next_to("both.html", "decay")
    'both_decay.html'
    """
    path = Path(report)
    return str(path.with_name(f"{path.stem}_{name}{path.suffix}"))


def _check_files(words: list[str], given: argparse.Namespace) -> None:
    if len(words) < 2:
        raise ValueError(
            f"--simulations names {words[0]} alone: there are at least two to compare. One is for "
            "hybridsurrogate diagnose."
        )
    twice = next((word for word in words if words.count(word) > 1), None)
    if twice is not None:
        raise ValueError(f"--simulations names {twice} twice.")
    if given.measured in words:
        raise ValueError(
            f"{given.measured} is both the file of measurements, which comes first, and one of "
            "--simulations."
        )
    if given.runs is not None and not any(map(is_code, words)):
        raise ValueError("--runs is for a function: files of runs have those that they have.")


def _names_of(words: list[str]) -> list[str]:
    """Return what to call simulations: a function or a file, in full where two are alike.

    Examples
    --------
    >>> _names_of(["model.py:decay", "old/runs.csv"]), _names_of(["a/runs.csv", "b/runs.csv"])
    (['decay', 'runs'], ['a-runs', 'b-runs'])
    """
    short = [word.rpartition(":")[2] if is_code(word) else Path(word).stem for word in words]
    if len(set(short)) == len(words):
        return short
    long = ["-".join(Path(word.replace(":", "/")).with_suffix("").parts[-2:]) for word in words]
    return long if len(set(long)) == len(words) else [f"{k + 1}" for k in range(len(words))]


def _names_in(word: str, given: argparse.Namespace) -> set[str]:
    """Return the columns or arguments of a simulation, and its outputs."""
    named = {name for option in _SHARED for name in getattr(given, option)}
    if not is_code(word):
        table = long_table(read_table(word), given.inputs, given.output)
        if lacking := [name for name in given.output if name not in table]:
            raise ValueError(
                f"{word} has no columns {lacking}; its columns are {list(table)}. Simulations are "
                f"compared by the same outputs.{did_you_mean(lacking, table)}"
            )
        return {str(name) for name in table.columns}
    try:
        arguments = inspect.signature(function_in(word).function).parameters
    except ValueError:  # some compiled functions have no signature
        return named
    takes_any = any(one.kind == one.VAR_KEYWORD for one in arguments.values())
    return {*arguments, *given.output} | (named if takes_any else set())


def _check_all_there(given: argparse.Namespace, there: set[str]) -> None:
    """Raise ValueError for a name that no simulation has."""
    for option in _SHARED:
        for name in getattr(given, option):
            if name not in there:
                raise ValueError(
                    f"--{option.replace('_', '-')} {name}: none of the simulations has {name!r}, "
                    f"they have {', '.join(sorted(there))}.{did_you_mean(name, there)}"
                )


def _check_measured(given: argparse.Namespace) -> None:
    """Raise ValueError where the file of measurements looks like one of runs."""
    columns = list(read_table(given.measured).columns)
    there = [name for name in dict.fromkeys([*given.parameters, *given.prior]) if name in columns]
    if there:
        raise ValueError(
            f"{given.measured} has columns of the parameters {there}, which are unknown for "
            "measurements: is it a file of runs? The file of measurements comes first, those of "
            "runs are --simulations."
        )


def _given_to(word: str, there: set[str], given: argparse.Namespace) -> argparse.Namespace:
    """Return the options as `diagnose` has them, of one simulation."""
    own: dict[str, Any] = {}
    for option in _SHARED:
        named = getattr(given, option)
        names = [name for name in named if name in there]
        own[option] = {name: named[name] for name in names} if isinstance(named, dict) else names
    runs = given.runs if is_code(word) else None
    return argparse.Namespace(**{**vars(given), **own, "simulation": word, "runs": runs})


def _check_same_rows(studies: dict[str, Study]) -> None:
    """Raise ValueError where dates count from other days."""
    (one, first), *others = studies.items()
    for name, other in others:
        try:
            pd.testing.assert_frame_equal(first.X, other.X)
        except AssertionError as error:
            raise ValueError(
                f"The runs of {one} and {name} begin on other dates, and each counts days from its "
                "first: write the days since one date in all files."
            ) from error
