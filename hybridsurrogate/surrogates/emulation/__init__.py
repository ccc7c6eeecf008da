"""A simulation emulated from its runs, with the emulator's error.

covariance      how alike outputs are, learned from the runs
process         a Gaussian process with that covariance, given the runs
local_variance  errors as large along each axis as the leave-one-out errors of the runs there
curves          which rows are one run, and the few curves that all runs are made of
between_places  the error of interpolation along them: none at places that were simulated
curve_emulator  a process for the coefficients of these curves
"""
