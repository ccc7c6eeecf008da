"""What an option is: one table from which parsers, study files and the reference page come."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

# a path that stands for standard output
STDOUT = "-"
SURROGATES = ("kriging", "polynomial-chaos", "gaussian-process", "exact")


@dataclass(frozen=True)
class Option:
    """One option of a command.

    Attributes
    ----------
    name : str
        As in code and study files; on the command line with "-" for "_".
    kind : {"text", "path", "paths", "names", "limit", "number", "numbers", "whole", "pairs", "yes"}
        What it takes: one text or file, several files, names, a number or a text, numbers,
        NAME=VALUE that may be repeated, or nothing.
    meaning : str
        A phrase for help and reference.
    default : Any
    metavar : str or None
    choices : tuple of str, or callable that returns them
    positional : bool
    required : bool
        On the command line or in the study file.
    in_file : bool
        Whether a study file may contain it.
    example : str
        A right value of a pair.
    """

    name: str
    kind: str
    meaning: str
    default: Any = None
    metavar: str | None = None
    choices: tuple[str, ...] | Callable[[], Iterable[str]] = ()
    positional: bool = False
    required: bool = False
    in_file: bool = True
    example: str = ""

    @property
    def flag(self) -> str:
        """How it is written on the command line."""
        return self.name if self.positional else f"--{self.name.replace('_', '-')}"

    @property
    def allowed(self) -> tuple[str, ...]:
        """The texts that it takes, empty where it takes any."""
        return tuple(self.choices() if callable(self.choices) else self.choices)

    @property
    def shown_default(self) -> str:
        """The default as help shows it, empty where there is none to show."""
        shown = self.kind != "yes" and self.default not in (None, ())
        return str(self.default) if shown else ""


class Kind(NamedTuple):
    """A kind of value: what it is called, what a study file must hold, what becomes of it."""

    wanted: str
    types: tuple[type, ...]
    convert: Callable[[Any], Any]
    several: bool = False

    def has(self, value: Any) -> bool:
        """Return whether this is one value of the kind; True is no number."""
        return isinstance(value, self.types) and isinstance(value, bool) == (bool in self.types)

    def read(self, value: Any) -> Any:
        """Return what a study file holds as options have it, None for another kind of value."""
        if not self.several:
            return self.convert(value) if self.has(value) else None
        each = [value] if isinstance(value, str) else value
        right = isinstance(each, list) and all(map(self.has, each))
        return list(map(self.convert, each)) if right else None


def _joined(table: dict[str, Any]) -> dict[str, str] | None:
    lists = {name: one if isinstance(one, list) else [one] for name, one in table.items()}
    right = all(KINDS["limit"].has(cell) for cells in lists.values() for cell in cells)
    return {name: ",".join(map(str, cells)) for name, cells in lists.items()} if right else None


KINDS = {
    "text": Kind("text", (str,), str),
    "path": Kind("text", (str,), str),
    "paths": Kind('a list of names, such as ["t"]', (str,), str, several=True),
    "names": Kind('a list of names, such as ["t"]', (str,), str, several=True),
    "limit": Kind("a number or a text", (str, int, float), str),
    "number": Kind("a number", (int, float), float),
    "numbers": Kind("a list of numbers", (int, float), float, several=True),
    "whole": Kind("a whole number", (int,), int),
    "pairs": Kind("a table of names, such as {speed = [2, 0.5]}", (dict,), _joined),
    "yes": Kind("true or false", (bool,), bool),
}
# what is typed otherwise than a value, or several
_ACTIONS = {"pairs": "append", "yes": "store_true"}


def add_options(parser: argparse.ArgumentParser, options: Iterable[Option]) -> None:
    """Add options to a parser, which sets those alone that were given.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    options : iterable of Option
    """
    for one in options:
        kind = KINDS[one.kind]
        settings: dict[str, Any] = {"type": kind.convert}
        if one.kind in _ACTIONS:
            settings = {"action": _ACTIONS[one.kind]}
        elif kind.several:
            settings["nargs"] = "+"
        if one.choices:
            settings["choices"] = one.allowed
        if one.positional:
            settings["nargs"] = "?"
        if one.metavar and one.kind != "yes":
            settings["metavar"] = one.metavar
        # a positional one with choices would not take SUPPRESS, which is none of them
        default = one.default if one.positional and one.choices else argparse.SUPPRESS
        meaning = f"{one.meaning} ({one.shown_default})" if one.shown_default else one.meaning
        parser.add_argument(one.flag, default=default, help=meaning.replace("%", "%%"), **settings)


def completed(
    options: Sequence[Option], given: dict[str, Any], from_file: dict[str, Any]
) -> dict[str, Any]:
    """Return a value for each option: what was given, else that in the file, else the default.

    Pairs are a dict, in which a name that both have is as it was given.

    Parameters
    ----------
    options : sequence of Option
    given, from_file : dict

    Raises
    ------
    ValueError
        Where one that is required is in neither, and for a pair without a name or a value.

    Examples
    --------
    >>> completed([Option("seed", "whole", "random seed", 0)], {}, {})
    {'seed': 0}
    """
    out = {}
    for one in options:
        out[one.name] = given.get(one.name, from_file.get(one.name, one.default))
        if one.kind == "pairs":
            out[one.name] = from_file.get(one.name, {}) | _named(given.get(one.name, []), one)
        if one.required and not out[one.name]:
            raise ValueError(
                f"{one.flag} is missing: give it"
                f"{f', or write {one.name} = ... in a file for --config' if one.in_file else ''}."
            )
    return out


def _named(pairs: Sequence[str], option: Option) -> dict[str, str]:
    """Return NAME=VALUE texts by name; raise ValueError for a text without one of the two."""
    out = {}
    for text in pairs:
        name, _, value = text.partition("=")
        if not name or not value:
            raise ValueError(
                f"{option.flag} {text}: write {option.metavar}, such as "
                f"{name or 'x'}={option.example}."
            )
        out[name] = value
    return out


MEASURED = Option(
    "measured",
    "path",
    "csv, Parquet or NetCDF file of measurements",
    metavar="MEASURED",
    positional=True,
    required=True,
)
SIMULATIONS = Option(
    "simulations",
    "paths",
    "two or more files of runs, or model.py:function, which are executed",
    metavar="FILE",
    required=True,
)
CONFIG = Option("config", "path", "study file (TOML) with options", metavar="FILE", in_file=False)
DATA = (
    Option(
        "simulation",
        "path",
        "csv, Parquet or NetCDF file of runs; or model.py:function, which is executed",
        metavar="FILE",
        required=True,
    ),
    Option(
        "inputs", "names", "columns known for runs and measurements: numbers, dates", (), "COLUMN"
    ),
    Option(
        "parameters",
        "names",
        "columns known for runs only; of a function its unknown arguments, by default those with "
        "a prior",
        (),
        "NAME",
    ),
    Option("output", "names", "column of the output, or several", (), "COLUMN"),
    Option(
        "prior",
        "pairs",
        "prior of a parameter: normal MEAN,SD, or MEAN,SD,LOW,HIGH cut off there, or uniform "
        "LOW..HIGH; of runs the default is uniform over them",
        metavar="NAME=MEAN,SD",
        example="2,0.5",
    ),
    Option(
        "assumed",
        "pairs",
        "constant that the modeller fixed, and the range in which it may be (of runs: theirs)",
        metavar="NAME=VALUE[,LOW,HIGH]",
        example="0.5,0.3,0.9",
    ),
    Option(
        "runs",
        "whole",
        "run the function so often and emulate it (else it is run itself)",
        None,
        "N",
    ),
    Option(
        "errors",
        "names",
        "column of the measurements' standard deviations (error bars); of several outputs one each",
        (),
        "COLUMN",
    ),
    Option(
        "error_correlation",
        "limit",
        "correlation of the errors of several outputs: with --errors a number, or one for each "
        "pair, such as 0.7,-0.3,0.1 of outputs 1 and 2, 1 and 3, 2 and 3; or estimated",
        metavar="R",
    ),
    Option("experiment", "text", "column that labels the experiment of a row", metavar="COLUMN"),
    Option(
        "by_experiment",
        "pairs",
        "parameter that differs between experiments: own, or spread around a mean; of the output "
        "spread: errors that rows share",
        metavar="NAME=HOW",
        example="spread",
    ),
)


def _likelihoods() -> Iterable[str]:
    from hybridsurrogate.likelihoods import LIKELIHOODS

    return LIKELIHOODS


LIMITS = (
    Option(
        "below",
        "limit",
        "limit of the instrument, or column with that of each row: y there or below means at most; "
        "predict takes one for each output, such as 1,limit",
        None,
        "Y",
    ),
    Option("above", "limit", "upper limit or column: y there or above means at least", None, "Y"),
)
MODEL = (
    Option("likelihood", "text", "of the measurements", "normal", choices=_likelihoods),
    *LIMITS,
    Option("rounded", "number", "step to whose multiples measurements were rounded", None, "STEP"),
    Option(
        "noise",
        "text",
        "with --errors: noise added to them, a factor on them, or neither",
        "added",
        choices=("added", "scaled", "known"),
    ),
    Option("beta", "number", "weight of the simulation, 0 to 1", 0.5, "BETA"),
    Option(
        "surrogate",
        "text",
        "emulator of the runs: by default kriging; beyond 200 measured rows a polynomial",
        choices=SURROGATES,
    ),
    Option("degree", "whole", "of polynomial-chaos, which it chooses", None, "N"),
)
METHOD = Option(
    "method",
    "text",
    "how runs and measurements are joined",
    "power-scaling",
    choices=("power-scaling", "predictive-weighting"),
)
NEW = Option(
    "new",
    "path",
    "later measurements, in order: does the extended model still predict them?",
    metavar="FILE",
)
_MAX_CAUSES = "look for up to N causes (default: a further one where residual structure remains)"
SEARCH = (
    Option("exclude", "names", "kinds that cannot be the cause, such as delay noise", (), "KIND"),
    Option("max_causes", "whole", _MAX_CAUSES, None, "N"),
    Option("no_folds", "yes", "do not measure the gain on held-out rows", False),
)
FOLDS = Option("folds", "whole", "how many", 5, "N")
BETA_SCAN = Option("beta_scan", "yes", "also try other weights: takes longer than all else", False)
REPORT = Option("report", "path", "report to write: .html, .txt or .json", "report.html", "FILE")
OUTCOME = (
    Option("json", "path", "also write the numbers; - prints them alone", metavar="FILE"),
    Option(
        "units", "pairs", "unit of a column, for the report", metavar="NAME=UNIT", example="ppm"
    ),
    Option("check", "yes", "end with exit code 1 unless the verdict is adequate", False),
)
SAVE = Option("save", "path", "file to save the result in, for later commands", metavar="FILE")
SEED = Option("seed", "whole", "random seed", 0, "N")
JOBS = Option("jobs", "whole", "processes that share the folds; -1: one for each core", -1, "N")
LOUDNESS = (
    Option("verbose", "yes", "print every section, and each stage with its seconds", False),
    Option("quiet", "yes", "print warnings and errors alone", False),
)
