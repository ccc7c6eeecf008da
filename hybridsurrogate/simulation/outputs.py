"""Several outputs of a simulation: their names, what a function returned of them, rows of one each.

Everything that is fitted has one output a row. Of several outputs, one more input of a row holds
which one it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hybridsurrogate.arguments import as_names
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.simulation.arrays import as_numbers
from hybridsurrogate.types import FloatArray

# the input that says, by position, which output a row is of
OUTPUT = "output_of_row"


def output_names(output: str | Sequence[str]) -> tuple[str, ...]:
    """Return the names of one output or several; raise ValueError where they are none.

    Examples
    --------
    >>> output_names("height"), output_names(["height", "flow"])
    (('height',), ('height', 'flow'))
    """
    names = as_names(output, "output", '"height", or ["height", "flow"]')
    if not names:
        raise ValueError(f"output must be a name or several, got {output!r}.")
    if len(set(names)) < len(names):
        raise ValueError(f"The outputs must have different names, got {list(names)}.")
    return names


def check_names(outputs: Sequence[str], others: Sequence[str]) -> None:
    """Raise ValueError for outputs that are called like inputs or parameters."""
    twice = [name for name in outputs if name in others]
    if twice:
        raise ValueError(f"The output {twice[0]!r} is also an input, parameter or constant.")


def by_output(value: Any, names: Sequence[str], title: str, axis: int = -1) -> FloatArray:
    """Return what a function returned as an array (..., k) of its outputs, (...) of a single one.

    Parameters
    ----------
    value : dict of name to array, tuple or list of k arrays, or array
        A dict may hold more than is named. An array has the outputs along ``axis``.
    names : sequence of str
    title : str
        What to call it in an error.
    axis : int, default=-1
    """
    if isinstance(value, Mapping):
        missing = [name for name in names if name not in value]
        if missing:
            raise ValueError(
                f"{title} returned {', '.join(map(str, value))}, but no {missing[0]!r}: name one "
                f"of these as output.{did_you_mean(missing[0], value)}"
            )
        value = tuple(value[name] for name in names)
        value = value[0] if len(names) == 1 else value
    if len(names) == 1:
        return as_numbers(value, f"The output of {title}")
    if isinstance(value, tuple | list):
        parts = [as_numbers(part, f"The output of {title}") for part in value]
        shapes = sorted({part.shape for part in parts})
        if len(shapes) != 1:
            raise ValueError(f"{title} returned outputs of different shapes: {shapes}.")
        array = np.stack(parts, axis=-1)
    else:
        array = as_numbers(value, f"The output of {title}")
        array = np.moveaxis(array, axis, -1) if array.ndim else array
    if array.shape[-1:] != (len(names),):
        raise ValueError(
            f"{title} must return {len(names)} outputs, {', '.join(names)}: a dict of them, a "
            f"tuple, or an array with as many along its {'first' if axis == 0 else 'last'} axis; "
            f"got shape {array.shape}."
        )
    return array


class OneOutput:
    """A simulation of several outputs as a function of rows of one output each.

    Neighbours of which only the output differs are one run.

    Parameters
    ----------
    simulator : Simulator
        ``simulator.evaluate(X, omega) -> (m, n_outputs)``.
    names : sequence of str
        Its inputs, parameters and constants.
    n_inputs : int
    scale : ndarray of shape (n_outputs,)
        By which outputs are divided.
    """

    def __init__(
        self, simulator: Any, names: Sequence[str], n_inputs: int, scale: FloatArray
    ) -> None:
        self.simulator, self.names, self.n_inputs = simulator, names, n_inputs
        self.scale = scale
        self.__name__ = simulator.name

    def __call__(self, **columns: FloatArray) -> FloatArray:
        """Return the outputs (n,) of n rows."""
        which = columns[OUTPUT].astype(np.intp)
        points = np.array([columns[name] for name in self.names]).T
        new = np.append(True, np.any(points[1:] != points[:-1], axis=1))[: len(points)]
        outputs = self.simulator.evaluate(
            points[new, : self.n_inputs], points[new, self.n_inputs :]
        )
        return (outputs / self.scale)[np.cumsum(new) - 1, which]


class AllOutputs:
    """A simulation of rows of one output each as a function of all outputs: `OneOutput` undone.

    Parameters
    ----------
    simulator : Simulator
        `OUTPUT` is one of its inputs.
    outputs : sequence of str
    """

    def __init__(self, simulator: Any, outputs: Sequence[str]) -> None:
        self.simulator, self.outputs = simulator, tuple(outputs)
        self.__name__ = simulator.name

    def __call__(self, **columns: FloatArray) -> dict[str, FloatArray]:
        """Return the outputs by name."""
        k, n = len(self.outputs), len(next(iter(columns.values())))
        own = {name: np.repeat(values, k) for name, values in columns.items()}
        own[OUTPUT] = np.tile(np.arange(k, dtype=float), n)
        names = (*self.simulator.input_names, *self.simulator.parameter_ranges)
        points = np.array([own[name] for name in names]).T
        at = len(self.simulator.input_names)
        found = self.simulator.evaluate(points[:, :at], points[:, at:]).reshape(n, k)
        return dict(zip(self.outputs, found.T, strict=True))
