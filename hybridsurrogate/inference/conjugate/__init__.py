"""Gaussian coefficients integrated out.

collapsed       the density of step 1: by the coefficients, by few rows, or for sigma alone
target          what samplers need of a density, and what all posteriors of step 1 hold
factored_rows   its Gram matrices; rows that are products of parts
noise_marginal  sigma integrated out
"""
