"""Command line: ``hybridsurrogate demo`` and ``hybridsurrogate diagnose``."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import warnings
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple, NoReturn

import numpy as np
import pandas as pd
from scipy import stats
from tqdm import tqdm

from hybridsurrogate.datasets import load_mauna_loa_co2, load_nile, make_log_sin
from hybridsurrogate.diagnosis import DiscrepancyDiagnosis
from hybridsurrogate.diagnosis.report.report import Report, ending_of
from hybridsurrogate.diagnosis.validation.progress import doing
from hybridsurrogate.estimators import PowerScaledSurrogate
from hybridsurrogate.exceptions import DiagnosisWarning, HybridSurrogateWarning, did_you_mean
from hybridsurrogate.likelihoods import LIKELIHOODS
from hybridsurrogate.priors import Prior, truncated_normal
from hybridsurrogate.problem.rows import without_gaps
from hybridsurrogate.simulation.curve_tables import long_table
from hybridsurrogate.simulation.files.measured_table import numbers_of, with_days, with_levels
from hybridsurrogate.simulation.files.table_file import RUN, read_table
from hybridsurrogate.simulation.ranges import check_support
from hybridsurrogate.simulation.simulator import SimulationData
from hybridsurrogate.surrogates import ExactSurrogate, Kriging, PolynomialChaos, Surrogate
from hybridsurrogate.whole_file import check_writable, written_whole

# of measurements, beyond which kriging takes too long; of the polynomial that then takes its place
_MOST_ROWS, _MOST_DEGREE = 200, 5


class Demo(NamedTuple):
    """A demonstration: what it is, its simulation and its data, rows held back, causes at most."""

    introduction: str
    simulator: Any
    X: Any
    y: Any
    test: tuple[Any, Any] | None
    max_causes: int = 1


def _co2() -> Demo:
    data = load_mauna_loa_co2()
    early = (data.data["year"] < 1996).to_numpy()
    return Demo(
        "Monthly CO2 at Mauna Loa, 1958 to 1995 (1996 to 2001 held back), against a simulation of "
        "smooth growth: a pre-industrial level plus an excess that grows exponentially.",
        data.simulator,
        data.data[early],
        np.asarray(data.target)[early],
        (data.data[~early], np.asarray(data.target)[~early]),
        max_causes=2,
    )


def _log_sin() -> Demo:
    case = make_log_sin(random_state=0)
    return Demo(
        "Case study 1 of arXiv 2412.11875: 30 rows of a process in x = 1 to 100, against a "
        "simulation that lacks one of its terms (x = 100 to 200 held back).",
        case.simulator,
        case.X,
        case.y,
        (case.X_out, case.y_out),
    )


def _nile() -> Demo:
    data = load_nile()
    return Demo(
        "Annual flow of the Nile at Aswan, 1871 to 1970, against a simulation of constant flow.",
        data.simulator,
        data.data,
        np.asarray(data.target),
        None,
    )


DEMOS = {
    "co2": (_co2, "Mauna Loa CO2 against smooth growth (measured, public domain)"),
    "log-sin": (_log_sin, "the published case study 1 (generated)"),
    "nile": (_nile, "flow of the Nile against a constant (measured, public domain)"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = _parser()
    given = parser.parse_args(argv)
    with warnings.catch_warnings():
        warnings.simplefilter("always", HybridSurrogateWarning)
        warnings.showwarning = _PrintOnce()  # catch_warnings restores it
        try:
            code = int(given.run(given))
            sys.stdout.flush()
            return code
        except BrokenPipeError:
            # whoever read the text has seen enough of it; what is left goes nowhere
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0
        except (ValueError, TypeError, OSError) as error:
            print(f"hybridsurrogate: {error}", file=sys.stderr)
            return 2


def _add_experiments(command: argparse.ArgumentParser) -> None:
    command.add_argument("--experiment", metavar="COLUMN", help="says which experiment a row is of")
    command.add_argument(
        "--by-experiment",
        action="append",
        default=[],
        metavar="NAME=HOW",
        help="a parameter that differs between experiments: own, or spread around a mean",
    )


class _Parser(argparse.ArgumentParser):
    """Asks, of a misspelt word, whether another one was meant."""

    def __init__(self, **settings: Any) -> None:
        self.words: list[str] = []
        self.given: list[str] = []
        super().__init__(**settings)

    def add_argument(self, *names: str, **settings: Any) -> argparse.Action:
        self.words += [*names, *settings.get("choices", ())]
        return super().add_argument(*names, **settings)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        self.given = list(sys.argv[1:] if args is None else args)
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        given = [word.partition("=")[0] for word in self.given]
        strange = [w for w in given if w not in self.words and (w in message or w[:2] == "--")]
        meant = "".join(did_you_mean(word, self.words) for word in strange)
        super().error(f"{message.rstrip('.')}.{meant}" if meant else message)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="hybridsurrogate", description="Find out what a simulation gets wrong.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    demo = commands.add_parser("demo", help="diagnose a simulation on data inside the package")
    demo.add_argument("name", nargs="?", default="co2", choices=DEMOS, help="which one (co2)")
    demo.add_argument("--list", action="store_true", help="list the demonstrations")
    demo.set_defaults(run=_demo)
    own = commands.add_parser("diagnose", help="diagnose a simulation from its runs and your data")
    own.add_argument("measured", help="csv, Parquet or NetCDF file of measurements")
    own.add_argument(
        "--simulation", required=True, help="csv, Parquet or NetCDF file of simulation runs"
    )
    own.add_argument("--inputs", nargs="+", required=True, help="known for both: numbers, dates")
    own.add_argument("--parameters", nargs="*", default=[], help="columns known for runs only")
    own.add_argument("--output", nargs="+", required=True, help="column of the output, or several")
    own.add_argument(
        "--prior",
        action="append",
        default=[],
        metavar="NAME=MEAN,SD",
        help="normal prior of a parameter, cut off at the range of the runs; else uniform there",
    )
    _add_experiments(own)
    own.add_argument(
        "--new", metavar="FILE", help="later measurements, in order: does the extension hold?"
    )
    own.add_argument("--likelihood", default="normal", choices=tuple(LIKELIHOODS))
    own.add_argument(
        "--degree",
        type=int,
        help="emulate the simulation by a polynomial of this degree (default: by a Gaussian "
        "process through the runs; beyond 200 rows by a polynomial of at most degree 5)",
    )
    own.add_argument("--beta", type=float, default=0.5, help="weight of the simulation (0.5)")
    own.add_argument(
        "--beta-scan",
        action="store_true",
        help="also try which weight the simulation deserves: takes longer than all else",
    )
    own.set_defaults(run=_diagnose)
    demo.set_defaults(beta_scan=False)
    for command in (demo, own):
        command.add_argument(
            "--exclude",
            nargs="+",
            default=[],
            metavar="KIND",
            help="kinds that cannot be the cause, such as delay noise",
        )
        command.add_argument(
            "--max-causes",
            type=int,
            metavar="N",
            help=f"look for up to N causes ({'2 for co2, else 1' if command is demo else 1})",
        )
        command.add_argument("--report", default="report.html", help="file to write (report.html)")
        command.add_argument("--json", metavar="FILE", help="also write the numbers, for machines")
        command.add_argument("--seed", type=int, default=0, help="random seed (0)")
    parser.words += ["demo", "diagnose", *demo.words, *own.words]
    return parser


def _demo(given: argparse.Namespace) -> int:
    if given.list:
        for name, (_, description) in DEMOS.items():
            print(f"{name:8} {description}")
        return 0
    _check_files(given)
    demo = DEMOS[given.name][0]()
    print(demo.introduction, end="\n\n", flush=True)
    model = PowerScaledSurrogate(
        demo.simulator, surrogate=ExactSurrogate(), random_state=given.seed
    )
    given.max_causes = demo.max_causes if given.max_causes is None else given.max_causes
    return _finish(model, demo.X, demo.y, demo.test, None, given)


def _diagnose(given: argparse.Namespace) -> int:
    _check_files(given)
    runs = long_table(read_table(given.simulation), given.inputs, given.output)
    measured = _measured(given.measured, (*given.inputs, *given.output), given.output)
    n = len(measured)
    if given.new:
        later = _measured(given.new, measured.columns, given.output)
        # names mean the same level in both
        measured = pd.concat([measured, later[measured.columns]], ignore_index=True)
    runs, measured = with_days(runs, measured, given.inputs, (given.simulation, given.measured))
    _make_numbers(given, runs, measured)
    priors = _priors(given, runs)
    _warn_of_unnamed(runs, {*given.inputs, *given.parameters, *given.output})
    simulation = SimulationData.from_frame(runs, given.inputs, priors, given.output)
    if given.degree is not None:
        _check_degree(given.degree, simulation)
    model = PowerScaledSurrogate(
        simulation,
        surrogate=_surrogate(given.degree, simulation, n),
        beta=given.beta,
        likelihood=given.likelihood,
        experiment=given.experiment,
        by_experiment=dict(map(_differing, given.by_experiment)) or None,
        random_state=given.seed,
    )
    y = measured[given.output].to_numpy(dtype=float)
    y = y[:, 0] if len(given.output) == 1 else y
    labels = [given.experiment] if given.experiment in measured else []
    X = with_levels(measured.drop(columns=[*given.output, *labels]))
    X = X.assign(**{name: measured[name] for name in labels})
    later = (X[n:], y[n:]) if given.new else None
    return _finish(model, X[:n], y[:n], None, later, given)


def _make_numbers(given: argparse.Namespace, runs: pd.DataFrame, measured: pd.DataFrame) -> None:
    """Turn measured columns into numbers, in place; raise ValueError where one of them is none."""
    for name in dict.fromkeys([*given.inputs, *given.output, *measured.select_dtypes("number")]):
        column = measured[name]
        if name in given.output:
            # of several some may be missing
            measured.loc[column.notna(), name] = numbers_of(column.dropna(), given.measured)
            measured[name] = measured[name].astype(float)
        else:
            measured[name] = numbers_of(column, given.measured)
    for name in (*given.inputs, *given.parameters):
        if name in runs:
            numbers_of(runs[name], given.simulation)
    for name in given.output:
        if name in runs:
            # a run without a number has failed, and is dropped with a warning
            numbers_of(runs[name].dropna(), given.simulation, finite=False)


def _measured(path: str, names: Sequence[str], outputs: list[str]) -> pd.DataFrame:
    """Return measured rows that have the named columns, and any of the outputs."""
    table = read_table(path)
    missing = [name for name in names if name not in table]
    if missing:
        raise ValueError(
            f"{path} has no columns {missing}; its columns are {list(table)}."
            f"{did_you_mean(missing, table)}"
        )
    table, *_ = without_gaps(table, table[outputs], word=", ".join(outputs))
    # a comma at the end of each line makes a column without a cell
    return table.dropna(axis="columns", how="all")


def _differing(text: str) -> tuple[str, str]:
    name, _, how = text.partition("=")
    if not how:
        raise ValueError(f"--by-experiment {text}: write NAME=HOW, such as {name}=spread.")
    return name, how


def _warn_of_unnamed(runs: pd.DataFrame, named: set[str]) -> None:
    rest = [name for name in runs.select_dtypes("number") if name not in {*named, RUN}]
    varied = [name for name in rest if runs[name].min() < runs[name].max()]
    if varied:
        warnings.warn(
            f"The columns {varied} differ between runs and are not among --inputs and "
            "--parameters: what they do to the output is taken for an error of the surrogate. "
            "Name them, unless they do nothing.",
            DiagnosisWarning,
            stacklevel=2,
        )


def _surrogate(degree: int | None, simulation: SimulationData, n_rows: int) -> Surrogate:
    # curves are few runs, however many rows they have
    omega = simulation.omega
    curves = omega.shape[1] and 5 * len(np.unique(omega, axis=0)) <= simulation.n_rows
    if degree is None and (n_rows <= _MOST_ROWS or curves):
        return Kriging()
    return PolynomialChaos(_degree(simulation) if degree is None else degree)


def _check_degree(degree: int, simulation: SimulationData) -> None:
    """Raise ValueError for more terms than rows of the runs: a fit takes the cube of their number.

    What no row determines is the prior's alone.
    """
    n, d = len(simulation.y), simulation.X.shape[1] + simulation.omega.shape[1]
    terms = math.comb(d + max(degree, 0), d)
    if terms > n:
        most = next(k for k in range(degree) if math.comb(d + k + 1, d) > n)
        raise ValueError(
            f"--degree {degree} has {terms if terms < 1e6 else f'{terms:.3g}'} terms, more than "
            f"the {n} rows of the runs determine: take at most --degree {most}, or leave it out."
        )


def _degree(simulation: SimulationData) -> int:
    """Return the largest degree that leaves two runs for each term."""
    n_runs, d = len(simulation.y), simulation.X.shape[1] + simulation.omega.shape[1]
    fitting = [k for k in range(2, _MOST_DEGREE + 1) if 2 * math.comb(d + k, k) <= n_runs]
    return max(fitting, default=1)


def _priors(given: argparse.Namespace, runs: pd.DataFrame) -> dict[str, Prior | None]:
    missing = [name for name in given.parameters if name not in runs]
    if missing:
        raise ValueError(
            f"{given.simulation} has no columns {missing}; it has {list(runs)}."
            f"{did_you_mean(missing, runs)}"
        )
    ends = {name: (float(runs[name].min()), float(runs[name].max())) for name in given.parameters}
    priors: dict[str, Prior | None] = {
        name: None for name, (low, high) in ends.items() if low < high
    }
    for text in given.prior:
        name, _, numbers = text.partition("=")
        if name not in ends:
            raise ValueError(
                f"--prior {text}: {name!r} is not one of --parameters.{did_you_mean(name, ends)}"
            )
        try:
            mean, sd = map(float, numbers.split(","))
        except ValueError:
            raise ValueError(f"--prior {text}: write NAME=MEAN,SD, such as {name}=2,0.5.") from None
        # cut off at the runs it would lie among them, wherever it was
        check_support(name, stats.norm(mean, sd), ends[name], len(runs))
        priors[name] = truncated_normal(mean, sd, *ends[name])
    fixed = [name for name in given.parameters if name not in priors]
    if fixed:
        raise ValueError(f"The parameters {fixed} have one value in all runs: leave them out.")
    return priors


def _check_files(given: argparse.Namespace) -> None:
    """Raise where a file cannot be written: now, not after minutes."""
    ending_of(given.report)
    for path in (given.report, given.json):
        if path is not None:
            check_writable(path)


def _finish(
    model: PowerScaledSurrogate,
    X: Any,
    y: Any,
    test: Any,
    later: tuple[Any, Any] | None,
    given: argparse.Namespace,
) -> int:
    most = 1 if given.max_causes is None else given.max_causes
    diagnosis = DiscrepancyDiagnosis(
        model, exclude=given.exclude, max_causes=most, random_state=given.seed, progress=True
    )
    diagnosis.fit(X, y)
    with doing("Report"):
        report = diagnosis.report(test=test, beta_scan=given.beta_scan)
    files = [("With pictures", given.report, report.save)]
    if given.json:
        files.append(("Numbers", given.json, partial(_write_numbers, report)))
    written, failed = [], []
    # first: whoever reads the text may have seen enough of it, as "| head" does
    for what, path, write in files:
        try:
            write(path)
            written.append(f"{what}: {path}")
        except OSError as error:
            failed.append(f"{path} was not written: {error}.")
    # the text is not lost with a file
    print("\n".join([str(report), *([""] if written else []), *written]), flush=True)
    if later is not None:
        print(f"\nSince then: {diagnosis.update(*later)}", flush=True)
    if failed:
        raise OSError(" ".join(failed))
    return 0


def _write_numbers(report: Report, path: str) -> None:
    with written_whole(path) as part:
        part.write_text(json.dumps(report.to_dict(), indent=2, allow_nan=False), encoding="utf-8")


class _PrintOnce:
    """Prints each warning once: a diagnosis fits and predicts on the same rows many times."""

    def __init__(self) -> None:
        self._told: set[str] = set()

    def __call__(self, message: Any, *_: Any, **__: Any) -> None:
        if str(message) not in self._told:
            self._told.add(str(message))
            # not into the line that says what is being done
            tqdm.write(f"Warning: {message}", file=sys.stderr)


if __name__ == "__main__":
    raise SystemExit(main())
