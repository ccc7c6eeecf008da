"""Drawing: functions that take numbers and the Axes to draw on, and return the Axes.

Nothing is shown and no window is needed. ``report`` and ``checks`` have the pictures of a
diagnosis, ``monitor`` that of what comes in after it; ``scene``, ``curves``, ``scores`` and
``densities`` those of a study of the weight beta.
"""

from hybridsurrogate.plotting.checks import (
    plot_coverage,
    plot_quantiles,
    plot_residuals,
    plot_scores,
)
from hybridsurrogate.plotting.comparison import plot_comparison
from hybridsurrogate.plotting.curves import (
    plot_bands_over_beta,
    plot_mean_draws,
    plot_mean_draws_over_beta,
    plot_predictive_bands,
)
from hybridsurrogate.plotting.densities import plot_densities_over_beta
from hybridsurrogate.plotting.emulator import plot_emulator
from hybridsurrogate.plotting.monitor import plot_monitor
from hybridsurrogate.plotting.overview import Predicted, plot_overview
from hybridsurrogate.plotting.planning import plot_power
from hybridsurrogate.plotting.report import (
    Prediction,
    plot_alternatives,
    plot_causes,
    plot_discrepancy,
    plot_information,
    plot_parameter_course,
    plot_prediction,
)
from hybridsurrogate.plotting.scene import Scene, plot_measured, plot_scene, plot_setup
from hybridsurrogate.plotting.scores import plot_beta_scan, plot_scores_over_beta
from hybridsurrogate.plotting.sensitivity import plot_sobol
from hybridsurrogate.plotting.style import (
    AFTER,
    ALTERNATIVES,
    BEFORE,
    DATA,
    HELD_OUT,
    OMEGA_COLOURS,
    QUIET,
    new_axes,
    share_range,
    tidy,
)

__all__ = [
    "AFTER",
    "ALTERNATIVES",
    "BEFORE",
    "DATA",
    "HELD_OUT",
    "OMEGA_COLOURS",
    "QUIET",
    "Predicted",
    "Prediction",
    "Scene",
    "new_axes",
    "plot_alternatives",
    "plot_bands_over_beta",
    "plot_beta_scan",
    "plot_causes",
    "plot_comparison",
    "plot_coverage",
    "plot_densities_over_beta",
    "plot_discrepancy",
    "plot_emulator",
    "plot_information",
    "plot_mean_draws",
    "plot_mean_draws_over_beta",
    "plot_measured",
    "plot_monitor",
    "plot_overview",
    "plot_parameter_course",
    "plot_power",
    "plot_prediction",
    "plot_predictive_bands",
    "plot_quantiles",
    "plot_residuals",
    "plot_scene",
    "plot_scores",
    "plot_scores_over_beta",
    "plot_setup",
    "plot_sobol",
    "share_range",
    "tidy",
]
