"""A simulation emulated from its runs, with the emulator's error.

covariance      how alike outputs are, learned from the runs, and a process given them
between_places  the error of interpolation along curves: none at places that were simulated
curve_emulator  a process for the few curves that all runs are made of
"""
