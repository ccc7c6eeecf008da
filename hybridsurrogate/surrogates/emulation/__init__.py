"""A simulation emulated from its runs, with the emulator's error.

covariance      how alike outputs are, learned from the runs, and a process given them
between_places  the error of interpolation along curves: none at places that were simulated
components      the few curves that all runs are made of, and how repeated runs differ
curves          rows of runs as curves on one grid of places
fields          runs over all pairs of the places of two inputs
curve_emulator  a process for the few curves that all runs are made of
"""
