"""A second store that empties more slowly than a simulated decay."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy import stats

from hybridsurrogate.effects.axis import UNKNOWN, Axis
from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows, quantiles
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import FromOrigin
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# of the second store at the origin, in shares of the geometric mean of the measured output
_LEAST, _MOST = 0.03, 30.0
# nodes of the size and of the scale
_NODES = 10


class SecondStore(FromOrigin):
    """An exponential that is added to the output itself, where its logarithm is what is measured.

    ``simulation + size exp(-(x - origin) / scale)``: in addition to a decay, a share that waits in
    a second store and comes back slowly, such as a drug in the tissue (the two-compartment model;
    Gibaldi and Perrier 1982, Pharmacokinetics, chapter 2). On a logarithmic scale that is no added
    column: ``log(exp(eta) + size exp(-(x - origin) / scale))``. Where the output itself is
    measured, `Decay` is the same.

    The scale, after which 37 % remains, is log-uniform from a quarter of the measured span to four
    times it; the size from 0.03 to 30 times the geometric mean of the measured output.

    Parameters
    ----------
    column : str
        An input of the simulation.
    origin : float or None, default=None
        Where the size is meant. None: the smallest measured value.
    size, scale : frozen scipy.stats distribution or None, default=None
        Priors; positive.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> tissue = hs.SecondStore("t", origin=0.0)
    >>> X, theta = {"t": np.array([0.0, 5.0])}, {"size": 0.5, "scale": 5.0}
    >>> np.exp(tissue.response(np.log([2.0, 0.1]), X, theta)[0]).round(3).tolist()
    [2.5, 0.284]
    """

    kind = "second-store"
    unknowns = ("size", "scale")

    def __init__(
        self,
        column: str,
        origin: float | None = None,
        size: Prior | None = None,
        scale: Prior | None = None,
        axis: Axis = UNKNOWN,
    ):
        super().__init__(column, origin, axis)
        self.size = size
        self.scale = scale

    def prepare(self, context: Context) -> Cause:
        """Fill in origin and priors from the measured rows.

        Raises
        ------
        ValueError
            Where the output is not logarithmic.
        """
        if not context.log_scale:
            raise ValueError(
                f"SecondStore({self.column!r}) is for a logarithmic output; where the output "
                f"itself is measured, use Decay({self.column!r}), which is the same."
            )
        axis, usual = self.along(context), float(np.exp(context.location))
        return self.filled(
            axis=axis,
            size=self.size or frozen(stats.loguniform, _LEAST * usual, _MOST * usual),
            scale=self.scale or frozen(stats.loguniform, axis.span / 4, 4 * axis.span),
        )

    def grid(self) -> dict[str, FloatArray]:
        """Return sizes and scales, evenly spaced on logarithmic scales."""
        return {name: quantiles(prior, _NODES) for name, prior in self.parameters.items()}

    def response(
        self, simulated: FloatArray, X: Rows, theta: Rows
    ) -> tuple[FloatArray, FloatArray]:
        """Return the logarithm of the sum, and the share of the simulation in it."""
        # the logarithm of a simulated output below zero is no number: some processors warn again
        with np.errstate(divide="ignore", invalid="ignore"):
            added = np.log(theta["size"]) - self.distance(X) / theta["scale"]
            total = np.logaddexp(simulated, added)
        return total, np.exp(simulated - total)

    def code(self) -> Code:
        """Return the cause as Python."""
        whole = "np.logaddexp({simulated}, np.log({size}) - {beyond} / {scale})"
        return replace(self.shown(), expression=whole)

    def shown(self) -> Code:
        """Return what is added to the output itself."""
        return Code(
            "{simulated} + {size} * np.exp(-{beyond} / {scale})",
            {"size": "{plain}", "scale": "{x}"},
            {"x": self.column},
            {"origin": self.pivot},
            steps={"beyond": "np.maximum({x} - {origin}, 0)"},
            does="responds",
        )


def _over_inputs(context: Context) -> Iterator[Cause]:
    return (SecondStore(name) for name in context.inputs if context.log_scale)


def _lacking(context: Context) -> Iterator[tuple[str | None, str]]:
    if not (context.log_scale or context.states):
        yield None, "the output itself is measured: decay is the same"


register(
    Form(
        "second-store",
        SecondStore,
        _over_inputs,
        meaning="a part of {output} waits in a second store that empties more slowly over {column}",
        least_distinct=6,
        lacking=_lacking,
        like=("saturation", "ramp"),
        headline="A part of {output} empties more slowly than in the simulation, over {scale}",
        formula="log(exp(eta) + size exp(-(x - origin) / scale)); origin: smallest measured x",
        priors="size: log-uniform, 0.03 to 30 times the geometric mean of the output; scale: "
        "log-uniform, a quarter of the span to four times it",
        estimates="size, scale",
        left_out="fewer than 6 distinct values; an output that is not logarithmic",
    )
)
