"""Arrays and files, whatever they stand for.

blocks       large batches cut into blocks
cholesky     factorisations that do not fail
psis         Pareto-smoothed importance weights
digits       numbers as text
threads      threads of linear algebra
atomic_file  files that are written whole or not at all
"""
