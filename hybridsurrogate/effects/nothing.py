"""The cause that changes nothing: what later causes are compared with once one is accepted."""

from __future__ import annotations

from hybridsurrogate.effects.base import Cause


class Nothing(Cause):
    """No further cause.

    Examples
    --------
    >>> Nothing().coefficients, Nothing().parameters
    ((), {})
    """

    kind = "none"
