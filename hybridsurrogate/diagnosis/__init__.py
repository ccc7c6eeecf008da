"""What the simulation gets wrong: search, verdict, extension, gain, report.

diagnosis   DiscrepancyDiagnosis: checks its arguments, keeps the result, answers
refinement  a diagnosis with further runs where they inform most
checks      data, simulation and emulator: is there something to doubt?
search      screen every cause, score the most probable, accept, repeat; the same of simulated data
planning    how often planned measurements would show each cause
answers     verdict tables, discrepancy, findings, extended simulation, next measurement
validation  the whole search repeated on folds: what the extension gains
fitting     what a fit does with all of these, and its result
source      the extended model as Python source
report      text and HTML
stored      a fitted diagnosis as plain arrays
"""

from hybridsurrogate.diagnosis.answers.finding import CauseFinding
from hybridsurrogate.diagnosis.diagnosis import DiscrepancyDiagnosis
from hybridsurrogate.diagnosis.refinement import refine

__all__ = ["CauseFinding", "DiscrepancyDiagnosis", "refine"]
