"""Measured rows.

columns        by name, rows outside the simulated range, groups of rows
stacking       several outputs as one
measured_data  the record that a fit keeps: checked, with its error bars, equal rows counted once
"""
