"""The pictures of a diagnosis: what is drawn where, against the numbers given."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from numpy.testing import assert_allclose
from scipy.stats import norm

from hybridsurrogate import plotting
from hybridsurrogate.plotting import AFTER, BEFORE, DATA, HELD_OUT, QUIET, Prediction

X = np.array([0.0, 1.0, 3.0])
MEAN = np.array([2.0, 5.0, 4.0])
TOLD = Prediction(MEAN, MEAN - 1, MEAN + 2, MEAN - 3, MEAN + 4)


@pytest.fixture
def ax():
    return Figure().subplots()


def band(collection):
    """Lower and upper ends, at ascending x, of what `fill_between` drew."""
    corners = collection.get_paths()[0].vertices
    places = np.unique(corners[:, 0])
    at = [corners[corners[:, 0] == x, 1] for x in places]
    return places, np.array([y.min() for y in at]), np.array([y.max() for y in at])


def names_on(axis):
    return [label.get_text() for label in axis.get_ticklabels()]


def bars_of(container):
    """Middles and half lengths of the horizontal error bars of a series."""
    (bars,) = container.lines[2]
    ends = np.array([segment[:, 0] for segment in bars.get_segments()])
    return ends.mean(axis=1), np.ptp(ends, axis=1) / 2


@pytest.mark.parametrize("held_out", [False, True])
def test_measurements_are_dots_and_those_held_out_crosses(ax, held_out):
    assert plotting.plot_measured(ax, X, MEAN, "rows", held_out) is ax
    (line,) = ax.lines
    assert_allclose(line.get_xydata(), np.column_stack([X, MEAN]))
    assert line.get_label() == "rows"
    assert line.get_marker() == ("x" if held_out else ".")
    assert same_color(line.get_color(), HELD_OUT if held_out else DATA)


def test_predictions_on_a_line_have_bands(ax):
    assert plotting.plot_prediction(ax, X, TOLD, BEFORE, "before") is ax
    outer, inner = ax.collections
    assert_allclose(band(outer), (X, TOLD.lower90, TOLD.upper90))
    assert_allclose(band(inner), (X, TOLD.lower50, TOLD.upper50))
    assert_allclose(ax.lines[0].get_xydata(), np.column_stack([X, MEAN]))
    assert ax.lines[0].get_label() == "before, 50 and 90 % bands"


def test_predictions_of_scattered_rows_have_a_bar_each(ax):
    assert plotting.plot_prediction(ax, X, TOLD, BEFORE, "before", curve=False) is ax
    ends = [[s[:, 1] for s in bars.get_segments()] for bars in ax.collections]
    assert_allclose(ends[0], np.column_stack([TOLD.lower90, TOLD.upper90]))
    assert_allclose(ends[1], np.column_stack([TOLD.lower50, TOLD.upper50]))
    assert_allclose([s[0, 0] for s in ax.collections[0].get_segments()], X)
    assert ax.lines[0].get_label() == "before, 50 and 90 % intervals"


def test_the_discrepancy_has_a_band_around_zero(ax):
    assert plotting.plot_discrepancy(ax, X, MEAN, MEAN - 3, MEAN + 1) is ax
    assert_allclose(band(ax.collections[0]), (X, MEAN - 3, MEAN + 1))
    zero, mean = ax.lines
    assert_allclose(zero.get_ydata(), 0)
    assert_allclose(mean.get_xydata(), np.column_stack([X, MEAN]))


def test_causes_are_bars_in_percent_the_chosen_one_in_colour(ax):
    probabilities = [0.9996, 0.0374, 0.0004]
    assert plotting.plot_causes(ax, ["step", "trend", "none"], probabilities, chosen=1) is ax
    assert_allclose([bar.get_width() for bar in ax.patches], 100 * np.array(probabilities))
    middles = [bar.get_y() + bar.get_height() / 2 for bar in ax.patches]
    assert_allclose(middles, [2, 1, 0])  # the first on top
    assert_allclose(ax.get_yticks(), middles)
    assert names_on(ax.yaxis) == ["step", "trend", "none"]
    assert [text.get_text() for text in ax.texts] == ["> 99.9 %", "3.7 %", "< 0.1 %"]
    for bar, colour in zip(ax.patches, (QUIET, AFTER, QUIET), strict=True):
        assert same_color(bar.get_facecolor(), colour)
    assert ax.get_xlabel() == "probability in %"


def test_no_cause_is_in_colour_where_none_is_meant(ax):
    plotting.plot_causes(ax, ["step", "trend"], [0.5, 0.5], chosen=None)
    assert all(same_color(bar.get_facecolor(), QUIET) for bar in ax.patches)


def test_residuals_state_their_root_mean_square(ax):
    residual = np.array([3.0, -4.0])
    assert plotting.plot_residuals(ax, X[:2], residual, AFTER, "after") is ax
    zero, dots = ax.lines
    assert_allclose(zero.get_ydata(), 0)
    assert_allclose(dots.get_xydata(), np.column_stack([X[:2], residual]))
    assert ax.get_title() == "after: root mean square 3.54"  # sqrt((9 + 16) / 2)


def test_quantiles_of_perfect_residuals_lie_on_the_diagonal(ax):
    expected = norm.ppf([0.1, 0.3, 0.5, 0.7, 0.9])
    assert plotting.plot_quantiles(ax, expected[[3, 0, 4, 1, 2]], BEFORE, "o", "before") is ax
    diagonal, dots = ax.lines
    assert_allclose(dots.get_xydata(), np.column_stack([expected, expected]))
    assert_allclose(diagonal.get_xydata(), np.outer([-1, 1], [expected[-1]] * 2))
    assert dots.get_label() == "before"
    assert ax.get_ylabel() == "standardised residual"


def test_scores_before_and_after_are_joined_in_each_fold(ax):
    before, after = np.array([-3.0, -2.0, -1.0]), np.array([-1.0, -1.5, -0.5])
    error = np.array([0.2, np.nan, 0.4])
    assert plotting.plot_scores(ax, ["a", "b", "c"], before, after, error) is ax
    joins = np.array(ax.collections[0].get_segments())
    assert_allclose(joins[:, :, 0], np.column_stack([before, after]))
    assert_allclose(joins[:, :, 1], [[2, 2], [1, 1], [0, 0]])
    assert_allclose(ax.lines[0].get_xydata(), np.column_stack([before, [2, 1, 0]]))
    (container,) = ax.containers
    assert_allclose(bars_of(container), (after, [0.2, 0, 0.4]))
    assert names_on(ax.yaxis) == ["a", "b", "c"]
    assert ax.get_legend_handles_labels()[1] == ["before", "after, ± error of the difference"]


def test_scores_where_nothing_was_added_are_those_before(ax):
    nothing = np.full(2, np.nan)
    plotting.plot_scores(ax, ["a", "b"], np.array([-3.0, -2.0]), nothing, nothing)
    assert ax.get_legend_handles_labels()[1] == ["before"]


def test_coverage_has_its_standard_error_and_what_it_should_be(ax):
    shares = np.array([0.5, 0.8])
    names = ["in range, before", "in range, after"]
    assert plotting.plot_coverage(ax, names, shares, [9, 36], level=0.9) is ax
    assert_allclose(ax.lines[0].get_xdata(), 90)
    found = [bars_of(container) for container in ax.containers]
    # in percent: 100 sqrt(0.9 x 0.1 / n) is 10 for nine rows, 5 for 36
    assert_allclose(np.ravel(found), [50, 10, 80, 5])
    marks = [container.lines[0] for container in ax.containers]
    assert [mark.get_marker() for mark in marks] == ["o", "s"]
    assert_allclose([mark.get_ydata()[0] for mark in marks], [1, 0])
    assert ax.get_xlabel() == "rows in the 90 % interval, %"
    assert ax.get_legend_handles_labels()[1] == ["should be 90 %"]


@pytest.mark.parametrize(("n", "mark"), [(6, "o"), (7, "")])
def test_rivals_are_lines_or_dots_where_a_column_has_few_values(ax, n, mark):
    x = np.arange(n, dtype=float)
    assert plotting.plot_alternatives(ax, x, [x, -x], ["trend", "ramp"], place=4.0) is ax
    trend, ramp, place = ax.lines
    assert_allclose(trend.get_xydata(), np.column_stack([x, x]))
    assert_allclose(ramp.get_xydata(), np.column_stack([x, -x]))
    assert_allclose(place.get_xdata(), 4)
    labels = [line.get_label() for line in ax.lines]
    assert labels == ["trend", "ramp", "measure here"]
    assert trend.get_marker() == ramp.get_marker() == mark
    assert trend.get_linestyle() != ramp.get_linestyle()


def test_information_starts_at_zero_and_little_of_it_looks_little(ax):
    information = np.array([0.001, 0.002, 0.0])
    assert plotting.plot_information(ax, X, information, place=1.0) is ax
    curve, place = ax.lines
    assert_allclose(curve.get_xydata(), np.column_stack([X, information]))
    assert_allclose(place.get_xdata(), 1)
    assert_allclose(ax.get_ylim(), (0, 0.05))
    assert ax.get_ylabel() == "information\nin bits"


def test_much_information_is_in_view(ax):
    plotting.plot_information(ax, X, np.array([0.5, 1.0, 0.0]), place=1.0)
    low, high = ax.get_ylim()
    assert low == 0
    assert high >= 1.0


def test_what_came_in_since_and_the_odds_of_a_change(ax):
    table = pd.DataFrame({"deviation": [0.3, -1.0, 4.0], "e_value": [0.9, 0.8, 30.0]})
    assert plotting.plot_monitor(table, 0.05, 2, ax) is ax
    measured = next(line for line in ax.lines if line.get_label() == "measured")
    assert_allclose(measured.get_xydata(), [[0, 0.3], [1, -1.0], [2, 4.0]])
    changed = next(line for line in ax.lines if line.get_label() == "most probably changed")
    assert_allclose(changed.get_xdata(), 1.5)
    (beside,) = [other for other in ax.figure.axes if other is not ax]
    odds, alarm = beside.lines
    assert_allclose(odds.get_ydata(), [0.9, 0.8, 30.0])
    assert_allclose(alarm.get_ydata(), 20.0)
    assert beside.get_yscale() == "log"
    # without a change nothing is marked
    bare = plotting.plot_monitor(table.iloc[:2], 0.05)
    assert not [line for line in bare.lines if line.get_label() == "most probably changed"]


def test_bounds_are_arrows_and_errors_bars():
    x = np.arange(4.0)
    band = plotting.Prediction(x, x - 1, x + 1, x - 2, x + 2)
    top, _ = plotting.plot_overview(
        x, x, plotting.Predicted(x, band, 0 * x), y_err=0.5 + x, side=np.array([-1, 0, 0, 1])
    )
    marks = {line.get_label(): line for line in top.lines}
    assert marks["at most"].get_xdata().tolist() == [0.0]
    assert marks["at least"].get_xdata().tolist() == [3.0]
    assert marks["measured"].get_xdata().tolist() == [1.0, 2.0]
    held = x + 0.5, x
    top, _ = plotting.plot_overview(
        x, x, plotting.Predicted(x, band, 0 * x), held_out=held, held_side=np.array([0, -1, 0, 1])
    )
    marks = {line.get_label(): (line.get_marker(), line.get_xdata().tolist()) for line in top.lines}
    assert marks["held out"] == ("o", [0.5, 2.5])
    assert marks["at most"] == ("v", [1.5])
    assert marks["at least"] == ("^", [3.5])
    top, _ = plotting.plot_overview(
        x, x, plotting.Predicted(x, band, 0 * x), y_err=0.5 + x, side=np.array([-1, 0, 0, 1])
    )
    (bars,) = [one for one in top.containers if one.has_yerr]
    widths = [float(np.ptp(path.vertices[:, 1])) for path in bars.lines[2][0].get_paths()]
    np.testing.assert_allclose(widths, 1 + 2 * x)
