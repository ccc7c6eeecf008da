"""Scores of predictions: of arrays, and of estimators for scikit-learn's searches."""

from hybridsurrogate.scoring.scores import (
    SCORERS,
    PairedDifference,
    coverage,
    crps,
    elpd,
    elpd_scorer,
    interval_score,
    interval_score_scorer,
    interval_width,
    neg_crps_scorer,
    neg_rmse_scorer,
    paired_difference,
    pit,
    rmse,
)

__all__ = [
    "SCORERS",
    "PairedDifference",
    "coverage",
    "crps",
    "elpd",
    "elpd_scorer",
    "interval_score",
    "interval_score_scorer",
    "interval_width",
    "neg_crps_scorer",
    "neg_rmse_scorer",
    "paired_difference",
    "pit",
    "rmse",
]
