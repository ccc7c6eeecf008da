"""Measured rows.

columns        by name, and rows outside the simulated range
experiments    groups of rows, and parameters that differ between them
stacking       several outputs as one
measured_rows  checks of gaps, outcomes and weights
measured_data  the record that a fit keeps, equal rows counted once
"""
