"""Commands about a diagnosis: demo, diagnose, report, next-runs."""

from __future__ import annotations

import argparse
from contextlib import suppress
from functools import partial
from typing import Any

from hybridsurrogate.command_line.output import (
    STDOUT,
    as_json,
    check_outputs,
    first_words,
    print_table,
    report_of,
    say,
    stage,
    write_files,
    write_json,
)
from hybridsurrogate.command_line.study import (
    Study,
    checked_units,
    model_of,
    read_study_data,
)
from hybridsurrogate.command_line.user_code import read_saved
from hybridsurrogate.datasets.demonstrations import DEMONSTRATIONS
from hybridsurrogate.diagnosis import DiscrepancyDiagnosis
from hybridsurrogate.estimators import PowerScaledSurrogate
from hybridsurrogate.saved_file import save
from hybridsurrogate.surrogates import ExactSurrogate

_DONE, _FOUND = 0, 1


def demo(given: argparse.Namespace) -> int:
    """Diagnose data inside the package; return the exit code."""
    if given.list:
        say("\n".join(f"{name:8} {text}" for name, (_, text) in DEMONSTRATIONS.items()))
        return _DONE
    check_outputs(given)
    shown = DEMONSTRATIONS[given.name][0]()
    study = Study(shown.simulator, ExactSurrogate(), shown.X, shown.y)
    units = checked_units(given.units, study.columns)
    say(f"{shown.introduction}\n")
    model = PowerScaledSurrogate(study.simulation, study.surrogate, random_state=given.seed)
    if given.max_causes is None:
        given.max_causes = shown.max_causes
    return _diagnosed(model, study, given, units, shown.test)


def diagnose(given: argparse.Namespace) -> int:
    """Diagnose a simulation on the user's measurements; return the exit code."""
    check_outputs(given)
    study = read_study_data(given)
    units = checked_units(given.units, study.columns)
    return _diagnosed(model_of(study, given, given.beta), study, given, units)


def report(given: argparse.Namespace) -> int:
    """Report a saved diagnosis; return the exit code."""
    check_outputs(given)
    diagnosis = read_saved(given.saved, DiscrepancyDiagnosis)
    result = diagnosis.result_
    simulation, columns = result.before.simulation, result.search.problem.model.columns
    known = dict.fromkeys([*columns, *simulation.parameter_ranges, *simulation.outputs])
    return _reported(diagnosis, given, checked_units(given.units, known))


def next_runs(given: argparse.Namespace) -> int:
    """Write the runs that a saved diagnosis asks for; return the exit code."""
    check_outputs(given)
    print_table(read_saved(given.saved, DiscrepancyDiagnosis).next_runs(given.number), given)
    return _DONE


def _diagnosed(
    model: PowerScaledSurrogate,
    study: Study,
    given: argparse.Namespace,
    units: dict[str, str],
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
        diagnosis.fit(study.X, study.y, y_err=list(getattr(given, "errors", ())) or None)
    say(first_words(report_of(diagnosis, given, units, None), diagnosis.result_))
    if not given.no_folds:
        say(
            "\nNow the gain on held-out rows: the search is repeated without them. --no-folds "
            "leaves it out.\n"
        )
        # the diagnosis warns that its folds were interrupted, and keeps all else
        with stage("Folds", given, shown=False), suppress(KeyboardInterrupt):
            diagnosis.cross_validate()
    return _reported(diagnosis, given, units, test, study)


def _reported(
    diagnosis: DiscrepancyDiagnosis,
    given: argparse.Namespace,
    units: dict[str, str],
    test: Any = None,
    study: Study | None = None,
) -> int:
    """Write the files, then print the report; return the exit code."""
    with stage("Report", given):
        made = report_of(diagnosis, given, units, test)
        written, failed = write_files(
            [
                ("With pictures", given.report, made.save),
                ("Numbers", given.json, partial(write_json, made.to_dict())),
                (
                    "Saved",
                    getattr(given, "save", None),
                    lambda path: save(diagnosis, path, study and study.code),
                ),
            ]
        )
    # the text is not lost with a file
    say("\n".join([str(made), *([""] if written else []), *written]))
    if given.json == STDOUT:
        say(as_json(made.to_dict()), given.result)
    if study is not None and study.later is not None:
        say(f"\nSince then: {diagnosis.update(*study.later)}")
    if failed:
        raise OSError(" ".join(failed))
    return _FOUND if given.check and diagnosis.verdict_ != "adequate" else _DONE
