"""A process that feeds in what the simulation has from the start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from hybridsurrogate.effects.axis import UNKNOWN, Axis
from hybridsurrogate.effects.base import Act, Cause, Context, FloatArray, Rows, quantiles
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import FromOrigin
from hybridsurrogate.effects.registry import Form, over_inputs, register
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior


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

    def __init__(
        self,
        column: str,
        origin: float | None = None,
        scale: Prior | None = None,
        log_scale: bool | None = None,
        axis: Axis = UNKNOWN,
    ):
        super().__init__(column, origin, axis)
        self.scale = scale
        self.log_scale = log_scale

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

    @property
    def acts_on(self) -> frozenset[Act]:
        """A factor: its logarithm, too, is a straight line over the simulated output."""
        return frozenset({"gain"})

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
        meaning="what the simulation has from the start builds up over {column}, as where a dose "
        "is taken up or an instrument warms up",
        least_distinct=6,
        trouble=_trouble,
        like=("decay", "saturation"),
        headline=(
            "{output} builds up at the start, over {scale}, where the simulation has it at once"
        ),
        formula="eta (1 - exp(-x / scale))",
        priors="scale: log-uniform, a tenth of a spacing to half the span",
        estimates="scale",
        left_out="fewer than 6 distinct values; x does not begin near zero",
    )
)
