"""Simulation and measurements from what the command line or a study file names."""

from __future__ import annotations

import argparse
import math
import re
import tomllib
import warnings
from collections.abc import Iterable, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from hybridsurrogate.arguments import check_readable, described, is_address
from hybridsurrogate.command_line.options import KINDS, Option
from hybridsurrogate.command_line.priors import assumed_of, prior_of
from hybridsurrogate.command_line.user_code import function_in, is_code
from hybridsurrogate.effects.noise.noise import OutputCorrelation
from hybridsurrogate.estimators import PowerScaledSurrogate, PredictiveWeightedSurrogate
from hybridsurrogate.exceptions import DiagnosisWarning, did_you_mean
from hybridsurrogate.likelihoods import Censored, Likelihood
from hybridsurrogate.model.rows.measured_data import without_gaps
from hybridsurrogate.simulation.arrays import DATE
from hybridsurrogate.simulation.curve_tables import long_table
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.simulation.table_file import (
    RUN,
    numbers_of,
    read_table,
    with_days,
)
from hybridsurrogate.surrogates import (
    SURROGATES,
    ExactSurrogate,
    Kriging,
    PolynomialChaos,
    Surrogate,
)
from hybridsurrogate.types import FloatArray, Prior


def read_study(path: str, options: Iterable[Option]) -> dict[str, Any]:
    """Return the options in a TOML file, files in it relative to its folder.

    Parameters
    ----------
    path : str
    options : iterable of Option
        All that may be in it; whoever reads it takes those that it knows.

    Raises
    ------
    ValueError
        For what is no TOML, an unknown key, or a value of another kind than the option takes.
    OSError
        Where there is no such file.

    Examples
    --------
    >>> from pathlib import Path
    >>> from hybridsurrogate.command_line.options import SEED
    >>> _ = Path("study.toml").write_text("sead = 3")
    >>> read_study("study.toml", [SEED])
    Traceback (most recent call last):
    ...
    ValueError: study.toml has an unknown key 'sead'. Did you mean 'seed'?
    """
    file = check_readable(path)
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is no TOML: {error}.") from error
    known = {one.name: one for one in options if one.in_file}
    for key in table:
        if key not in known:
            meant = did_you_mean(key, known) or f" The keys are {', '.join(sorted(known))}."
            raise ValueError(f"{path} has an unknown key {key!r}.{meant}")
    return {key: _value(known[key], value, path, file.parent) for key, value in table.items()}


def _value(option: Option, value: Any, path: str, folder: Path) -> Any:
    kind = KINDS[option.kind]
    converted = kind.read(value)
    if converted is None:
        raise ValueError(f"{path}: {option.name} must be {kind.wanted}, got {described(value)}.")
    if option.choices and converted not in option.allowed:
        raise ValueError(
            f"{path}: {option.name} must be one of {', '.join(option.allowed)}, got {value!r}."
            f"{did_you_mean(value, option.allowed)}"
        )
    if option.kind not in ("path", "paths"):
        return converted
    files = [
        file if file == "-" or is_address(file) else str(folder / Path(file).expanduser())
        for file in ([converted] if option.kind == "path" else converted)
    ]
    return files[0] if option.kind == "path" else files


# of measurements, beyond which kriging takes too long; of the polynomial that then takes its place
_MAX_KRIGED_ROWS, _MAX_DEGREE = 200, 5
_METHODS = {
    "power-scaling": PowerScaledSurrogate,
    "predictive-weighting": PredictiveWeightedSurrogate,
}


class Study(NamedTuple):
    """What is compared: simulation, surrogate, rows, their errors, later rows, code, likelihood."""

    simulation: SimulationData | Simulator
    surrogate: Surrogate
    X: pd.DataFrame
    y: FloatArray
    y_err: Any = None
    later: tuple[pd.DataFrame, FloatArray, Any] | None = None
    code: str | None = None
    likelihood: str | Likelihood = "normal"

    @property
    def columns(self) -> list[str]:
        """Names of all that has a unit."""
        source = self.simulation
        return [*self.X.columns, *source.parameter_ranges, *source.outputs]


def read_study_data(given: argparse.Namespace) -> Study:
    """Return the study that options describe: those of `options.DATA`, ``new`` and ``surrogate``.

    Parameters
    ----------
    given : argparse.Namespace

    Raises
    ------
    ValueError, OSError
        For files and names that do not fit.
    """
    for name in ("inputs", "output"):
        if not getattr(given, name):
            raise ValueError(f"--{name} is missing: name the columns.")
    correlation = _correlation(given)
    user = function_in(given.simulation) if is_code(given.simulation) else None
    if user is None and given.runs is not None:
        raise ValueError("--runs is for a function: the file of runs has those that it has.")
    runs = None
    if user is None:
        runs = long_table(read_table(given.simulation), given.inputs, given.output)
    measured = _measured(
        given.measured, (*given.inputs, *given.output, *given.errors), given.output
    )
    n, new = len(measured), getattr(given, "new", None)
    if new:
        later = _measured(new, measured.columns, given.output)
        # names mean the same level in both
        measured = pd.concat([measured, later[measured.columns]], ignore_index=True)
    below, above, columns = limits_in(measured, given.measured, given)
    measured = measured.drop(columns=columns)
    if runs is not None:
        runs, measured = with_days(runs, measured, given.inputs, (given.simulation, given.measured))
    _make_numbers(given, runs, measured)
    if user is None:
        assert runs is not None
        simulation: SimulationData | Simulator = _from_runs(given, runs)
    else:
        print(f"The function {given.simulation} is executed as it stands.", flush=True)
        simulation = _from_function(given, user.function, measured)
    surrogate = surrogate_for(given, simulation, n)
    y = measured[given.output].to_numpy(dtype=float)
    y = y[:, 0] if len(given.output) == 1 else y
    likelihood: str | Likelihood = given.likelihood
    if any(map(np.ndim, (below, above))):
        y, likelihood = Censored.of_rows(y, below, above, likelihood, given.rounded)
    elif any(limit is not None for limit in (below, above, given.rounded)):
        likelihood = Censored(likelihood, below, above, given.rounded)
    X, errors = measured.drop(columns=given.output), list(given.errors) or None
    now = later = errors
    if correlation is not None:
        sd = X[errors].to_numpy(dtype=float)
        if np.any(sd <= 0):
            raise ValueError(f"{given.measured}: the errors in {errors} must be positive.")
        X, covariances = X.drop(columns=errors), correlation * sd[:, :, None] * sd[:, None]
        now, later = covariances[:n], covariances[n:]
    after = (X[n:], y[n:], later) if new else None
    return Study(simulation, surrogate, X[:n], y[:n], now, after, user and user.file, likelihood)


# the word for what measurements are to show
_ESTIMATED = "estimated"


def _correlation(given: argparse.Namespace) -> FloatArray | None:
    """Return the known correlations (k, k) of the errors of outputs, None where none are known."""
    text, outputs, k = given.error_correlation, list(given.output), len(given.output)
    if text is None:
        return None
    option = f"--error-correlation {text}"
    if k < 2:
        raise ValueError(f"{option} is of several outputs, and --output names one.")
    if text == _ESTIMATED:
        return None
    pairs = [" and ".join(pair) for pair in combinations(outputs, 2)]
    try:
        values = np.array([float(one) for one in text.split(",")])
    except ValueError:
        raise ValueError(f"{option} is neither numbers nor the word {_ESTIMATED}.") from None
    if len(values) not in (1, len(pairs)):
        raise ValueError(
            f"{option}: give one number, or {len(pairs)} numbers, of {', '.join(pairs)}."
        )
    if len(given.errors) != k:
        raise ValueError(
            f"{option} needs --errors, a column for each of {', '.join(outputs)}. Where these are "
            f"unknown: --error-correlation {_ESTIMATED}."
        )
    matrix, upper = np.eye(k), np.triu_indices(k, 1)
    matrix[upper] = matrix.T[upper] = values
    if not np.all(np.abs(values) < 1) or np.linalg.eigvalsh(matrix)[0] <= 0:
        raise ValueError(
            f"{option}: no {k} outputs have such correlations. Each lies between -1 and 1, and "
            "their matrix is positive definite."
        )
    return matrix


def _from_runs(given: argparse.Namespace, runs: pd.DataFrame) -> SimulationData:
    parameters = list(given.parameters)
    unknown = [*parameters, *given.assumed]
    check_file_columns(unknown, runs, given.simulation)
    ends = {name: (float(runs[name].min()), float(runs[name].max())) for name in unknown}
    priors: dict[str, Prior | None] = {
        name: None for name in parameters if ends[name][0] < ends[name][1]
    }
    _check_priors(given, parameters)
    for name, text in given.prior.items():
        priors[name] = prior_of(name, text, (ends[name], len(runs)))
    fixed = [name for name in parameters if name not in priors]
    if fixed:
        raise ValueError(f"The parameters {fixed} have one value in all runs: leave them out.")
    assumed = {name: assumed_of(name, text, ends[name]) for name, text in given.assumed.items()}
    _warn_of_unnamed(runs, {*given.inputs, *unknown, *given.output})
    return SimulationData.from_frame(runs, given.inputs, priors, given.output, assumed)


def _from_function(
    given: argparse.Namespace, function: Any, measured: pd.DataFrame
) -> SimulationData | Simulator:
    """Return the function as a simulation over the ranges of the measured inputs, or its runs."""
    parameters = list(given.parameters or given.prior)
    _check_priors(given, parameters)
    without = [name for name in parameters if name not in given.prior]
    if without:
        raise ValueError(
            f"The parameters {without} have no prior, and a function no runs to take one from: "
            f"add --prior {without[0]}=MEAN,SD."
        )
    simulator = Simulator(
        function,
        {name: (float(measured[name].min()), float(measured[name].max())) for name in given.inputs},
        {name: prior_of(name, given.prior[name]) for name in parameters},
        {name: assumed_of(name, text) for name, text in given.assumed.items()},
        given.output,
    )
    return simulator if given.runs is None else simulator.run(given.runs, random_state=given.seed)


def _check_priors(given: argparse.Namespace, parameters: Sequence[str]) -> None:
    for name, text in given.prior.items():
        if name not in parameters:
            raise ValueError(
                f"--prior {name}={text}: {name!r} is not one of --parameters."
                f"{did_you_mean(name, parameters)}"
            )


def check_file_columns(names: Sequence[str], table: pd.DataFrame, path: str) -> None:
    """Raise ValueError where a table of a file has not all of the columns.

    Parameters
    ----------
    names : sequence of str
    table : pandas.DataFrame
    path : str
    """
    missing = [name for name in names if name not in table]
    if missing:
        raise ValueError(
            f"{path} has no columns {missing}; its columns are {list(table)}."
            f"{did_you_mean(missing, table)}"
        )


def _make_numbers(
    given: argparse.Namespace, runs: pd.DataFrame | None, measured: pd.DataFrame
) -> None:
    """Turn measured columns into numbers, in place; raise ValueError where one of them is none."""
    for name in dict.fromkeys([*given.inputs, *given.output, *measured.select_dtypes("number")]):
        column = measured[name]
        if name in (*given.output, *given.errors):
            # of several some may be missing
            measured.loc[column.notna(), name] = numbers_of(column.dropna(), given.measured)
            measured[name] = measured[name].astype(float)
            continue
        if runs is None and re.fullmatch(DATE, str(column.iloc[0]).strip()):
            raise ValueError(
                f"{given.measured}: {name!r} holds dates, and a function takes numbers: write the "
                "days that have passed since the simulation began."
            )
        measured[name] = numbers_of(column, given.measured)
    if runs is None:
        return
    for name in (*given.inputs, *given.parameters):
        if name in runs:
            numbers_of(runs[name], given.simulation)
    for name in given.output:
        if name in runs:
            # a run without a number has failed, and is dropped with a warning
            numbers_of(runs[name].dropna(), given.simulation, finite=False)


def _measured(path: str, names: Iterable[str], outputs: list[str]) -> pd.DataFrame:
    """Return measured rows that have the named columns, and any of the outputs."""
    table = read_table(path)
    check_file_columns(list(names), table, path)
    table, *_ = without_gaps(table, table[outputs], word=", ".join(outputs))
    # a comma at the end of each line makes a column without a cell
    return table.dropna(axis="columns", how="all")


def limits_in(
    table: pd.DataFrame, path: str, given: argparse.Namespace
) -> tuple[Any, Any, list[str]]:
    """Return lower and upper limit, one or that of each row, and the columns that hold them.

    Of several outputs one of each (k,), or those of each row (n, k).

    Parameters
    ----------
    table : pandas.DataFrame
        What a file holds.
    path : str
    given : argparse.Namespace
        With ``below`` and ``above``.
    """
    limits: list[Any] = []
    columns = []
    for word in ("below", "above"):
        text, each = getattr(given, word), list[Any]()
        whole = text is None or text in table
        for one in [text] if whole else str(text).split(","):
            try:
                each.append(None if one is None else float(one))
            except ValueError:
                if one not in table:
                    raise ValueError(
                        f"--{word} {one}: it is neither a number nor a column of {path}, which has "
                        f"{list(table)}.{did_you_mean(one, table)}"
                    ) from None
                each.append(pd.to_numeric(table[one]))
                columns.append(one)
        limits.append(np.stack(np.broadcast_arrays(*each), -1) if len(each) > 1 else each[0])
    return *limits, columns


def _warn_of_unnamed(runs: pd.DataFrame, known: set[str]) -> None:
    rest = [name for name in runs.select_dtypes("number") if name not in {*known, RUN}]
    varied = [name for name in rest if runs[name].min() < runs[name].max()]
    if varied:
        warnings.warn(
            f"The columns {varied} differ between runs and are not among --inputs and "
            "--parameters: what they do to the output is taken for an error of the surrogate. "
            "Name them, unless they do nothing.",
            DiagnosisWarning,
            stacklevel=2,
        )


def surrogate_for(
    given: argparse.Namespace, simulation: SimulationData | Simulator, n_rows: int
) -> Surrogate:
    """Return the surrogate that was named, or that serves so many measured rows.

    Parameters
    ----------
    given : argparse.Namespace
        With ``surrogate`` and ``degree``, which may be None.
    simulation : SimulationData or Simulator
    n_rows : int

    Raises
    ------
    ValueError
        For a surrogate that cannot be had, and for more terms than runs.
    """
    word, degree = given.surrogate, given.degree
    if degree is not None and word not in (None, "polynomial-chaos"):
        raise ValueError(f"--degree is for polynomial-chaos, not for --surrogate {word}.")
    if isinstance(simulation, Simulator):
        if word not in (None, "exact") or degree is not None:
            raise ValueError(
                "An emulator needs runs of the function: add --runs 128, or leave out "
                f"--{'surrogate' if degree is None else 'degree'} and it is run itself."
            )
        return ExactSurrogate()
    if word == "exact" and simulation.simulator is None:
        raise ValueError(
            "--surrogate exact runs the simulation: name its function, --simulation "
            "model.py:FUNCTION."
        )
    if degree is not None:
        _check_degree(degree, simulation)
        return PolynomialChaos(degree)
    if word == "polynomial-chaos":
        return PolynomialChaos(largest_degree(simulation))
    if word is not None:
        return SURROGATES[word]
    # curves are few runs, however many rows they have
    omega = simulation.omega
    curves = omega.shape[1] and 5 * len(np.unique(omega, axis=0)) <= simulation.n_rows
    if n_rows <= _MAX_KRIGED_ROWS or curves:
        return Kriging()
    return PolynomialChaos(largest_degree(simulation))


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


def largest_degree(simulation: SimulationData) -> int:
    """Return the largest degree that leaves two runs for each term, at most 5.

    Parameters
    ----------
    simulation : SimulationData
    """
    n_runs, d = len(simulation.y), simulation.X.shape[1] + simulation.omega.shape[1]
    fitting = [k for k in range(2, _MAX_DEGREE + 1) if 2 * math.comb(d + k, k) <= n_runs]
    return max(fitting, default=1)


def model_of(
    study: Study, given: argparse.Namespace, beta: float, method: str = "power-scaling"
) -> PowerScaledSurrogate | PredictiveWeightedSurrogate:
    """Return the estimator of a study, which is yet to be fitted.

    Parameters
    ----------
    study : Study
    given : argparse.Namespace
        With noise, error_correlation, experiment, by_experiment and seed.
    beta : float
        Weight of the simulation.
    method : {"power-scaling", "predictive-weighting"}

    Raises
    ------
    ValueError
        For correlations of errors that this method does not estimate.
    """
    effects = {}
    if given.error_correlation == _ESTIMATED:
        if method != "power-scaling":
            raise ValueError(
                f"--error-correlation {_ESTIMATED} is for --method power-scaling: give numbers."
            )
        effects = {"effects": [OutputCorrelation()]}
    return _METHODS[method](
        study.simulation,
        surrogate=study.surrogate,
        beta=beta,
        likelihood=study.likelihood,
        noise=given.noise,
        experiment=given.experiment,
        by_experiment=given.by_experiment or None,
        random_state=given.seed,
        **effects,
    )
