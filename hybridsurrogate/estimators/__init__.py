"""The estimators, and which parameters the output depends on (`sensitivity`)."""

from hybridsurrogate.estimators.averaged import AveragedSurrogate
from hybridsurrogate.estimators.beta_path import BetaChoice, BetaPath, beta_path, choose_beta
from hybridsurrogate.estimators.multi_source import MultiSourceSurrogate, Source
from hybridsurrogate.estimators.power_scaled import KennedyOHaganSurrogate, PowerScaledSurrogate
from hybridsurrogate.estimators.predictive_weighted import PredictiveWeightedSurrogate
from hybridsurrogate.prediction.leave_one_out import Loo

__all__ = [
    "AveragedSurrogate",
    "BetaChoice",
    "BetaPath",
    "KennedyOHaganSurrogate",
    "Loo",
    "MultiSourceSurrogate",
    "PowerScaledSurrogate",
    "PredictiveWeightedSurrogate",
    "Source",
    "beta_path",
    "choose_beta",
]
