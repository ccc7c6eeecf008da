"""Several simulations of the same measurements: which of them, and what each lacks.

compare  compare_simulations: evidence, held-out densities, stacking weights, agreement
result   SimulationComparison: tables, conclusion, picture, report
"""

from hybridsurrogate.comparison.compare import compare_simulations
from hybridsurrogate.comparison.result import SimulationComparison

__all__ = ["SimulationComparison", "compare_simulations"]
