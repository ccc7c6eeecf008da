"""The catalogue of causes: one small file a kind, which registers itself.

registry (what a file registers), base (the methods of a cause), context (what it may know of
the data), axis (where measured rows lie), code (a cause as an expression), expressions (that in
text and in LaTeX), in_output (a cause in one of several outputs), over_column, sized, picture,
notation; then rooms by what a cause changes: output (added to it), response (made of it),
parameters, inputs, dynamics, noise. Registered classes are names of this package, too.
"""

from hybridsurrogate.effects.base import SIMULATED, SLOPE, Cause, Context
from hybridsurrogate.effects.in_output import InOutput
from hybridsurrogate.effects.output.remainder import Remainder
from hybridsurrogate.effects.registry import classes, load_causes

__all__ = ["SIMULATED", "SLOPE", "Cause", "Context", "InOutput", "Remainder"]

load_causes()
globals().update(classes())
__all__ += sorted(classes())
