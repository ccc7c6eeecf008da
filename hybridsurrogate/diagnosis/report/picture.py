"""The one picture of the first screen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from hybridsurrogate import plotting
from hybridsurrogate.diagnosis.report.elements.section import Drawn, logarithmic, rendered
from hybridsurrogate.diagnosis.report.elements.view import SETTINGS, View
from hybridsurrogate.numerics import digits
from hybridsurrogate.plotting import Predicted
from hybridsurrogate.types import FloatArray

# rows held out: a table and its outputs, checked
Test = tuple[Any, FloatArray] | None


def overview(view: View, test: Test = None, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw data, simulation and extended model, and the residuals of both below.

    Parameters
    ----------
    view : View
    test : (X_test, y_test) or None
        Rows that were held out.
    axes : sequence of two matplotlib Axes, default=None
    """
    return _drawn(view, test, axes)[0]


def picture(view: View, test: Test = None) -> Drawn:
    """Return the picture with its caption and numbers."""
    axes, table, low = _drawn(view, test, None)
    since = f"From {view.name} = {digits.number(low)} on. " if low is not None else ""
    lines = "the calibrated simulation (blue)"
    if view.extended:
        lines += " and the extended model (orange)"
    held = "; circles: held out, seen by no fit" if test is not None else ""
    return rendered(
        axes,
        f"{since}Above: measurements (dots), {lines} with 90 % intervals{held}. Below: the "
        "residuals.",
        table,
    )


def _drawn(
    view: View, test: Test, axes: Sequence[Axes] | None
) -> tuple[list[Axes], pd.DataFrame, float | None]:
    """Return Axes, the numbers at the measured rows, and where the picture begins, if later."""
    held = None
    if test is not None:
        rows, values = view.held_back(test)
        held = rows[:, view.shown], values
    low = _start(view, held)
    shown = np.ones(len(view.x), dtype=bool) if low is None else view.x >= low
    x, y = view.x[shown], view.y[shown]
    last = x if held is None else np.concatenate([x, held[0]])
    models = [view.result.before]
    if view.extended:
        models.append(view.result.extension.estimator)
    table = pd.DataFrame({view.name: x, f"measured {view.output}": y})
    drawn = []
    for name, model in zip(("simulation", "extended model"), models, strict=False):
        residual = y - view.predicted(model, view.as_given(view.X))[shown]
        at_rows = view.prediction(model, view.as_given(view.X[shown]))
        table[name], table[f"{name}, lower 90 %"] = at_rows.mean, at_rows.lower90
        table[f"{name}, upper 90 %"], table[f"{name}, residual"] = at_rows.upper90, residual
        drawn.append(_predicted(view, model, at_rows, residual, last, x))
    axes = plotting.plot_overview(
        x,
        y,
        drawn[0],
        drawn[1] if view.extended else None,
        held,
        view.is_curve,
        (view.axis(view.name), view.axis(view.output), f"residual ({view.unit_of(view.output)})"),
        axes,
        None if view.y_err is None else view.y_err[shown],
        None if view.side is None else view.side[shown],
    )
    logarithmic(axes[0], view, y)
    return axes, table, low


def _predicted(
    view: View,
    model: Any,
    at_rows: plotting.Prediction,
    residual: FloatArray,
    last: FloatArray,
    x: FloatArray,
) -> Predicted:
    if not view.is_curve:
        return Predicted(x, at_rows, residual)
    rows = view.grid(float(last.min()), float(last.max()), n=500)
    return Predicted(rows[:, view.shown], view.prediction(model, view.as_given(rows)), residual)


def _start(view: View, held: tuple[FloatArray, FloatArray] | None) -> float | None:
    """Return where the picture begins so that cycles can be seen; None: at the first row."""
    if not view.is_curve:
        return None
    periods = [
        finding.estimates["period"][0]
        for finding, cause in view.findings
        if "period" in finding.estimates and getattr(cause, "column", view.name) == view.name
    ]
    end = float(view.x.max() if held is None else max(view.x.max(), held[0].max()))
    start = end - SETTINGS.most_periods * min(periods, default=np.inf)
    return start if start > float(view.x.min()) and np.sum(view.x >= start) > 1 else None
