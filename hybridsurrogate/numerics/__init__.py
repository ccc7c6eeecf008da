"""Arrays and files, whatever they stand for.

linear_algebra  blocks of large batches, factorisations that do not fail, threads
hilbert         smooth processes as sums of waves
psis            Pareto-smoothed importance weights
digits          numbers as text
atomic_file     files that are written whole or not at all
"""
