"""Run a simulation, hold its runs, read runs made elsewhere.

arrays             the door: arrays and frames of any library, checked and by name
variables          inputs, parameters and assumed constants with their ranges and priors
design             Sobol and Latin hypercube designs
simulator          Simulator: a function, run on a design or at given rows
command_simulator  CommandSimulator: an external program, started for each run
calls              how the function is called: all rows at once or row by row, timed
evaluation         the outputs of rows, at the same time, kept in a table
simulation_data    SimulationData: runs, their ranges, what they were run with
curve_tables       runs that are curves, from arrays, wide and long tables, datasets
outputs            several outputs: their names, and rows of one output each
modification       a change of an ODE's right-hand side, described
table_file         tables of runs and measurements on disk
run_store          finished runs on disk
"""

from hybridsurrogate.simulation.command_simulator import CommandSimulator
from hybridsurrogate.simulation.simulation_data import SimulationData, read_simulation
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.simulation.variables import Assumed

__all__ = ["Assumed", "CommandSimulator", "SimulationData", "Simulator", "read_simulation"]
