"""Gaussian coefficients integrated out.

sufficient_statistics  of the runs
emulator_posterior     the coefficients given the runs alone
collapsed              the density of step 1, coefficients integrated out
gram, factored_rows    its Gram matrices; rows that are products of parts
woodbury               the same by the covariance of few rows
spectral               the same by one eigendecomposition, where only sigma varies
noise_marginal         sigma integrated out
"""
