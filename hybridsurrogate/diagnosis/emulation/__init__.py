"""A simulation known from runs.

conditioned     a Gaussian process through the runs on a polynomial's terms
local_variance  errors as large along each axis as runs there were hard to foresee
"""
