"""Commands about a diagnosis: demo, diagnose, report, next-runs."""

from __future__ import annotations

import argparse
from contextlib import suppress
from typing import Any

from hybridsurrogate.arguments import check_units
from hybridsurrogate.command_line.output import (
    check_outputs,
    first_words,
    print_table,
    say,
    show,
    stage,
    write_files,
)
from hybridsurrogate.command_line.study import Study, model_of, read_study_data
from hybridsurrogate.command_line.user_code import read_saved
from hybridsurrogate.datasets.demonstrations import DEMONSTRATIONS
from hybridsurrogate.diagnosis import DiscrepancyDiagnosis
from hybridsurrogate.estimators import PowerScaledSurrogate
from hybridsurrogate.surrogates import ExactSurrogate


def demo(given: argparse.Namespace) -> int:
    """Diagnose data inside the package; return the exit code."""
    if given.list:
        say("\n".join(f"{name:8} {text}" for name, (_, text) in DEMONSTRATIONS.items()))
        return 0
    check_outputs(given)
    shown = DEMONSTRATIONS[given.name][0]()
    study = Study(shown.simulator, ExactSurrogate(), shown.X, shown.y)
    check_units(given.units, study.columns)
    say(f"{shown.introduction}\n")
    model = PowerScaledSurrogate(study.simulation, study.surrogate, random_state=given.seed)
    return _diagnosed(model, study, given, shown.test)


def diagnose(given: argparse.Namespace) -> int:
    """Diagnose a simulation on the user's measurements; return the exit code."""
    check_outputs(given)
    study = read_study_data(given)
    check_units(given.units, study.columns)
    return _diagnosed(model_of(study, given, given.beta), study, given)


def report(given: argparse.Namespace) -> int:
    """Report a saved diagnosis; return the exit code."""
    check_outputs(given)
    diagnosis = read_saved(given.saved, DiscrepancyDiagnosis)
    return _reported(diagnosis, given)


def next_runs(given: argparse.Namespace) -> int:
    """Write the runs that a saved diagnosis asks for; return the exit code."""
    check_outputs(given)
    print_table(read_saved(given.saved, DiscrepancyDiagnosis).next_runs(given.number), given)
    return 0


def _diagnosed(
    model: PowerScaledSurrogate,
    study: Study,
    given: argparse.Namespace,
    test: Any = None,
) -> int:
    """Search, print the verdict, measure the gain, report."""
    diagnosis = DiscrepancyDiagnosis(
        model,
        exclude=given.exclude,
        cv=None,
        max_causes=given.max_causes,
        n_jobs=given.jobs,
        random_state=given.seed,
        progress=not given.quiet,
    )
    with stage("Search", given, shown=False):
        diagnosis.fit(study.X, study.y, y_err=study.y_err)
    say(first_words(diagnosis.report(units=given.units), diagnosis.result_))
    if not given.no_folds:
        say(
            "\nNow the gain on held-out rows: the search is repeated without them. --no-folds "
            "leaves it out.\n"
        )
        # the diagnosis warns that its folds were interrupted, and keeps all else
        with stage("Folds", given, shown=False), suppress(KeyboardInterrupt):
            diagnosis.cross_validate()
    return _reported(diagnosis, given, test, study)


def _reported(
    diagnosis: DiscrepancyDiagnosis,
    given: argparse.Namespace,
    test: Any = None,
    study: Study | None = None,
) -> int:
    """Write the files, then print the report; return the exit code."""
    with stage("Report", given):
        made = diagnosis.report(
            test=test,
            beta_scan=getattr(given, "beta_scan", False),
            units=given.units,
            full=given.verbose,
        )
        numbers = made.to_dict()
        pictures = [("With pictures", given.report, made.save)]
        files = write_files(given, numbers, pictures, diagnosis, study and study.code)
    show(given, str(made), numbers, *files)
    if study is not None and study.later is not None:
        say(f"\nSince then: {diagnosis.update(*study.later)}")
    return int(given.check and diagnosis.verdict_ != "adequate")
