"""The catalogue of causes: each kind is a class that registers itself.

registry (what a file registers), base (the methods of a cause), context (what it may know of the
data, and where measured rows lie), expressions (a cause in text, in LaTeX and as code), wrapped (a
cause in one of several outputs, or with the size of a search), over_column, picture; then rooms by
what a cause changes: output (added to it), response (made of it), parameters, inputs, dynamics,
noise. Registered classes are names of this package, too.
"""

from hybridsurrogate.effects.base import SIMULATED, SLOPE, Cause, Context
from hybridsurrogate.effects.output.processes import Remainder
from hybridsurrogate.effects.registry import classes, load_causes
from hybridsurrogate.effects.wrapped import InOutput

__all__ = ["SIMULATED", "SLOPE", "Cause", "Context", "InOutput", "Remainder"]

load_causes()
globals().update(classes())
__all__ += sorted(classes())
