"""The two estimators."""

from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.estimators.predictive_weighted import PredictiveWeightedSurrogate

__all__ = ["PowerScaledSurrogate", "PredictiveWeightedSurrogate"]
