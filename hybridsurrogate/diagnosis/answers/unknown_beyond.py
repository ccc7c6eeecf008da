"""What an extension keeps for what the simulation may lack beyond the measured range."""

from __future__ import annotations

import numpy as np

from hybridsurrogate.effects import InOutput, Remainder
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.output.remainder import LEAST, LEAST_OF_CURVE
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate, as_causes


def with_remainder(
    before: PowerScaledSurrogate, after: PowerScaledSurrogate
) -> PowerScaledSurrogate:
    """Return a fitted extension with a `Remainder` as large as what it changed.

    Parameters
    ----------
    before, after : PowerScaledSurrogate
        Fitted to the same rows; after has causes as effects.
    """
    return after.with_prior_only(_remainders(before, after))


def _remainders(before: PowerScaledSurrogate, after: PowerScaledSurrogate) -> tuple[Cause, ...]:
    """Return the remainder, of several outputs one for each; none of what did not change."""
    rows, stacking = before.data_.single.X, before.data_.stacking
    by = _experiments_that_differ(after)
    is_any_curve = any(effect.kind == "unexplained" for effect in as_causes(after.effects))
    least = LEAST_OF_CURVE if is_any_curve else LEAST
    change = np.mean(after.posterior_.eta(rows)[0], axis=0)
    change = change - np.mean(before.posterior_.eta(rows)[0], axis=0)
    if stacking is None:
        size = _size(change)
        return (Remainder(size, least, by=by),) if size > 0 else ()
    which = rows[:, stacking.at]
    sizes = {name: _size(change[which == k]) for k, name in enumerate(stacking.names)}
    return tuple(
        InOutput(Remainder(size, least, by=by), name) for name, size in sizes.items() if size > 0
    )


def _experiments_that_differ(after: PowerScaledSurrogate) -> str | None:
    """Return the column of experiments, None where what is fitted is the same in all of them."""
    experiments = after.data_.experiments
    if experiments is None:
        return None
    # errors that rows share leave the simulation the same in all
    effects = [one for one in after.posterior_.model.effects if one.changes_output]
    differ = any(experiments.column in one.reads for one in effects)
    return experiments.column if differ else None


def _size(change: np.ndarray) -> float:
    """Return the root mean square; zero for what is no number."""
    size = float(np.sqrt(np.mean(change**2)))
    return size if np.isfinite(size) else 0.0
