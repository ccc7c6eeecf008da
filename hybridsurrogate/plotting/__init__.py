"""Drawing: functions that take numbers and the Axes to draw on, and return the Axes.

Nothing is shown and no window is needed. ``diagnosis`` has the pictures of a diagnosis, ``curves``
and ``scores`` those of a study of the weight beta and of several simulations, ``planning`` those of
measurements that are planned or come in.
"""

from hybridsurrogate.plotting.curves import (
    Scene,
    plot_bands_over_beta,
    plot_mean_draws,
    plot_mean_draws_over_beta,
    plot_measured,
    plot_predictive_bands,
    plot_scene,
    plot_setup,
)
from hybridsurrogate.plotting.diagnosis import (
    Predicted,
    Prediction,
    plot_alternatives,
    plot_causes,
    plot_coverage,
    plot_discrepancy,
    plot_emulator,
    plot_information,
    plot_overview,
    plot_parameter_course,
    plot_prediction,
    plot_quantiles,
    plot_residuals,
    plot_scores,
)
from hybridsurrogate.plotting.planning import plot_monitor, plot_power, plot_sobol
from hybridsurrogate.plotting.scores import (
    plot_beta_scan,
    plot_comparison,
    plot_densities_over_beta,
    plot_scores_over_beta,
)
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
