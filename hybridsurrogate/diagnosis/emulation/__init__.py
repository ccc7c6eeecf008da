"""A simulation known from runs.

conditioned     a Gaussian process through the runs on a polynomial's terms
"""
