"""Step 2: unknowns given each draw of the surrogate's coefficients.

sampler               chooses among the ways below
grid                  one or two parameters
pairwise_squares      residuals of all pairs of proposals and coefficients
local_proposals       proposals of each coefficient draw's own
mcmc                  moves, for likelihoods that are not normal
principal_components  directions in which coefficients matter
"""
