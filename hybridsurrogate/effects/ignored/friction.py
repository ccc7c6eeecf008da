"""What turns with the sign of a column, and a part in proportion to it."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.over_column import OverColumn
from hybridsurrogate.effects.registry import Form, over_extras, register

# rows on either side of zero, of distinct values
_LEAST_EACH = 3


class Friction(OverColumn):
    """Dry friction and viscous friction: one depends on the sign, the other on the speed.

    ``simulation + viscous x + dry sign(x)``: Coulomb's and Newton's law (Olsson et al. 1998,
    European Journal of Control 4:176); the same form has the voltage at a contact, or a backlash.
    ``dry`` is in units of the output, ``viscous`` in those per unit of the column.

    Parameters
    ----------
    column : str
        A measured column that the simulation ignores, with rows on both sides of zero.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.axis import Axis
    >>> friction = hs.Friction("v", axis=Axis.of([-2.0, 2.0]))
    >>> friction.columns({"v": np.array([-2.0, 1.0])}, {}).tolist()
    [[-1.0, -1.0], [0.5, 1.0]]
    """

    kind = "missing-input"
    coefficients = ("viscous", "dry")

    @property
    def variant(self) -> str:
        """The name of this form, which differs from a straight line."""
        return "friction"

    def columns(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the column in half spans, and its sign."""
        x = X[self.column]
        return np.stack([2 * x / self.axis.span, np.sign(x)], axis=-1)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return both parts in the units of output and column."""
        return {
            "viscous": 2 / self.axis.span * np.asarray(coefficients["viscous"]),
            "dry": np.asarray(coefficients["dry"]),
        }

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{viscous} * {x} + {dry} * np.sign({x})",
            {"viscous": "{y} / {x}", "dry": "{y}"},
            {"x": self.column},
        )


def _trouble(cause: Cause, context: Context) -> str | None:
    if not isinstance(cause, Friction) or cause.column not in context.X:
        return None
    values = np.unique(context.column(cause.column))
    if min(np.sum(values < 0), np.sum(values > 0)) >= _LEAST_EACH:
        return None
    return f"{cause.column} has fewer than {_LEAST_EACH} distinct values on one side of zero"


register(
    Form(
        "missing-input: friction",
        Friction,
        over_extras(Friction),
        meaning="{output} has a part that turns with the sign of {target}, which the simulation "
        "ignores, and one in proportion to it, as dry and viscous friction",
        least_distinct=6,
        trouble=_trouble,
        headline="{output} depends on {target} as by friction, which the simulation ignores",
        estimates="viscous, dry",
        left_out="fewer than 3 distinct values on one side of zero",
    )
)
