"""What the simulation gets wrong: search, verdict, extension, gain, report.

diagnosis   DiscrepancyDiagnosis: checks, wires and stores
verdict     what it concludes: one rule for all who ask
fitted      what a fitted diagnosis answers
refinement  a diagnosis with further runs where they inform most
checks      data, simulation and emulator: is there something to doubt?
emulation   the simulation conditioned on its runs alone
search      screen every cause, score the most probable, accept, repeat
answers     verdict tables, discrepancy, findings, extended simulation, next measurement
source      the extended model as Python source
validation  the whole search repeated on folds: what the extension gains
report      text and HTML
"""

from hybridsurrogate.diagnosis.answers.finding import CauseFinding
from hybridsurrogate.diagnosis.diagnosis import DiscrepancyDiagnosis
from hybridsurrogate.diagnosis.refinement import refine

__all__ = ["CauseFinding", "DiscrepancyDiagnosis", "refine"]
