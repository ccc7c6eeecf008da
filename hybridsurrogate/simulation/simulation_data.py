"""Runs of a simulation, from arrays, a DataFrame or a csv file."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from hybridsurrogate.exceptions import FailedRunsWarning
from hybridsurrogate.notebook import table
from hybridsurrogate.simulation.arrays import as_numbers, as_table, check_spread
from hybridsurrogate.simulation.curve_tables import (
    check_curves,
    curve_rows,
    name_of_curves,
    wide_along,
)
from hybridsurrogate.simulation.outputs import OUTPUT, check_names, output_names
from hybridsurrogate.simulation.table_file import RUN, read_table, write_table
from hybridsurrogate.simulation.variables import (
    Assumed,
    Range,
    as_matrix,
    check_assumed,
    check_inputs,
    check_lengths,
    check_support,
    check_value,
    describe,
    named_fields,
    parameter_range,
    prior_names,
    priors_of,
    ranges_of_inputs,
    select_columns,
    varied_ranges,
    with_uniform_priors,
)
from hybridsurrogate.types import FloatArray, Prior


@dataclass(frozen=True, init=False, repr=False, eq=False)
class SimulationData:
    """Runs of a simulation.

    A run has one output, or is a curve along one input, of as many rows as it has outputs: give
    those to `from_curves`.

    Parameters
    ----------
    X : array-like of shape (n_rows, n_inputs)
        One input may also be given as (n_rows,).
    omega : array-like of shape (n_rows, n_parameters + n_assumed) or None
        The parameters, then the assumed constants, as varied in the runs.
    y : array-like of shape (n_rows,), or (n_rows, n_outputs) of several outputs
        Outputs. Rows with NaN or infinity are dropped with a warning; of several outputs some may
        be missing (NaN).
    inputs : dict of name to (low, high), or list of names
        With names alone the ranges are those of the runs.
    parameters : dict of name to scipy.stats frozen distribution, or list of names, optional
        With a name alone, or None in place of a prior, the prior is uniform over the runs, with a
        warning.
    assumed : dict of name to Assumed, optional
    output : str or sequence of str
        What ``y`` is, for labels: a name for each output.
    simulator : Simulator, optional
        The simulation that made the runs, if it can be called again.
    run : array-like of shape (n_rows,) or None, default=None
        The run that each row is of; None: each row is a separate run.
    failed : array-like of shape (n_failed, n_inputs + n_parameters + n_assumed) or None
        Further runs that gave no output, a row each. Runs of ``y`` without any are added.

    Attributes
    ----------
    n_rows, n_runs : int
    output : str
        The label; of several outputs their names, separated by commas.
    outputs : tuple of str
    input_names, parameter_names, assumed_names : tuple of str
    input_ranges : dict of name to (low, high)
    parameter_ranges : dict of name to (low, high)
        Of the parameters, then of the assumed constants: the support of the prior if it has two
        ends and holds all runs, else the range of the runs.

    Warns
    -----
    FailedRunsWarning
        If runs were dropped.
    PriorWarning
        If less than 90 % of a prior's mass lies in the simulated range, or no prior was given.

    Notes
    -----
    The arrays are copies and read-only; memory-mapped ones (`numpy.load` with ``mmap_mode="r"``)
    stay on disk, and fits read some of them at a time. There is no length and no shape on purpose:
    scikit-learn's searches would take the runs for rows of the measured data and slice them.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> import numpy as np
    >>> t, gravity = np.repeat([1.0, 2.0, 3.0], 3), np.tile([9.0, 10.0, 11.0], 3)
    >>> hs.SimulationData(
    ...     t, gravity, gravity / 2 * t**2, inputs=["t"],
    ...     parameters={"gravity": hs.truncated_normal(9.8, 0.3, 9, 11)}, output="distance",
    ... )
    SimulationData(9 runs: t -> distance, parameters: gravity)
    """

    X: FloatArray
    omega: FloatArray
    y: FloatArray
    run: NDArray[np.intp] | None
    failed: FloatArray
    n_rows: int
    n_runs: int
    parameters: dict[str, Prior]
    assumed: dict[str, Assumed]
    output: str
    outputs: tuple[str, ...]
    simulator: Any | None
    input_names: tuple[str, ...]
    parameter_names: tuple[str, ...]
    assumed_names: tuple[str, ...]
    input_ranges: dict[str, Range]
    parameter_ranges: dict[str, Range]

    def __init__(
        self,
        X: ArrayLike,
        omega: ArrayLike | None,
        y: ArrayLike,
        inputs: Mapping[str, Range] | Sequence[str],
        parameters: Mapping[str, Prior | None] | Sequence[str] | None = None,
        assumed: Mapping[str, Assumed] | None = None,
        output: str | Sequence[str] = "y",
        simulator: Any | None = None,
        run: ArrayLike | None = None,
        failed: ArrayLike | None = None,
    ) -> None:
        inputs = check_inputs(inputs)
        given = prior_names(parameters)
        X = as_matrix(X, "X", tuple(inputs))
        omega = np.empty((len(X), 0)) if omega is None else omega
        omega = as_matrix(omega, "omega", (*given, *check_assumed(assumed)))
        fields = named_fields(tuple(inputs), with_uniform_priors(given, omega), assumed)
        priors = priors_of(fields["parameters"], fields["assumed"])
        outputs = output_names(output)
        check_names(outputs, [*fields["input_names"], *priors])
        y = as_numbers(y, "y")
        several = (len(outputs),) if len(outputs) > 1 else ()
        if y.ndim == 0 or y.shape[1:] != several:
            shape = f"(n_runs, {len(outputs)})" if several else "(n_runs,)"
            raise ValueError(
                f"y must have shape {shape}, got {y.shape}: output names what it holds, "
                f"{', '.join(outputs)}."
            )
        check_lengths({"X": X, "omega": omega, "y": y})
        lost = [] if failed is None else [as_matrix(failed, "failed", (*inputs, *priors))]
        labels = np.arange(len(y)) if run is None else np.asarray(run)
        if not np.issubdtype(labels.dtype, np.integer):
            labels = np.unique(labels, return_inverse=True)[1]  # words, as files may have
        if labels.shape != y.shape[:1]:
            raise ValueError(f"run must have shape ({len(y)},), got {labels.shape}.")
        finite = check_failed(X, omega, y, "runs", error=None)
        if not finite.all():
            _, first = np.unique(labels, return_index=True)
            first = first[~np.isin(labels[first], labels[finite])]
            points = np.hstack([X[first], omega[first]])
            lost.append(points[np.isfinite(points).all(axis=1)])
            X, omega, y, labels = X[finite], omega[finite], y[finite], labels[finite]
        for word, values in {"X": X, "omega": omega, "y": y}.items():
            check_spread(values, f"{word} of the runs")
        varied = varied_ranges(X, omega, fields)
        fields |= {
            "X": X,
            "omega": omega,
            "y": y,
            "run": None if run is None else labels,
            "failed": np.vstack([np.empty((0, X.shape[1] + omega.shape[1])), *lost]),
            "n_rows": len(y),
            "n_runs": len(y) if run is None else len(np.unique(labels)),
            "output": ", ".join(outputs),
            "outputs": outputs,
            "simulator": simulator,
            "input_ranges": ranges_of_inputs(inputs, varied),
            "parameter_ranges": {
                name: parameter_range(prior, varied[name]) for name, prior in priors.items()
            },
        }
        self.__dict__.update(fields)
        self._lock()
        for name, constant in self.assumed.items():
            check_value(name, constant.value, varied[name], self.n_runs)
        for name, prior in priors.items():
            check_support(name, prior, varied[name], self.n_runs)

    @classmethod
    def from_curves(
        cls,
        omega: Any,
        Y: Any = None,
        *,
        along: str | Mapping[str, ArrayLike],
        parameters: Mapping[str, Prior | None] | Sequence[str] | None = None,
        assumed: Mapping[str, Assumed] | None = None,
        inputs: Mapping[str, Range] | Sequence[str] = (),
        output: str | Sequence[str] = "y",
    ) -> SimulationData:
        """Take runs that are curves: one run, one value of each parameter, outputs along one input.

        Places may differ between runs; missing outputs are NaN.

        Parameters
        ----------
        omega : array-like of shape (n_runs, n_columns), DataFrame or xarray.Dataset
            Columns by name, or in the order of further inputs, parameters, assumed constants. A
            Dataset holds these, and the output over the runs and ``along``.
        Y : array-like of shape (n_runs, n_places) or DataFrame, optional
            Outputs; (n_runs, n_places, n_outputs) of several, or a dict of name to (n_runs,
            n_places). A wide DataFrame has a row for each run, and the places as column labels; a
            long one has a column "run" and those of ``along`` and the outputs. Where omega is None
            either has the columns of all else, too.
        along : dict of name to array of shape (n_places,) or (n_runs, n_places), or str
            The input along which a run is a curve, and its values where Y does not have them.
        parameters, assumed
            As in SimulationData.
        inputs : dict of name to (low, high), or list of names, default=()
            Ranges of inputs, of ``along`` too where it goes beyond the runs; further inputs, of
            which each run has one value.
        output : str or sequence of str
            A name for each output.

        Returns
        -------
        SimulationData

        Raises
        ------
        ValueError, TypeError
            For shapes that differ, for a run whose parameters change, or that has two results.

        Warns
        -----
        FailedRunsWarning
            For runs without a single output.

        Examples
        --------
        >>> import hybridsurrogate as hs
        >>> import numpy as np
        >>> from scipy.stats import uniform
        >>> rate, t = np.linspace(0.1, 0.5, 20), np.linspace(0, 10, 30)
        >>> hs.SimulationData.from_curves(
        ...     rate, np.exp(-rate[:, None] * t), along={"t": t},
        ...     parameters={"rate": uniform(0.1, 0.4)},
        ... )
        SimulationData(20 runs of 600 rows: t -> y, parameters: rate)
        """
        name, inputs = name_of_curves(along), check_inputs(inputs)
        others = [other for other in inputs if other != name]
        parameters = prior_names(parameters)
        names = [*others, *parameters, *check_assumed(assumed)]
        outputs = output_names(output)
        check_names(outputs, [name, *names])
        table = curve_rows(omega, Y, along, names, outputs)
        check_curves(table, [name], names, outputs)
        ranges = inputs if isinstance(inputs, Mapping) else {}
        ends = {
            key: ranges.get(key, (float(table[key].min()), float(table[key].max())))
            for key in (name, *others)
        }
        omega_names = names[len(others) :]
        return cls(
            table[list(ends)],
            table[omega_names],
            table[outputs[0] if len(outputs) == 1 else list(outputs)],
            ends,
            parameters,
            assumed,
            outputs,
            run=table[RUN],
            failed=table.attrs["failed"][[*ends, *omega_names]],
        )

    @classmethod
    def from_frame(
        cls,
        frame: Any,
        inputs: Mapping[str, Range] | Sequence[str],
        parameters: Mapping[str, Prior | None] | Sequence[str] | None = None,
        output: str | Sequence[str] = "y",
        assumed: Mapping[str, Assumed] | None = None,
    ) -> SimulationData:
        """Take the runs from the named columns of a DataFrame.

        A column "run" holds the run of each row.

        Parameters
        ----------
        frame : DataFrame of pandas, polars or another library
            One output a row; other columns are ignored. Or a wide table: one run a row, whose
            columns are called by the values of an input that has no column, such as "0.5" or
            "t=0.5", and hold the output there.
        inputs, parameters, assumed
            As in SimulationData; their names are columns.
        output : str or sequence of str
            The column with the simulation's output, or those of several.

        Returns
        -------
        SimulationData
        """
        inputs = check_inputs(inputs)
        parameters = prior_names(parameters)
        omega_names = [*parameters, *check_assumed(assumed)]
        outputs = output_names(output)
        check_names(outputs, [*inputs, *omega_names])
        frame = as_table(frame, "The table of runs")
        if not isinstance(frame, pd.DataFrame):
            raise TypeError(
                "from_frame takes a DataFrame, whose columns have names; give arrays to "
                "SimulationData(X, omega, y, ...)."
            )
        names = [*inputs, *omega_names, *outputs]
        along = wide_along(frame, inputs, outputs)
        if along is not None:
            named: dict[str, Any] = {"parameters": parameters, "assumed": assumed, "inputs": inputs}
            return cls.from_curves(None, frame, along=along, output=outputs, **named)
        table = select_columns(frame, names, "The simulation runs")
        X, omega = table[list(inputs)], table[omega_names]
        y = table[outputs[0] if len(outputs) == 1 else list(outputs)]
        run = frame[RUN] if RUN in frame.columns and RUN not in names else None
        return cls(X, omega, y, inputs, parameters, assumed, outputs, run=run)

    def to_frame(self) -> pd.DataFrame:
        """Return the rows: the run where runs are curves, inputs, parameters, constants, outputs.

        Returns
        -------
        pandas.DataFrame
            `from_frame` reads it. Last a row for each run that failed, its outputs NaN.
        """
        points = np.vstack([np.hstack([self.X, self.omega]), self.failed])
        frame = pd.DataFrame(points, columns=[*self.input_names, *self.parameter_ranges])
        frame[list(self.outputs)] = np.nan
        frame.loc[: self.n_rows - 1, list(self.outputs)] = self.y.reshape(self.n_rows, -1)
        if self.run is not None:
            lost = np.arange(len(self.failed)) + np.max(self.run) + 1
            frame.insert(0, RUN, np.concatenate([self.run, lost]))
        return frame

    def with_rows(self, frame: Any) -> SimulationData:
        """Return these runs and further ones of the same simulation.

        Parameters
        ----------
        frame : DataFrame
            The columns of `to_frame`, such as `Simulator.run_at` returns. Where runs are curves, a
            column "run" holds the run of each row.

        Returns
        -------
        SimulationData

        Raises
        ------
        ValueError
            For missing columns, or for other results of a run that is there already.
        """
        names = [*self.input_names, *self.parameter_ranges, *self.outputs]
        table = as_table(frame, "The table of runs")
        if not isinstance(table, pd.DataFrame):
            raise TypeError("with_rows takes a DataFrame with the columns of to_frame().")
        more = select_columns(table, names, "The runs").reset_index(drop=True)
        run = None
        if self.run is not None:
            if RUN not in table.columns:
                raise ValueError(
                    f"Runs are curves: a column {RUN!r} must hold the run of each row."
                )
            _, labels = np.unique(table[RUN], return_inverse=True)
            run = np.concatenate([self.run, labels.ravel() + int(np.max(self.run)) + 1])
        whole = pd.concat([self.to_frame()[names][: self.n_rows], more], ignore_index=True)
        if run is not None:
            # one input along which runs are curves, or two of fields
            changes = pd.DataFrame(self.X).groupby(self.run).nunique().max() > 1
            along = [name for name, one in zip(self.input_names, changes, strict=True) if one]
            constant = [*self.input_names, *self.parameter_ranges]
            # repeats of a stochastic simulation differ
            repeated = whole[constant][: self.n_rows].duplicated().any()
            outputs = () if repeated else self.outputs
            constant = [name for name in constant if name not in along]
            check_curves(whole.assign(**{RUN: run}), along, constant, outputs)
        ranges = {
            name: (min(low, more[name].min()), max(high, more[name].max()))
            for name, (low, high) in self.input_ranges.items()
        }
        y = whole[self.output if len(self.outputs) == 1 else list(self.outputs)]
        omega = whole[list(self.parameter_ranges)]
        return self.with_data(whole[list(ranges)], omega, y, run, inputs=ranges)

    def with_data(
        self, X: Any, omega: Any, y: Any, run: Any | None = None, **changes: Any
    ) -> SimulationData:
        """Return other runs of the same simulation, with those of these that failed.

        Parameters
        ----------
        X, omega, y, run : array-like
            As in SimulationData.
        **changes
            Further parameters of SimulationData that differ.
        """
        names = ("parameters", "assumed", "simulator", "failed")
        same = {name: getattr(self, name) for name in names}
        same |= {"inputs": self.input_ranges, "output": self.outputs}
        return SimulationData(X, omega, y, run=run, **same | changes)

    def single_output(self, scale: FloatArray) -> SimulationData:
        """Return the runs with one output a row, `OUTPUT` their last input; missing ones left out.

        Parameters
        ----------
        scale : ndarray of shape (n_outputs,)
            By which outputs are divided.

        Raises
        ------
        ValueError
            For an output that no run has.
        """
        row, which = np.nonzero(np.isfinite(self.y))
        k, n = len(self.input_names), len(self.outputs)
        empty = sorted(set(range(len(self.outputs))) - set(which.tolist()))
        if empty:
            raise ValueError(f"No run has the output {self.outputs[empty[0]]!r}: leave it out.")
        return self.with_data(
            np.column_stack([self.X[row], which]),
            self.omega[row],
            (self.y / scale)[row, which],
            None if self.run is None else self.run[row] * len(self.outputs) + which,
            inputs={**self.input_ranges, OUTPUT: (0.0, len(self.outputs) - 1.0)},
            output=self.output,
            failed=np.vstack([np.insert(self.failed, k, which, axis=1) for which in range(n)]),
            simulator=None if self.simulator is None else self.simulator.single_output(scale),
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the rows of `to_frame` to a file: .csv, or .parquet with pyarrow.

        `read_simulation` reads it, with those of runs that failed, which have no output.

        Parameters
        ----------
        path : str or path

        Raises
        ------
        ValueError
            For another ending, or an address.
        OSError
            For a folder that does not exist, or where you may not write.
        """
        write_table(self.to_frame(), path)

    def __sklearn_clone__(self) -> SimulationData:
        return self

    def __setstate__(self, state: dict[str, Any]) -> None:
        # pickle does not keep the read-only flag of an array
        self.__dict__.update(state)
        self._lock()

    def __repr__(self) -> str:
        names = (self.input_names, self.parameter_names, self.assumed_names)
        return f"SimulationData({describe(self._title(), *names, self.output)})"

    def _repr_html_(self) -> str:
        words = dict.fromkeys(self.input_names, "input")
        words |= dict.fromkeys(self.parameter_names, "parameter")
        words |= {name: f"assumed {one.value:.4g}" for name, one in self.assumed.items()}
        ends = (*self.input_ranges.values(), *self.parameter_ranges.values())
        rows = [
            (name, word, f"{low:.4g} to {high:.4g}")
            for (name, word), (low, high) in zip(words.items(), ends, strict=True)
        ]
        rows += [(name, "output", "") for name in self.outputs]
        return table(rows, (self._title(), "", "simulated range"))

    def _title(self) -> str:
        source = "" if self.simulator is None else f" of {self.simulator.name}"
        if self.n_runs < self.n_rows:
            source += f" of {self.n_rows} rows"
        return f"{self.n_runs} runs{source}"

    def _lock(self) -> None:
        for array in (self.X, self.omega, self.y, self.failed):
            array.setflags(write=False)


def read_simulation(
    path: str | os.PathLike[str],
    inputs: Mapping[str, Range] | Sequence[str],
    parameters: Mapping[str, Prior | None] | Sequence[str] | None = None,
    output: str | Sequence[str] = "y",
    assumed: Mapping[str, Assumed] | None = None,
    *,
    allow_urls: bool = False,
) -> SimulationData:
    r"""Read the runs of a simulation from a file.

    Parameters
    ----------
    path : str or path
        A csv file with one output a line below a line of column names; the rest of a line after
        ``#`` is ignored. Or .parquet (with pyarrow), or .nc (NetCDF, with xarray): a dataset whose
        output has the dimensions of the runs and one input. A column "run" holds the run of each
        row. Or a wide table, one run a row.
    inputs, parameters, output, assumed
        As in ``SimulationData.from_frame``.
    allow_urls : bool, default=False
        Whether ``path`` may be an address such as ``https://...``, which is then fetched; others
        than http, https and ftp need fsspec.

    Returns
    -------
    SimulationData

    Raises
    ------
    OSError
        For a file that is not there, a folder, or an address that does not answer.
    ValueError
        For an address without ``allow_urls``, and a file that is damaged or lacks a column.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> with open("runs.csv", "w") as file:
    ...     _ = file.write("t,gravity,distance\n1,9,4.5\n2,10,20\n3,11,49.5\n")
    >>> prior = hs.truncated_normal(9.8, 0.3, 9, 11)
    >>> hs.read_simulation("runs.csv", ["t"], parameters={"gravity": prior}, output="distance")
    SimulationData(3 runs: t -> distance, parameters: gravity)
    """
    return SimulationData.from_frame(
        read_table(path, allow_urls), inputs, parameters, output, assumed
    )


def check_failed(
    X: FloatArray, omega: FloatArray, y: FloatArray, title: str, error: str | None
) -> NDArray[np.bool_]:
    """Return which runs hold neither NaN nor infinity, and warn about the others."""
    finite = finite_rows(X, omega, y)
    reason = f"First error: {error}" if error else "They hold NaN or infinity."
    if not finite.any():
        raise ValueError(f"All {len(y)} {title} failed. {reason}")
    if not finite.all():
        rows = np.flatnonzero(~finite)
        shown = ", ".join(map(str, rows[:5])) + (", ..." if len(rows) > 5 else "")
        warnings.warn(
            f"{len(rows)} of {len(y)} {title} failed and were dropped (rows {shown}). {reason}",
            FailedRunsWarning,
            stacklevel=3,
        )
    return finite


def finite_rows(X: FloatArray, omega: FloatArray, y: FloatArray) -> NDArray[np.bool_]:
    """Return which rows hold neither NaN nor infinity, column by column: there may be millions.

    Of several outputs one is enough.
    """
    finite: NDArray[np.bool_] = np.isfinite(y)
    if y.ndim > 1:
        finite = np.asarray(finite.any(axis=1))
    for column in (*X.T, *omega.T):
        finite &= np.isfinite(column)
    return finite
