"""Measured rows.

columns        by name, and rows outside the simulated range
experiments    groups of rows, and parameters that differ between them
stacking       several outputs as one
measured_rows  rows and their weights, those that are equal counted once
"""
