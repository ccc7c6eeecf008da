"""The figures of a study of beta: what is drawn, where, in which colours, under which names."""

import io

import numpy as np
import pandas as pd
import pytest
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, same_color, to_rgb, to_rgba
from matplotlib.figure import Figure
from scipy.stats import norm, truncnorm

from hybridsurrogate import plotting
from hybridsurrogate.plotting import Scene

X = np.linspace(0, 10, 41)
SCENE = Scene(
    measured=(X[:21:2], 1.0 + X[:21:2]),
    truth=(X, 1.0 + X),
    train=(0, 5),
    tests={"near": (0, 5), "far": (5, 10)},
    xlabel="days",
    ylabel="infected",
)
SCHEMES = ("power scaling", "predictive weighting")
BLUE, ORANGE, BLACK = "#0072B2", "#D55E00", "#222222"


def rendered(figure):
    """The picture as an array of shape (height, width, 3)."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].astype(int)


def bare_axes(n=1):
    """Axes over whole figures of 200 x 200 pixels, without ticks: only what is drawn in them."""
    return [Figure(figsize=(2, 2), dpi=100).add_axes((0, 0, 1, 1)) for _ in range(n)]


def same_view(*axes):
    for ax in axes:
        ax.set(xlim=(0, 10), ylim=(-2, 14))
        ax.axis("off")
        if ax.get_legend():
            ax.get_legend().remove()


def share_of(picture, colour):
    """Share of the pixels that have a colour, up to rounding."""
    wanted = 255 * np.array(to_rgb(colour))
    return np.mean(np.abs(picture - wanted).max(axis=-1) <= 2)


def legend_words(figure):
    """Words of all legends of a figure and its Axes."""
    legends = [*figure.legends, *(ax.get_legend() for ax in figure.axes)]
    return [text.get_text() for legend in legends if legend for text in legend.get_texts()]


def lightness(colours):
    """Lightness L* of CIELAB, by the published formula."""
    rgb = np.asarray(colours)[:, :3]
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    return np.where(luminance > 216 / 24389, 116 * np.cbrt(luminance) - 16, luminance * 24389 / 27)


def test_colours_of_omega_are_perceptually_uniform_and_visible_on_white():
    colours = plotting.OMEGA_COLOURS(np.linspace(0, 1, 101))
    steps = np.diff(lightness(colours))
    assert (steps > 0).all()
    assert steps.max() < 2 * steps.mean()
    assert lightness(colours).max() < 90


def test_scene_draws_measurements_truth_and_the_range_of_training():
    ax = plotting.plot_scene(SCENE)
    truth, measured = ax.lines
    np.testing.assert_array_equal(truth.get_xydata().T, SCENE.truth)
    np.testing.assert_array_equal(measured.get_xydata().T, SCENE.measured)
    assert (truth.get_linestyle(), measured.get_linestyle()) == ("--", "None")
    (shade,) = ax.patches
    # a Polygon in old versions of matplotlib, a Rectangle in new ones
    across = shade.get_patch_transform().transform(shade.get_path().vertices)[:, 0]
    assert (across.min(), across.max()) == SCENE.train
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("days", "infected")
    assert not plotting.plot_scene(Scene()).lines


def test_setup_colours_runs_by_omega_and_keeps_the_bars_above_the_data():
    rng = np.random.default_rng(0)
    x, omega = rng.uniform(0, 10, 30), rng.uniform(0.6, 1.4, 30)
    ax = plotting.plot_setup(SCENE, x, omega * x, omega, omega_label="contact rate")
    (runs,) = ax.collections
    np.testing.assert_allclose(runs.get_offsets(), np.column_stack([x, omega * x]))
    np.testing.assert_array_equal(runs.get_array(), omega)
    assert runs.colorbar.ax.get_ylabel() == "contact rate"
    assert legend_words(ax.figure) == ["true process", "measured", "simulation runs"]
    assert [text.get_text() for text in ax.texts] == ["training", "test: near", "test: far"]
    bars = [line for line in ax.lines if line.get_marker() == "|"]
    assert [tuple(bar.get_xdata()) for bar in bars] == [(0, 5), (0, 5), (5, 10)]
    ax.figure.canvas.draw()
    lowest = min(text.get_window_extent().y0 for text in ax.texts)
    highest = ax.transData.transform((0, max((omega * x).max(), 11)))[1]
    assert lowest > highest


def test_mean_draws_have_the_colours_of_their_omega():
    omega = np.array([0.8, 1.2, 1.0, np.nan])
    draws = omega[:, None] * X
    draws[3] = 4.0
    order = np.random.default_rng(1).permutation(len(X))
    ax = plotting.plot_mean_draws(X[order], draws[:, order], omega, norm=Normalize(0.8, 1.2))
    coloured, plain = ax.collections
    ax.figure.canvas.draw()
    viridis = colormaps["viridis"]
    for segment, colour in zip(coloured.get_segments(), coloured.get_colors(), strict=True):
        slope = segment[-1, 1] / segment[-1, 0]
        np.testing.assert_allclose(segment[:, 0], X)
        np.testing.assert_allclose(segment[:, 1], slope * X, atol=1e-12)
        # the colour bar ends at 93 % of viridis, in 256 steps
        expected = viridis(0.93 * (slope - 0.8) / 0.4)
        np.testing.assert_allclose(colour[:3], expected[:3], atol=0.012)
    (flat,) = plain.get_segments()
    np.testing.assert_array_equal(flat[:, 1], 4.0)
    assert same_color(plain.get_colors()[0][:3], to_rgb("#777777"))
    assert ax.get_ylim()[0] <= 0
    assert ax.get_ylim()[1] >= 12


def test_picture_of_mean_draws_agrees_with_lines_drawn_one_by_one():
    omega = np.array([0.4, 0.9, 1.3])
    norm_ = Normalize(0.4, 1.3)
    ours, plain = bare_axes(2)
    plotting.plot_mean_draws(X, omega[:, None] * X, omega, ours, norm=norm_)
    for value in omega:
        colour = plotting.OMEGA_COLOURS(norm_(value))
        plain.plot(X, value * X, color=colour, lw=0.7, alpha=0.5)
    same_view(ours, plain)
    one, two = rendered(ours.figure), rendered(plain.figure)
    assert (one < 250).any()
    # lines cross at the origin alone, where their order counts
    assert np.mean(np.abs(one - two).max(axis=-1) > 8) < 0.001


def test_no_more_than_a_hundred_draws_from_all_parts_of_a_mixture():
    omega = np.r_[np.full(700, 1.0), np.full(300, np.nan)]
    ax = plotting.plot_mean_draws(X, np.zeros((1000, 41)), omega)
    counts = [len(lines.get_segments()) for lines in ax.collections]
    assert sum(counts) == 100
    # 70 of 100 drawn without replacement: sd 4.3
    assert counts[0] == pytest.approx(70, abs=18)
    assert ax.collections[1].get_label() == "draws without omega"


def test_mean_draws_over_beta_share_colours_limits_and_names():
    rng = np.random.default_rng(0)
    betas = (0, 0.3, 1)
    omega = {name: [rng.normal(1, 0.1, 50) for _ in betas] for name in SCHEMES}
    draws = {name: [1 + w[:, None] * X for w in omega[name]] for name in SCHEMES}
    # a runaway extrapolation does not spoil the view
    draws[SCHEMES[0]][0][:, -1] = 1e6
    axes = plotting.plot_mean_draws_over_beta(X, draws, omega, betas, scene=SCENE)
    assert axes.shape == (2, 3)
    assert [ax.get_title() for ax in axes[0]] == ["beta = 0", "beta = 0.3", "beta = 1"]
    assert [ax.get_ylabel() for ax in axes[:, 0]] == [f"{name}\ninfected" for name in SCHEMES]
    limits = {ax.get_ylim() for ax in axes.ravel()}
    assert len(limits) == 1
    (low, high) = limits.pop()
    # truth from 1 to 11, half of that as room
    assert -4.7 < low <= 1
    assert 11 <= high < 16.7
    lines = [ax.collections[0] for ax in axes.ravel()]
    assert all(isinstance(drawn, LineCollection) for drawn in lines)
    assert len({(drawn.norm.vmin, drawn.norm.vmax) for drawn in lines}) == 1
    assert lines[0].norm.vmin == pytest.approx(np.quantile(np.ravel(list(omega.values())), 0.005))
    figure = axes[0, 0].figure
    assert figure.axes[-1].get_ylabel() == "omega"
    assert legend_words(figure) == ["true process", "measured"]
    figure.savefig(io.BytesIO(), format="png")


def test_view_does_not_reach_below_what_is_drawn():
    counts = np.exp(np.linspace(0, 5, 41)) * np.linspace(0.5, 1e4, 300)[:, None]
    scene = Scene(truth=(X, np.exp(np.linspace(0, 5, 41))))
    axes = plotting.plot_bands_over_beta(X, {"power scaling": [counts]}, (0,), scene=scene)
    low, high = axes[0, 0].get_ylim()
    # of a width of 1.5 times 1 to 148.4
    assert -10 < low < 1
    assert 222 < high < 233


def test_bands_hold_50_90_and_99_per_cent():
    rng = np.random.default_rng(0)
    draws = 2 * rng.standard_normal((4000, 41)) + X
    ax = plotting.plot_predictive_bands(X, draws, colour=ORANGE)
    tints = {"99 %": (0.18, 2.576), "90 %": (0.38, 1.645), "50 %": (0.62, 0.6745)}
    assert [band.get_label() for band in ax.collections] == list(tints)
    for band in ax.collections:
        tint, z = tints[band.get_label()]
        corners = band.get_paths()[0].vertices
        above = np.array([corners[corners[:, 0] == x, 1].max() for x in X])
        below = np.array([corners[corners[:, 0] == x, 1].min() for x in X])
        # the sd of the most extreme of these quantiles over 4000 draws is 0.12
        np.testing.assert_allclose(above - X, 2 * z, atol=0.6)
        np.testing.assert_allclose(below - X, -2 * z, atol=0.6)
        assert np.mean(above - X) == pytest.approx(2 * z, abs=0.08)
        mixed = 1 - tint * (1 - np.array(to_rgb(ORANGE)))
        np.testing.assert_allclose(band.get_facecolor()[0], [*mixed, 1])
    (middle,) = ax.lines
    np.testing.assert_allclose(middle.get_ydata(), np.median(draws, axis=0))


def test_picture_of_bands_has_each_colour_where_its_band_is():
    # draws at known heights: the central 50 % of 0, ..., 100 is 25 to 75, and so on
    levels = np.linspace(0, 100, 1001)
    (ax,) = bare_axes()
    plotting.plot_predictive_bands(X, np.tile(levels[:, None], (1, 41)), ax)
    ax.set(xlim=(2, 8), ylim=(0, 100))
    ax.axis("off")
    picture = rendered(ax.figure)
    for tint, share in ((0.18, 0.09), (0.38, 0.4), (0.62, 0.5)):
        mixed = 1 - tint * (1 - np.array(to_rgb(BLUE)))
        # the median's line covers 1 % of the height, edges are blended
        assert share_of(picture, mixed) == pytest.approx(share, abs=0.025)


def test_bands_over_beta_use_one_colour_a_scheme_and_the_given_axes():
    draws = np.random.default_rng(0).standard_normal((200, 41)) + X
    given = np.array(plotting.new_axes(2, 2)).reshape(2, 2)
    out = plotting.plot_bands_over_beta(X, dict.fromkeys(SCHEMES, [draws] * 2), (0, 1), given)
    assert (out == given).all()
    for row, colour in zip(out, (BLUE, ORANGE), strict=True):
        assert all(same_color(ax.lines[0].get_color(), colour) for ax in row)
    assert legend_words(out[0, 0].figure) == ["99 %", "90 %", "50 %", "median"]
    with pytest.raises(ValueError, match=r"axes must contain 2 x 3 Axes, got 4\."):
        plotting.plot_bands_over_beta(X, dict.fromkeys(SCHEMES, [draws] * 3), (0, 0.5, 1), given)


def score_table():
    """Scores at three betas, repeated at -1, 0, ..., 3 times 0.1 about a known middle."""
    rows = []
    for scheme, best in zip(SCHEMES, (0.5, 1.0), strict=True):
        for test, worse in (("in range", 1), ("out of range", 10)):
            for beta in (0.0, 0.5, 1.0):
                for step in (-0.1, 0.0, 0.1, 0.2, 0.3):
                    off = (beta - best) ** 2
                    rows.append((scheme, test, beta, -off + step, 1 + worse * off + step))
    return pd.DataFrame(rows, columns=["scheme", "test", "beta", "elpd", "rmse"])


def test_scores_over_beta_show_means_bands_and_the_best_beta():
    axes = plotting.plot_scores_over_beta(score_table())
    assert axes.shape == (2, 2)
    assert [ax.get_title() for ax in axes[0]] == ["in range", "out of range"]
    assert axes[1, 0].get_xlabel() == "beta"
    for ax in axes[0]:
        for k, (scheme, best) in enumerate(zip(SCHEMES, (0.5, 1.0), strict=True)):
            line, ring = ax.lines[2 * k : 2 * k + 2]
            assert line.get_label() == scheme
            np.testing.assert_array_equal(line.get_xdata(), [0, 0.5, 1])
            off = (np.array([0, 0.5, 1]) - best) ** 2
            np.testing.assert_allclose(line.get_ydata(), 0.1 - off)
            np.testing.assert_allclose(ring.get_xydata(), [[best, 0.1]], atol=1e-12)
            # 5 and 95 % of five evenly spaced values: a fifth of a step from their ends
            corners = ax.collections[k].get_paths()[0].vertices
            at_best = corners[corners[:, 0] == best, 1]
            assert at_best.min() == pytest.approx(-0.08)
            assert at_best.max() == pytest.approx(0.28)
    first, second = (axes[0, 0].lines[k] for k in (0, 2))
    assert same_color(first.get_color(), BLUE)
    assert same_color(second.get_color(), ORANGE)
    # told apart without colours, too
    assert first.get_linestyle() != second.get_linestyle()
    assert first.get_marker() != second.get_marker()
    assert [ax.get_yscale() for ax in axes[1]] == ["linear", "log"]
    # the least RMSE is best
    assert axes[1, 0].lines[1].get_xdata() == [0.5]
    axes[0, 0].figure.savefig(io.BytesIO(), format="png")


def test_scores_far_worse_than_the_best_leave_the_view():
    table = score_table()
    table.loc[(table["beta"] == 0) & (table["scheme"] == SCHEMES[1]), "rmse"] = 1e20
    table.loc[(table["beta"] == 0) & (table["scheme"] == SCHEMES[1]), "elpd"] = -1e6
    axes = plotting.plot_scores_over_beta(table)
    for ax in axes[0]:
        assert ax.get_ylim()[0] == pytest.approx(0.3 - 8)
        assert ax.get_ylim()[1] > 0.3
    for ax in axes[1]:
        assert ax.get_ylim()[0] < 0.9
        assert 27 < ax.get_ylim()[1] < 40
    axes[0, 0].figure.savefig(io.BytesIO(), format="png")


def test_scores_of_other_models_are_level_lines_in_their_test_set():
    references = pd.DataFrame(
        [("Kennedy-O'Hagan", "out of range", -0.5, 0.4), ("extended", "out of range", 0.2, 0.3)],
        columns=["model", "test", "elpd", "rmse"],
    )
    axes = plotting.plot_scores_over_beta(score_table(), references=references)
    assert len(axes[0, 0].lines) == 4
    level = {line.get_label(): line for line in axes[1, 1].lines}
    assert list(level["Kennedy-O'Hagan"].get_ydata()) == [0.4, 0.4]
    assert list(level["extended"].get_ydata()) == [0.3, 0.3]
    assert level["extended"].get_linestyle() != level["Kennedy-O'Hagan"].get_linestyle()
    assert legend_words(axes[0, 0].figure) == [*SCHEMES, "Kennedy-O'Hagan", "extended"]


def test_densities_over_beta_are_on_one_scale():
    rng = np.random.default_rng(0)
    draws = [rng.normal(1, sd, 20_000) for sd in (0.1, 0.2)]
    ax = plotting.plot_densities_over_beta((0, 1), draws, prior=norm(1, 0.2), truth=1.1)
    outlines = [line for line in ax.lines if line.get_linestyle() == "-"]
    heights = {}
    for line in outlines:
        place = 0 if line.get_ydata().min() < 0.5 else 1
        heights[place] = line.get_ydata().max() - place
    # a normal density's height goes with 1 / sd; smoothing lowers it by some per cent
    assert heights[0] / heights[1] == pytest.approx(2, rel=0.06)
    priors = [line for line in ax.lines if line.get_linestyle() == "--"]
    assert len(priors) == 2
    # the second draws are the prior's own
    top = max(priors[k].get_ydata().max() for k in range(2)) - 1
    assert top == pytest.approx(heights[1], rel=0.08)
    assert [text.get_text() for text in ax.get_yticklabels()] == ["0", "1"]
    (truth,) = [line for line in ax.lines if line.get_linestyle() == ":"]
    assert list(truth.get_xdata()) == [1.1, 1.1]
    spans = sorted(bar.get_segments()[0][:, 0].tolist() for bar in ax.collections[1::2])
    np.testing.assert_allclose(spans, [[0.671, 1.329], [0.8355, 1.1645]], atol=0.01)
    assert legend_words(ax.figure) == ["prior", "90 %", "median", "truth, 1.1"]


def test_density_keeps_its_mass_at_the_end_of_its_support():
    # exponential from zero: an unreflected kernel density halves at the end
    draws = np.random.default_rng(0).exponential(size=20_000)
    half = truncnorm(0, np.inf, scale=5)
    ax = plotting.plot_densities_over_beta((0,), [draws], prior=half, label="sigma")
    (outline,) = [line for line in ax.lines if line.get_linestyle() == "-"]
    x, y = outline.get_xydata().T
    assert x[0] == 0
    assert y[0] / np.interp(1.0, x, y) == pytest.approx(np.e, rel=0.15)
    assert ax.get_xlabel() == "sigma"


def test_beta_scan_rings_the_best_beta():
    scan = pd.DataFrame({"beta": [0, 0.5, 1], "before": [-1, -2, -3], "after": [-1, -0.5, -2]})
    ax = plotting.plot_beta_scan(scan)
    assert legend_words(ax.figure) == ["before, best beta 0", "after, best beta 0.5"]


def test_pictures_are_not_empty_and_black_is_kept_for_data():
    ax = plotting.plot_scene(SCENE, bare_axes()[0])
    same_view(ax)
    picture = rendered(ax.figure)
    assert share_of(picture, to_rgba(BLACK)) > 0.002
    # 0 to 5 of 0 to 10 is shaded
    assert share_of(picture[:40], "#ECECEC") == pytest.approx(0.5, abs=0.02)
