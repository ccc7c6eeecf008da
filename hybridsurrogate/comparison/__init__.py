"""Several simulations of the same measurements: which of them, and what each lacks.

compare     compare_simulations: checks, evidence, held-out densities, a diagnosis of each
evidence    how probable the measurements are under a simulation in which nothing is wrong
held_out    log densities of held-out rows, and stacking weights
agreement   how far the predictions of the simulations differ, as they are and extended
result      SimulationComparison: tables, conclusion, picture
report      the same as text and HTML
"""

from hybridsurrogate.comparison.compare import compare_simulations
from hybridsurrogate.comparison.result import SimulationComparison

__all__ = ["SimulationComparison", "compare_simulations"]
