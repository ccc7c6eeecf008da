"""The two estimators."""

from .power_scaled import PowerScaledSurrogate
from .predictive_weighted import PredictiveWeightedSurrogate

__all__ = ["PowerScaledSurrogate", "PredictiveWeightedSurrogate"]
