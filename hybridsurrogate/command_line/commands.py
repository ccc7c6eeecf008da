"""Every command: what it does, its options, an example."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module

from hybridsurrogate.command_line.options import (
    BETA_SCAN,
    CONFIG,
    DATA,
    FOLDS,
    JOBS,
    LIMITS,
    LOUDNESS,
    MEASURED,
    METHOD,
    MODEL,
    NEW,
    OUTCOME,
    REPORT,
    SAVE,
    SEARCH,
    SEED,
    SIMULATIONS,
    STDOUT,
    Option,
)

_JSON = OUTCOME[0]
_SAVED = Option(
    "saved",
    "path",
    "file that an earlier command wrote with --save; loading it runs code: only what you trust",
    metavar="SAVED",
    positional=True,
    required=True,
    in_file=False,
)
_TABLE = Option("table", "path", "csv file to write; - prints it", STDOUT, "FILE", in_file=False)


@dataclass(frozen=True)
class Subcommand:
    """A command of the command line.

    Attributes
    ----------
    name : str
    purpose : str
        A phrase for the list of commands.
    description : str
        Sentences for its help.
    options : tuple of Option
    place : str
        File and name of its function, which is imported when it runs.
    example : str
    """

    name: str
    purpose: str
    description: str
    options: tuple[Option, ...]
    place: str
    example: str

    def run(self, given: argparse.Namespace) -> int:
        """Run with a value for each option by name; return the exit code."""
        module, _, name = self.place.partition(".")
        return getattr(import_module(f"{__package__}.{module}"), name)(given)


# what commands have in common: what is compared, and what becomes of a result
_STUDY = (MEASURED, CONFIG, *DATA, *MODEL)
_DIAGNOSED = (REPORT, *OUTCOME, SAVE, SEED, JOBS, *LOUDNESS)
_FITTED = (_JSON, SAVE, SEED, *LOUDNESS)


def _demonstrations() -> Iterable[str]:
    from hybridsurrogate.datasets.demonstrations import DEMONSTRATIONS

    return DEMONSTRATIONS


_DEMO = Option("name", "text", "which one", "nile", "NAME", _demonstrations, True, in_file=False)
_LIST = Option("list", "yes", "list the demonstrations", False, in_file=False)

COMMANDS = (
    Subcommand(
        "demo",
        "diagnose a simulation on data inside the package",
        "Diagnoses data inside the package, and prints what it finds as it finds it.",
        (
            _DEMO,
            _LIST,
            *SEARCH,
            *_DIAGNOSED,
        ),
        "diagnoses.demo",
        "hybridsurrogate demo --report nile.html",
    ),
    Subcommand(
        "diagnose",
        "find out what a simulation gets wrong, from its runs and your data",
        "Finds out whether a simulation is wrong, names the cause, and measures the gain. The "
        "simulation is a file of runs, or a function of a Python file, which is executed.",
        (
            *_STUDY,
            NEW,
            *SEARCH,
            BETA_SCAN,
            *_DIAGNOSED,
        ),
        "diagnoses.diagnose",
        "hybridsurrogate diagnose measured.csv --simulation decay.py:decay --inputs minutes "
        "--prior rate=0.2,0.05 --output glucose",
    ),
    Subcommand(
        "compare",
        "compare several simulations of the same measurements",
        "Says which of several simulations the measurements favour, and what each of them lacks. "
        "Each is a file of runs, or a function of a Python file, which is executed. It takes those "
        "of the inputs, parameters and constants that it has. Next to the report there is one on "
        "the diagnosis of each.",
        (
            MEASURED,
            CONFIG,
            SIMULATIONS,
            *(one for one in DATA if one.name != "simulation"),
            *MODEL,
            *(one for one in SEARCH if one.name == "max_causes"),
            Option("no_diagnosis", "yes", "only compare them, which takes seconds", False),
            FOLDS,
            REPORT,
            _JSON,
            SEED,
            JOBS,
            *LOUDNESS,
        ),
        "comparisons.compare",
        "hybridsurrogate compare measured.csv --simulations decay.py:decay runs.csv "
        "--inputs minutes --parameters rate --prior rate=0.2,0.05 --output glucose",
    ),
    Subcommand(
        "report",
        "report a saved diagnosis",
        "Reports what diagnose --save wrote. Nothing is fitted.",
        (_SAVED, REPORT, *OUTCOME, *LOUDNESS),
        "diagnoses.report",
        "hybridsurrogate report study.hs --report study.html --units co2=ppm",
    ),
    Subcommand(
        "next-runs",
        "list the simulation runs that a diagnosis lacks most",
        "Lists the runs that would decide most of what the known ones leave open, as csv.",
        (
            _SAVED,
            Option("number", "whole", "how many", 10, "N", in_file=False),
            _TABLE,
            *LOUDNESS,
        ),
        "diagnoses.next_runs",
        "hybridsurrogate next-runs study.hs --number 10 --table more.csv",
    ),
    Subcommand(
        "fit",
        "train a surrogate on runs and measurements",
        "Trains a surrogate on two data sources and prints the estimates. The simulation is a file "
        "of runs, or a function of a Python file, which is executed.",
        (*_STUDY, METHOD, *_FITTED),
        "fits.fit",
        "hybridsurrogate fit measured.csv --simulation runs.csv --inputs minutes --parameters rate "
        "--output glucose --beta 0.5 --save fit.hs",
    ),
    Subcommand(
        "predict",
        "predict from a saved fit or diagnosis",
        "Writes mean, standard deviation and 90 % interval of new measurements as csv. A diagnosis "
        "predicts by its extended model. With limits the interval is that of what is recorded.",
        (
            _SAVED,
            Option(
                "new_inputs",
                "path",
                "csv, Parquet or NetCDF file with the measured columns, numbers as in the fit",
                metavar="NEW",
                positional=True,
                required=True,
                in_file=False,
            ),
            *LIMITS,
            _TABLE,
            *LOUDNESS,
        ),
        "fits.predict",
        "hybridsurrogate predict fit.hs new.csv --table predicted.csv",
    ),
    Subcommand(
        "choose-beta",
        "choose the weight of the simulation",
        "Compares weights of the simulation by the log density of held-out measurements.",
        (
            *(one for one in _STUDY if one.name != "beta"),
            METHOD,
            Option("betas", "numbers", "weights to try (21 from 0 to 1)", metavar="BETA"),
            FOLDS,
            Option("future", "yes", "test on later rows, along the first input", False),
            *_FITTED,
        ),
        "fits.choose_beta",
        "hybridsurrogate choose-beta measured.csv --simulation runs.csv --inputs minutes "
        "--parameters rate --output glucose --folds 5",
    ),
)
