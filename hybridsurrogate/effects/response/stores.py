"""Causes that act on the simulated output again and again: a feed, a second store."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows, quantiles
from hybridsurrogate.effects.context import UNKNOWN, Axis
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.over_column import FromOrigin
from hybridsurrogate.effects.registry import Form, needs, over_inputs, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


@dataclass(eq=False, repr=False)
class BuildUp(FromOrigin):
    """Nothing at first, then more and more of what is simulated: absorption of a dose, a warm-up.

    ``simulation (1 - exp(-(x - origin) / scale))``. Where the simulation is an exponential decay,
    that is first-order absorption and elimination of a substance (Bateman 1910, Proceedings of the
    Cambridge Philosophical Society 15:423). The scale is in units of the column; its prior is
    log-uniform from a tenth of the distance of neighbouring rows to half the measured span.

    Parameters
    ----------
    column : str
        An input of the simulation.
    origin : float or None, default=None
        Where it begins. None: zero, from which the measurements begin at no more than a quarter of
        their span.
    scale : frozen scipy.stats distribution or None, default=None
        Prior of the scale.
    log_scale : bool or None, default=None
        Whether the output is logarithmic, so that the logarithm of the share is added.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Raises
    ------
    ValueError
        When prepared without an origin for a column that does not begin near zero.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> taken_up = hs.BuildUp("t", origin=0.0)
    >>> taken_up.gain({"t": np.array([0.0, 1.0, 9.0])}, {"scale": 1.0}).round(2).tolist()
    [0.0, 0.63, 1.0]
    """

    kind = "build-up"
    unknowns = ("scale",)
    # a factor: its logarithm, too, is a straight line over the simulated output
    acts_on = frozenset({"gain"})

    column: str
    origin: float | None = None
    scale: Prior | None = None
    log_scale: bool | None = None
    axis: Axis = UNKNOWN

    def prepare(self, context: Context) -> Cause:
        """Fill in the prior from the measured rows."""
        values = context.column(self.column)
        if self.origin is None and not _begins_at_zero(context, self.column):
            raise ValueError(
                f"{self.column!r} does not begin near zero: give the place where the "
                f"build-up begins, as in BuildUp({self.column!r}, origin={values.min():.4g})."
            )
        axis = self.along(context)
        return self.filled(
            axis=axis,
            origin=self.origin or 0.0,
            scale=self.scale or frozen(stats.loguniform, 0.1 * axis.spacing, 0.5 * axis.span),
            log_scale=context.log_scale if self.log_scale is None else self.log_scale,
        )

    def grid(self) -> dict[str, FloatArray]:
        """Return scales, evenly spaced on a logarithmic scale."""
        return {"scale": quantiles(self.scale, 20)}

    def gain(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the share that is there."""
        return -np.expm1(-self.distance(X) / theta["scale"])

    def response(
        self, simulated: FloatArray, X: Rows, theta: Rows
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return the output times the share, or plus its logarithm."""
        if not self.log_scale:
            return super().response(simulated, X, theta)
        share = np.maximum(self.gain(X, theta), np.finfo(float).tiny)
        return simulated + np.log(share), np.ones_like(simulated)

    def code(self) -> Code:
        """Return the cause as Python."""
        share = "-np.expm1(-np.maximum({x} - {origin}, 0) / {scale})"
        whole = "{simulated} * {share}"
        if self.log_scale:
            whole = "{simulated} + np.log(np.maximum({share}, np.finfo(float).tiny))"
        return replace(self.shown(), expression=whole, steps={"share": share})

    def shown(self) -> Code:
        """Return the output itself times the share."""
        return Code(
            "{simulated} * (1 - np.exp(-np.maximum({x} - {origin}, 0) / {scale}))",
            {"scale": "{x}"},
            {"x": self.column},
            {"origin": self.pivot},
            does="responds",
        )


def _begins_at_zero(context: Context, column: str) -> bool:
    return bool(context.X[column].min() >= 0) and context.begins_at_zero(column)


def _trouble(cause: Cause, context: Context) -> str | None:
    # a user-defined cause of this kind sets where it begins
    if not isinstance(cause, BuildUp) or cause.origin is not None:
        return None
    begins = _begins_at_zero(context, cause.column)
    return None if begins else f"{cause.column} does not begin near zero"


register(
    Form(
        "build-up",
        BuildUp,
        over_inputs(BuildUp),
        meaning=(
            "what the simulation has from the start builds up over {column}, as where a dose "
            "is taken up or an instrument warms up"
        ),
        least_distinct=6,
        trouble=_trouble,
        headline=(
            "{output} builds up at the start, over {scale}, where the simulation has it at once"
        ),
    )
)


@dataclass(eq=False, repr=False)
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

    column: str
    origin: float | None = None
    size: Prior | None = None
    scale: Prior | None = None
    axis: Axis = UNKNOWN

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
            size=self.size or frozen(stats.loguniform, 0.03 * usual, 30 * usual),
            scale=self.scale or frozen(stats.loguniform, axis.span / 4, 4 * axis.span),
        )

    def grid(self) -> dict[str, FloatArray]:
        """Return sizes and scales, evenly spaced on logarithmic scales."""
        return {name: quantiles(prior, 10) for name, prior in self.parameters.items()}

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


register(
    Form(
        "second-store",
        SecondStore,
        lambda context: (SecondStore(name) for name in context.inputs if context.log_scale),
        meaning="a part of {output} waits in a second store that empties more slowly over {column}",
        least_distinct=6,
        lacking=needs(
            lambda context: context.log_scale or context.states,
            "the output itself is measured: decay is the same",
        ),
        headline="A part of {output} empties more slowly than in the simulation, over {scale}",
    )
)
