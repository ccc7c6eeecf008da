"""Coefficients by Laplace's approximation, for likelihoods that are not normal.

target            the density of step 1
inner_mode        the mode and curvature of the coefficients
linear_predictor  rows that are linear in them
"""
