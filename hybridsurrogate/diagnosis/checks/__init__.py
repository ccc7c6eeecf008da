"""What is doubtful before or after a search.

caution     a reason to doubt a verdict, and the thresholds of all checks
parameters  of the diagnosis itself; causes that a parameter can imitate
columns     outputs among the inputs, wrong units, exchanged columns
data        rows that are far off, copies, exact data, lost digits, counts that scatter
simulation  what takes long, jumps, or is left open by the runs
residuals   whether the residuals of the measured rows look like noise
"""
