"""The pictures of a report, first that of the first screen: which numbers go into which Axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from hybridsurrogate import plotting
from hybridsurrogate.diagnosis.answers.experimental_design import information_at
from hybridsurrogate.diagnosis.report.elements.section import Drawn, logarithmic, rendered
from hybridsurrogate.diagnosis.report.elements.view import (
    SETTINGS,
    View,
    label_of,
    root_mean_square,
)
from hybridsurrogate.diagnosis.validation.beta_scan import best_beta
from hybridsurrogate.diagnosis.validation.gain import HeldOutGain
from hybridsurrogate.effects.context import MAX_EXPERIMENTS
from hybridsurrogate.numerics import digits
from hybridsurrogate.plotting import AFTER, BEFORE, Predicted
from hybridsurrogate.scoring.scores import COVERAGE_LEVEL
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


def picture_overview(view: View, test: Test = None) -> Drawn:
    """Return the picture with its caption and numbers."""
    axes, table, low = _drawn(view, test, None)
    since = f"From {view.name} = {digits.number(low)} on. " if low is not None else ""
    lines = "the calibrated simulation (blue)"
    if view.extended:
        lines += " and the extended model (orange)"
    held = "; circles: held out, seen by no fit" if test is not None else ""
    of = "" if view.stacking is None else f" of {view.output}"
    return rendered(
        axes,
        f"{since}Above: measurements{of} (dots), {lines} with 90 % intervals{held}. Below: the "
        "residuals.",
        table,
    )


def _drawn(
    view: View, test: Test, axes: Sequence[Axes] | None
) -> tuple[list[Axes], pd.DataFrame, float | None]:
    """Return Axes, the numbers at the measured rows, and where the picture begins, if later."""
    held = held_side = None
    if test is not None:
        rows, values = view.held_back(test)
        held, held_side = (rows[:, view.shown], values), view.result.before.side_of(values)
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
        at_rows = view.prediction(model, view.X[shown])
        residual = y - at_rows.mean
        table[name], table[f"{name}, lower 90 %"] = at_rows.mean, at_rows.lower90
        table[f"{name}, upper 90 %"], table[f"{name}, residual"] = at_rows.upper90, residual
        curve, at = at_rows, x
        if view.is_curve:
            rows = view.grid(float(last.min()), float(last.max()), n=500)
            curve, at = view.prediction(model, rows), rows[:, view.shown]
        drawn.append(Predicted(at, curve, residual))
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
        held_side,
    )
    logarithmic(axes[0], view, y)
    _write_names(axes[-1], view)
    return axes, table, low


def _write_names(ax: Axes, view: View) -> None:
    """Write names where the column that is shown has numbers for them."""
    names = view.labels.get(view.name)
    if names is not None:
        ax.set_xticks(range(len(names)), names, fontsize="small")


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
    # more than 15 periods would be a block of colour
    start = end - 15 * min(periods, default=np.inf)
    return start if start > float(view.x.min()) and np.sum(view.x >= start) > 1 else None


def picture_discrepancy(view: View) -> Drawn:
    """Draw the residuals of the simulation with a smooth curve through them."""
    (ax,) = axes = plotting.new_axes(height=3.4)
    band = view.band
    if band.column == view.name:
        plotting.plot_discrepancy(ax, view.band_x, band.mean, band.lower, band.upper)
        plotting.plot_measured(ax, view.x, band.residual, "measured - simulated")
    else:
        # the smooth curve is one over the inputs and does not know the column that matters
        _draw_column(ax, view)
    plotting.tidy(ax, view.axis(view.name), f"{view.log}measured - {view.log}simulated")
    _write_names(ax, view)
    return rendered(axes, _described(view))


def experiment_column(view: View) -> str | None:
    """Return the column of experiments by which an accepted cause goes, None without one."""
    few = [
        name
        for name, values in zip(view.columns, view.X.T, strict=True)
        if name not in view.inputs and 2 <= len(np.unique(values)) <= MAX_EXPERIMENTS
    ]
    read = (name for _, cause in view.findings for name in cause.reads if cause.changes_output)
    return next((name for name in read if name in few), None)


def picture_experiments(view: View, column: str) -> Drawn:
    """Draw what the simulation misses in each experiment, and what the extended model adds."""
    of_row = view.X[:, view.columns.index(column)]
    levels = np.unique(of_row)
    own = [k for k in range(len(view.inputs)) if np.ptp(view.X[:, k]) > 0] or [0]
    shown = view.shown if view.shown in own else own[0]
    x = view.X[:, shown]
    residual = view.working_residuals(view.result.before)
    labels = view.labels.get(column)
    across = min(4, len(levels))
    down = -(-len(levels) // across)
    axes = plotting.new_axes(down, across, height=1.2 + 1.5 * down, share=True)
    for k, (ax, level) in enumerate(zip(axes, levels, strict=False)):
        rows = np.flatnonzero(of_row == level)
        rows = rows[np.argsort(x[rows], kind="stable")]
        ax.axhline(0, color=plotting.QUIET, lw=1)
        plotting.plot_measured(ax, x[rows], residual[rows], "measured - simulated")
        # with several inputs neighbours over one of them are none over the others
        line = "-" if len(own) == 1 else "_"
        ax.plot(x[rows], view.change[rows], line, color=AFTER, label="extended - simulated")
        ax.set_title(labels[k] if labels else f"{column} = {level:.6g}", fontsize="small")
        lowest = k + across >= len(levels)
        plotting.tidy(ax, view.columns[shown] if lowest else "", "", legend=False, ticks=4)
        ax.tick_params(labelbottom=lowest, labelleft=k % across == 0)
    for ax in axes[len(levels) :]:
        ax.remove()
    axes = axes[: len(levels)]
    _center(axes)
    figure = axes[0].figure
    figure.supylabel(f"{view.log}measured - {view.log}simulated {view.output}", fontsize="medium")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return rendered(
        axes,
        f"For each {column}: {view.log}measured minus {view.log}simulated {view.output} over "
        f"{view.columns[shown]} as dots, and what the extended model adds to the calibrated "
        "simulation as a line.",
    )


def picture_course(view: View, course: pd.DataFrame) -> Drawn:
    """Draw a parameter as it would have to vary."""
    ax = plotting.plot_parameter_course(course)
    name, over = (str(course[word].iloc[0]) for word in ("parameter", "over"))
    plotting.tidy(ax, view.axis(over), view.axis(name))
    ends = (digits.number(float(course["mean"].agg(word)), 3) for word in ("min", "max"))
    return rendered(
        [ax],
        f"The parameter {name} over {over} with its pointwise 90 % band, as it would have to vary: "
        f"its mean is between {' and '.join(ends)}. The dashed line is its estimate as a constant.",
        course,
    )


def picture_causes(view: View) -> Drawn:
    """Draw the probabilities of the causes."""
    candidates, probabilities = zip(*view.candidates[: SETTINGS.max_causes], strict=True)
    names = [label_of(candidate) for candidate in candidates]
    chosen = next((k for k, one in enumerate(candidates) if one.cause is view.cause), None)
    axes = plotting.new_axes(height=1.0 + 0.32 * len(names))
    plotting.plot_causes(axes[0], names, probabilities, chosen)
    first = zip(names[:4], probabilities, strict=False)
    text = "; ".join(f"{name} {digits.percent(p)}" for name, p in first)
    return rendered(axes, f"Bars of the probabilities of the causes, most probable first: {text}.")


def picture_residuals(view: View) -> Drawn:
    """Draw residuals before and after over the shown column, and their quantiles."""
    looks = (("before", BEFORE, "o"), ("after", AFTER, "s"))
    n = len(view.models)
    axes = plotting.new_axes(2, n, width=7.0 if n > 1 else 4.5, height=5.4)
    sizes = []
    for k, (model, (word, colour, mark)) in enumerate(
        zip(view.models.values(), looks, strict=False)
    ):
        residual = view.working_residuals(model)
        sizes.append(f"{digits.number(root_mean_square(residual), 3)} {word}")
        plotting.plot_residuals(axes[k], view.x, residual, colour, word)
        plotting.tidy(
            axes[k],
            view.axis(view.name),
            f"{view.log}measured - {view.log}predicted",
            False,
            ticks=5,
        )
        _write_names(axes[k], view)
        plotting.plot_quantiles(axes[n + k], view.standardised(model), colour, mark, word)
    for row in (axes[:n], axes[n:]):
        _center(row)
    text = " and ".join(sizes)
    return rendered(
        axes,
        f"Above: residuals over {view.name}, their root mean square {text}. Below: standardised "
        "residuals against normal quantiles; on the line where the predicted spread is right.",
    )


def picture_gain(gains: dict[str, HeldOutGain]) -> Drawn:
    """Draw held-out scores before and after, fold by fold, and coverage; gains have names."""
    rows: list[tuple[str, float, float, float]] = []
    covered: list[tuple[str, float, int]] = []
    for name, g in gains.items():
        rows += [
            (f"{name}, {k + 1}: {f.kind}", f.elpd_before, f.elpd_after, f.standard_error)
            for k, f in enumerate(g.folds)
        ]
        rows.append((f"{name}, all", g.elpd_before, g.elpd_after, g.standard_error))
        covered.append((f"{name}, before", g.coverage_before, g.n_rows))
        if g.elpd_difference:
            covered.append((f"{name}, after", g.coverage_after, g.n_rows))
    names = [row[0] for row in rows]
    before, after, error = np.array([row[1:] for row in rows]).T
    after = np.where(after == before, np.nan, after)
    axes = plotting.new_axes(1, 2, height=1.5 + 0.3 * max(len(rows), len(covered)))
    plotting.plot_scores(axes[0], names, before, after, error)
    titles, shares, counts = zip(*covered, strict=True)
    plotting.plot_coverage(axes[1], titles, np.array(shares), counts, COVERAGE_LEVEL)
    for ax in axes:
        ax.legend(frameon=False, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1))
    text = "; ".join(
        f"{name} {digits.score(b, e)}" + ("" if np.isnan(a) else f" and {digits.score(a, e)}")
        for name, b, a, e in zip(names, before, after, error, strict=True)
        if name.endswith(", all")
    )
    inside = "; ".join(f"{t} {digits.percent(s)}" for t, s in zip(titles, shares, strict=True))
    return rendered(
        axes,
        f"Left: held-out log density per row before and, where something was added, after: {text}. "
        f"Right: share of held-out rows inside the 90 % interval: {inside}.",
    )


def picture_next(view: View) -> Drawn:
    """Draw the alternatives' predictions and where one more measurement would separate them."""
    place = view.result.next_measurement.place
    view = view.of(place["output"]) if view.stacking is not None else view
    at = np.array([place[name] for name in view.columns])
    here = at[view.shown]
    simulated = view.result.before.simulation.input_ranges.get(view.name, ())
    ends = [*simulated, view.x.min(), view.x.max(), here]
    rows = view.grid(min(ends), max(ends), at)
    x = rows[:, view.shown]
    found = view.result.asked
    alternatives = view.alternatives(found)
    means = [view.expected(found, one, rows) for one in alternatives]
    axes = plotting.new_axes(2, 1, height=5.0, share=True)
    names = [label_of(one) for one in alternatives]
    plotting.plot_alternatives(axes[0], x, means, names, here)
    if view.is_curve:
        plotting.plot_measured(axes[0], view.x, view.y)
    logarithmic(axes[0], view, view.y)
    near = means[0] if view.is_curve else np.concatenate(means)
    plotting.share_range(axes[:1], np.concatenate([view.y, near]))
    plotting.tidy(axes[0], "", view.axis(view.output))
    information = information_at(found, view.single(rows))
    plotting.plot_information(axes[1], x, information, here)
    plotting.tidy(axes[1], view.axis(view.name), "information\nin bits", legend=False)
    _write_names(axes[1], view)
    return rendered(
        axes,
        f"What the alternatives predict over {view.name}: {digits.listing(names)}. A vertical "
        f"line marks {view.name} = {view.value(view.name, float(here))}, where one more "
        "measurement would best separate them.",
    )


def picture_weight(within: pd.DataFrame, beyond: pd.DataFrame | None) -> Drawn:
    """Draw held-out scores against beta."""
    scans = {"within the measured range": within, "beyond it": beyond}
    known = {where: scan for where, scan in scans.items() if scan is not None}
    axes = plotting.new_axes(1, len(known), width=3.5 + 3.5 * len(known))
    text = []
    for ax, (where, scan) in zip(axes, known.items(), strict=True):
        plotting.plot_beta_scan(scan, ax)
        ax.set_title(where, fontsize="medium")
        before, after = (best_beta(scan, word) for word in ("before", "after"))
        text.append(f"{where} best at beta = {before:g} before and {after:g} after")
    return rendered(
        axes,
        "Held-out log density per row against beta before and after the extension; "
        f"{'; '.join(text)}.",
    )


def _center(axes: Sequence[Axes]) -> None:
    """Give Axes one range with zero in its middle."""
    limit = max(np.max(np.abs(ax.get_ylim())) for ax in axes)
    for ax in axes:
        ax.set_ylim(-limit, limit)


def _draw_column(ax: Axes, view: View) -> None:
    residual = view.working_residuals(view.result.before)
    ax.axhline(0, color=plotting.QUIET, lw=1)
    plotting.plot_measured(ax, view.x, residual, "measured - simulated")
    moved = residual - view.working_residuals(view.found)
    ax.plot(view.x, moved, "_", color=AFTER, ms=6, label="extended model - simulated")


def _described(view: View) -> str:
    band = view.band
    if band.column != view.name:
        return "Residuals of the calibrated simulation, and what the extended model adds to it."
    part = (
        "nowhere in" if not band.share_outside else f"over {digits.percent(band.share_outside)} of"
    )
    return (
        "Residuals of the simulation with a smooth curve and its pointwise 90 % band, which "
        f"excludes zero {part} the measured range. The parameters are estimated together with the "
        "curve, and so differ from those of the first picture."
    )
