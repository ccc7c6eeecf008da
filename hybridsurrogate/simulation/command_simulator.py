"""A simulation that is an external program, started once for each run."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from string import Formatter
from typing import Any

import numpy as np

from hybridsurrogate.arguments import check_choice, check_mapping, check_number, described
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.simulation.outputs import by_output, output_names
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.simulation.table_file import MAX_MESSAGE, read_table
from hybridsurrogate.simulation.variables import Assumed, Range, check_ranges, named_fields
from hybridsurrogate.types import FloatArray, Prior


class CommandSimulator(Simulator):
    """A simulation that is an external program.

    Each run has a new, empty folder. The input files are written there, and the command is started
    there without a shell. ``{name}`` in the command or in an input file is the value of an
    input, a parameter or an assumed constant; ``{{`` and ``}}`` are braces.

    Parameters
    ----------
    command : str or sequence of str
        Program and arguments, such as ``"solver --rate {rate} input.txt"``.
    inputs, parameters, assumed, output
        As in `Simulator`.
    files : dict of file name to template, optional
        Input files.
    read : str or callable, optional
        What holds the output. A file name: a csv (or Parquet, NetCDF) file with a column for each
        ``output``; where a run is a curve, one with a column of the first input too is interpolated
        by lines where the program chose other places. A callable gets the folder, as a Path, and
        what the program printed, and returns a number or an array of shape (n_places,), of several
        outputs a dict of them. None: the last numbers that the program printed.
    returns : {"values", "curve"}, default="values"
        "curve": one run gives outputs at all values of the first input, which stand in templates
        as numbers with spaces between.
    timeout : float, optional
        Seconds after which a run is stopped, and counts as failed.

    Raises
    ------
    ValueError
        For a program that does not exist, or a template with an unknown name.

    Examples
    --------
    >>> import sys
    >>> from scipy.stats import uniform
    >>> import hybridsurrogate as hs
    >>> simulator = hs.CommandSimulator(
    ...     [sys.executable, "-c", "print({rate} * {t})"], inputs={"t": (0, 10)},
    ...     parameters={"rate": uniform(0, 1)}, timeout=60)
    >>> simulator([2.0], [0.5])
    array([1.])
    """

    def __init__(
        self,
        command: str | Sequence[str],
        inputs: Mapping[str, Range],
        parameters: Mapping[str, Prior] | None = None,
        assumed: Mapping[str, Assumed] | None = None,
        output: str | Sequence[str] = "y",
        files: Mapping[str, str] | None = None,
        read: str | Callable[[Path, str], Any] | None = None,
        returns: str = "values",
        timeout: float | None = None,
    ) -> None:
        if timeout is not None:
            check_number(timeout, "timeout", Real, min_val=0, include_boundaries="neither")
        words = _words(command)
        if not words or shutil.which(words[0]) is None:
            raise ValueError(
                f"There is no program {words[0] if words else ''!r}: give its path, or check PATH."
            )
        ranges = check_ranges(inputs)
        unknown = named_fields(tuple(ranges), parameters, assumed)
        check_choice(returns, "returns", ("values", "curve"))
        curve = next(iter(ranges)) if returns == "curve" else None
        outputs = output_names(output)
        if curve is not None and read is None and len(outputs) > 1:
            raise ValueError(
                "Of several outputs that are curves read must name the file, or be a function."
            )
        if not (read is None or isinstance(read, str) or callable(read)):
            raise TypeError(
                "read must be the name of the file that holds the output, a function, or None, got "
                f"{described(read)}."
            )
        program = Command(tuple(words), _templates(files), read, outputs, curve, timeout)
        program.check([*ranges, *unknown["parameters"], *unknown["assumed"]])
        super().__init__(program, ranges, parameters, assumed, output, False, returns)


@dataclass(frozen=True)
class Command:
    """A program as a function of keyword arguments.

    Attributes
    ----------
    words : tuple of str
    files : dict of str to str
    read : str, callable or None
    outputs : tuple of str
    along : str or None
        The input along which a run is a curve.
    timeout : float or None
    """

    words: tuple[str, ...]
    files: dict[str, str]
    read: str | Callable[[Path, str], Any] | None
    outputs: tuple[str, ...]
    along: str | None
    timeout: float | None

    @property
    def __name__(self) -> str:
        return Path(self.words[0]).name

    def check(self, names: Sequence[str]) -> None:
        """Raise ValueError where a template uses an unknown name, or a name is in no template."""
        asked = set()
        for title, text in [("command", " ".join(self.words)), *self.files.items()]:
            try:
                fields = {field for _, field, _, _ in Formatter().parse(text) if field is not None}
            except ValueError as error:
                raise ValueError(
                    f"The template of {title!r} is broken ({error}): write braces twice where they "
                    "are not around a name."
                ) from None
            unknown = sorted(fields - set(names))
            if unknown:
                raise ValueError(
                    f"The template of {title!r} uses {unknown}; there are {list(names)}."
                    f"{did_you_mean(unknown, names)}"
                )
            asked |= fields
        missing = [name for name in names if name not in asked and name != self.along]
        if missing:
            raise ValueError(
                f"Neither command nor files have a place for {missing}: write {{{missing[0]}}}."
            )

    def __call__(self, **values: Any) -> Any:
        """Run the program once."""
        texts = {name: _text(value) for name, value in values.items()}
        with tempfile.TemporaryDirectory(prefix="hybridsurrogate-") as name:
            folder = Path(name)
            for file, template in self.files.items():
                path = folder / file
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(template.format(**texts), encoding="utf-8")
            said = self._started([word.format(**texts) for word in self.words], folder)
            out = self._outputs(folder, said, values)
        if not np.isfinite(out).all():
            raise ValueError("the program gave NaN or infinity")
        return out

    def _started(self, words: list[str], folder: Path) -> str:
        try:
            done = subprocess.run(
                words, cwd=folder, capture_output=True, text=True, timeout=self.timeout, check=False
            )
        except subprocess.TimeoutExpired:
            raise TimeoutError(
                f"the program took longer than {self.timeout:g} s and was stopped"
            ) from None
        if done.returncode:
            tail = " ".join((done.stderr or done.stdout).split())[-MAX_MESSAGE:]
            raise RuntimeError(f"the program ended with code {done.returncode}: {tail}")
        return done.stdout

    def _outputs(self, folder: Path, said: str, values: Mapping[str, Any]) -> Any:
        places = None if self.along is None else np.asarray(values[self.along], dtype=float)
        k = len(self.outputs)
        if callable(self.read):
            out = by_output(self.read(folder, said), self.outputs, "read")
        elif self.read is None:
            numbers = [number for word in said.split() if (number := _number(word)) is not None]
            n = k if places is None else len(places)
            if len(numbers) < n:
                raise ValueError(f"the program printed {len(numbers)} numbers of {n}")
            out = np.array(numbers[-n:])
        else:
            out = self._table(folder / self.read, places)
        if places is not None:
            return out
        last = out.reshape(-1, k)[-1]
        return float(last[0]) if k == 1 else last

    def _table(self, path: Path, places: FloatArray | None) -> FloatArray:
        if not path.exists():
            raise FileNotFoundError(f"the program wrote no file {path.name!r}")
        table = read_table(path)
        for name in self.outputs:
            if name not in table:
                raise ValueError(
                    f"{path.name} has no column {name!r}, but {list(table)}."
                    f"{did_you_mean(name, table)}"
                )
        columns = table[list(self.outputs)].to_numpy(dtype=float)
        if places is None or self.along not in table:
            return columns[:, 0] if len(self.outputs) == 1 else columns
        own = table[self.along].to_numpy(dtype=float)
        order = np.argsort(own)
        slack = 1e-9 * float(np.ptp(own))
        if places[0] < own.min() - slack or places[-1] > own.max() + slack:
            raise ValueError(
                f"{path.name} goes from {own.min():g} to {own.max():g} in {self.along!r}, and "
                f"{places[0]:g} to {places[-1]:g} is needed"
            )
        found = [np.interp(places, own[order], column[order]) for column in columns.T]
        return found[0] if len(found) == 1 else np.column_stack(found)


def _words(command: Any) -> list[str]:
    """Return program and arguments; raise for what is no text, path or list of such."""
    if isinstance(command, str):
        try:
            return shlex.split(command)
        except ValueError as error:
            raise ValueError(f"command {command!r} is broken ({error}).") from None
    words = list(command) if isinstance(command, list | tuple) else [command]
    if not all(isinstance(word, str | os.PathLike | Real) for word in words):
        raise TypeError(
            'command must be text, such as "solver --rate {rate}", or a list of words, got '
            f"{described(command)}."
        )
    return [str(word) for word in words]


def _templates(files: Mapping[str, str] | None) -> dict[str, str]:
    """Return the templates of input files by name; TypeError for anything else."""
    templates = check_mapping(files, "files", "template", '{"input.txt": "rate = {rate}"}')
    for name, template in templates.items():
        if not isinstance(template, str):
            raise TypeError(
                f"The template of {name!r} must be text, got {described(template)}; "
                "of a file read it first, Path(...).read_text()."
            )
    return templates


def _text(value: Any) -> str:
    # 17 digits are read as the same double
    return " ".join(f"{number:.17g}" for number in np.atleast_1d(value))


def _number(word: str) -> float | None:
    try:
        return float(word.strip(",;"))
    except ValueError:
        return None
