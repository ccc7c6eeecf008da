"""What a cause looks like before any data; nothing else of the package needs it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hybridsurrogate.effects.base import SIMULATED, SLOPE, Cause, Context
from hybridsurrogate.likelihoods.student_t import log_shape
from hybridsurrogate.simulation.variables import MAX_LEVELS
from hybridsurrogate.types import FloatArray

# of outliers, so many standard deviations are drawn
_MAX_Z = 15.0


def plot_cause(cause: Cause, context: Context, ax: Axes | None = None) -> Axes:
    """Draw what a cause may look like: some draws of its prior over its column.

    Coefficients are drawn as standard normal: the shape counts, the height does not.

    Parameters
    ----------
    cause : Cause
        Prepared.
    context : Context
        Of the measured rows.
    ax : matplotlib Axes or None
    """
    ax = ax or Figure(figsize=(4.5, 2.8), layout="constrained").subplots()
    column = next((name for name in cause.reads if name in context.X), context.inputs[0])
    values = np.asarray(context.X[column])
    if cause.follows_mean or "response" in cause.acts_on:
        column, values = SIMULATED, context.location + context.scale * np.array([-2.0, 2.0])
    if cause.follows_slope:
        column = SLOPE
        values = 2 * np.max(np.abs(context.slopes[cause.follows_slope[0]])) * np.array([-1, 1])
    if "outliers" in cause.acts_on:
        column, values = "deviation, in sd of the other rows", _MAX_Z * np.array([-1, 1])
    x = np.linspace(values.min(), values.max(), 300)
    # a column of levels is only known at its levels
    if column in context.X and len(np.unique(values)) <= MAX_LEVELS:
        x = np.unique(values)
    rows = {name: np.full(len(x), np.median(v)) for name, v in context.X.items()} | {column: x}
    for other in cause.reads[1:]:
        # a product is zero at the middle of the other column: draw it at the upper end
        rows[other] = np.full(len(x), np.max(context.X[other]))
    # five curves, from the bulk of the prior: the tails of a Cauchy prior would flatten all others
    shares = np.random.RandomState(0).uniform(0.15, 0.85, (5, len(cause.parameters)))
    weights = np.random.RandomState(1).standard_normal((len(shares), len(cause.coefficients)))
    label = "change"
    for share, weight in zip(shares, weights, strict=True):
        theta = {
            name: np.full(len(x), prior.ppf(q))
            for (name, prior), q in zip(cause.parameters.items(), share, strict=True)
        }
        label, height = _shape(cause, rows, theta, weight, context)
        ax.plot(x, height, "o-" if len(x) <= MAX_LEVELS else "-", lw=1.2, ms=4)
    ax.set_xlabel(column)
    ax.set_ylabel(label)
    ax.set_title(cause.name, fontsize="medium")
    return ax


def _shape(
    cause: Cause,
    rows: dict[str, FloatArray],
    theta: dict[str, FloatArray],
    weight: FloatArray,
    context: Context,
) -> tuple[str, FloatArray]:
    """Return what a cause changes, in words, and by how much at some rows."""
    n = len(next(iter(rows.values())))
    if "outliers" in cause.acts_on:
        z = np.linspace(-_MAX_Z, _MAX_Z, n)
        return "log density of the noise", log_shape(z, np.asarray(cause.outliers(theta)))
    columns = cause.columns(rows, theta)
    if columns is not None:
        return "added to the simulation", columns @ weight
    if "noise" in cause.acts_on:
        return "factor on the noise", np.broadcast_to(cause.noise(rows, theta), n)
    if "response" in cause.acts_on:
        changed = cause.response(rows[SIMULATED], rows, theta)
        assert changed is not None
        return "measured output", changed[0]
    gain = np.asarray(cause.gain(rows, theta))
    if gain.ndim or gain != 1.0:
        return "factor on the simulation", np.broadcast_to(gain, n)
    omega = {name: np.full(n, prior.median()) for name, prior in context.parameters.items()}
    omega |= {name: np.full(n, constant.value) for name, constant in context.assumed.items()}
    run_rows, run_omega = cause.inputs(rows, omega, theta)
    before, after = {**rows, **omega}, {**run_rows, **run_omega}
    moved = [name for name in before if not np.array_equal(before[name], after[name])]
    name = moved[0] if moved else next(iter(before))
    return f"change of {name}", after[name] - before[name]
