"""Pictures of a diagnosis: functions that take ``ax=None`` and return the Axes; nothing is shown.

Colours are those of Okabe and Ito, which colour-blind readers can tell apart.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from hybridsurrogate.priors import FloatArray

if TYPE_CHECKING:
    from hybridsurrogate.diagnosis import DiscrepancyDiagnosis

Test = tuple[ArrayLike, ArrayLike] | None

BEFORE, AFTER, DATA, HELD_OUT, QUIET = "#0072B2", "#D55E00", "#222222", "#009E73", "#999999"


def new_axes(n: int = 1, width: float = 7.0, height: float = 3.4) -> list[Axes]:
    """Return n Axes side by side on a new figure without a window."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return list(np.atleast_1d(figure.subplots(1, n)))


def plot_fit(diagnosis: DiscrepancyDiagnosis, ax: Axes | None = None) -> Axes:
    """Draw the data and the calibrated simulation with its 90 % interval.

    Parameters
    ----------
    diagnosis : DiscrepancyDiagnosis
        Fitted.
    ax : matplotlib Axes or None
    """
    ax = ax or new_axes()[0]
    column, X, y = _shown(diagnosis)
    grid, values = _grid(diagnosis, column, X[:, column].min(), X[:, column].max())
    _band(ax, diagnosis.estimator_, grid, values, BEFORE, "simulation, calibrated")
    ax.plot(X[:, column], y, ".", color=DATA, ms=4, label="measured")
    return _labelled(ax, diagnosis, column)


def plot_discrepancy(diagnosis: DiscrepancyDiagnosis, ax: Axes | None = None) -> Axes:
    """Draw measured minus simulated, with the 90 % band of the smooth discrepancy.

    Parameters
    ----------
    diagnosis : DiscrepancyDiagnosis
        Fitted.
    ax : matplotlib Axes or None
    """
    ax = ax or new_axes()[0]
    band = diagnosis.discrepancy_
    columns = diagnosis.search_.problem.model.columns
    x = band.grid[:, columns.index(band.column)]
    ax.axhline(0, color=QUIET, lw=1)
    ax.fill_between(x, band.lower, band.upper, color=BEFORE, alpha=0.25, lw=0, label="90 % band")
    ax.plot(x, band.mean, color=BEFORE, label="discrepancy")
    ax.set_xlabel(band.column)
    scale = "log " if diagnosis.search_.problem.likelihood.log_scale else ""
    ax.set_ylabel(f"{scale}measured - {scale}simulated")
    ax.legend(frameon=False, fontsize="small")
    return ax


def plot_causes(diagnosis: DiscrepancyDiagnosis, ax: Axes | None = None, most: int = 8) -> Axes:
    """Draw the probabilities of the most probable causes.

    Parameters
    ----------
    diagnosis : DiscrepancyDiagnosis
        Fitted.
    ax : matplotlib Axes or None
    most : int, default=8
        How many causes.
    """
    ax = ax or new_axes()[0]
    table = diagnosis.causes_[diagnosis.causes_["note"] == ""].head(most)[::-1]
    names = [
        f"{kind} ({target})" if isinstance(target, str) else kind
        for kind, target in zip(table["kind"], table["target"], strict=True)
    ]
    best = diagnosis.best_cause_
    colours = [
        AFTER if (kind == best.kind and (best.target is None or target == best.target)) else QUIET
        for kind, target in zip(table["kind"], table["target"], strict=True)
    ]
    bars = ax.barh(names, 100 * table["probability"], color=colours)
    ax.bar_label(bars, fmt=_percent, padding=3, fontsize="small")
    ax.set_xlim(0, 115)
    ax.set_xlabel("probability in %")
    ax.xaxis.set_major_locator(ticker.MultipleLocator(25))
    return ax


def plot_before_after(
    diagnosis: DiscrepancyDiagnosis, test: Test = None, axes: list[Axes] | None = None
) -> list[Axes]:
    """Draw predictions before and after the extension, in and out of the measured range.

    Parameters
    ----------
    diagnosis : DiscrepancyDiagnosis
        Fitted.
    test : (X_test, y_test) or None
        Held-out rows.
    axes : two matplotlib Axes or None
    """
    axes = axes or new_axes(2, 10.0, 3.6)
    column, X, y = _shown(diagnosis)
    name = diagnosis.search_.problem.model.columns[column]
    low, high = diagnosis.estimator_.simulation.input_ranges.get(
        name, (X[:, column].min(), X[:, column].max())
    )
    grid, values = _grid(diagnosis, column, low, high)
    titles = ("before", f"after: {diagnosis.best_cause_.kind}")
    models = (diagnosis.estimator_, diagnosis.extended_estimator_)
    for ax, model, colour, title in zip(axes, models, (BEFORE, AFTER), titles, strict=True):
        ax.axvspan(X[:, column].min(), X[:, column].max(), color="#eeeeee", zorder=0, lw=0)
        _band(ax, model, grid, values, colour, "prediction, 90 %")
        ax.plot(X[:, column], y, ".", color=DATA, ms=4, label="measured")
        if test is not None:
            held = model._check_data(test[0])
            ax.plot(held[:, column], test[1], "x", color=HELD_OUT, ms=4, label="held out")
        ax.set_title(title, fontsize="medium")
        _labelled(ax, diagnosis, column)
    _share_range(axes, y if test is None else np.concatenate([y, np.asarray(test[1])]))
    return axes


def plot_residuals(diagnosis: DiscrepancyDiagnosis, axes: list[Axes] | None = None) -> list[Axes]:
    """Draw measured minus predicted, before and after the extension.

    Parameters
    ----------
    diagnosis : DiscrepancyDiagnosis
        Fitted.
    axes : two matplotlib Axes or None
    """
    axes = axes or new_axes(2, 10.0, 2.8)
    column, X, y = _shown(diagnosis)
    rows = as_given(diagnosis, X)
    models = (diagnosis.estimator_, diagnosis.extended_estimator_)
    for ax, model, colour, title in zip(
        axes, models, (BEFORE, AFTER), ("before", "after"), strict=True
    ):
        ax.axhline(0, color=QUIET, lw=1)
        residual = y - model.predict(rows)
        ax.plot(X[:, column], residual, ".", color=colour, ms=4)
        ax.set_title(
            f"{title}: root mean square {np.sqrt(np.mean(residual**2)):.3g}", fontsize="medium"
        )
        ax.set_xlabel(diagnosis.search_.problem.model.columns[column])
        ax.set_ylabel("measured - predicted")
    limit = max(np.max(np.abs(ax.get_ylim())) for ax in axes)
    for ax in axes:
        ax.set_ylim(-limit, limit)
    return axes


def plot_beta_scan(table: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Draw held-out ELPD against beta before and after the extension, the best beta marked.

    Parameters
    ----------
    table : pandas.DataFrame
        From ``DiscrepancyDiagnosis.beta_scan``.
    ax : matplotlib Axes or None
    """
    ax = ax or new_axes()[0]
    for word, colour in (("before", BEFORE), ("after", AFTER)):
        best = table.iloc[int(np.argmax(table[word]))]
        ax.plot(table["beta"], table[word], "-o", ms=3, color=colour, label=word)
        ax.plot(best["beta"], best[word], "o", ms=9, mfc="none", color=colour)
    ax.set_xlabel("beta (0: measured data only, 1: simulation only)")
    ax.set_ylabel("held-out ELPD per row")
    ax.legend(frameon=False, fontsize="small")
    return ax


def as_given(diagnosis: DiscrepancyDiagnosis, X: FloatArray) -> Any:
    """Return rows whose simulation inputs come first as the user's own columns."""
    estimator = diagnosis.estimator_
    rows = np.empty_like(X)
    rows[:, estimator._column_order] = X
    names = getattr(estimator, "feature_names_in_", None)
    return rows if names is None else pd.DataFrame(rows, columns=names)


def _shown(diagnosis: DiscrepancyDiagnosis) -> tuple[int, FloatArray, FloatArray]:
    X, y = diagnosis.estimator_._measured
    return diagnosis.search_.problem.model.columns.index(diagnosis.discrepancy_.column), X, y


def _grid(
    diagnosis: DiscrepancyDiagnosis, column: int, low: float, high: float
) -> tuple[Any, FloatArray]:
    X, _ = diagnosis.estimator_._measured
    grid = np.repeat(np.median(X, axis=0)[None], 400, axis=0)
    grid[:, column] = np.linspace(low, high, 400)
    return as_given(diagnosis, grid), grid[:, column]


def _band(ax: Axes, model: Any, grid: Any, values: FloatArray, colour: str, label: str) -> None:
    lower, upper = model.predict_interval(grid, 0.9)
    ax.fill_between(values, lower, upper, color=colour, alpha=0.25, lw=0)
    ax.plot(values, model.predict(grid), color=colour, label=label)


def _labelled(ax: Axes, diagnosis: DiscrepancyDiagnosis, column: int) -> Axes:
    ax.set_xlabel(diagnosis.search_.problem.model.columns[column])
    ax.set_ylabel(diagnosis.estimator_.simulation.output)
    ax.legend(frameon=False, fontsize="small")
    return ax


def _share_range(axes: list[Axes], y: FloatArray) -> None:
    """Give both Axes one range, wide enough for the data but not for a runaway extrapolation."""
    low, high = float(np.min(y)), float(np.max(y))
    room = 0.5 * (high - low) + 1e-12
    bottom = max(min(float(ax.get_ylim()[0]) for ax in axes), low - room)
    top = min(max(float(ax.get_ylim()[1]) for ax in axes), high + room)
    for ax in axes:
        ax.set_ylim(bottom, top)


def _percent(value: float) -> str:
    if value >= 99.95:
        return "100 %"
    return f"{value:.1f} %" if value >= 0.1 else "< 0.1 %"
