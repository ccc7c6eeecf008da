"""A function, its arguments, and what it must return."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class Function:
    """A simulation's function and how it is called.

    Attributes
    ----------
    call : callable
    name : str
    names : sequence of str
        Its arguments, inputs first.
    outputs : sequence of str
    returns : {"values", "curve"}
    vectorized : bool
    typical : callable
        Returns arguments at which the function should work.
    read : callable
        Makes an array (..., n_outputs), (...) of a single one, of what the function returned.
    """

    call: Callable[..., Any]
    name: str
    names: Sequence[str]
    outputs: Sequence[str]
    returns: str
    vectorized: bool
    typical: Callable[[], Sequence[float]]
    read: Callable[[Any], FloatArray]

    @property
    def several(self) -> tuple[int, ...]:
        """The shape of what a row has: () for one output, (k,) for several."""
        return () if len(self.outputs) == 1 else (len(self.outputs),)

    def of_run(self, value: Any, places: FloatArray) -> FloatArray:
        """Return what one call returned as the outputs of its rows, at places of a curve."""
        outputs = self.read(value)
        if self.returns != "curve":
            self.check_shape(outputs.shape, self.several)
            return outputs[None]
        different, which = np.unique(places, return_inverse=True)
        self.check_shape(outputs.shape, (*different.shape, *self.several))
        out: FloatArray = outputs[which.ravel()]
        return out

    def check_shape(self, actual: tuple[int, ...], expected: tuple[int, ...]) -> None:
        """Raise ValueError where the shapes differ."""
        if actual == expected:
            return
        hint = f"vectorized={self.vectorized}: "
        hint += "arrays in, an array out" if self.vectorized else "numbers in, a number out"
        if self.returns == "curve":
            hint = 'returns="curve": as many values as the first input has'
        raise ValueError(
            f"{self.name!r} returned an array of shape {actual}, expected {expected} ({hint})."
        )
