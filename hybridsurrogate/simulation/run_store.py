"""Finished runs on disk, each written at once, so that a stopped ensemble goes on."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterable, Sequence
from io import StringIO
from typing import Any

import numpy as np

from hybridsurrogate.arguments import local_path
from hybridsurrogate.numerics.atomic_file import written_whole
from hybridsurrogate.simulation.table_file import RUN
from hybridsurrogate.types import FloatArray

_ABOUT, _RUNS = "about.json", "runs.csv"
_ENDING = ["error", "seconds", "last"]


class RunStore:
    """A folder with the finished runs of a simulation: ``runs.csv``, which pandas reads.

    A row for each output: the run, its inputs and parameters, the output, the error of a run that
    failed, its seconds, and whether the row is the run's last. Rows are only ever added; a run
    whose last row is missing, because the process was killed while it wrote, is run again.

    Parameters
    ----------
    folder : str or path
        Made where it does not exist.
    simulation : str
        Its name, by which stores are distinguished.
    names : sequence of str
        Inputs, parameters and constants, then the outputs.
    n_outputs : int, default=1

    Raises
    ------
    ValueError
        For a folder that holds runs of another simulation, or other files, or damaged ones; for
        an address.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        simulation: str,
        names: Sequence[str],
        n_outputs: int = 1,
    ) -> None:
        self.folder, self.n_outputs = local_path(folder, "store"), n_outputs
        self.names = list(names)
        self._check({"simulation": simulation, "columns": self.names})
        self._path = self.folder / _RUNS
        try:
            self._known, self._next = self._read()
        except (KeyError, TypeError, ValueError, csv.Error) as error:
            raise ValueError(
                f"{self._path} is damaged ({type(error).__name__}: {error}): name a new folder as "
                "store."
            ) from error

    def _check(self, about: dict[str, Any]) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise type(error)(
                f"store must name a folder, and {str(self.folder)!r} cannot be one: {error}."
            ) from None
        path = self.folder / _ABOUT
        try:
            known = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            if any(self.folder.iterdir()):
                raise ValueError(
                    f"The folder {str(self.folder)!r} holds other files than runs: name a new one "
                    "as store."
                ) from None
            with written_whole(path) as part:
                part.write_text(json.dumps(about, indent=1), encoding="utf-8")
            return
        except (ValueError, OSError):
            known = None
        if not isinstance(known, dict):
            raise ValueError(f"{path} is broken: name a new folder as store.")
        differ = [key for key, value in about.items() if known.get(key) != value]
        if differ:
            key = differ[0]
            raise ValueError(
                f"The store {str(self.folder)!r} holds runs of another simulation: its {key} is "
                f"{known.get(key)!r}, here it is {about[key]!r}. Name another folder."
            )

    def known(self, rows: FloatArray) -> tuple[FloatArray, str | None] | None:
        """Return outputs and error of the run with these rows (k, d), None if it is new.

        The former (k,), or (k, n_outputs) of several.
        """
        return self._known.get(np.ascontiguousarray(rows, dtype=float).tobytes())

    def _read(self) -> tuple[dict[bytes, tuple[FloatArray, str | None]], int]:
        text = self._path.read_text(encoding="utf-8") if self._path.exists() else ""
        reader = csv.DictReader(StringIO(text[: text.rfind("\n") + 1]))
        lines, columns = list(reader), [RUN, *self.names, *_ENDING]
        if reader.fieldnames not in (None, columns):
            raise ValueError(f"its columns are {reader.fieldnames}")
        found: dict[bytes, tuple[FloatArray, str | None]] = {}
        whole: list[dict[str, str]] = []
        run: list[dict[str, str]] = []
        for line in lines:
            if run and line[RUN] != run[-1][RUN]:
                run = []  # it was cut short
            run.append(line)
            if line["last"] != "1":
                continue
            table = np.array([[float(own[name] or "nan") for name in self.names] for own in run])
            rows, y = np.split(table, [len(self.names) - self.n_outputs], axis=1)
            key = np.ascontiguousarray(rows).tobytes()
            found[key] = y[:, 0] if self.n_outputs == 1 else y, line["error"] or None
            whole += run
            run = []
        if len(whole) < len(lines) or (text and not text.endswith("\n")):
            self._rewrite(whole)
        return found, 1 + max((int(line[RUN]) for line in whole), default=-1)

    def add(self, runs: Iterable[tuple[FloatArray, FloatArray, str | None, float]]) -> None:
        """Write finished runs at once: of each rows (k, d), outputs, error and seconds."""
        buffer = StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        if not self._path.exists() or not self._path.stat().st_size:
            writer.writerow([RUN, *self.names, *_ENDING])
        for rows, y, error, seconds in runs:
            for k, (row, value) in enumerate(zip(rows, y, strict=True)):
                last = k == len(rows) - 1
                # repr of a double is read as the same double
                numbers = [repr(float(number)) for number in (*row, *np.atleast_1d(value))]
                text = " ".join((error or "").split()) if last else ""
                writer.writerow([self._next, *numbers, text, f"{seconds:.3f}", int(last)])
            self._known[np.ascontiguousarray(rows, dtype=float).tobytes()] = y, error
            self._next += 1
        with self._path.open("a", encoding="utf-8", newline="") as file:
            file.write(buffer.getvalue())
            file.flush()
            os.fsync(file.fileno())

    def _rewrite(self, lines: list[dict[str, str]]) -> None:
        with (
            written_whole(self._path) as part,
            part.open("w", encoding="utf-8", newline="") as file,
        ):
            writer = csv.DictWriter(file, [RUN, *self.names, *_ENDING], lineterminator="\n")
            writer.writeheader()
            writer.writerows(lines)
